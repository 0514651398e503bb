"""Trials of several bisections: those that are due, then those that may become so.

What a bisection does not ask for yet may be tried where there is room for it. That changes how many
runs there are, never the clearing time: only the trials that the bisection asks for count.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from math import nan
from typing import NamedTuple

from gridfold.errors import GridfoldError
from gridfold.grid.case import UnitKey
from gridfold.runs.clearing.found import ClearingTime, Fault
from gridfold.runs.clearing.search import Search, TimeGrid
from gridfold.runs.trajectory import Trajectory
from gridfold.systems.status import Status

_MACHINE_DECIDED = (Status.LOST_SYNCHRONISM, Status.OFF_SPEED)


class Trial(NamedTuple):
    """A clearing time that is tried: position of the fault, steps of the grid of times."""

    place: int
    steps: int


@dataclass(frozen=True)
class Verdict:
    """What a trial came to; `reason` says why there is no run."""

    status: Status | None
    machine: UnitKey | None = None
    reason: str = ""

    @property
    def stable(self) -> bool:
        """Whether synchronism was kept until the end."""
        return self.status is Status.COMPLETED


def verdict_of(outcome: Trajectory | GridfoldError) -> Verdict:
    """What is kept of a run, or of why there is none."""
    if isinstance(outcome, GridfoldError):
        return Verdict(None, reason=" ".join(str(outcome).split()))
    machine = None
    if outcome.status in _MACHINE_DECIDED and outcome.culprit is not None:
        bus, _, name = outcome.culprit.partition(":")[2].partition(":")
        machine = UnitKey(int(bus), name)
    return Verdict(outcome.status, machine)


@dataclass
class _Place:
    """One fault: its search, verdicts by steps, steps that are being tried."""

    search: Search
    known: dict[int, Verdict] = field(default_factory=dict)
    flying: set[int] = field(default_factory=set)
    reason: str = ""

    @property
    def trial(self) -> int | None:
        """Steps that the search asks for."""
        return None if self.reason else self.search.trial

    def take(self, steps: int, verdict: Verdict) -> None:
        """Go on with a verdict, as far as verdicts are known."""
        self.flying.discard(steps)
        self.known[steps] = verdict
        while (asked := self.trial) in self.known:
            assert asked is not None
            self.reason = self.known[asked].reason
            if not self.reason:
                self.search = self.search.after(self.known[asked].stable)

    def ahead(self) -> int | None:
        """Steps that the search may ask for later and that nobody tries yet."""
        stable = {steps: verdict.stable for steps, verdict in self.known.items()}
        later = (steps for steps in self.search.ahead(stable) if steps not in self.flying)
        return next(later, None)


class Trials:
    """The bisections of some faults.

    A trial that is handed out, by :meth:`due` or :meth:`ahead`, is under way until :meth:`take`. Of
    every place that is not found one at least is under way or due.
    """

    def __init__(self, faults: Sequence[Fault], grid: TimeGrid):
        self.faults, self.grid = faults, grid
        self._places = [_Place(grid.search) for _ in faults]
        self._due = deque(range(len(faults)))
        self._open = dict.fromkeys(range(len(faults)))
        self.under_way = 0

    def event(self, trial: Trial) -> Fault:
        """The fault of a trial."""
        return replace(self.faults[trial.place], duration=self.grid.seconds(trial.steps))

    def due(self) -> Trial | None:
        """The next trial that a bisection asks for; None if all of them are under way."""
        if not self._due:
            return None
        place = self._due.popleft()
        steps = self._places[place].trial
        assert steps is not None
        return self._begin(place, steps)

    def ahead(self) -> Trial | None:
        """A trial that may be asked for later, of the place that is looked at the least.

        It is for the time in which nothing is due.
        """
        for place in sorted(self._open, key=lambda k: len(self._places[k].flying)):
            steps = self._places[place].ahead()
            if steps is not None:
                return self._begin(place, steps)
        return None

    def take(self, trial: Trial, verdict: Verdict) -> bool:
        """Go on with what a trial came to; whether its clearing time is found now, or cannot be."""
        self.under_way -= 1
        number, place = trial.place, self._places[trial.place]
        place.take(trial.steps, verdict)
        if number not in self._open:
            return False
        if place.trial is None:
            del self._open[number]
            return True
        if place.trial not in place.flying and number not in self._due:
            self._due.appendleft(number)
        return False

    @property
    def found(self) -> list[ClearingTime]:
        """The clearing times that are known, in the order of the faults."""
        return [self.time(k) for k in range(len(self.faults)) if k not in self._open]

    def time(self, number: int) -> ClearingTime:
        """The clearing time of a fault that is found."""
        place, fault = self._places[number], self.faults[number]
        runs, search = len(place.known), place.search
        if place.reason:
            return ClearingTime(fault, nan, False, runs, reason=place.reason)
        seconds = self.grid.seconds(search.low)
        fault = replace(fault, duration=seconds) if search.low else fault
        if not search.lost:
            return ClearingTime(fault, seconds, False, runs)
        after = place.known[search.high]
        lost_at = self.grid.seconds(search.high)
        return ClearingTime(fault, seconds, True, runs, lost_at, after.machine, after.status)

    def _begin(self, place: int, steps: int) -> Trial:
        self._places[place].flying.add(steps)
        self.under_way += 1
        return Trial(place, steps)
