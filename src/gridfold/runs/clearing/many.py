"""Critical clearing times of many faults, on all cores, side by side where that pays."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass
from pathlib import Path
from queue import SimpleQueue
from threading import Event as Flag
from typing import Any

from gridfold.dynamics.model import DetailedModel
from gridfold.errors import GridfoldError
from gridfold.grid.events import Event
from gridfold.numerics.blas import one_blas_thread
from gridfold.numerics.lanes import WIDTH
from gridfold.numerics.steppers import Stepper
from gridfold.runs.batch import simulate_chains, why_single
from gridfold.runs.clearing.found import ClearingTime, ClearingTimes, Fault, require_faults
from gridfold.runs.clearing.kept import kept_times
from gridfold.runs.clearing.search import TimeGrid
from gridfold.runs.clearing.single import Simulator
from gridfold.runs.clearing.trials import Trial, Trials, Verdict, verdict_of
from gridfold.runs.method import fit_stepper
from gridfold.runs.simulate import ModelStore, simulate
from gridfold.runs.synchronism import DEFAULT_CRITERION, SynchronismCriterion
from gridfold.runs.trajectory import Trajectory

#: Places from which it pays to have their trials side by side.
FEWEST_PLACES = 4
#: Places that one worker looks at together: four for each member of a batch.
_SIDE_BY_SIDE = 4 * WIDTH
#: Seconds after which a wait is broken off to see whether the work is to be stopped.
_GLANCE = 0.2

Told = Callable[[ClearingTime], None]


@one_blas_thread
def critical_clearing_times(
    model: DetailedModel,
    faults: Sequence[Fault],
    workers: int | None = None,
    on_done: Told | None = None,
    *,
    resolution: float = 0.01,
    longest: float = 2.0,
    t_end: float = 16.0,
    stepper: Stepper | None = None,
    criterion: SynchronismCriterion = DEFAULT_CRITERION,
    simulator: Simulator = simulate,
    out: str | Path | None = None,
    resume: bool = False,
    settings: Mapping[str, Any] | None = None,
    stop: Flag | None = None,
) -> ClearingTimes:
    """Critical clearing times of many faults: the map of a grid.

    Each is what :func:`critical_clearing_time` finds. Trials of the detailed model advance together in
    batches: one trial of each place where there are many places, several of one place where there are
    few. Cores that would be idle try what may be asked for next.

    Parameters
    ----------
    model, resolution, longest, t_end, stepper, criterion, simulator
        As for :func:`critical_clearing_time`.
    faults : sequence of BusFault or BranchFault
        Where the faults are.
    workers : int, optional
        Threads; as many as there are cores by default.
    on_done : callable, optional
        Called with each :class:`ClearingTime` as it is found.
    out : path, optional
        Folder in which each is written as it is found; :func:`gridfold report <gridfold.cli>` reads it.
    resume : bool
        Go on with what the folder holds; without it the folder must not hold clearing times.
    settings : mapping, optional
        Further facts that the times hang on, ready for JSON, such as the model of `simulator`.
    stop : threading.Event, optional
        Ends the work early once it is set.

    Returns
    -------
    ClearingTimes
        In the order of `faults`. A place whose runs go wrong has a reason, and ends nothing.

    Raises
    ------
    EventError
        A fault does not fit the case; nothing has run then.
    OptionError
        Times make no sense, or the folder holds others.
    """
    require_faults(faults)
    for fault in faults:
        fault.changes(model.case)
    grid = TimeGrid(resolution, longest, t_end)
    method = fit_stepper(model, stepper)
    work = _Work(model, grid, method.stepper, criterion, simulator, stop or Flag())
    facts = {
        **vars(grid),
        "method": method.stepper.name,
        "step": method.stepper.step,
        "criterion": str(criterion),
        **(settings or {}),
    }
    with kept_times(model.case, faults, facts, out, resume) as kept:
        left = [fault for number, fault in enumerate(faults) if number not in kept.known]
        places = [number for number in range(len(faults)) if number not in kept.known]
        alone = work.why_alone(left)
        runs = work.together if alone is None else work.alone
        for k, found in runs(left, workers or os.cpu_count() or 1):
            kept.add(places[k], found)
            if on_done is not None:
                on_done(found)
        known = kept.known
    waiting = tuple(fault for number, fault in enumerate(faults) if number not in known)
    items = tuple(known[number] for number in sorted(known))
    words = _words(alone, len(left))
    return ClearingTimes(model.case, items, waiting, facts, words)


def _words(alone: str | None, places: int) -> str:
    """How the trials were run."""
    if alone is not None:
        return f"one by one: {alone}"
    if places < WIDTH:
        return f"{WIDTH} side by side, several clearing times of a place at once"
    return f"{WIDTH} side by side, one clearing time of each place at once"


@dataclass(frozen=True)
class _Work:
    """What the trials of all places share."""

    model: DetailedModel
    grid: TimeGrid
    stepper: Stepper
    criterion: SynchronismCriterion
    simulator: Simulator
    stop: Flag

    def why_alone(self, faults: Sequence[Fault]) -> str | None:
        """Why trials are run one by one; None if they advance together."""
        if self.simulator is not simulate:
            return "they are not of the detailed model"
        if len(faults) < FEWEST_PLACES:
            return "there are few places"
        if len({fault.start for fault in faults}) > 1:
            return "the faults begin at several times"
        return why_single(self.model, self.stepper)

    def alone(self, faults: Sequence[Fault], workers: int) -> Iterator[tuple[int, ClearingTime]]:
        """Clearing times by runs of their own, one a thread; yields the number of a fault, too."""
        trials = Trials(faults, self.grid)
        flying: dict[Future[Verdict], Trial] = {}
        stores: dict[int, ModelStore] = {}
        with ThreadPoolExecutor(workers) as pool:
            while not self.stop.is_set():
                while len(flying) < workers and (trial := trials.due() or trials.ahead()):
                    store = stores.setdefault(trial.place, {})
                    flying[pool.submit(self._run, trials.event(trial), store)] = trial
                if not flying:
                    return
                done, _ = wait(flying, _GLANCE, FIRST_COMPLETED)
                for future in done:
                    trial = flying.pop(future)
                    if trials.take(trial, future.result()):
                        stores.pop(trial.place, None)
                        yield trial.place, trials.time(trial.place)

    def _run(self, fault: Fault, store: ModelStore) -> Verdict:
        """One trial by itself."""
        end = fault.start + self.grid.t_end
        try:
            return verdict_of(
                self.simulator(self.model, [fault], end, self.stepper, self.criterion, store)
            )
        except GridfoldError as error:
            return verdict_of(error)

    def together(self, faults: Sequence[Fault], workers: int) -> Iterator[tuple[int, ClearingTime]]:
        """Clearing times by batches, one a thread; yields the number of a fault, too."""
        size = min(_SIDE_BY_SIDE, -(-len(faults) // (workers * WIDTH)) * WIDTH)
        shares = [range(k, min(k + size, len(faults))) for k in range(0, len(faults), size)]
        queue: SimpleQueue[tuple[int, ClearingTime] | None] = SimpleQueue()

        def solve(share: range) -> None:
            try:
                batch = _Batch(self, [faults[k] for k in share])
                for place, found in batch.run():
                    queue.put((share[place], found))
            finally:
                queue.put(None)

        with ThreadPoolExecutor(workers) as pool:
            tasks = [pool.submit(solve, share) for share in shares]
            try:
                ended = 0
                while ended < len(tasks):
                    item = queue.get()
                    if item is None:
                        ended += 1
                    else:
                        yield item
            except BaseException:
                self.stop.set()
                raise
            for task in tasks:
                task.result()


class _Batch:
    """The trials of some places in the lanes of one batch."""

    def __init__(self, work: _Work, faults: Sequence[Fault]):
        self.work, self.trials = work, Trials(faults, work.grid)
        self.lanes: dict[int, Trial] = {}
        self.found: list[int] = []

    def run(self) -> Iterator[tuple[int, ClearingTime]]:
        """The clearing times as they are found, with the positions of their faults."""
        work, trials = self.work, self.trials
        if work.stop.is_set():
            return
        first: list[tuple[Event]] = []
        while (trial := self._next()) is not None:
            self.lanes[len(first)] = trial
            first.append((trials.event(trial),))
        runs = simulate_chains(
            work.model,
            first,
            self._follow,
            trials.faults[0].start + work.grid.t_end,
            work.stepper,
            work.criterion,
            voltages=False,
        )
        for _ in runs:
            yield from self._told()
            if work.stop.is_set():
                return
        yield from self._told()

    def _follow(self, lane: int, outcome: Trajectory | GridfoldError) -> tuple[Event] | None:
        """What a lane tries next."""
        trial = self.lanes.pop(lane)
        if self.trials.take(trial, verdict_of(outcome)):
            self.found.append(trial.place)
        following = None if self.work.stop.is_set() else self._next()
        if following is None:
            return None
        self.lanes[lane] = following
        return (self.trials.event(following),)

    def _next(self) -> Trial | None:
        """A trial that is due, or while there are fewer of them than lanes one that may become so."""
        trial = self.trials.due()
        if trial is None and self.trials.under_way < WIDTH:
            trial = self.trials.ahead()
        return trial

    def _told(self) -> Iterator[tuple[int, ClearingTime]]:
        """Those that were found since the last time."""
        places, self.found = self.found, []
        for place in places:
            yield place, self.trials.time(place)
