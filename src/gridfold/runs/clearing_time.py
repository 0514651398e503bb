"""Critical clearing times by bisection."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass, replace
from typing import Any, Protocol

from gridfold.dynamics.model import DetailedModel
from gridfold.errors import GridfoldError, OptionError
from gridfold.grid.events import BranchFault, BusFault, Event
from gridfold.numerics.lanes import WIDTH
from gridfold.numerics.steppers import Stepper
from gridfold.runs.batch import FEWEST_TOGETHER, simulate_chains, why_single
from gridfold.runs.method import fit_stepper
from gridfold.runs.simulate import ModelStore, simulate
from gridfold.runs.synchronism import DEFAULT_CRITERION, SynchronismCriterion
from gridfold.runs.trajectory import Trajectory
from gridfold.systems.status import Status

Fault = BusFault | BranchFault

#: Finest grid of clearing times in seconds.
_FINEST = 1e-6
#: Faults whose clearing times are looked for side by side.
_SIDE_BY_SIDE = 32
#: First clearing time that is tried, in seconds.
_FIRST_TRY = 0.16


class Simulator(Protocol):
    """Simulates a disturbance on some model of the system; :func:`gridfold.simulate` is one."""

    def __call__(
        self,
        model: DetailedModel,
        events: Sequence[Event],
        t_end: float,
        stepper: Stepper | None,
        criterion: SynchronismCriterion | None,
        store: ModelStore | None,
        /,
    ) -> Trajectory:
        """Simulate; arguments as in :func:`gridfold.simulate`."""


@dataclass(frozen=True)
class ClearingTime:
    """Critical clearing time of one fault.

    Parameters
    ----------
    fault : BusFault or BranchFault
        The fault; its duration is the critical clearing time.
    seconds : float
        Largest clearing time of the grid for which no machine loses synchronism; 0 if there is none.
    bounded : bool
        False if even the longest clearing time that was tried is stable.
    runs : int
        Simulations made.
    """

    fault: Fault
    seconds: float
    bounded: bool
    runs: int


def critical_clearing_time(
    model: DetailedModel,
    fault: Fault,
    resolution: float = 0.01,
    longest: float = 2.0,
    t_end: float = 16.0,
    stepper: Stepper | None = None,
    criterion: SynchronismCriterion = DEFAULT_CRITERION,
    simulator: Simulator = simulate,
) -> ClearingTime:
    """Largest clearing time, on a grid, for which no machine loses synchronism.

    Stability is taken to be monotonous in the clearing time, as always in a bisection: the result is
    stable and one step of the grid longer is not.

    Parameters
    ----------
    model : DetailedModel
        The intact system at its equilibrium.
    fault : BusFault or BranchFault
        The fault; its duration is ignored.
    resolution : float
        Step of the grid of clearing times in seconds.
    longest : float
        Longest clearing time tried, in seconds.
    t_end : float
        End of each run in seconds after the fault starts.
    stepper : Stepper, optional
        Integration rule; by default as in :func:`gridfold.simulate`.
    criterion : SynchronismCriterion
        When synchronism counts as lost.
    simulator : callable
        What simulates a disturbance; the detailed model by default.
    """
    search = Search(fault, resolution, longest, t_end)
    store: ModelStore = {}
    while (event := search.trial) is not None:
        run = simulator(model, [event], fault.start + t_end, stepper, criterion, store)
        search.take(run.status is Status.COMPLETED)
    return search.found


class Search:
    """A bisection for one fault, which says what is to be tried and is told what came of it."""

    def __init__(self, fault: Fault, resolution: float, longest: float, t_end: float):
        for name, value in (("resolution", resolution), ("longest", longest), ("t_end", t_end)):
            if not (math.isfinite(value) and value > 0):
                raise OptionError(f"{name} must be a positive number of seconds, not {value!r}")
        if resolution < _FINEST:
            raise OptionError(
                f"the resolution of clearing times must be {_FINEST:g} s or more, not "
                f"{resolution:g} s"
            )
        if not resolution <= longest < t_end:
            raise OptionError(
                f"the longest clearing time {longest:g} s must lie between the resolution "
                f"{resolution:g} s and the end of the run {t_end:g} s"
            )
        self.fault, self.resolution = fault, resolution
        self.most = math.floor(longest / resolution + 1e-9)
        self.low, self.high = 0, min(self.most, max(1, round(_FIRST_TRY / resolution)))
        self.lost, self.runs = False, 0

    @property
    def trial(self) -> Fault | None:
        """The fault that is to be tried next; None when the time is found."""
        if self.low == self.most or (self.lost and self.high - self.low <= 1):
            return None
        return replace(self.fault, duration=self._steps * self.resolution)

    def take(self, stable: bool) -> None:
        """Whether the trial was stable."""
        steps = self._steps
        self.runs += 1
        if not stable:
            self.high, self.lost = steps, True
        else:
            self.low = steps
            if not self.lost:
                self.high = min(2 * steps, self.most)

    @property
    def found(self) -> ClearingTime:
        """The critical clearing time."""
        seconds = round(self.low * self.resolution, 9)
        critical = replace(self.fault, duration=seconds) if self.low else self.fault
        return ClearingTime(critical, seconds, self.low < self.most, self.runs)

    @property
    def _steps(self) -> int:
        return (self.low + self.high) // 2 if self.lost else self.high


def critical_clearing_times(
    model: DetailedModel,
    faults: Sequence[Fault],
    workers: int | None = None,
    on_done: Callable[[ClearingTime], None] | None = None,
    **options: Any,
) -> list[ClearingTime]:
    """Critical clearing times of many faults, on all cores; `options` as above.

    `on_done` is called with each result as it comes in; the list is in the order of `faults`.
    """
    for fault in faults:
        fault.changes(model.case)
    count = workers or os.cpu_count() or 1
    size = _together(model, faults, count, options)
    shares = [faults[k : k + size] for k in range(0, len(faults), size)]
    with ThreadPoolExecutor(count) as pool:
        solve = _times_together if size > 1 else _times_alone
        tasks = [pool.submit(solve, model, share, options) for share in shares]
        for task in as_completed(tasks):
            if on_done is not None:
                for found in task.result():
                    on_done(found)
        return [found for task in tasks for found in task.result()]


def _together(
    model: DetailedModel, faults: Sequence[Fault], workers: int, options: Mapping[str, Any]
) -> int:
    """How many faults are looked at side by side: 1 where their runs stay alone."""
    starts = {fault.start for fault in faults}
    if "simulator" in options or len(faults) < FEWEST_TOGETHER or len(starts) > 1:
        return 1
    stepper = fit_stepper(model, options.get("stepper")).stepper
    if why_single(model, stepper) is not None:
        return 1
    return min(_SIDE_BY_SIDE, -(-len(faults) // (workers * WIDTH)) * WIDTH)


def _times_alone(
    model: DetailedModel, faults: Sequence[Fault], options: Mapping[str, Any]
) -> list[ClearingTime]:
    return [critical_clearing_time(model, fault, **options) for fault in faults]


def _times_together(
    model: DetailedModel, faults: Sequence[Fault], options: Mapping[str, Any]
) -> list[ClearingTime]:
    """The bisections of some faults that begin at one time, side by side."""
    resolution, longest = options.get("resolution", 0.01), options.get("longest", 2.0)
    t_end: float = options.get("t_end", 16.0)
    searches = [Search(fault, resolution, longest, t_end) for fault in faults]

    def trial(number: int) -> tuple[Fault] | None:
        event = searches[number].trial
        return None if event is None else (event,)

    def follow(number: int, outcome: Trajectory | GridfoldError) -> tuple[Fault] | None:
        if isinstance(outcome, GridfoldError):
            raise outcome
        searches[number].take(outcome.status is Status.COMPLETED)
        return trial(number)

    first = [event for number in range(len(faults)) if (event := trial(number)) is not None]
    runs = simulate_chains(
        model,
        first,
        follow,
        faults[0].start + t_end,
        options.get("stepper"),
        options.get("criterion", DEFAULT_CRITERION),
        voltages=False,
    )
    for _ in runs:
        pass
    return [search.found for search in searches]
