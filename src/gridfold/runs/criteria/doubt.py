"""Whether a run that has an error could be judged otherwise without it."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from gridfold.grid.criteria import Criterion
from gridfold.runs.criteria.judge import judge
from gridfold.runs.trajectory import Trajectory


def doubt_of(
    run: Trajectory,
    corrected: Trajectory,
    criteria: Sequence[Criterion],
    study_buses: Collection[int] | None = None,
) -> str | None:
    """What may be judged otherwise within the error of a run, in words; None if nothing is.

    A criterion is in doubt where the two verdicts differ, and where twice what the error moves its
    value by would use up the margin.

    Parameters
    ----------
    run, corrected : Trajectory
        A run, and the same with its estimated error.
    criteria : sequence of Criterion
        What is asked.
    study_buses : collection of int, optional
        Bus numbers of the study area; those of the run by default.
    """
    pairs = zip(
        judge(run, criteria, study_buses), judge(corrected, criteria, study_buses), strict=True
    )
    for one, other in pairs:
        moved = 0.0
        if one.value is not None and other.value is not None:
            moved = abs(other.value - one.value)
        if one.verdict is not other.verdict or one.within(2 * moved):
            return f"the criterion {one.name!r} may be judged otherwise within its error"
    return None
