"""What a linear area is projected on, and the area in these coordinates."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from gridfold.dynamics.descriptor import grid_descriptor
from gridfold.dynamics.model import DetailedModel
from gridfold.dynamics.port_rhs import LinearPorts, PowerInputs
from gridfold.dynamics.unit_limits import touched_held
from gridfold.errors import OptionError
from gridfold.numerics.modal_form import ModalForm, modal_form
from gridfold.partition.port_area import PortArea
from gridfold.reduction import BalancedTruncation, Reducer, Reduction
from gridfold.reduction.balanced import BalancedSystem
from gridfold.reduction.order import OrderRule
from gridfold.reduction.slow_modes import slow_modes
from gridfold.systems.descriptor import DescriptorSystem
from gridfold.systems.linear import LinearSystem
from gridfold.systems.statemap import StateMap

#: Bound (6) to which the external area is reduced if nothing else is asked for: change of the voltages
#: at ports and kept machines in p.u., for port voltages that swing as in the samples.
PORT_TOLERANCE = 1e-3
#: It is looked how much bases miss of an area at s = 2 pi times this (1/s): real, which costs less.
CHECKED_AT = 0.7
#: States of an area up to which its matrix is formed to be reduced.
DENSE_UP_TO = 500


@dataclass(frozen=True)
class Bases:
    """What a linear area is projected on: x = x0 + T~ z and z = T (x - x0).

    Parameters
    ----------
    lift, restrict : ndarrays, shapes (n, r) and (r, n)
        T~ and T.
    weights : ndarray, shape (2 n_ports, 2 n_ports)
        How changes of the port currents count, :func:`interface_weights`.
    input_weights : ndarray, shape (2 n_ports, 2 n_ports)
        How changes of the port voltages count, :func:`port_swings`.
    miss : float
        Error of the transfer matrix of the intact network's area on them, :func:`missed`.
    hankel_values : ndarray or None
        Hankel singular values from changes of the port voltages to what is caused, in p.u.
    bound : float or None
        The bound (6) in the same unit, for the truncation without the common turn of all angles.
    """

    lift: NDArray[np.float64] = field(repr=False)
    restrict: NDArray[np.float64] = field(repr=False)
    weights: NDArray[np.float64] = field(repr=False)
    input_weights: NDArray[np.float64] = field(repr=False)
    miss: float
    hankel_values: NDArray[np.float64] | None = field(repr=False)
    bound: float | None

    @property
    def order(self) -> int:
        """Number r of coordinates."""
        return int(self.lift.shape[1])


def find_bases(
    reducer: Reducer,
    area: PortArea,
    model: DetailedModel,
    x: NDArray[np.float64],
    weights: NDArray[np.float64],
    input_weights: NDArray[np.float64],
) -> Bases:
    """Bases by which `reducer` truncates the area about the state `x` of `model`.

    The common turn of all angles stays exact, but for reducers that are not balanced. Without input
    weights, (0, 0), all states count alike.
    """
    reference, system = area.x0, _weighed(area, input_weights)
    if not isinstance(reducer, BalancedTruncation):
        found = reducer.reduce(system.dense(), reference)
        maps, values, bound = found.state_map, found.hankel_values, found.bound
    else:
        small = system.n <= DENSE_UP_TO
        found = reducer.reduce(
            system.dense() if small else system, reference, _exact(reducer, area, model, x)
        )
        maps, values = found.state_map, found.hankel_values
        bound = _left_out(OrderRule(reducer.tolerance, reducer.order), found, system)
    return _checked(
        Bases(maps.lift_matrix, maps.restrict_matrix, weights, input_weights, 0.0, values, bound),
        area,
    )


def coarser_bases(
    bases: Bases,
    area: PortArea,
    model: DetailedModel,
    x: NDArray[np.float64],
    reducers: Iterable[BalancedTruncation],
) -> Iterator[Bases]:
    """Coarser bases from balanced ones of the same area: only what is projected on them is balanced.

    What the bases themselves miss counts in the bound of each of `reducers`.

    Raises
    ------
    OptionError
        They miss as much as a bound allows.
    """
    lift, restrict, missing = bases.lift, bases.restrict, bases.bound or 0.0
    full = _weighed(area, bases.input_weights)
    small = LinearSystem(restrict @ full.apply(lift), restrict @ full.b, full.c @ lift)
    balanced, reference = BalancedSystem.of(small), np.zeros(bases.order)
    for reducer in reducers:
        rule = OrderRule(reducer.tolerance, reducer.order)
        if rule.tolerance is not None:
            if not missing < rule.tolerance:
                raise OptionError(
                    f"bases with a bound of {missing:.1e} give none of {rule.tolerance:.1e}"
                )
            rule = replace(rule, tolerance=rule.tolerance - missing)
        exact = restrict @ _exact(reducer, area, model, x)
        found = balanced.truncated(rule, reference, exact)
        coarse = replace(
            bases,
            lift=lift @ found.state_map.lift_matrix,
            restrict=found.state_map.restrict_matrix @ restrict,
            hankel_values=found.hankel_values,
            bound=_left_out(rule, found, small) + missing,
        )
        yield _checked(coarse, area)


def _weighed(area: PortArea, input_weights: NDArray[np.float64]) -> DescriptorSystem:
    """The area with what is balanced as its inputs and outputs."""
    if input_weights.size:
        return area.driven.with_input_weights(input_weights)
    return area.driven.with_outputs(np.eye(area.system.n))


def _left_out(rule: OrderRule, found: Reduction, system: LinearSystem | DescriptorSystem) -> float:
    """The bound (6) of a truncation without the states that stay exact besides."""
    values = found.hankel_values
    assert values is not None
    return 2 * float(values[rule.choose(values, system, found.kept_exactly) :].sum())


def _checked(bases: Bases, area: PortArea) -> Bases:
    return replace(bases, miss=missed(bases, area))


def missed(bases: Bases, area: PortArea, applied: NDArray[np.float64] | None = None) -> float:
    """Error of the transfer matrix of the projected area at a rate of electromechanical swings.

    Largest change of the voltages at ports and kept machines, in p.u., for port voltages that swing as
    in the samples; without input weights for changes of 1 rad or by the factor e. `applied` is A T~,
    if that is known.
    """
    system, s = area.driven, CHECKED_AT * 2 * np.pi
    if bases.input_weights.size:
        system = system.with_input_weights(bases.input_weights)
    a = bases.restrict @ (system.apply(bases.lift) if applied is None else applied)
    small = np.linalg.solve(s * np.eye(bases.order) - a, bases.restrict @ system.b)
    return float(np.linalg.norm(system.transfer_once(s) - system.c @ (bases.lift @ small), 2))


def _exact(
    reducer: BalancedTruncation, area: PortArea, model: DetailedModel, x: NDArray[np.float64]
) -> NDArray[np.float64]:
    """States that stay exact: the common turn and, if wanted, slow modes of the whole grid."""
    if reducer.slow_modes is None:
        return area.turn
    smooth = touched_held(model, x, area.ports.units)
    _, vectors = slow_modes(grid_descriptor(smooth, x), reducer.slow_modes)
    inside = vectors[area.state_index]
    return np.hstack([area.turn, inside.real, inside.imag])


def in_modes(
    bases: Bases, area: PortArea, applied: NDArray[np.float64] | None = None
) -> tuple[LinearPorts, StateMap]:
    """The area projected on its bases, with coordinates that do not see each other."""
    lift, restrict = bases.lift, bases.restrict
    form = modal_form(restrict @ (area.system.apply(lift) if applied is None else applied))
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
        movers=_power_inputs(area, lift, restrict),
    ), StateMap(area.x0, lift, restrict)


def _power_inputs(
    area: PortArea, lift: NDArray[np.float64], restrict: NDArray[np.float64]
) -> PowerInputs | None:
    """The exact prime movers of the area's machines as its coordinates know them."""
    at = area.movers
    if at is None:
        return None
    return PowerInputs(at.units, at.speed, at.power, area.speeds @ lift, restrict @ area.powers)


def _pairs_apart(form: ModalForm) -> tuple[NDArray[np.int64], int]:
    """Real modes first, then the first coordinate of each pair, then the second; and the pairs."""
    every = np.arange(len(form.partner))
    first = np.flatnonzero(form.partner > every)
    real = np.flatnonzero(form.partner == every)
    return np.concatenate([real, first, form.partner[first]]), len(first)
