"""Governors and turbines whose limits act at once: they see a speed, and give a power.

A gate whose rate is limited to 0.1 p.u./s behind a gain of 1000 is at its limit during any swing. No
linear function stands for it. But it acts on its machine by one number, and is cheap, so that it may
stay as it is where the machine is linear.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from gridfold.dynamics.device import Role
from gridfold.dynamics.evaluate import derivative_stage, output_stage, source_stage
from gridfold.dynamics.layout import Block
from gridfold.dynamics.limiting import acting_limits
from gridfold.dynamics.model import DetailedModel
from gridfold.dynamics.unit_limits import limit_name
from gridfold.grid.case import UnitKey

#: Speed deviation in p.u. that any swing has: a limit that it reaches is always active.
ANY_SWING = 1e-3
_ROLES = (Role.GOVERNOR, Role.TURBINE)
_STEP = 1e-30


@dataclass(frozen=True)
class PrimeMovers:
    """How the prime movers of k machines and the machines know each other, at a state.

    Parameters
    ----------
    units : tuple of UnitKey
        The machines.
    state_index : ndarray of int
        Positions of the prime movers' states in the state vector.
    speed_index : ndarray of int, shape (k,)
        Positions of the machines' speeds in the state vector.
    speed, power : ndarrays, shape (k,)
        Speeds and mechanical powers there in p.u.
    slopes : ndarray, shape (n_states, k)
        Slopes of the derivatives of the states in the mechanical powers; zero for units out.
    direct : ndarray, shape (k,)
        Slopes of the mechanical powers in the speeds where no state is between them.
    """

    units: tuple[UnitKey, ...]
    state_index: NDArray[np.int64] = field(repr=False)
    speed_index: NDArray[np.int64] = field(repr=False)
    speed: NDArray[np.float64] = field(repr=False)
    power: NDArray[np.float64] = field(repr=False)
    slopes: NDArray[np.float64] = field(repr=False)
    direct: NDArray[np.float64] = field(repr=False)


def limited_by_any_swing(
    model: DetailedModel, x: NDArray[np.float64], units: Collection[UnitKey]
) -> tuple[UnitKey, ...]:
    """Those of `units` with a prime mover that is at a limit if the speed is off by 0.001 p.u.

    Judged at the state `x` (n_states,). Only prime movers that act by speed and power alone count.
    """
    signals, found = model.signals(x[None, :])[0], set()
    for block in model.layout.blocks:
        if block.device.role is not Role.GOVERNOR or "speed" not in block.device.inputs:
            continue
        row = block.device.inputs.index("speed")
        for change in (-ANY_SWING, ANY_SWING):
            moved = signals[block.inputs]
            moved[row] += change
            acts = acting_limits(block.device, signals[block.state_index], moved, block.parameters)
            found |= {block.units[k] for k in np.flatnonzero(acts.any(axis=0))}
    return tuple(
        u for u in units if u in found and u not in model.state.units_out and _plain(model, u)
    )


def prime_movers(
    model: DetailedModel, x: NDArray[np.float64], units: Collection[UnitKey]
) -> PrimeMovers:
    """The prime movers of `units`, at the state `x` (n_states,)."""
    chosen = tuple(units)
    signals = model.signals(x[None, :])[0]
    speed_index, power_index = model.slots("speed", chosen), model.slots("mechanical_power", chosen)
    slopes, direct = np.zeros((model.n_states, len(chosen))), np.zeros(len(chosen))
    states = [np.zeros(0, dtype=np.int64)]
    for block, column, place in _columns_of(model, chosen):
        if block.device.role is Role.MACHINE:
            slopes[block.state_index[:, column], place] = _power_slopes(block, column, signals)
        elif block.device.role in _ROLES:
            states.append(block.state_index[:, column])
            direct[place] += _direct_slope(block, column, signals)
    out = [unit in model.state.units_out for unit in chosen]
    slopes[:, out] = 0.0
    return PrimeMovers(
        chosen, np.sort(np.concatenate(states)), speed_index, signals[speed_index],
        signals[power_index], slopes, direct,
    )  # fmt: skip


def mover_limits(model: DetailedModel, units: Collection[UnitKey]) -> frozenset[str]:
    """Names of the limits of the prime movers of `units`."""
    return frozenset(
        limit_name(block.device, limit, unit)
        for block in model.layout.blocks
        if block.device.role in _ROLES
        for unit in set(block.units) & set(units)
        for limit in block.device.limits
    )


def _columns_of(
    model: DetailedModel, units: tuple[UnitKey, ...]
) -> Iterator[tuple[Block, int, int]]:
    """Every device of `units`: its block, its column there, and the place of its unit."""
    place = {unit: k for k, unit in enumerate(units)}
    for block in model.layout.blocks:
        for column, unit in enumerate(block.units):
            if unit in place:
                yield block, column, place[unit]


def _plain(model: DetailedModel, unit: UnitKey) -> bool:
    """Whether speed, a state, and power, which the machine alone takes, are all that is exchanged."""
    slots = model.layout.signal_slots
    if slots.get((unit, "speed"), model.n_states) >= model.n_states:
        return False
    if (unit, "mechanical_power") not in slots:
        return False
    own: set[int] = set()
    taken: list[tuple[Role, int]] = []
    for block, column, _ in _columns_of(model, (unit,)):
        taken += [(block.device.role, int(slot)) for slot in block.inputs[:, column]]
        if block.device.role in _ROLES:
            own |= {*block.state_index[:, column].tolist(), *block.signal_index[:, column].tolist()}
    constants = range(model.n_states, model.n_states + len(model.layout.constant_names))
    known = own | {slots[unit, "speed"], *constants}
    inwards = all(slot in known for role, slot in taken if role in _ROLES)
    outwards = {(role, slot) for role, slot in taken if role not in _ROLES and slot in own}
    return inwards and outwards == {(Role.MACHINE, slots[unit, "mechanical_power"])}


def _power_slopes(block: Block, column: int, signals: NDArray[np.float64]) -> NDArray[np.float64]:
    """Slopes of a machine's derivatives in its mechanical power, by a complex step."""
    x, u, p = _values(block, column, signals)
    u[block.device.inputs.index("mechanical_power")] += 1j * _STEP
    y = output_stage(block.device, x, u, p, source_stage(block.device, x, p))
    return np.asarray(derivative_stage(block.device, x, u, p, y)[:, 0].imag / _STEP)


def _direct_slope(block: Block, column: int, signals: NDArray[np.float64]) -> float:
    """Slope of the mechanical power in the speed, zero in a device that does not join them."""
    device = block.device
    if "mechanical_power" not in device.outputs or "speed" not in device.inputs:
        return 0.0
    x, u, p = _values(block, column, signals)
    u[device.inputs.index("speed")] += 1j * _STEP
    y = output_stage(device, x, u, p, source_stage(device, x, p))
    return float(y[device.signal_rows.index("mechanical_power"), 0].imag / _STEP)


def _values(
    block: Block, column: int, signals: NDArray[np.float64]
) -> tuple[NDArray[np.complex128], NDArray[np.complex128], NDArray[np.complex128]]:
    """States, inputs and parameters of one unit, one column each."""
    x, u, p = (
        np.ascontiguousarray(rows[:, None], dtype=np.complex128)
        for rows in (
            signals[block.state_index[:, column]],
            signals[block.inputs[:, column]],
            block.parameters[:, column],
        )
    )
    return x, u, p
