"""Integrate segments one after the other."""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from gridfold.errors import OptionError
from gridfold.numerics.deadline import check_time, time_watches
from gridfold.numerics.steppers.base import Integration, Stepper, time_grid
from gridfold.numerics.watch import Watch, first_fired
from gridfold.simulation.segment import Piece, Segment
from gridfold.systems.protocol import ClosedForm, has_closed_form
from gridfold.systems.status import Status

#: Rows of a solution in closed form that are computed before the watches look at them.
BLOCK = 256


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
    """Integrate what `plan` says, from the whole system's state `x0` at time `start`.

    A system that offers a ``ClosedForm`` is not stepped: `stepper` gives the sampling times alone.
    Where the time of the machine is limited, a TimeLimitError ends the run, see :func:`time_limit`.
    """
    pieces: list[Piece] = []
    time, x = start, x0
    while (segment := plan.next(time, x)) is not None:
        if not segment.until > time:
            raise OptionError(f"segment {segment.label!r} ends at {segment.until}, before {time}")
        times = time_grid(time, segment.until, stepper.step)
        began = clock.perf_counter()
        result = _integrate(segment, times, segment.restrict(x), stepper)
        seconds = clock.perf_counter() - began
        if isinstance(result, _Formula):
            pieces.append(Piece(segment, times, result.states, seconds))
            time, x = float(times[-1]), segment.lift(result.end)
            continue
        finite = _finite_rows(result.states)
        piece = Piece(segment, times[:finite], result.states[:finite], seconds)
        pieces.append(piece)
        if finite < len(result.states):
            culprit = int(np.flatnonzero(~np.isfinite(result.states[finite]))[0])
            return Run(tuple(pieces), Status.NOT_FINITE, culprit)
        if 0 < result.fired <= len(segment.stops):
            watch, status = segment.stops[result.fired - 1]
            distances = watch.distances(piece.states[-1])
            return Run(tuple(pieces), status, int(np.argmax(distances)))
        time, x = float(piece.times[-1]), segment.lift(piece.states[-1])
    return Run(tuple(pieces), Status.COMPLETED)


@dataclass(frozen=True)
class _Formula:
    """A solution in closed form along which no watch can fire: its end, and what computes the rest."""

    end: NDArray[np.float64]
    states: Callable[[], NDArray[np.float64]]


def _integrate(
    segment: Segment, times: NDArray[np.float64], x0: NDArray[np.float64], stepper: Stepper
) -> Integration | _Formula:
    """States of the segment's system from `x0` along `times`, until a stop or a switch fires."""
    check_time()
    watches = (*(stop.watch for stop in segment.stops), *segment.switches)
    if has_closed_form(segment.system):
        return _evaluate(segment.system, times, x0, watches)
    limited = (*watches, *time_watches())
    result = stepper.integrate(segment.system.compiled, times, x0, limited)
    if result.fired > len(watches):
        check_time()
    return result


def _evaluate(
    system: ClosedForm,
    times: NDArray[np.float64],
    x0: NDArray[np.float64],
    watches: Sequence[Watch],
) -> Integration | _Formula:
    """The same from a closed form, in blocks: a watch that fires early does not cost the rest.

    Once no watch can fire any more, nothing is computed but the end.
    """
    elapsed = times - times[0]
    states = np.empty((len(times), len(x0)))
    states[0] = x0
    for start in range(1, len(times), BLOCK):
        check_time()
        reach = partial(system.reach, states[start - 1], elapsed[-1] - elapsed[start - 1])
        if all(watch.never(reach) for watch in watches):
            end = system.states_after(x0, elapsed[-1:])[0]
            if np.isfinite(end).all():
                return _Formula(end, partial(_from_the_start, system, x0, elapsed))
        block = slice(start, start + BLOCK)
        found = first_fired(watches, system.states_after(x0, elapsed[block], states[block]))
        if found is not None:
            row, number = found
            return Integration(states[: start + row + 1], number)
    return Integration(states, 0)


def _from_the_start(
    system: ClosedForm, x0: NDArray[np.float64], elapsed: NDArray[np.float64]
) -> NDArray[np.float64]:
    """States at all times, the start included."""
    states = np.empty((len(elapsed), len(x0)))
    states[0] = x0
    for start in range(1, len(elapsed), BLOCK):
        block = slice(start, start + BLOCK)
        system.states_after(x0, elapsed[block], states[block])
    return states


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
