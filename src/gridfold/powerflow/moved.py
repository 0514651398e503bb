"""A case moved to another operating point, and what was moved in words."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gridfold.grid.case import Case, Generator
from gridfold.powerflow.plants import Plant, Switched

_LISTED = 8
_TOLD_VOLTAGE = 1e-4  # p.u., change of a stored voltage
_SAME = 1e-6  # p.u., of set points
PlantPower = tuple[Plant, float]


def moved_case(
    case: Case,
    voltage: NDArray[np.complex128],
    made: Iterable[PlantPower],
    limited: Sequence[PlantPower],
    over: Sequence[PlantPower],
    switched: Sequence[tuple[Switched, float]],
    stuck: Sequence[Switched],
    astray: Sequence[str],
) -> Case:
    """The case with this operating point as its stored one.

    Parameters
    ----------
    case : Case
        The case as stored.
    voltage : ndarray of complex, shape (n_buses,)
        The voltages in p.u.
    made : iterable of (Plant, float)
        Reactive power of each plant in p.u.
    limited, over : sequences of (Plant, float)
        Plants at a limit, and swing plants beyond one.
    switched : sequence of (Switched, float)
        Shunts whose susceptance changed, and that in p.u.
    stuck : sequence of Switched
        Shunts that turned back, and stay.
    astray : sequence of str
        Units and shunts whose regulated bus is out of reach.
    """
    size = np.abs(voltage)
    buses = tuple(
        replace(bus, voltage_pu=float(v), angle_deg=float(np.rad2deg(np.angle(phasor))))
        for bus, v, phasor in zip(case.buses, size, voltage, strict=True)
    )
    every = tuple(made)
    power = {unit: (plant, q) for plant, q in every for unit in plant.units}
    units = {unit.key: unit for unit in case.generators}

    def solved(unit: Generator) -> Generator:
        if unit.key not in power:
            return unit
        plant, total = power[unit.key]
        part = unit.share / sum(units[key].share for key in plant.units)
        held = float(size[case.bus_index[unit.bus]])
        return replace(unit, voltage_pu=held, reactive_mvar=total * case.base_mva * part)

    shunts = list(case.shunts)
    for item, susceptance in switched:
        changed = replace(shunts[item.shunt], susceptance_mvar=susceptance * case.base_mva)
        shunts[item.shunt] = changed
    told = [
        "the operating point is that of set points, reactive limits and switched shunts, not the "
        "stored one",
        *_voltages(case, size),
        *_targets([plant for plant, _ in every]),
        *_plants(case, limited),
        *_swings(case, over),
        *_shunts(case, switched, stuck),
        *(
            [f"a regulated bus is out of reach, so that the own one is held: {_list(astray)}"]
            if astray
            else []
        ),
    ]
    return replace(
        case,
        buses=buses,
        generators=tuple(solved(unit) for unit in case.generators),
        shunts=tuple(shunts),
        notices=(*case.notices, *told),
    )


def _voltages(case: Case, size: NDArray[np.float64]) -> Iterable[str]:
    change = np.array([bus.voltage_pu for bus in case.buses]) - size
    moved = int((np.abs(change) > _TOLD_VOLTAGE).sum())
    if moved:
        worst = int(np.argmax(np.abs(change)))
        bus = case.buses[worst]
        yield (
            f"{moved} of {len(case.buses)} voltages moved by more than {_TOLD_VOLTAGE:g} p.u., most at "
            f"{bus}: {bus.voltage_pu:.4f} to {size[worst]:.4f} p.u."
        )


def _targets(plants: Sequence[Plant]) -> Iterable[str]:
    """Plants that hold one node at different voltages: the first counts."""
    first: dict[int, Plant] = {}
    for plant in plants:
        leading = first.setdefault(plant.holds, plant)
        if abs(leading.target - plant.target) > _SAME:
            yield (
                f"{plant.name} holds {leading.target:g} p.u. in place of {plant.target:g}, with "
                f"{leading.name}, which holds the same bus"
            )


def _plants(case: Case, limited: Sequence[PlantPower]) -> Iterable[str]:
    lines = [
        f"{plant.name}{' and those beside it' if len(plant.units) > 1 else ''} "
        f"{q * case.base_mva:.1f} Mvar"
        for plant, q in limited
    ]
    if lines:
        yield f"at a reactive limit: {_list(lines)}"


def _swings(case: Case, over: Sequence[PlantPower]) -> Iterable[str]:
    for plant, q in over:
        yield (
            f"{plant.name} balances with {q * case.base_mva:.1f} Mvar, beyond its limits of "
            f"{plant.least * case.base_mva:g} to {plant.most * case.base_mva:g} Mvar"
        )


def _shunts(
    case: Case, switched: Sequence[tuple[Switched, float]], stuck: Sequence[Switched]
) -> Iterable[str]:
    lines = [
        f"{item.control.bus}:{item.control.id} {item.stored * case.base_mva:.2f} to "
        f"{b * case.base_mva:.2f} Mvar"
        for item, b in switched
    ]
    if lines:
        yield f"switched shunts moved: {_list(lines)}"
    held = [f"{item.control.bus}:{item.control.id}" for item in stuck]
    if held:
        yield f"switched shunts that hunt between two steps, and stay: {_list(held)}"


def _list(lines: Sequence[str]) -> str:
    more = f" and {len(lines) - _LISTED} more" if len(lines) > _LISTED else ""
    return ", ".join(lines[:_LISTED]) + more
