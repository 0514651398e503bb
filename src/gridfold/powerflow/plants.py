"""Plants and switched shunts of a case as nodes of its network see them."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gridfold.grid.case import Case, Control, Generator, UnitKey
from gridfold.grid.dc_lines import TransistorEnd, TransistorLine
from gridfold.grid.flow_controls import ShuntControl, ShuntMode, UnitControl

_FREE = 99.99  # p.u., of limits that are no limits


@dataclass(frozen=True)
class Plant:
    """The units at a node that hold a voltage, or a converter that does.

    Parameters
    ----------
    name : str
        Its first unit, or the converter, in words.
    node, holds : int
        The node where it stands, and that whose voltage it holds.
    target : float
        The voltage in p.u.
    least, most : float
        Limits of its reactive power in p.u.
    part : float
        Its part where several plants hold one node.
    swings : bool
        Whether it is at a swing bus.
    stored : float
        Its stored reactive power in p.u.
    units : tuple of UnitKey
        Its units.
    """

    name: str
    node: int
    holds: int
    target: float
    least: float
    most: float
    part: float
    swings: bool
    stored: float
    units: tuple[UnitKey, ...] = ()


@dataclass(frozen=True)
class Switched:
    """A switched shunt in service: susceptances in p.u."""

    control: ShuntControl
    shunt: int
    node: int
    holds: int
    band: tuple[float, float]
    levels: tuple[float, ...]
    stored: float

    @property
    def mode(self) -> ShuntMode:
        """How it follows the voltage."""
        return self.control.mode


def plants_of(
    case: Case, place: NDArray[np.int64], islands: NDArray[np.int64]
) -> tuple[Plant, ...]:
    """Plants of a case, those at swing buses first.

    Parameters
    ----------
    case : Case
        The case.
    place : ndarray of int, shape (n_buses,)
        The node of each bus.
    islands : ndarray of int, shape (n_nodes,)
        The island of each node.
    """
    controls = {
        UnitKey(item.bus, item.id): item
        for item in case.flow_controls
        if isinstance(item, UnitControl)
    }
    together: dict[int, list[Generator]] = defaultdict(list)
    for unit in case.generators:
        if unit.in_service and unit.control is not Control.POWER:
            together[int(place[case.bus_index[unit.bus]])].append(unit)
    plants = [
        _plant(case, place, islands, node, units, controls) for node, units in together.items()
    ]
    plants += [
        _converter(case, place, islands, line, end)
        for line in case.dc_lines
        if isinstance(line, TransistorLine)
        for end in (line.first, line.second)
        if end.bus in line.voltage_buses
    ]
    return tuple(sorted(plants, key=lambda plant: not plant.swings))


def switched_shunts_of(
    case: Case, place: NDArray[np.int64], islands: NDArray[np.int64]
) -> tuple[Switched, ...]:
    """Switched shunts in service that follow a voltage."""
    position = {(shunt.bus, shunt.id): k for k, shunt in enumerate(case.shunts)}
    found = []
    for item in case.flow_controls:
        if not isinstance(item, ShuntControl):
            continue
        at = position.get((item.bus, item.id))
        follows = item.mode in (ShuntMode.DISCRETE, ShuntMode.CONTINUOUS)
        if at is None or not follows or not case.shunts[at].in_service:
            continue
        if case.shunts[at].conductance_mw != 0:
            continue
        node = int(place[case.bus_index[item.bus]])
        stored = case.shunts[at].susceptance_mvar / case.base_mva
        levels = sorted({stored, *(level / case.base_mva for level in item.levels)})
        found.append(
            Switched(
                item,
                at,
                node,
                _held(case, place, islands, node, item.regulated_bus),
                (item.voltage_min_pu, item.voltage_max_pu),
                tuple(levels),
                stored,
            )
        )
    return tuple(found)


def control_faults(case: Case) -> list[str]:
    """Set points and limits that cannot be meant, a line each, of units and shunts in service."""
    faults = []
    live = {unit.key: unit for unit in case.generators if unit.in_service}
    shunts = {(shunt.bus, shunt.id): shunt for shunt in case.shunts if shunt.in_service}
    for item in case.flow_controls:
        if isinstance(item, UnitControl):
            unit = live.get(UnitKey(item.bus, item.id))
            if unit is None or unit.control is Control.POWER:
                continue
            where = case.locate(unit)
            if not item.set_point_pu > 0:
                faults.append(
                    f"{where}: the set point must be positive, not {item.set_point_pu:g} p.u."
                )
            if item.reactive_min_mvar > item.reactive_max_mvar:
                faults.append(
                    f"{where}: the least reactive power {item.reactive_min_mvar:g} Mvar is above the "
                    f"most {item.reactive_max_mvar:g}"
                )
            if not item.part > 0:
                faults.append(f"{where}: its part RMPCT must be positive, not {item.part:g}")
        elif shunt := shunts.get((item.bus, item.id)):
            follows = item.mode in (ShuntMode.DISCRETE, ShuntMode.CONTINUOUS)
            if follows and not 0 < item.voltage_min_pu <= item.voltage_max_pu:
                faults.append(
                    f"{case.locate(shunt)}: its band of {item.voltage_min_pu:g} to "
                    f"{item.voltage_max_pu:g} p.u. is none"
                )
    return faults


def out_of_reach(case: Case, place: NDArray[np.int64], islands: NDArray[np.int64]) -> list[str]:
    """Units and shunts whose regulated bus is not in their island: they hold their own."""
    names = []
    for item in case.flow_controls:
        if item.bus in case.bus_index and item.regulated_bus != item.bus:
            node = int(place[case.bus_index[item.bus]])
            remote = case.bus_index.get(item.regulated_bus)
            if remote is None or islands[place[remote]] != islands[node]:
                names.append(f"{item.bus}:{item.id} ({item.regulated_bus})")
    return names


def _held(
    case: Case, place: NDArray[np.int64], islands: NDArray[np.int64], node: int, bus: int
) -> int:
    """The node of a bus that is held; the own one where the bus is elsewhere or not there."""
    if bus not in case.bus_index:
        return node
    remote = int(place[case.bus_index[bus]])
    return remote if islands[remote] == islands[node] else node


def _plant(
    case: Case,
    place: NDArray[np.int64],
    islands: NDArray[np.int64],
    node: int,
    units: Sequence[Generator],
    controls: dict[UnitKey, UnitControl],
) -> Plant:
    leading = max(units, key=lambda unit: (unit.control is Control.SLACK, unit.base_mva))
    swings = leading.control is Control.SLACK
    control = controls.get(leading.key)
    holds, target = node, leading.voltage_pu
    if control is not None:
        holds = _held(case, place, islands, node, control.regulated_bus)
        target = control.set_point_pu
    if swings and holds != node:
        holds, target = node, leading.voltage_pu
    limits = [controls.get(unit.key) for unit in units]
    least = sum(
        -_FREE if item is None else item.reactive_min_mvar / case.base_mva for item in limits
    )
    most = sum(_FREE if item is None else item.reactive_max_mvar / case.base_mva for item in limits)
    part = sum(item.part for item in limits if item is not None)
    stored = sum(unit.reactive_mvar for unit in units) / case.base_mva
    return Plant(
        str(leading), node, holds, target, min(least, most), max(least, most), part or 100.0, swings,
        stored, tuple(unit.key for unit in units),
    )  # fmt: skip


def _converter(
    case: Case,
    place: NDArray[np.int64],
    islands: NDArray[np.int64],
    line: TransistorLine,
    end: TransistorEnd,
) -> Plant:
    node = int(place[case.bus_index[end.bus]])
    return Plant(
        f"the converter of {line} at bus {end.bus}",
        node,
        _held(case, place, islands, node, end.regulated_bus or end.bus),
        end.voltage_pu,
        end.reactive_min_mvar / case.base_mva,
        end.reactive_max_mvar / case.base_mva,
        100.0,
        swings=False,
        stored=0.0,
    )
