"""Checks and look-ups that events share; each error says `where`, that is in which event."""

from __future__ import annotations

import math
import re
from dataclasses import replace

from gridfold.errors import EventError
from gridfold.grid.case import Case
from gridfold.grid.network_state import NetworkState


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
    )


def check_time(where: str, name: str, value: float) -> None:
    """Raise unless the time is 0 s or later."""
    if not (math.isfinite(value) and value >= 0):
        raise EventError(f"{where}: {name} must be 0 s or later, not {value!r}")


def check_window(where: str, start: float, duration: float) -> None:
    """Raise unless a fault starts at 0 s or later and lasts."""
    check_time(where, "start", start)
    if not (math.isfinite(duration) and duration > 0):
        raise EventError(
            f"{where}: duration must be a positive number of seconds, not {duration!r}"
        )


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
