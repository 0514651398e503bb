"""Which model is cheapest for the work at hand: the detailed one unless a reduced one pays.

A reduced model has to earn what it takes to make it: the reduction itself, and two detailed runs for
every new topology. What cannot pay is not begun. Within a tolerance it has to earn its estimates and
the attempts that miss it as well; runs that lead to another topology are detailed then.
"""

from __future__ import annotations

import time as clock
from dataclasses import dataclass, replace

from gridfold.dynamics.model import DetailedModel
from gridfold.equivalents.area_bases import DENSE_UP_TO
from gridfold.equivalents.choice import Family, ModelSettings
from gridfold.equivalents.families import Mode
from gridfold.equivalents.ladder import Ladder, step_seconds
from gridfold.equivalents.model_kind import ModelKind
from gridfold.equivalents.tolerant import TolerantModel
from gridfold.errors import OptionError
from gridfold.numerics.steppers import Stepper
from gridfold.partition import Partition

#: A reduced model is used where it is predicted to take less than this part of the detailed one.
FACTOR = 0.8
#: Reductions are begun where they are predicted to take less than this part of the detailed runs.
OFFLINE_PART = 0.1
#: Seconds that the reductions of a ladder take for each state of the external area, roughly: of areas
#: whose matrices are formed, and of those that are compressed.
SECONDS_PER_STATE = (3e-3, 4e-3)
#: How often the detailed step is timed; the fastest counts.
_TRIES = 3
#: How much longer reductions take with those for estimates of errors.
WITH_ESTIMATES = 2.0
#: Detailed runs that a new topology costs.
RUNS_PER_TOPOLOGY = 2.0


@dataclass(frozen=True)
class Work:
    """What is to be simulated: runs, steps of each, and topologies other than the intact one."""

    runs: int
    steps: int
    topologies: int = 0


@dataclass(frozen=True)
class Chosen:
    """The model that was chosen, why, and its family if it is a reduced one.

    `tolerant` is what keeps the tolerance, if there is one.
    """

    kind: ModelKind
    reason: str
    family: Family | None = None
    tolerant: TolerantModel | None = None


def choose_model(
    settings: ModelSettings,
    model: DetailedModel,
    parts: Partition | None,
    work: Work,
    stepper: Stepper,
) -> Chosen:
    """The detailed model, or the ladder where that is predicted to be cheaper.

    Parameters
    ----------
    settings : ModelSettings
        Options of the ladder, should it be chosen.
    model : DetailedModel
        The whole system.
    parts : Partition or None
        Study and external area; None where no study area is known.
    work : Work
        What is to be simulated.
    stepper : Stepper
        Integration rule of the runs.
    """
    detailed = ModelKind.DETAILED
    if parts is None:
        return Chosen(detailed, "no study area is given")
    tolerance = settings.tolerance_deg
    if tolerance == 0:
        return Chosen(detailed, "with a tolerance of 0 degrees all runs are detailed")
    if tolerance is not None and work.topologies >= work.runs:
        why = "all runs lead to another topology, and are detailed within a tolerance"
        return Chosen(detailed, why)
    step = min(step_seconds(model, model.x0, stepper) for _ in range(_TRIES))
    total = work.runs * work.steps * step
    states = len(parts.states_of(parts.external_units))
    expected = SECONDS_PER_STATE[states > DENSE_UP_TO] * states
    if tolerance is not None:
        expected *= WITH_ESTIMATES
    runs = (
        f"{work.runs} detailed {'run takes' if work.runs == 1 else 'runs take'} about {total:.2g} s"
    )
    if expected > OFFLINE_PART * total:
        why = f"to reduce {states} external states would take about {expected:.2g} s"
        return Chosen(detailed, f"{runs}; {why}")
    began = clock.perf_counter()
    try:
        family = replace(settings, kind=ModelKind.ADAPTIVE).build(parts, stepper)
    except OptionError as error:
        return Chosen(detailed, f"the external area cannot be reduced: {error}")
    assert isinstance(family, Ladder)
    tolerant = None if tolerance is None else TolerantModel(family, tolerance)
    spent = clock.perf_counter() - began
    if tolerant is not None and not tolerant.rules:
        return Chosen(detailed, f"{runs}; {tolerant.told}")
    reduced, why = _predicted(family, tolerant, work, step)
    if spent + reduced > FACTOR * total:
        return Chosen(detailed, f"{runs}; {why}")
    return Chosen(ModelKind.ADAPTIVE, f"{runs}; {why}", family, tolerant)


def _predicted(
    family: Ladder, tolerant: TolerantModel | None, work: Work, step: float
) -> tuple[float, str]:
    """Seconds that the ladder is predicted to take where a detailed step takes `step`, in words too."""
    if tolerant is None:
        share = _share(family)
        seconds = work.runs * share + RUNS_PER_TOPOLOGY * work.topologies
        ladder = "the ladder is"
    else:
        share = tolerant.share
        seconds = (work.runs - work.topologies) * share + work.topologies
        ladder = "the ladder, its estimates and attempts that miss the tolerance are"
    seconds *= work.steps * step
    return (
        seconds,
        f"{ladder} predicted to take {seconds:.2g} s, {share:.2f} of the detailed model a step",
    )


def _share(family: Ladder) -> float:
    """Time of a step of the ladder in relation to the detailed one, with all its bands alike."""
    spent = [family.step_seconds[mode] for mode in family.modes]
    return sum(spent) / len(spent) / family.step_seconds[Mode.DETAILED]
