"""The critical clearing time of one fault, by one run after the other."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from gridfold.dynamics.model import DetailedModel
from gridfold.grid.events import Event
from gridfold.numerics.steppers import Stepper
from gridfold.runs.clearing.found import ClearingTime, Fault, require_faults
from gridfold.runs.clearing.search import TimeGrid
from gridfold.runs.clearing.trials import Trials, verdict_of
from gridfold.runs.simulate import ModelStore, simulate
from gridfold.runs.synchronism import DEFAULT_CRITERION, SynchronismCriterion
from gridfold.runs.trajectory import Trajectory


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
    require_faults([fault])
    trials = Trials([fault], TimeGrid(resolution, longest, t_end))
    store: ModelStore = {}
    while (trial := trials.due()) is not None:
        run = simulator(
            model, [trials.event(trial)], fault.start + t_end, stepper, criterion, store
        )
        trials.take(trial, verdict_of(run))
    return trials.found[0]
