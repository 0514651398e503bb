"""Many runs of one model: a longer step, where a trial shows that its error is small.

Over 0.02 s Runge-Kutta needs eight evaluations with its usual step, four with one of 0.02 s, and
Adams-Bashforth-Moulton two. A trial takes the time of six to eight runs.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gridfold.dynamics.model import DetailedModel
from gridfold.errors import OptionError
from gridfold.grid.events import BranchFault, BusFault, Event
from gridfold.numerics.steppers import AdamsBashforthMoulton4, RungeKutta4, Stepper
from gridfold.runs.method import Choice, Method, choose_stepper, fault_doubt
from gridfold.runs.simulate import simulate
from gridfold.runs.size import check_times
from gridfold.runs.synchronism import DEFAULT_CRITERION, SynchronismCriterion
from gridfold.runs.trajectory import AngleReference, Trajectory
from gridfold.systems.status import Status

#: Root mean square error of the worst rotor angle against the centre of inertia that a longer step may
#: make, in degrees, and the part of it that the trial may show: other disturbances may err more.
LARGEST_ERROR_DEG, TRIED_PART = 0.05, 1 / 3
#: Rules that are tried, the cheapest first.
LONGER = (AdamsBashforthMoulton4(0.02), RungeKutta4(0.02))
#: Runs from which on a trial pays, and disturbances that it looks at.
PAYS_FROM, TRIALS = 25, 4


def choose_for_many(
    model: DetailedModel,
    disturbances: Sequence[Sequence[Event]],
    method: Method | str = Method.AUTO,
    step: float | None = None,
    *,
    runs: int | None = None,
    t_end: float = 16.0,
    criterion: SynchronismCriterion | None = DEFAULT_CRITERION,
) -> Choice:
    """The stepper of a method for many runs; AUTO tries longer steps.

    Parameters
    ----------
    model : DetailedModel
        The model that all runs start from.
    disturbances : sequence of sequences of Event
        What is to be simulated; a few spread evenly over it are tried.
    method, step
        As in :func:`gridfold.choose_stepper`; the trial is made with AUTO and no step of the user's.
    runs : int, optional
        How many runs there will be; by default as many as disturbances.
    t_end, criterion
        Of the runs.
    """
    choice = choose_stepper(model, method, step)
    check_times(t_end, choice.stepper.step)
    fixed = Method(method) is not Method.AUTO or step is not None
    count = len(disturbances) if runs is None else runs
    if fixed or not isinstance(choice.stepper, RungeKutta4) or count < PAYS_FROM:
        return choice
    usual, shortest = choice.stepper, shortest_fault(disturbances)
    tried = disturbances[:: -(-len(disturbances) // TRIALS)]
    short = [simulate(model, events, t_end, usual, criterion) for events in tried]
    for longer in LONGER:
        if not _suits(model, longer) or fault_doubt(longer, shortest) is not None:
            continue
        error = angle_error_deg(
            short, [simulate(model, run.events, t_end, longer, criterion) for run in short]
        )
        if error <= TRIED_PART * LARGEST_ERROR_DEG:
            text = f"{longer.name} at {longer.step:g} s: at most {error:.2g} degree from "
            text += f"{usual.name} at {usual.step:g} s in {len(tried)} trial runs"
            return Choice(longer, text)
    return choice


def _suits(model: DetailedModel, stepper: Stepper) -> bool:
    """Whether it is stable, and not too coarse."""
    try:
        return not choose_stepper(model, stepper.name, stepper.step).doubts
    except OptionError:
        return False


def shortest_fault(disturbances: Sequence[Sequence[Event]]) -> float:
    """Duration in s of the shortest fault of all; infinite where there is none."""
    events = (event for events in disturbances for event in events)
    return min(
        (e.duration for e in events if isinstance(e, BusFault | BranchFault)), default=np.inf
    )


def angle_error_deg(short: Sequence[Trajectory], longer: Sequence[Trajectory]) -> float:
    """Largest root mean square difference of a rotor angle; infinite where the outcomes differ.

    A run that loses synchronism is left out, since its angles say nothing; infinite if all do.
    """
    if any(fine.status is not coarse.status for fine, coarse in zip(short, longer, strict=True)):
        return np.inf
    errors = [
        difference_deg(fine, coarse)
        for fine, coarse in zip(short, longer, strict=True)
        if fine.status is Status.COMPLETED
    ]
    return max(errors, default=np.inf)


def difference_deg(fine: Trajectory, coarse: Trajectory) -> float:
    """That of two runs of one disturbance, at the samples of the coarser one while both go on."""
    times = coarse.times[coarse.times <= fine.times[-1] + fine.stepper.step / 2]
    shared = np.searchsorted(fine.times, times - fine.stepper.step / 2)
    centre = AngleReference.CENTRE_OF_INERTIA
    angles = coarse.rotor_angle_deg(None, centre)[: len(times)]
    difference = fine.rotor_angle_deg(None, centre)[shared] - angles
    return float(np.sqrt((difference**2).mean(axis=0)).max(initial=0.0))
