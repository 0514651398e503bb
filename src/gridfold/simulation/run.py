"""Integrate a list of segments one after the other."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gridfold.errors import OptionError
from gridfold.numerics.steppers.base import Stepper, time_grid
from gridfold.simulation.segment import Piece, Segment
from gridfold.systems.status import Status


@dataclass(frozen=True)
class Run:
    """Pieces of a run in order of time, and how it ended.

    `culprit` is the position in the state vector of the entry that ended the run early, else None.
    """

    pieces: tuple[Piece, ...]
    status: Status
    culprit: int | None = None

    @property
    def step_count(self) -> int:
        """Number of time steps taken."""
        return sum(len(piece.times) - 1 for piece in self.pieces)


def run_segments(
    segments: Iterable[Segment], x0: NDArray[np.float64], stepper: Stepper, start: float = 0.0
) -> Run:
    """Integrate `segments` from the state `x0` at time `start`; stop early when one says so."""
    pieces: list[Piece] = []
    time, x = start, x0
    for segment in segments:
        if not segment.until > time:
            raise OptionError(f"segment {segment.label!r} ends at {segment.until}, before {time}")
        times = time_grid(time, segment.until, stepper.step)
        result = stepper.integrate(segment.system.compiled, times, x, segment.watch)
        finite = _finite_rows(result.states)
        piece = Piece(segment, times[:finite], result.states[:finite])
        pieces.append(piece)
        if finite < len(result.states):
            culprit = int(np.flatnonzero(~np.isfinite(result.states[finite]))[0])
            return Run(tuple(pieces), Status.NOT_FINITE, culprit)
        if result.watch_fired:
            watch = segment.watch
            culprit = int(watch.index[np.argmax(watch.distances(piece.states[-1]))])
            return Run(tuple(pieces), Status.LOST_SYNCHRONISM, culprit)
        time, x = segment.until, piece.states[-1]
    return Run(tuple(pieces), Status.COMPLETED)


def _finite_rows(states: NDArray[np.float64]) -> int:
    """Number of leading rows without infinities or NaN (once there, they stay)."""
    if np.isfinite(states[-1]).all():
        return len(states)
    return int(np.argmin(np.isfinite(states).all(axis=1)))
