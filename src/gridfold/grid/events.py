"""Disturbances as small records.

An event says what it changes in the :class:`~gridfold.grid.network_state.NetworkState`, and when.
To add one, write a frozen dataclass with a ``changes(case)`` method and put it into :data:`EVENTS`.

Branches are named ``FROM-TO`` or ``FROM-TO:CIRCUIT``, from either end.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple, Protocol

from gridfold.errors import EventError
from gridfold.grid.case import Case, UnitKey
from gridfold.grid.event_checks import (
    branches_at,
    check_bus,
    check_impedance,
    check_time,
    check_window,
    find_branch,
    open_branches,
    require_closed,
)
from gridfold.grid.network_state import BranchFaultPoint, NetworkState


class Change(NamedTuple):
    """One switching action: when, what it is called, and what it does to the network state.

    `buses` are those where it acts; if all of them are de-energized it has no effect. What only ends
    another action names none.
    """

    time: float
    label: str
    apply: Callable[[NetworkState], NetworkState]
    buses: tuple[int, ...] = ()


class Event(Protocol):
    """A disturbance of the grid."""

    def changes(self, case: Case) -> list[Change]:
        """The switching actions; raises :class:`EventError` if something is not in the case."""


@dataclass(frozen=True)
class BusFault:
    """A three-phase fault at a bus.

    Parameters
    ----------
    bus : int
        Bus number.
    start, duration : float
        Time of the fault and of its clearing after that, in seconds.
    resistance, reactance : float
        Fault impedance in per unit on the system base; 0 is a bolted fault.
    trip_bus : bool
        False: the fault clears itself. True: it is cleared by tripping every branch at the bus.
    """

    bus: int
    start: float = 0.0
    duration: float = 0.1
    resistance: float = 0.0
    reactance: float = 0.0
    trip_bus: bool = False

    def changes(self, case: Case) -> list[Change]:
        """Fault on; fault off, with all branches at the bus if `trip_bus`."""
        where = f"fault at bus {self.bus}"
        check_window(where, self.start, self.duration)
        check_impedance(where, self.resistance, self.reactance)
        check_bus(where, case, self.bus)
        fault = (self.bus, complex(self.resistance, self.reactance))
        opened = branches_at(case, self.bus) if self.trip_bus else frozenset()

        def put_on(state: NetworkState) -> NetworkState:
            if any(bus == self.bus for bus, _ in state.bus_faults):
                raise EventError(f"{where}: the bus is faulted already at {self.start:g} s")
            return replace(state, bus_faults=state.bus_faults | {fault})

        def clear(state: NetworkState) -> NetworkState:
            return open_branches(replace(state, bus_faults=state.bus_faults - {fault}), opened)

        cleared = f"bus {self.bus} tripped" if self.trip_bus else f"{where} cleared"
        return [
            Change(self.start, where, put_on, (self.bus,)),
            Change(self.start + self.duration, cleared, clear),
        ]


@dataclass(frozen=True)
class BranchFault:
    """A three-phase fault on a line or transformer, cleared by tripping it.

    Parameters
    ----------
    branch : str
        ``FROM-TO`` or ``FROM-TO:CIRCUIT``.
    start, duration : float
        Time of the fault and of its clearing after that, in seconds.
    fraction : float
        Where: 0 at the bus named first, 1 at the other, in between a part of the length.
    resistance, reactance : float
        Fault impedance in per unit on the system base; 0 is a bolted fault.
    trip : bool
        True: cleared by tripping the branch. False: the fault clears itself.
    """

    branch: str
    start: float = 0.0
    duration: float = 0.1
    fraction: float = 0.0
    resistance: float = 0.0
    reactance: float = 0.0
    trip: bool = True

    def changes(self, case: Case) -> list[Change]:
        """Fault on; fault off and branch out."""
        where = f"fault on branch {self.branch}"
        check_window(where, self.start, self.duration)
        check_impedance(where, self.resistance, self.reactance)
        if not 0 <= self.fraction <= 1:
            raise EventError(f"{where}: fraction must lie between 0 and 1, not {self.fraction!r}")
        position, turned = find_branch(case, self.branch, where)
        fraction = 1 - self.fraction if turned else self.fraction
        branch = case.branches[position]
        impedance = complex(self.resistance, self.reactance)
        point = BranchFaultPoint(position, fraction, impedance)
        end = {0.0: branch.from_bus, 1.0: branch.to_bus}.get(round(fraction, 9))
        fault = None if end is None else (end, impedance)

        def put_on(state: NetworkState) -> NetworkState:
            require_closed(state, position, where, self.start)
            if any(other.branch == position for other in state.branch_faults):
                raise EventError(f"{where}: the branch is faulted already at {self.start:g} s")
            if fault is None:
                return replace(state, branch_faults=state.branch_faults | {point})
            if any(bus == end for bus, _ in state.bus_faults):
                raise EventError(f"{where}: bus {end} is faulted already at {self.start:g} s")
            return replace(state, bus_faults=state.bus_faults | {fault})

        def clear(state: NetworkState) -> NetworkState:
            cleared = replace(
                state,
                bus_faults=state.bus_faults - {fault},
                branch_faults=state.branch_faults - {point},
            )
            return open_branches(cleared, frozenset({position})) if self.trip else cleared

        cleared = f"branch {self.branch} tripped" if self.trip else f"{where} cleared"
        return [
            Change(self.start, where, put_on, (branch.from_bus, branch.to_bus)),
            Change(self.start + self.duration, cleared, clear),
        ]


@dataclass(frozen=True)
class BranchTrip:
    """A branch (``FROM-TO`` or ``FROM-TO:CIRCUIT``) is opened at `time` (s).

    It has no effect on a branch that another event has opened.
    """

    branch: str
    time: float = 0.0

    def changes(self, case: Case) -> list[Change]:
        """The branch goes out of service."""
        where = f"trip of branch {self.branch}"
        check_time(where, "time", self.time)
        position, _ = find_branch(case, self.branch, where)

        def apply(state: NetworkState) -> NetworkState:
            if position in case.branches_out:
                require_closed(state, position, where, self.time)
            return open_branches(state, frozenset({position}))

        branch = case.branches[position]
        ends = branch.from_bus, branch.to_bus
        return [Change(self.time, f"branch {self.branch} tripped", apply, ends)]


@dataclass(frozen=True)
class BranchReclose:
    """A branch (``FROM-TO`` or ``FROM-TO:CIRCUIT``) that is open is closed at `time` (s)."""

    branch: str
    time: float = 0.0

    def changes(self, case: Case) -> list[Change]:
        """The branch comes back into service."""
        where = f"reclosing of branch {self.branch}"
        check_time(where, "time", self.time)
        position, _ = find_branch(case, self.branch, where)

        def apply(state: NetworkState) -> NetworkState:
            if position not in state.branches_out:
                raise EventError(f"{where}: it is not open at {self.time:g} s")
            return replace(state, branches_out=state.branches_out - {position})

        branch = case.branches[position]
        ends = branch.from_bus, branch.to_bus
        return [Change(self.time, f"branch {self.branch} reclosed", apply, ends)]


@dataclass(frozen=True)
class MachineTrip:
    """The unit `id` at `bus` is disconnected at `time` (s); its states are frozen from then on.

    It has no effect on a unit that another event has disconnected.
    """

    bus: int
    id: str = "1"
    time: float = 0.0

    def changes(self, case: Case) -> list[Change]:
        """The unit is disconnected."""
        key = UnitKey(self.bus, str(self.id))
        where = f"trip of machine {key}"
        check_time(where, "time", self.time)
        check_bus(where, case, self.bus)
        if not any(g.key == key and g.in_service for g in case.generators):
            known = ", ".join(str(g.key) for g in case.generators if g.bus == self.bus) or "none"
            raise EventError(f"{where}: no such machine in service (at bus {self.bus}: {known})")

        def apply(state: NetworkState) -> NetworkState:
            return replace(state, units_out=state.units_out | {key})

        return [Change(self.time, f"machine {key} tripped", apply, (self.bus,))]


@dataclass(frozen=True)
class LoadStep:
    """Load is added at `bus` at `time` (s), as a constant impedance.

    `active_mw` and `reactive_mvar` are what it draws at the bus's initial voltage; negative values
    shed load.
    """

    bus: int
    time: float = 0.0
    active_mw: float = 0.0
    reactive_mvar: float = 0.0

    def changes(self, case: Case) -> list[Change]:
        """The load is added."""
        where = f"load step at bus {self.bus}"
        check_time(where, "time", self.time)
        check_bus(where, case, self.bus)
        for name in ("active_mw", "reactive_mvar"):
            if not math.isfinite(getattr(self, name)):
                raise EventError(f"{where}: {name} must be finite, not {getattr(self, name)!r}")
        step = complex(self.active_mw, self.reactive_mvar)

        def apply(state: NetworkState) -> NetworkState:
            added = dict(state.load_steps)
            added[self.bus] = added.get(self.bus, 0j) + step
            return replace(state, load_steps=tuple(item for item in added.items() if item[1]))

        label = f"load at bus {self.bus} {self.active_mw:+g} MW {self.reactive_mvar:+g} Mvar"
        return [Change(self.time, label, apply, (self.bus,))]


#: Name of each kind of event in files and on the command line.
EVENTS: Mapping[str, type] = {
    "bus-fault": BusFault,
    "branch-fault": BranchFault,
    "branch-trip": BranchTrip,
    "branch-reclose": BranchReclose,
    "machine-trip": MachineTrip,
    "load-step": LoadStep,
}
