"""What criteria ask of the course of a run: when the fault is over, whether it was finished."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from gridfold.dynamics.model import DetailedModel
from gridfold.grid.network_state import NetworkState
from gridfold.runs.criteria.finding import Finding, Verdict
from gridfold.runs.trajectory import Trajectory
from gridfold.systems.status import Status

#: What is said of places that a reduced model stands for.
APPROXIMATE = "outside the study area, where the reduced model is approximate"


@dataclass(frozen=True)
class Course:
    """How a run went.

    Parameters
    ----------
    start : DetailedModel
        The network of the first rows, with the dispatch of the start.
    cleared : float or None
        Time in seconds at which the last fault is cleared; without one that of the first event. None
        if a fault is on at the end.
    end : float
        Time of the last row in seconds.
    ended_early : str or None
        How the run ended, if it was not finished.
    """

    start: DetailedModel
    cleared: float | None
    end: float
    ended_early: str | None

    def answer(self, finding: Finding) -> Finding:
        """A finding of what was seen: what was not violated is open where the run ended early."""
        if finding.verdict is Verdict.KEPT and self.ended_early is not None:
            return replace(finding, verdict=Verdict.OPEN, told=self.ended_early)
        return finding


def course_of(run: Trajectory) -> Course:
    """How a run went."""
    end = float(run.times[-1])
    early = None
    if run.status is not Status.COMPLETED:
        early = f"the run ended at {end:g} s: {run.status.value.replace('_', ' ')}"
    return Course(run.models[0], _cleared(run), end, early)


def outside(run: Trajectory, buses: Iterable[int]) -> int:
    """How many of the buses lie outside the study area of a run with a reduced model."""
    small = any(piece.segment.coordinates is not None for piece in run.run.pieces)
    if not small or run.study_buses is None:
        return 0
    return sum(bus not in run.study_buses for bus in buses)


def _cleared(run: Trajectory) -> float | None:
    parts = [part for part in run.parts if len(part)]
    states = [replace(part.model.state, dispatch=()) for part in parts]
    faulted = np.flatnonzero([state.faulted for state in states])
    if len(faulted):
        after = int(faulted[-1]) + 1
        return float(parts[after].times[0]) if after < len(parts) else None
    changed = np.flatnonzero([state != _intact(run) for state in states])
    return float(parts[changed[0]].times[0]) if len(changed) else 0.0


def _intact(run: Trajectory) -> NetworkState:
    return replace(run.model.state, dispatch=())
