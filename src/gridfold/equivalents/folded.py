"""The external area folded behind ports: linear, reduced, and as cheap as its ports.

The study area and the machines that are retained stay exact. All others are linear, balanced for what
they cause at the ports, and truncated. What a projection needs is found once, for the intact network;
about any other operating point with the same machines the area is linearized anew and projected on the
same bases.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gridfold.cards import Card, first_few
from gridfold.dynamics.descriptor import grid_descriptor
from gridfold.dynamics.equilibrium import Equilibrium
from gridfold.dynamics.model import DetailedModel
from gridfold.dynamics.port_model import (
    PortCoordinates,
    PortModel,
    build_port_model,
    port_coordinates,
)
from gridfold.dynamics.port_rhs import LinearPorts
from gridfold.dynamics.prime_movers import limited_by_any_swing, mover_limits, prime_movers
from gridfold.dynamics.unit_limits import limits_touched, touched_held, touched_let_go
from gridfold.equivalents.area_bases import (
    PORT_TOLERANCE,
    Bases,
    coarser_bases,
    find_bases,
    in_modes,
    missed,
)
from gridfold.equivalents.families import Mode, SmallModel
from gridfold.equivalents.model_kind import Weights
from gridfold.equivalents.serving import (
    MOST_MISSED,
    grows,
    growth_on,
    serve,
    serving,
    without_growth,
)
from gridfold.equivalents.swings import Swings, port_swings, sample_swings
from gridfold.errors import OptionError
from gridfold.grid.case import UnitKey
from gridfold.numerics.chained_form import chained_form
from gridfold.partition import Coupling, Partition, couple
from gridfold.partition.port_area import PortArea, interface_weights, linearize_ports
from gridfold.partition.ports import Ports, feeding_units, find_ports
from gridfold.reduction import BalancedTruncation, Reducer
from gridfold.systems.dense import DenseSystem
from gridfold.systems.descriptor import DescriptorSystem
from gridfold.systems.modal import ModalSystem
from gridfold.systems.protocol import System
from gridfold.systems.statemap import StateMap


@dataclass(frozen=True, eq=False, repr=False)
class FoldedArea(Card):
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
    governed : tuple of UnitKey
        Linear units whose prime movers are exact, because any swing takes them to a limit.
    made : str
        How it came about, for the log.
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
    governed: tuple[UnitKey, ...] = ()
    made: str = "reduced at the equilibrium of the intact network"

    def _facts(self) -> dict[str, object]:
        bound = self.bases.bound
        return {
            "case": self.parts.model.case.name,
            "model": self.mode.value,
            "states": f"{len(self.area.state_index)} reduced to {self.bases.order}",
            "bound": "none" if bound is None else f"{bound:.1e} p.u.",
            "retained": first_few(self.retained),
            "ports": first_few(self.ports.buses),
        }

    @property
    def mode(self) -> Mode:
        """What the model is called: retained where machines beside the study area are."""
        return Mode.RETAINED if self.retained else Mode.LINEAR

    @property
    def growth(self) -> float:
        """Largest real part of the modes of the projected area, in 1/s."""
        return float(self.linear_ports.diagonal.max(initial=-np.inf))

    @property
    def modes(self) -> tuple[Mode, ...]:
        """One model."""
        return (self.mode,)

    @property
    def reference_unit(self) -> UnitKey | None:
        """The electrically furthest machine."""
        return self.coupling.reference

    @property
    def study_units(self) -> tuple[UnitKey, ...]:
        """Machines of the study area."""
        return self.parts.study_units

    @property
    def light_limits(self) -> Mapping[Mode, float]:
        """All limits count."""
        return {}

    def how(self, mode: Mode) -> str:
        """How it came about."""
        return self.made

    def held_at_limits(self, mode: Mode) -> tuple[str, ...]:
        """Limits of linear units that act at the operating point."""
        return self.at_limits

    def build(self, mode: Mode, model: DetailedModel) -> SmallModel:
        """The model on the network of `model`; with everything linear if `mode` says so."""
        if mode is Mode.WHOLE:
            return self.whole(model)
        built = self._ported(model)
        followed = mover_limits(model, self.governed)
        return SmallModel(built, built, 0, self.ports.units, followed)

    def whole(self, model: DetailedModel) -> SmallModel:
        """The same with the study area and the retained machines linear as well, in closed form."""
        return self._intact if model is self.parts.model else self._whole(model)

    @cached_property
    def _intact(self) -> SmallModel:
        return self._whole(self.parts.model)

    def _whole(self, model: DetailedModel) -> SmallModel:
        places = self._places(model)
        n_exact, r = len(places.exact_index), self.states.order
        lift = np.zeros((model.n_states, n_exact + r))
        lift[places.exact_index, np.arange(n_exact)] = 1.0
        lift[places.area_index, n_exact:] = self.states.lift_matrix
        smooth = touched_held(model, self.origin, model.layout.source_units)
        moved = grid_descriptor(smooth, self.origin).apply(lift)
        drift = model.compiled(self.origin)
        a = np.vstack([moved[places.exact_index], self._restricted(moved[places.area_index])])
        offset = np.r_[drift[places.exact_index], self._restricted(drift[places.area_index])]
        form, point = chained_form(a), places.restrict(self.origin)
        system: System
        if form is None:
            system, states = DenseSystem(a, offset), StateMap.identity(point)
        else:
            system = ModalSystem(form, form.inverse @ offset)
            states = StateMap(point, form.basis, form.inverse)
        return SmallModel(system, WholeCoordinates(places, states), 0, model.layout.source_units)

    def moved(
        self, model: DetailedModel, point: Equilibrium, grid: DescriptorSystem | None = None
    ) -> FoldedArea:
        """Linearized anew about `point`, the equilibrium of `model`, where `grid` may be known.

        It is projected on the bases that are there, without modes that grow on them and not in the
        intact network. It is reduced anew where they miss too much of it (more than the bound, if
        modes are left out), and where linear machines are out, whose part in the common turn the bases
        know.
        """
        old = self.bases
        area = _linearized(self.ports, model, point.x, old.weights, self.governed, grid)
        applied, left_out = area.system.apply(old.lift), ""
        growth, bases = growth_on(old, applied), old
        if grows(growth, self.growth):
            bases = without_growth(old, applied, self.growth)
            applied = area.system.apply(bases.lift)
            left_out = f"; a mode that grows by {growth:.2g} 1/s on them is left out"
        miss = missed(bases, area, applied)
        told = f"the bases of the intact network miss {miss:.2g} p.u. of it ({old.miss:.2g} there)"
        made = f"linearized anew; {told}{left_out}"
        served = serve(old, miss, MOST_MISSED if bases is old else 1.0)
        if not served or model.state.units_out.intersection(self.ports.units):
            made = f"reduced anew: {told}{left_out}"
            bases = _found(self.reducer, area, model, point.x, old.weights, old.input_weights)
            applied = area.system.apply(bases.lift)
        return _projected(replace(self, bases=bases, made=made), area, model, point, applied)

    def area_of(self, mode: Mode) -> FoldedArea:
        """The area itself, as a ladder tells it of a rung."""
        return self

    def truncated(self, bounds: Iterable[float]) -> Iterator[FoldedArea]:
        """The area of the intact network with coarser bounds (p.u.), from its own balanced bases.

        Raises
        ------
        OptionError
            Its bases are not balanced, or are not finer than a bound.
        """
        if not isinstance(self.reducer, BalancedTruncation):
            raise OptionError(
                "an area that was not reduced by balanced truncation has no coarser ones"
            )
        usual = replace(self.reducer, order=None)
        reducers = [replace(usual, tolerance=bound) for bound in bounds]
        model, point = self.parts.model, Equilibrium(self.origin, self.rate)
        found = serving(
            self.area,
            _sides(self.area, model, point.x, self.bases.weights),
            lambda area, smooth: list(
                coarser_bases(self.bases, area, smooth, self.origin, reducers)
            ),
        )
        for reducer, bases in zip(reducers, found, strict=True):
            coarse = replace(self, reducer=reducer, bases=bases)
            yield _projected(coarse, self.area, model, point)

    def _places(self, model: DetailedModel) -> PortCoordinates:
        return port_coordinates(model, self.ports.units, self.area.state_index, self.states)

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
    """Coordinates of a model that is linear throughout: v = v0 + V w over those of `places`."""

    places: PortCoordinates
    states: StateMap

    def lift(self, w: NDArray[np.float64]) -> NDArray[np.float64]:
        """States of the whole model, (..., n_states), from w, (..., r)."""
        return self.places.lift(self.states.lift(w))

    def lift_rows(self, w: NDArray[np.float64], index: NDArray[np.int64]) -> NDArray[np.float64]:
        """The states at the positions `index` alone, (..., len(index))."""
        return self.places.lift_rows(self.states.lift(w), index)

    def restrict(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """The state w nearest to the whole model's state x."""
        return self.states.restrict(self.places.restrict(x))

    def restriction(self, rows: NDArray[np.int64]) -> NDArray[np.float64]:
        """How the states at `rows` (m,) of w change with the whole model's, (m, n_states)."""
        places, by = self.places, self.states.restrict_matrix[rows]
        n_exact = len(places.exact_index)
        found = np.empty((len(rows), n_exact + len(places.area_index)))
        found[:, places.exact_index] = by[:, :n_exact]
        found[:, places.area_index] = by[:, n_exact:] @ places.states.restrict_matrix
        return found


def fold(
    parts: Partition,
    retained: Collection[UnitKey] = (),
    reducer: Reducer | None = None,
    weights: Weights = Weights.INTERFACE,
    swings: Swings | None = None,
) -> FoldedArea:
    """Fold the external area behind its ports, at the equilibrium.

    Parameters
    ----------
    parts : Partition
        From :func:`gridfold.partition.partition`.
    retained : collection of UnitKey
        External machines that stay exact.
    reducer : Reducer
        Balanced truncation to a bound of 1e-3 p.u. by default.
    weights : Weights
        What is balanced: what sample swings of the ports cause at them, or all of the area's states
        for unit changes of the port voltages.
    swings : tuple of ndarrays, optional
        From :func:`sample_swings`, those after boundary faults by default.

    Raises
    ------
    OptionError
        A machine that is to be retained is not external, or no machine with states is left to be
        linear.
    """
    strange = [unit for unit in retained if unit not in set(parts.external_units)]
    if strange:
        raise OptionError(
            f"machine {strange[0]} cannot be retained: it is not in the external area"
        )
    kept = tuple(unit for unit in parts.external_units if unit in set(retained))
    linear = [unit for unit in parts.external_units if unit not in set(kept)]
    if not feeding_units(parts.model).intersection(linear):
        raise OptionError("all external machines are retained: none is left to be linear")
    if not parts.states_of(linear):
        raise OptionError(
            "what is left of the external area to be linear are infinite buses: there is no state to "
            "reduce"
        )
    ports = find_ports(parts.model, linear, parts.study_buses)
    chosen = BalancedTruncation(PORT_TOLERANCE) if reducer is None else reducer
    point = Equilibrium(parts.model.x0, 0.0)
    at_ports = interface_weights(parts.model, ports)
    governed = limited_by_any_swing(parts.model, point.x, ports.units)
    area = _linearized(ports, parts.model, point.x, at_ports, governed)
    by_ports = np.zeros((0, 0))
    if weights is Weights.INTERFACE:
        by_ports = port_swings(area, parts, sample_swings(parts) if swings is None else swings)
    bases = _found(chosen, area, parts.model, point.x, at_ports, by_ports)
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
    governed = limited_by_any_swing(parts.model, point.x, ports.units)
    area = _linearized(ports, parts.model, point.x, bases.weights, governed)
    return _about(parts, couple(parts), retained, ports, reducer, bases, area, point)


def _linearized(
    ports: Ports,
    model: DetailedModel,
    x: NDArray[np.float64],
    weights: NDArray[np.float64],
    governed: tuple[UnitKey, ...],
    grid: DescriptorSystem | None = None,
) -> PortArea:
    """The area behind the ports about `x`, without the prime movers of the `governed` machines.

    `grid` is the whole linearized there, if that is known.
    """
    smooth = touched_held(model, x, ports.units)
    movers = prime_movers(smooth, x, governed) if governed else None
    known = grid if smooth is model else None
    return linearize_ports(ports, smooth, x, weights, movers, known)


def _sides(
    area: PortArea,
    model: DetailedModel,
    x: NDArray[np.float64],
    weights: NDArray[np.float64],
) -> Iterator[tuple[PortArea, DetailedModel]]:
    """The area as it is inside the limits that `x` just touches, if there are any, and as it is held.

    Each comes with the model of which it is a part.
    """
    free = touched_let_go(model, x, area.ports.units)
    if free is not model:
        governed = () if area.movers is None else area.movers.units
        yield _linearized(area.ports, free, x, weights, governed), free
    yield area, model


def _found(
    reducer: Reducer,
    area: PortArea,
    model: DetailedModel,
    x: NDArray[np.float64],
    weights: NDArray[np.float64],
    input_weights: NDArray[np.float64],
) -> Bases:
    """Bases that serve the area inside the limits that `x` just touches, where it can be, and held.

    What is let go is seen by the ports, and held it is not: bases of the area that is held would
    know nothing of it at the next operating point.
    """
    (bases,) = serving(
        area,
        _sides(area, model, x, weights),
        lambda side, smooth: [find_bases(reducer, side, smooth, x, weights, input_weights)],
    )
    return bases


def _at_limits(
    model: DetailedModel, x: NDArray[np.float64], ports: Ports, area: PortArea
) -> tuple[str, ...]:
    """Limits that act, or are touched, at `x` and are not followed."""
    followed = mover_limits(model, area.movers.units if area.movers is not None else ())
    return tuple(n for n in limits_touched(model, x, ports.units) if n not in followed)


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
    linear_ports, states = in_modes(bases, area)
    at_limits = _at_limits(parts.model, point.x, ports, area)
    governed = area.movers.units if area.movers is not None else ()
    return FoldedArea(
        parts, coupling, retained, ports, reducer, bases, area, point.x, linear_ports, states,
        point.rate, at_limits, governed,
    )  # fmt: skip


def _projected(
    known: FoldedArea,
    area: PortArea,
    model: DetailedModel,
    point: Equilibrium,
    applied: NDArray[np.float64] | None = None,
) -> FoldedArea:
    """The area about another point; `applied` is A T~ there, if that is known."""
    linear_ports, states = in_modes(known.bases, area, applied)
    return replace(
        known,
        area=area,
        origin=point.x,
        linear_ports=linear_ports,
        states=states,
        rate=point.rate,
        at_limits=_at_limits(model, point.x, known.ports, area),
    )
