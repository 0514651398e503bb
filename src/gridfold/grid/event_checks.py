"""Checks and look-ups that events share; each error says `where`, that is in which event."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import replace
from typing import TypeVar

from gridfold.errors import EventError, OptionError
from gridfold.grid.case import Case
from gridfold.grid.network_state import NetworkState, OpenEnd
from gridfold.grid.selection import select_buses
from gridfold.grid.selection_text import Word

Name = TypeVar("Name")
Size = TypeVar("Size", float, complex)


def find_branch(case: Case, name: str, where: str) -> tuple[int, bool]:
    """Position of the branch called `name`, and whether it is named from its second bus."""
    match = re.fullmatch(r"\s*(\d{1,18})\s*-\s*(\d{1,18})\s*(?::\s*(\S+?)\s*)?", str(name))
    if match is None:
        raise EventError(f"{where}: a branch is named FROM-TO or FROM-TO:CIRCUIT, not {name!r}")
    first, second, circuit = int(match[1]), int(match[2]), match[3]
    parallel = [
        position
        for position, branch in enumerate(case.branches)
        if {branch.from_bus, branch.to_bus} == {first, second}
    ]
    found = [k for k in parallel if circuit in (None, case.branches[k].circuit)]
    if len(found) == 1:
        return found[0], case.branches[found[0]].from_bus != first
    circuits = ", ".join(case.branches[k].circuit for k in parallel)
    if not parallel:
        raise EventError(f"{where}: there is no branch between buses {first} and {second}")
    if not found:
        raise EventError(f"{where}: there is no circuit {circuit}, only {circuits}")
    raise EventError(f"{where}: say which circuit ({first}-{second}:CIRCUIT), one of {circuits}")


def branches_at(case: Case, bus: int) -> frozenset[int]:
    """Positions of all branches at a bus."""
    return frozenset(
        position
        for position, branch in enumerate(case.branches)
        if bus in (branch.from_bus, branch.to_bus)
    )


def open_branches(state: NetworkState, branches: frozenset[int]) -> NetworkState:
    """The state with `branches` open; a fault inside a branch goes with it."""
    return replace(
        state,
        branches_out=state.branches_out | branches,
        branch_faults=frozenset(p for p in state.branch_faults if p.branch not in branches),
        open_ends=frozenset(e for e in state.open_ends if e.branch not in branches),
    )


def open_end(state: NetworkState, branch: int, end: int) -> NetworkState:
    """The state with one end of a branch open; where the other one is open too the branch is out."""
    if branch in state.branches_out or OpenEnd(branch, 1 - end) in state.open_ends:
        return open_branches(state, frozenset({branch}))
    return replace(state, open_ends=state.open_ends | {OpenEnd(branch, end)})


def close_branch(state: NetworkState, branch: int) -> NetworkState:
    """The state with a branch closed at both ends."""
    ends = frozenset(e for e in state.open_ends if e.branch != branch)
    return replace(state, branches_out=state.branches_out - {branch}, open_ends=ends)


def place_text(buses: str, areas: str, zones: str) -> str:
    """What the texts of :func:`chosen_buses` name, in words."""
    texts = (("buses", buses), ("areas", areas), ("zones", zones))
    return " and ".join(f"{name} {text}" for name, text in texts if text) or "no place"


def chosen_buses(where: str, case: Case, buses: str, areas: str, zones: str) -> frozenset[int]:
    """Numbers of all buses that one of the texts chooses, each such as ``1-36,78`` or ``area:1``."""
    texts = {Word.BUS: buses, Word.AREA: areas, Word.ZONE: zones}
    if not any(texts.values()):
        raise EventError(f"{where}: say where, by buses, areas or zones")
    found: set[int] = set()
    for word, text in texts.items():
        if text:
            try:
                found.update(select_buses(str(text), case, f"{word.value} numbers", word=word))
            except OptionError as error:
                raise EventError(f"{where}: {error}") from None
    return frozenset(found)


def added(
    old: tuple[tuple[Name, Size], ...], steps: Mapping[Name, Size]
) -> tuple[tuple[Name, Size], ...]:
    """Sizes by name with `steps` added; what is zero then is left out."""
    sizes = dict(old)
    for name, step in steps.items():
        sizes[name] = sizes[name] + step if name in sizes else step
    return tuple(item for item in sizes.items() if item[1])


def check_finite(where: str, **sizes: float) -> None:
    """Raise unless all sizes are finite numbers."""
    for name, size in sizes.items():
        if not math.isfinite(size):
            raise EventError(f"{where}: {name} must be finite, not {size!r}")


def check_time(where: str, name: str, value: float) -> None:
    """Raise unless the time is 0 s or later."""
    if not (math.isfinite(value) and value >= 0):
        raise EventError(f"{where}: {name} must be 0 s or later, not {value!r}")


def check_window(where: str, start: float, duration: float, name: str = "duration") -> None:
    """Raise unless a fault starts at 0 s or later and lasts."""
    check_time(where, "start", start)
    if not (math.isfinite(duration) and duration > 0):
        raise EventError(f"{where}: {name} must be a positive number of seconds, not {duration!r}")


def check_impedance(where: str, resistance: float, reactance: float) -> None:
    """Raise unless a fault impedance is finite and not negative."""
    if not (math.isfinite(resistance) and resistance >= 0):
        raise EventError(f"{where}: resistance must be 0 or more, not {resistance!r}")
    if not math.isfinite(reactance):
        raise EventError(f"{where}: reactance must be finite, not {reactance!r}")


def check_bus(where: str, case: Case, bus: int) -> None:
    """Raise unless the case has the bus."""
    if bus not in case.bus_index:
        raise EventError(f"{where}: there is no bus {bus} in case {case.name}")


def require_closed(state: NetworkState, position: int, where: str, time: float) -> None:
    """Raise if a branch is open at the time of an event on it."""
    if position in state.branches_out:
        raise EventError(f"{where}: it is open at {time:g} s")
