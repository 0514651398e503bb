"""Relays of branches: they go by the impedance that is seen at one end."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from gridfold.errors import EventError
from gridfold.grid.case import Case
from gridfold.grid.event_checks import check_time, find_branch, open_branches, open_end
from gridfold.grid.measurements import Blinders, Mho
from gridfold.grid.network_state import NetworkState
from gridfold.grid.relay import Element, Relay, require_positive


@dataclass(frozen=True)
class DistanceRelay(Relay):
    """A distance relay of a branch with two mho zones, which opens the branch at its own end.

    A zone is picked up while the impedance that the relay sees lies in the circle through the origin
    whose diameter is `reach` times the series impedance of the branch.

    Parameters
    ----------
    branch : str
        ``FROM-TO`` or ``FROM-TO:CIRCUIT``.
    bus : int
        The end at which it stands.
    reach_1, delay_1, reach_2, delay_2 : float
        Reach as a part of the branch, and delay in s with the time of the breaker, of the two zones.
    transfer_trip : bool
        Whether the other end opens with it.
    """

    branch: str
    bus: int
    reach_1: float = 0.8
    delay_1: float = 0.05
    reach_2: float = 1.2
    delay_2: float = 0.35
    transfer_trip: bool = False

    def elements(self, case: Case) -> list[Element]:
        """One for each zone."""
        where = f"distance relay of branch {self.branch} at bus {self.bus}"
        position, end = _end_of(case, self.branch, self.bus, where)
        zones = ((1, self.reach_1, self.delay_1), (2, self.reach_2, self.delay_2))
        result = []
        for zone, reach, delay in zones:
            require_positive(where, **{f"reach_{zone}": reach})
            check_time(where, f"delay_{zone}", delay)
            label = f"{where}, zone {zone}: {'tripped' if self.transfer_trip else 'opened'}"
            result.append(
                Element(
                    label,
                    Mho(position, end, reach),
                    delay,
                    _tripping(position) if self.transfer_trip else _opening(position, end),
                    _ends(case, position),
                )
            )
        return result


@dataclass(frozen=True)
class OutOfStepRelay(Relay):
    """An out-of-step relay of a branch, which trips it: two pairs of blinders beside the branch.

    The impedance that the relay sees, Z, is looked at along the branch and across it, in parts of its
    series impedance. A swing comes slowly through the outer blinders to the inner ones, a fault at
    once: the branch trips where Z gets within the inner blinders `delay` or more after it came within
    the outer ones.

    Parameters
    ----------
    branch : str
        ``FROM-TO`` or ``FROM-TO:CIRCUIT``.
    bus : int
        The end at which it stands.
    outer, inner : float
        Distances of the blinders from the branch.
    delay : float
        Least time between them, in seconds.
    reach : float
        By how much the blinders stand out beyond both ends of the branch.
    """

    branch: str
    bus: int
    outer: float = 2.0
    inner: float = 1.0
    delay: float = 0.03
    reach: float = 0.5

    def elements(self, case: Case) -> list[Element]:
        """One."""
        where = f"out-of-step relay of branch {self.branch} at bus {self.bus}"
        position, end = _end_of(case, self.branch, self.bus, where)
        check_time(where, "delay", self.delay)
        check_time(where, "reach", self.reach)
        require_positive(where, outer=self.outer, inner=self.inner)
        if self.inner >= self.outer:
            raise EventError(
                f"{where}: inner {self.inner:g} must be less than outer {self.outer:g}"
            )
        seen = Blinders(position, end, self.outer, self.inner, self.reach)
        label = f"{where}: tripped"
        ends = _ends(case, position)
        return [Element(label, seen, self.delay, _tripping(position), ends)]


def _end_of(case: Case, branch: str, bus: int, where: str) -> tuple[int, int]:
    """Position of a branch with an impedance, and its end at a bus."""
    position, _ = find_branch(case, branch, where)
    ends = _ends(case, position)
    if bus not in ends:
        raise EventError(f"{where}: its ends are buses {ends[0]} and {ends[1]}")
    if case.branches[position].joins:
        raise EventError(f"{where}: the branch has no impedance, of which reaches are parts")
    return position, ends.index(bus)


def _ends(case: Case, position: int) -> tuple[int, int]:
    branch = case.branches[position]
    return branch.from_bus, branch.to_bus


def _opening(position: int, end: int) -> Callable[[NetworkState], NetworkState]:
    return lambda state: open_end(state, position, end)


def _tripping(position: int) -> Callable[[NetworkState], NetworkState]:
    return lambda state: open_branches(state, frozenset({position}))
