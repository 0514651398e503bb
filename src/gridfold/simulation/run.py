"""Integrate segments one after the other."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from gridfold.errors import OptionError
from gridfold.numerics.steppers.base import Stepper, time_grid
from gridfold.simulation.segment import Piece, Segment
from gridfold.systems.status import Status


class Plan(Protocol):
    """Says what comes next; it may look at the state, and keep a memory of its own."""

    def next(self, time: float, x: NDArray[np.float64]) -> Segment | None:
        """The segment from `time` (s) and the whole system's state `x` on; None at the end."""


@dataclass(frozen=True)
class Run:
    """Pieces of a run in order of time, and how it ended.

    `culprit` is the position, in the state vector of the last piece's system, of the entry that was
    not finite, or among the watched quantities that of the one that ended the run; else None.
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
    return run_plan(_Fixed(iter(segments)), x0, stepper, start)


def run_plan(plan: Plan, x0: NDArray[np.float64], stepper: Stepper, start: float = 0.0) -> Run:
    """Integrate what `plan` says, from the whole system's state `x0` at time `start`."""
    pieces: list[Piece] = []
    time, x = start, x0
    while (segment := plan.next(time, x)) is not None:
        if not segment.until > time:
            raise OptionError(f"segment {segment.label!r} ends at {segment.until}, before {time}")
        times = time_grid(time, segment.until, stepper.step)
        watches = (*segment.stops, *segment.switches)
        result = stepper.integrate(segment.system.compiled, times, segment.restrict(x), watches)
        finite = _finite_rows(result.states)
        piece = Piece(segment, times[:finite], result.states[:finite])
        pieces.append(piece)
        if finite < len(result.states):
            culprit = int(np.flatnonzero(~np.isfinite(result.states[finite]))[0])
            return Run(tuple(pieces), Status.NOT_FINITE, culprit)
        if 0 < result.fired <= len(segment.stops):
            distances = segment.stops[result.fired - 1].distances(piece.states[-1])
            return Run(tuple(pieces), Status.LOST_SYNCHRONISM, int(np.argmax(distances)))
        time, x = float(piece.times[-1]), segment.lift(piece.states[-1])
    return Run(tuple(pieces), Status.COMPLETED)


@dataclass
class _Fixed:
    """A plan that is a list."""

    segments: Iterator[Segment]

    def next(self, time: float, x: NDArray[np.float64]) -> Segment | None:
        """The next segment of the list."""
        return next(self.segments, None)


def _finite_rows(states: NDArray[np.float64]) -> int:
    """Number of leading rows without infinities or NaN (once there, they stay)."""
    if np.isfinite(states[-1]).all():
        return len(states)
    return int(np.argmin(np.isfinite(states).all(axis=1)))
