"""What is drawn for each sample: it follows from the seed and the number of the sample alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

from gridfold.errors import OptionError
from gridfold.grid.events import BranchFault, BusFault, Event
from gridfold.sampling.distribution import Distribution, value_of
from gridfold.sampling.plan import Filling, SamplePlan
from gridfold.study.generate import Contingency

#: Dimensions beside the powers and parameters: which contingency, and the clearing time.
_BESIDE = 2


@dataclass(frozen=True)
class Draw:
    """What is drawn for one sample.

    Parameters
    ----------
    number : int
        Number of the sample, from 1.
    values : dict
        Powers and parameters by name of the column.
    contingency : Contingency
        What happens, with the clearing time that was drawn.
    clearing_time : float or None
        Duration of its fault in s; None where it has none, or several.
    """

    number: int
    values: dict[str, float]
    contingency: Contingency
    clearing_time: float | None


def filling(plan: SamplePlan) -> NDArray[np.float64]:
    """Numbers from 0 to 1 of all samples, shape (samples, dimensions).

    A row of a Sobol sequence does not hang on how many samples there are, one of a Latin hypercube
    does. What the plan gives as a plain number has no dimension.
    """
    dimensions = sum(isinstance(amount, Distribution) for _, amount in plan.drawn) + _BESIDE
    rng = np.random.default_rng(plan.seed)
    if plan.filling is Filling.LATIN_HYPERCUBE:
        return np.asarray(qmc.LatinHypercube(dimensions, rng=rng).random(plan.samples))
    if dimensions > qmc.Sobol.MAXDIM:
        raise OptionError(f"a Sobol sequence has at most {qmc.Sobol.MAXDIM} dimensions")
    powers_of_two = max(plan.samples - 1, 1).bit_length()
    points = qmc.Sobol(dimensions, rng=rng).random_base2(powers_of_two)
    return np.asarray(points[: plan.samples])


@dataclass(frozen=True)
class Happenings:
    """All that may happen: contingencies, of which the first `timed` have the clearing time drawn."""

    contingencies: tuple[Contingency, ...]
    timed: int

    def chosen(self, u: float, seconds: float) -> Contingency:
        """The contingency for a number `u` from 0 to 1, with its fault cleared after some time (s)."""
        count = len(self.contingencies)
        place = min(int(u * count), count - 1)
        found = self.contingencies[place]
        return _cleared(found, seconds) if place < self.timed else found


def draw(plan: SamplePlan, happenings: Happenings, number: int, row: NDArray[np.float64]) -> Draw:
    """What is drawn for sample `number`, from its `row` of :func:`filling`."""
    dimension = iter(row.tolist())
    values = {
        name: value_of(amount, next(dimension) if isinstance(amount, Distribution) else 0.0)
        for name, amount in plan.drawn
    }
    which, when = dimension
    contingency = happenings.chosen(which, value_of(plan.faults.clearing_time, when))
    return Draw(number, values, contingency, _fault_duration(contingency.events))


def _cleared(contingency: Contingency, seconds: float) -> Contingency:
    events = tuple(
        replace(event, duration=seconds) if isinstance(event, BusFault | BranchFault) else event
        for event in contingency.events
    )
    return replace(contingency, events=events)


def _fault_duration(events: Sequence[Event]) -> float | None:
    found = [e.duration for e in events if isinstance(e, BusFault | BranchFault)]
    return found[0] if len(found) == 1 else None
