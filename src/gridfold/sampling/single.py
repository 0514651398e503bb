"""One sample of a data set by itself: its case and its events, to be looked at or run again."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path

from gridfold.errors import OptionError
from gridfold.grid.case import Case
from gridfold.grid.events import Event
from gridfold.numerics.steppers import Stepper
from gridfold.sampling.draw import filling
from gridfold.sampling.plan import SamplePlan, load_plan
from gridfold.sampling.prepare import prepared_work


@dataclass(frozen=True)
class SingleSample:
    """A sample of a plan.

    Parameters
    ----------
    number : int
        Its number.
    values : mapping
        What is drawn of powers and parameters, by column.
    case : Case
        The case at its operating point, to be solved.
    name : str
        What happens.
    events : tuple of Event
        The same as events.
    stepper : Stepper
        Integration rule and time step of all samples.
    """

    number: int
    values: Mapping[str, float]
    case: Case
    name: str
    events: tuple[Event, ...]
    stepper: Stepper


def single_sample(
    plan: SamplePlan | str | Path,
    number: int,
    folder: str | Path | None = None,
    trust_devices: bool | Collection[str] = False,
) -> SingleSample:
    """A sample of a plan by its number, from 1, without what was made of others.

    Parameters
    ----------
    plan : SamplePlan or path
        The plan, or its file.
    number : int
        Which sample.
    folder, trust_devices
        As for :func:`gridfold.sample`.

    Raises
    ------
    OptionError
        The plan has no such sample.
    EventError
        It has no operating point: a unit would have to give less than nothing.
    """
    path = None if isinstance(plan, SamplePlan) else Path(plan)
    wanted = plan if isinstance(plan, SamplePlan) else load_plan(plan)
    if not 1 <= number <= wanted.samples:
        raise OptionError(f"the plan has samples 1 to {wanted.samples}, not {number}")
    start = Path(folder) if folder is not None else (path.parent if path else Path())
    sampler = prepared_work(wanted, start, trust_devices=trust_devices)
    drawn = sampler.draw(number, filling(wanted)[number - 1])
    return SingleSample(
        number,
        drawn.values,
        sampler.case(drawn),
        drawn.contingency.name,
        (*drawn.contingency.events, *sampler.prepared.relays),
        sampler.prepared.method.stepper,
    )
