"""Critical clearing times by bisection."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass, replace
from typing import Protocol

from gridfold.dynamics.model import DetailedModel
from gridfold.errors import OptionError
from gridfold.grid.events import BranchFault, BusFault, Event
from gridfold.numerics.steppers import Stepper
from gridfold.runs.simulate import ModelStore, simulate
from gridfold.runs.synchronism import DEFAULT_CRITERION, SynchronismCriterion
from gridfold.runs.trajectory import Trajectory
from gridfold.systems.status import Status

Fault = BusFault | BranchFault

#: Finest grid of clearing times in seconds.
_FINEST = 1e-6
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
    for name, value in (("resolution", resolution), ("longest", longest), ("t_end", t_end)):
        if not (math.isfinite(value) and value > 0):
            raise OptionError(f"{name} must be a positive number of seconds, not {value!r}")
    if resolution < _FINEST:
        raise OptionError(
            f"the resolution of clearing times must be {_FINEST:g} s or more, not {resolution:g} s"
        )
    if not resolution <= longest < t_end:
        raise OptionError(
            f"the longest clearing time {longest:g} s must lie between the resolution "
            f"{resolution:g} s and the end of the run {t_end:g} s"
        )
    store: ModelStore = {}
    outcomes: dict[int, bool] = {}

    def stable(steps: int) -> bool:
        if steps not in outcomes:
            event = replace(fault, duration=steps * resolution)
            run = simulator(model, [event], fault.start + t_end, stepper, criterion, store)
            outcomes[steps] = run.status is Status.COMPLETED
        return outcomes[steps]

    most = math.floor(longest / resolution + 1e-9)
    low, high = 0, min(most, max(1, round(_FIRST_TRY / resolution)))
    while stable(high) and high < most:
        low, high = high, min(2 * high, most)
    if stable(high):
        low = high
    else:
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (middle, high) if stable(middle) else (low, middle)
    seconds = round(low * resolution, 9)
    critical = replace(fault, duration=seconds) if low else fault
    return ClearingTime(critical, seconds, low < most, len(outcomes))


def critical_clearing_times(
    model: DetailedModel,
    faults: Sequence[Fault],
    workers: int | None = None,
    on_done: Callable[[ClearingTime], None] | None = None,
    **options: object,
) -> list[ClearingTime]:
    """Critical clearing times of many faults, on all cores; `options` as above.

    `on_done` is called with each result as it comes in; the list is in the order of `faults`.
    """
    for fault in faults:
        fault.changes(model.case)
    with ThreadPoolExecutor(workers or os.cpu_count()) as pool:
        tasks = [
            pool.submit(critical_clearing_time, model, fault, **options)  # type: ignore[arg-type]
            for fault in faults
        ]
        for task in as_completed(tasks):
            if on_done is not None:
                on_done(task.result())
        return [task.result() for task in tasks]
