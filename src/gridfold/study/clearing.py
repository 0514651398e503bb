"""Critical clearing times of contingencies whose runs advance together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from gridfold.dynamics.model import DetailedModel
from gridfold.errors import GridfoldError
from gridfold.grid.events import BranchFault, BusFault, Event
from gridfold.runs.batch import simulate_chains
from gridfold.runs.clearing_time import ClearingTime, Fault, Search
from gridfold.runs.trajectory import Trajectory
from gridfold.study.prepare import Prepared
from gridfold.systems.status import Status


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
        number: Search(fault, wanted.resolution, wanted.longest, t_end - fault.start)
        for number, events in enumerate(disturbances)
        if (fault := only_fault(events)) is not None
    }
    numbers = list(searches)

    def trial(number: int) -> tuple[Fault, ...]:
        event = searches[number].trial
        return () if event is None else (event,)

    def follow(chain: int, outcome: Trajectory | GridfoldError) -> tuple[Fault, ...] | None:
        number = numbers[chain]
        if isinstance(outcome, GridfoldError):
            del searches[number]
            return None
        searches[number].take(outcome.status is Status.COMPLETED)
        return trial(number) or None

    runs = simulate_chains(
        prepared.model,
        [trial(number) for number in numbers],
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
    return {number: search.found for number, search in searches.items()}
