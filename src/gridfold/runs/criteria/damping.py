"""The dominant swing of a run against a least damping."""

from __future__ import annotations

import numpy as np

from gridfold.grid.criteria import LeastDamping
from gridfold.runs.criteria.course import APPROXIMATE, Course, outside
from gridfold.runs.criteria.finding import Finding, Verdict
from gridfold.runs.dominant_swing import dominant_swing, late_swing, swings
from gridfold.runs.summary import Summary
from gridfold.runs.trajectory import Trajectory

#: Part of the energy below which a swing is said not to be the only one.
_MOST_OF_IT = 0.5
_STILL = "nothing swings after the last event"


def damping_finding(
    criterion: LeastDamping, run: Trajectory, summary: Summary, course: Course
) -> Finding:
    """What the swing of the machine that moved furthest comes to."""
    if course.ended_early is not None:
        return Finding(criterion, Verdict.OPEN, told=course.ended_early)
    if not summary.swings:
        return Finding(criterion, Verdict.OPEN, told="no machine is in service")
    unit = summary.swings[0].unit
    swing = late_swing(run, unit)
    if len(swing) > 1 and not np.isnan(swing).any() and not swings(swing):
        return Finding(criterion, Verdict.KEPT, told=_STILL)
    found = dominant_swing(run, unit)
    where = f"machine {unit}"
    if found is None:
        told = f"no swing of {where} is found after the last event; run longer, or see eigenvalues"
        return Finding(criterion, Verdict.OPEN, where=where, told=told)
    value, limit = 100 * found.damping_ratio, criterion.percent
    finding = Finding(
        criterion,
        Verdict.VIOLATED if value < limit else Verdict.KEPT,
        value,
        limit,
        value - limit,
        (value - limit) / limit if limit else None,
        "%",
        f"angle_coi_deg:{unit}",
        where,
        None,
        f"{where} swings with {found.frequency_hz:.2f} Hz and {value:.2f} % of damping",
    )
    notes = []
    if found.share < _MOST_OF_IT:
        notes.append(f"only {found.share:.0%} of the swing; others overlap, see eigenvalues")
    if outside(run, [unit.bus]):
        notes.append(f"{where} lies {APPROXIMATE}")
    return finding.noted(*notes)
