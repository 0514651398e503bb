"""Limits of the units of a model: which of them act, and which bound a state."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gridfold.dynamics.device import Device, Limit
from gridfold.dynamics.layout import Block
from gridfold.dynamics.limiting import (
    NO_LIMIT,
    acting_limits,
    bounds_state,
    limit_symbol,
    limit_value,
    tightened,
)
from gridfold.dynamics.model import DetailedModel
from gridfold.grid.case import UnitKey

#: What is within this part of a limit (of 1, for limits of states below 1) is at the limit.
AT_LIMIT = 1e-6


@dataclass(frozen=True)
class StateLimits:
    """Limits that bound states as they stand.

    Parameters
    ----------
    index : ndarray of int, shape (n,)
        Position of the state in the state vector; a state may have several limits.
    bound, side : ndarrays, shape (n,)
        Value of the limit, and 1 for a highest, -1 for a lowest one.
    names : tuple of str
        For example ``"EMAX of sexs 23:1"``.
    """

    index: NDArray[np.int64]
    bound: NDArray[np.float64]
    side: NDArray[np.float64]
    names: tuple[str, ...]

    def beyond(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """How far the states `x`, (n_states,), are beyond their limits, negative inside."""
        return np.asarray(self.side * (x[self.index] - self.bound))

    def held(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """The states `x`, (n_states,), with those that are beyond a limit put at it."""
        beyond, result = self.beyond(x) > 0, x.copy()
        result[self.index[beyond]] = self.bound[beyond]
        return result

    def only(self, names: Collection[str]) -> StateLimits:
        """Those that are among `names`."""
        chosen = np.array([name in names for name in self.names], dtype=bool)
        kept = tuple(name for name in self.names if name in names)
        return StateLimits(self.index[chosen], self.bound[chosen], self.side[chosen], kept)

    @property
    def tolerance(self) -> NDArray[np.float64]:
        """What counts as being at the limit, shape (n,)."""
        return np.asarray(AT_LIMIT * np.maximum(np.abs(self.bound), 1.0))


def limits_acting(
    model: DetailedModel, x: NDArray[np.float64], units: Collection[UnitKey]
) -> tuple[str, ...]:
    """Limits of `units` that act at the state `x` (n_states,), by name."""
    return tuple(limits_passed(model, x[None, :], units))


def limits_touched(
    model: DetailedModel, x: NDArray[np.float64], units: Collection[UnitKey]
) -> tuple[str, ...]:
    """Limits of `units` that act at the state `x` (n_states,), or that it is just at."""
    acting, near = _acting_and_near(model, x, units)
    return tuple(name for name in limit_names(model, units) if name in near or name in acting)


def _acting_and_near(
    model: DetailedModel, x: NDArray[np.float64], units: Collection[UnitKey]
) -> tuple[set[str], set[str]]:
    """Limits that act at `x`, and those that act if all limits are moved inwards a little."""
    return (
        set(limits_passed(model, x[None, :], units)),
        set(limits_passed(model, x[None, :], units, inwards=AT_LIMIT)),
    )


def touched_held(
    model: DetailedModel, x: NDArray[np.float64], units: Collection[UnitKey]
) -> DetailedModel:
    """The model to linearize at `x`: what is just at a limit of `units` is held there.

    Beside such a limit the derivative is one-sided, and rounding would decide which side is taken. A
    state that is at its limit stands still: the limits of both sides are put beyond it. Limits without
    a state there, or without one on the other side, are taken away.
    """
    return _one_sided(model, x, units, held=True)


def touched_let_go(
    model: DetailedModel, x: NDArray[np.float64], units: Collection[UnitKey]
) -> DetailedModel:
    """The model to linearize at `x` as it is inside the limits of `units` that `x` is just at."""
    return _one_sided(model, x, units, held=False)


def _one_sided(
    model: DetailedModel, x: NDArray[np.float64], units: Collection[UnitKey], held: bool
) -> DetailedModel:
    """The model without the limits that `x` is just at, or with states held where they have some."""
    acting, near = _acting_and_near(model, x, units)
    near -= acting
    if not near:
        return model
    blocks = list(model.layout.blocks)
    for at, block in enumerate(blocks):
        parameters = block.parameters.copy()
        for limit in block.device.limits:
            row = block.device.parameter_rows.index(limit.parameter)
            for k, unit in enumerate(block.units):
                if limit_name(block.device, limit, unit) not in near:
                    continue
                parameters[row, k] = limit.side.value * NO_LIMIT
                bound = float(limit_value(block.device, limit, block.parameters)[k])
                others = _opposite(block.device, limit)
                if held and others and _is_at(block, limit, k, x, bound):
                    for each in (limit, *others):
                        _put(block.device, each, parameters, k, bound)
        blocks[at] = replace(block, parameters=parameters)
    return model.with_blocks(blocks)


def _is_at(block: Block, limit: Limit, column: int, x: NDArray[np.float64], bound: float) -> bool:
    """Whether the state of a limit is at it; the parameter may limit other things besides."""
    row = block.device.states.index(str(limit.state))
    off = abs(x[block.state_index[row, column]] - bound)
    return bool(off <= AT_LIMIT * max(abs(bound), 1.0))


def _opposite(device: Device, limit: Limit) -> list[Limit]:
    """The limits of the same state on the other side."""
    if limit.state is None:
        return []
    return [
        each for each in device.limits if each.state == limit.state and each.side is not limit.side
    ]


def _put(
    device: Device, limit: Limit, parameters: NDArray[np.float64], column: int, bound: float
) -> None:
    """Move a limit of a state a little beyond `bound`, where the state is, so that it holds it."""
    target = bound - limit.side.value * 2 * AT_LIMIT * max(abs(bound), 1.0)
    if limit.added_to is not None:
        target -= parameters[device.parameter_rows.index(limit.added_to), column]
    parameters[device.parameter_rows.index(limit.parameter), column] = target


def limits_passed(
    model: DetailedModel,
    states: NDArray[np.float64],
    units: Collection[UnitKey],
    inwards: float = 0.0,
) -> Mapping[str, NDArray[np.bool_]]:
    """Limits of `units` that act at one of the states (n_times, n_states), and at which: (n_times,).

    The limits are taken as they are, or moved inwards by a part of their size.
    """
    return {
        limit_name(block.device, block.device.limits[k], block.units[columns[j]]): acts[k, j]
        for block, columns, acts in _acting(model, states, units, inwards)
        for k, j in np.argwhere(acts.any(axis=2))
    }


def limit_names(model: DetailedModel, units: Collection[UnitKey]) -> tuple[str, ...]:
    """Names of all limits of `units` that are in service, in the order of the model."""
    return tuple(
        limit_name(block.device, limit, block.units[column])
        for block, columns in _limited(model, units)
        for limit in block.device.limits
        for column in columns
    )


def _acting(
    model: DetailedModel,
    states: NDArray[np.float64],
    units: Collection[UnitKey],
    inwards: float = 0.0,
) -> Iterator[tuple[Block, list[int], NDArray[np.bool_]]]:
    """Blocks with columns of `units`, and which limits act: (n_limits, n_columns, n_times)."""
    blocks = list(_limited(model, units))
    if not blocks:
        return
    signals = model.signals(states)
    for block, columns in blocks:
        x, u, p = _columns(block, columns, signals)
        limits = p if inwards == 0 else tightened(block.device, p, inwards)
        acts = acting_limits(block.device, x, u, limits)
        yield block, columns, acts.reshape(len(block.device.limits), len(columns), len(signals))


def state_limits(
    model: DetailedModel,
    x: NDArray[np.float64],
    units: Collection[UnitKey],
    without: Collection[str] = (),
) -> StateLimits:
    """Limits of `units` that bound a state, judged about the state `x`; not those named `without`."""
    found: list[tuple[int, float, int, str]] = []
    blocks = list(_limited(model, units))
    signals = model.signals(x[None, :]) if blocks else np.zeros((0, 0))
    for block, columns in blocks:
        values = _columns(block, columns, signals)
        for limit in block.device.limits:
            bounds = limit_value(block.device, limit, values[2])
            direct = bounds_state(block.device, limit, *values) & (np.abs(bounds) < NO_LIMIT)
            for k in np.flatnonzero(direct):
                name = limit_name(block.device, limit, block.units[columns[k]])
                if name not in without:
                    row = block.device.states.index(str(limit.state))
                    index = int(block.state_index[row, columns[k]])
                    found.append((index, float(bounds[k]), limit.side.value, name))
    return StateLimits(
        np.array([index for index, *_ in found], dtype=np.int64),
        np.array([bound for _, bound, *_ in found], dtype=float),
        np.array([side for *_, side, _ in found], dtype=float),
        tuple(name for *_, name in found),
    )


def _limited(model: DetailedModel, units: Collection[UnitKey]) -> Iterator[tuple[Block, list[int]]]:
    """Blocks with limits, and which of their columns are among `units` and in service."""
    wanted = set(units) - set(model.state.units_out)
    for block in model.layout.blocks:
        columns = [k for k, unit in enumerate(block.units) if unit in wanted]
        if block.device.limits and columns:
            yield block, columns


def _columns(
    block: Block, columns: list[int], signals: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """States, inputs and parameters of some units along signals (n_times, n_signals).

    One column for each unit and time, all times of a unit in a row.
    """
    states, inputs = (
        np.ascontiguousarray(signals.T[index[:, columns]].reshape(len(index), -1))
        for index in (block.state_index, block.inputs)
    )
    return states, inputs, np.repeat(block.parameters[:, columns], len(signals), axis=1)


def limit_name(device: Device, limit: Limit, unit: UnitKey) -> str:
    """For example ``EMAX of sexs 23:1``."""
    return f"{limit_symbol(device, limit)} of {device.model} {unit}"
