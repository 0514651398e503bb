"""Events of branches: faults, trips, opening at one end, reclosing.

Branches are named ``FROM-TO`` or ``FROM-TO:CIRCUIT``, from either end.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from gridfold.errors import EventError
from gridfold.grid.case import Case
from gridfold.grid.change import Change
from gridfold.grid.event_checks import (
    check_impedance,
    check_time,
    check_window,
    close_branch,
    find_branch,
    open_branches,
    open_end,
    require_closed,
)
from gridfold.grid.network_state import BranchFaultPoint, NetworkState

#: Fractions that are closer to an end than this are at it.
_AT_END = 1e-9


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
    far_duration : float, optional
        Time after the start, in seconds, at which the branch opens at the bus named second, where that
        is not when it opens at the first. From the first opening on the branch stands open at one end,
        with the fault still on it.
    """

    branch: str
    start: float = 0.0
    duration: float = 0.1
    fraction: float = 0.0
    resistance: float = 0.0
    reactance: float = 0.0
    trip: bool = True
    far_duration: float | None = None

    def changes(self, case: Case) -> list[Change]:
        """Fault on; fault off and branch out, at once or one end after the other."""
        where = f"fault on branch {self.branch}"
        check_window(where, self.start, self.duration)
        check_impedance(where, self.resistance, self.reactance)
        if not 0 <= self.fraction <= 1:
            raise EventError(f"{where}: fraction must lie between 0 and 1, not {self.fraction!r}")
        if self.far_duration is not None:
            check_window(where, self.start, self.far_duration, "far_duration")
            if not self.trip:
                raise EventError(
                    f"{where}: far_duration is of a branch that trips, but trip is false"
                )
        position, turned = find_branch(case, self.branch, where)
        branch = case.branches[position]
        ends = branch.from_bus, branch.to_bus
        fraction = 1 - self.fraction if turned else self.fraction
        if abs(fraction - round(fraction)) < _AT_END:
            fraction = float(round(fraction))
        point = BranchFaultPoint(position, fraction, complex(self.resistance, self.reactance))

        def put_on(state: NetworkState) -> NetworkState:
            require_closed(state, position, where, self.start)
            if any(other.branch == position for other in state.branch_faults):
                raise EventError(f"{where}: the branch is faulted already at {self.start:g} s")
            faulted = replace(state, branch_faults=state.branch_faults | {point})
            buses = [bus for bus, _ in faulted.bus_shorts(case)]
            for bus in ends:
                if buses.count(bus) > 1 and point.at_end == ends.index(bus):
                    raise EventError(f"{where}: bus {bus} is faulted already at {self.start:g} s")
            return faulted

        def clear(state: NetworkState) -> NetworkState:
            cleared = replace(state, branch_faults=state.branch_faults - {point})
            return open_branches(cleared, frozenset({position})) if self.trip else cleared

        on = Change(self.start, where, put_on, ends)
        end = self.start + self.duration
        if self.far_duration in (None, self.duration):
            cleared = f"branch {self.branch} tripped" if self.trip else f"{where} cleared"
            return [on, Change(end, cleared, clear)]
        far_end = self.start + (self.far_duration or 0.0)
        (first, side), (last, _) = sorted([(end, int(turned)), (far_end, 1 - int(turned))])
        return [
            on,
            Change(
                first,
                f"branch {self.branch} opened at bus {ends[side]}",
                lambda state: open_end(state, position, side),
            ),
            Change(last, f"branch {self.branch} tripped", clear),
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
class BranchOpenEnd:
    """A branch (``FROM-TO`` or ``FROM-TO:CIRCUIT``) opens at one end, `bus`, at `time` (s).

    It stays energized from the other end, with its charging and what stands at its ends. Where the
    other end is open already, the branch is out of service then.
    """

    branch: str
    bus: int
    time: float = 0.0

    def changes(self, case: Case) -> list[Change]:
        """One end opens."""
        where = f"opening of branch {self.branch} at bus {self.bus}"
        check_time(where, "time", self.time)
        position, _ = find_branch(case, self.branch, where)
        branch = case.branches[position]
        ends = branch.from_bus, branch.to_bus
        if self.bus not in ends:
            raise EventError(f"{where}: its ends are buses {ends[0]} and {ends[1]}")

        def apply(state: NetworkState) -> NetworkState:
            if position in case.branches_out:
                require_closed(state, position, where, self.time)
            return open_end(state, position, ends.index(self.bus))

        return [Change(self.time, f"branch {self.branch} opened at bus {self.bus}", apply, ends)]


@dataclass(frozen=True)
class BranchReclose:
    """A branch (``FROM-TO`` or ``FROM-TO:CIRCUIT``) that is open is closed at `time` (s).

    It is closed at both ends, also where one alone was open.
    """

    branch: str
    time: float = 0.0

    def changes(self, case: Case) -> list[Change]:
        """The branch comes back into service."""
        where = f"reclosing of branch {self.branch}"
        check_time(where, "time", self.time)
        position, _ = find_branch(case, self.branch, where)

        def apply(state: NetworkState) -> NetworkState:
            if position not in state.severed:
                raise EventError(f"{where}: it is not open at {self.time:g} s")
            return close_branch(state, position)

        branch = case.branches[position]
        ends = branch.from_bus, branch.to_bus
        return [Change(self.time, f"branch {self.branch} reclosed", apply, ends)]
