"""Critical clearing times of contingencies whose runs advance together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from gridfold.dynamics.model import DetailedModel
from gridfold.errors import GridfoldError
from gridfold.grid.events import BranchFault, BusFault, Event
from gridfold.runs.batch import simulate_chains
from gridfold.runs.clearing.found import ClearingTime, Fault
from gridfold.runs.clearing.search import TimeGrid
from gridfold.runs.clearing.trials import Trial, Trials, verdict_of
from gridfold.runs.trajectory import Trajectory
from gridfold.study.prepare import Prepared


def only_fault(events: Sequence[Event]) -> Fault | None:
    """The fault of a contingency that is nothing else."""
    if len(events) == 1 and isinstance(events[0], BusFault | BranchFault):
        return events[0]
    return None


def clearing_times(
    prepared: Prepared,
    disturbances: Sequence[Sequence[Event]],
    models: Sequence[DetailedModel] | None,
) -> Mapping[int, ClearingTime]:
    """Clearing times of disturbances that are a fault alone, by their numbers.

    `models` are the model of each; by default that of the study. One whose runs go wrong is left out.
    """
    wanted, t_end = prepared.study.clearing_times, prepared.study.run.t_end
    if not wanted.wanted:
        return {}
    searches = {
        number: Trials([fault], TimeGrid(wanted.resolution, wanted.longest, t_end - fault.start))
        for number, events in enumerate(disturbances)
        if (fault := only_fault(events)) is not None
    }
    numbers = list(searches)
    tried: dict[int, Trial] = {}

    def next_of(number: int) -> tuple[Fault] | None:
        trial = searches[number].due()
        if trial is None:
            return None
        tried[number] = trial
        return (searches[number].event(trial),)

    def follow(chain: int, outcome: Trajectory | GridfoldError) -> tuple[Fault] | None:
        number = numbers[chain]
        searches[number].take(tried[number], verdict_of(outcome))
        return next_of(number)

    runs = simulate_chains(
        prepared.model,
        [next_of(number) or () for number in numbers],
        follow,
        t_end,
        prepared.method.stepper,
        prepared.criterion,
        dict(prepared.intact),
        voltages=False,
        models=None if models is None else [models[number] for number in numbers],
    )
    for _ in runs:
        pass
    found = {number: trials.found[0] for number, trials in searches.items()}
    return {number: time for number, time in found.items() if not time.reason}
