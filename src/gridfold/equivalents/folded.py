"""The external area folded behind ports: linear, reduced, and as cheap as its ports.

The study area and the machines that are retained stay exact. All others are linear, balanced for what
they cause at the ports, and truncated. What a projection needs is found once, for the intact network;
about any other operating point with the same machines the area is linearized anew and projected on the
same bases.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from gridfold.dynamics.descriptor import grid_descriptor
from gridfold.dynamics.equilibrium import Equilibrium
from gridfold.dynamics.model import DetailedModel
from gridfold.dynamics.port_model import PortModel, build_port_model
from gridfold.dynamics.port_rhs import LinearPorts
from gridfold.dynamics.unit_limits import limits_touched, without_touched
from gridfold.equivalents.families import Mode, SmallModel
from gridfold.errors import OptionError
from gridfold.grid.case import UnitKey
from gridfold.numerics.modal_form import ModalForm, modal_form
from gridfold.partition import Coupling, Partition, couple
from gridfold.partition.port_area import PortArea, interface_weights, linearize_ports
from gridfold.partition.ports import Ports, find_ports
from gridfold.reduction import BalancedTruncation, Reducer
from gridfold.systems.dense import DenseSystem
from gridfold.systems.modal import ModalSystem
from gridfold.systems.protocol import System
from gridfold.systems.statemap import StateMap

#: Bound (6) to which the external area is reduced if nothing else is asked for: change of the voltages
#: at ports and kept machines in p.u. for a port voltage that changes by 1 rad or by the factor e.
PORT_TOLERANCE = 2e-3


@dataclass(frozen=True)
class Bases:
    """What a linear area is projected on: x = x0 + T~ z and z = T (x - x0).

    Parameters
    ----------
    lift, restrict : ndarrays, shapes (n, r) and (r, n)
        T~ and T.
    weights : ndarray, shape (2 n_ports, 2 n_ports)
        How changes of the port currents count, :func:`interface_weights`.
    hankel_values : ndarray or None
        Hankel singular values from changes of the port voltages to what is caused, in p.u.
    bound : float or None
        The bound (6) in the same unit, for the truncation without the common turn of all angles.
    """

    lift: NDArray[np.float64] = field(repr=False)
    restrict: NDArray[np.float64] = field(repr=False)
    weights: NDArray[np.float64] = field(repr=False)
    hankel_values: NDArray[np.float64] | None = field(repr=False)
    bound: float | None

    @property
    def order(self) -> int:
        """Number r of coordinates."""
        return int(self.lift.shape[1])


@dataclass(frozen=True)
class FoldedArea:
    """Study area and retained machines exact, all others linear behind ports, about a point.

    Build it with :func:`fold`.

    Parameters
    ----------
    parts : Partition
        Study and external area.
    coupling : Coupling
        Column norms of the external machines.
    retained : tuple of UnitKey
        External machines that stay exact.
    ports : Ports
        Where the linear area meets the rest.
    reducer : Reducer
        How the bases were found.
    bases : Bases
        What it is projected on.
    area : PortArea
        The area linearized at the operating point.
    origin : ndarray, shape (n_states,)
        State of the whole system there.
    linear_ports : LinearPorts
        The projected area as its ports know it.
    states : StateMap
        The way between the area's states and the coordinates of `linear_ports`.
    rate : float
        Common rate of all rotor angles there, in rad/s.
    at_limits : tuple of str
        Limits of linear units that act there.
    """

    parts: Partition
    coupling: Coupling
    retained: tuple[UnitKey, ...]
    ports: Ports
    reducer: Reducer
    bases: Bases
    area: PortArea = field(repr=False)
    origin: NDArray[np.float64] = field(repr=False)
    linear_ports: LinearPorts = field(repr=False)
    states: StateMap = field(repr=False)
    rate: float = 0.0
    at_limits: tuple[str, ...] = ()

    @property
    def modes(self) -> tuple[Mode, ...]:
        """One model; it is called retained where machines beside the study area are."""
        return (Mode.RETAINED if self.retained else Mode.LINEAR,)

    @property
    def reference_unit(self) -> UnitKey:
        """The electrically furthest machine."""
        return self.coupling.reference

    @property
    def study_units(self) -> tuple[UnitKey, ...]:
        """Machines of the study area."""
        return self.parts.study_units

    def held_at_limits(self, mode: Mode) -> tuple[str, ...]:
        """Limits of linear units that act at the operating point."""
        return self.at_limits

    def build(self, mode: Mode, model: DetailedModel) -> SmallModel:
        """The model on the network of `model`; with everything linear if `mode` says so."""
        if mode is Mode.WHOLE:
            return self.whole(model)
        built = self._ported(model)
        return SmallModel(built, built, 0, self.ports.units)

    def whole(self, model: DetailedModel) -> SmallModel:
        """The same with the study area and the retained machines linear as well, in closed form."""
        ported = self._ported(model)
        n_exact, r = len(ported.exact_index), self.states.order
        lift = np.zeros((model.n_states, n_exact + r))
        lift[ported.exact_index, np.arange(n_exact)] = 1.0
        lift[ported.area_index, n_exact:] = self.states.lift_matrix
        smooth = without_touched(model, self.origin, model.layout.source_units)
        moved = grid_descriptor(smooth, self.origin).apply(lift)
        drift = model.compiled(self.origin)
        a = np.vstack([moved[ported.exact_index], self._restricted(moved[ported.area_index])])
        offset = np.r_[drift[ported.exact_index], self._restricted(drift[ported.area_index])]
        form, point = modal_form(a), ported.restrict(self.origin)
        system: System
        if form is None:
            system, states = DenseSystem(a, offset), StateMap.identity(point)
        else:
            system = ModalSystem(form, form.inverse @ offset)
            states = StateMap(point, form.basis, form.inverse)
        return SmallModel(system, WholeCoordinates(ported, states), 0, model.layout.source_units)

    def moved(self, model: DetailedModel, point: Equilibrium) -> FoldedArea:
        """Linearized anew about `point`, the equilibrium of `model`, on the bases that are there.

        Where linear machines are out, the bases are found anew: in these the common turn is one of
        the machines that are left.
        """
        weights = self.bases.weights
        area = _linearized(self.ports, model, point.x, weights)
        out = model.state.units_out.intersection(self.ports.units)
        known = replace(self, bases=_bases(self.reducer, area, weights)) if out else self
        return _projected(known, area, model, point)

    def _ported(self, model: DetailedModel) -> PortModel:
        ports, index = self.ports, self.area.state_index
        return build_port_model(
            model, ports.buses, ports.study, ports.units, self.linear_ports, index, self.states,
            self.origin,
        )  # fmt: skip

    def _restricted(self, rows: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(self.states.restrict_matrix @ rows)


@dataclass(frozen=True)
class WholeCoordinates:
    """Coordinates of a model that is linear throughout: v = v0 + V w over those of `ported`."""

    ported: PortModel
    states: StateMap

    def lift(self, w: NDArray[np.float64]) -> NDArray[np.float64]:
        """States of the whole model, (..., n_states), from w, (..., r)."""
        return self.ported.lift(self.states.lift(w))

    def lift_rows(self, w: NDArray[np.float64], index: NDArray[np.int64]) -> NDArray[np.float64]:
        """The states at the positions `index` alone, (..., len(index))."""
        return self.ported.lift_rows(self.states.lift(w), index)

    def restrict(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """The state w nearest to the whole model's state x."""
        return self.states.restrict(self.ported.restrict(x))


def fold(
    parts: Partition, retained: Collection[UnitKey] = (), reducer: Reducer | None = None
) -> FoldedArea:
    """Fold the external area behind its ports, at the equilibrium.

    Parameters
    ----------
    parts : Partition
        From :func:`gridfold.partition.partition`.
    retained : collection of UnitKey
        External machines that stay exact.
    reducer : Reducer
        Balanced truncation to a bound of 2e-3 p.u. by default.

    Raises
    ------
    OptionError
        A machine that is to be retained is not external, or no machine is left to be linear.
    """
    strange = [unit for unit in retained if unit not in set(parts.external_units)]
    if strange:
        raise OptionError(
            f"machine {strange[0]} cannot be retained: it is not in the external area"
        )
    kept = tuple(unit for unit in parts.external_units if unit in set(retained))
    linear = [unit for unit in parts.external_units if unit not in set(kept)]
    ports = find_ports(parts.model, linear, parts.study_buses)
    chosen = BalancedTruncation(PORT_TOLERANCE) if reducer is None else reducer
    point = Equilibrium(parts.model.x0, 0.0)
    weights = interface_weights(parts.model, ports)
    area = _linearized(ports, parts.model, point.x, weights)
    bases = _bases(chosen, area, weights)
    return _about(parts, couple(parts), kept, ports, chosen, bases, area, point)


def on_bases(
    parts: Partition,
    retained: tuple[UnitKey, ...],
    ports: Ports,
    reducer: Reducer,
    bases: Bases,
) -> FoldedArea:
    """A folded area with bases that are known, at the equilibrium."""
    point = Equilibrium(parts.model.x0, 0.0)
    area = _linearized(ports, parts.model, point.x, bases.weights)
    return _about(parts, couple(parts), retained, ports, reducer, bases, area, point)


def _bases(reducer: Reducer, area: PortArea, weights: NDArray[np.float64]) -> Bases:
    """Bases by which `reducer` truncates the area; the common turn of all angles stays exact."""
    if isinstance(reducer, BalancedTruncation):
        found = reducer.reduce(area.system.dense(), area.x0, include=area.turn)
        values = np.zeros(0) if found.hankel_values is None else found.hankel_values
        tail: float | None = 2 * float(values[found.order - area.turn.shape[1] :].sum())
    else:
        found = reducer.reduce(area.system.dense(), area.x0)
        tail = found.bound
    maps = found.state_map
    return Bases(maps.lift_matrix, maps.restrict_matrix, weights, found.hankel_values, tail)


def _linearized(
    ports: Ports, model: DetailedModel, x: NDArray[np.float64], weights: NDArray[np.float64]
) -> PortArea:
    return linearize_ports(ports, without_touched(model, x, ports.units), x, weights)


def _about(
    parts: Partition,
    coupling: Coupling,
    retained: tuple[UnitKey, ...],
    ports: Ports,
    reducer: Reducer,
    bases: Bases,
    area: PortArea,
    point: Equilibrium,
) -> FoldedArea:
    linear_ports, states = _in_modes(bases, area)
    at_limits = limits_touched(parts.model, point.x, ports.units)
    return FoldedArea(
        parts, coupling, retained, ports, reducer, bases, area, point.x, linear_ports, states,
        point.rate, at_limits,
    )  # fmt: skip


def _projected(
    known: FoldedArea, area: PortArea, model: DetailedModel, point: Equilibrium
) -> FoldedArea:
    linear_ports, states = _in_modes(known.bases, area)
    return replace(
        known,
        area=area,
        origin=point.x,
        linear_ports=linear_ports,
        states=states,
        rate=point.rate,
        at_limits=limits_touched(model, point.x, known.ports.units),
    )


def _in_modes(bases: Bases, area: PortArea) -> tuple[LinearPorts, StateMap]:
    """The area projected on its bases, with coordinates that do not see each other."""
    lift, restrict = bases.lift, bases.restrict
    form = modal_form(restrict @ area.system.apply(lift))
    if form is None:
        raise OptionError(
            "the modes of the reduced area cannot be told apart; choose another order"
        )
    order, n_pairs = _pairs_apart(form)
    lift, restrict = lift @ form.basis[:, order], form.inverse[order] @ restrict
    first_of_pairs = len(order) - 2 * n_pairs
    return LinearPorts(
        diagonal=form.diagonal[order],
        coupling=form.coupling[order][first_of_pairs : first_of_pairs + n_pairs],
        b=restrict @ area.system.b,
        offset=restrict @ area.drift,
        c=area.log_slopes @ lift,
        current=area.current,
        voltage=area.voltage,
        turned=area.turned,
    ), StateMap(area.x0, lift, restrict)


def _pairs_apart(form: ModalForm) -> tuple[NDArray[np.int64], int]:
    """Real modes first, then the first coordinate of each pair, then the second; and the pairs."""
    every = np.arange(len(form.partner))
    first = np.flatnonzero(form.partner > every)
    real = np.flatnonzero(form.partner == every)
    return np.concatenate([real, first, form.partner[first]]), len(first)
