"""Integrate segments one after the other."""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
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
#: Times closer than this (s) are one instant.
_INSTANT = 1e-9
#: Bytes of the states of a piece that is handed on.
_HANDED_ON = 2**24


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
        return sum(piece.step_count for piece in self.pieces)


class Sink(Protocol):
    """Takes the pieces of a long run as they come, so that they need not be kept."""

    def take(self, piece: Piece) -> None:
        """The next piece; it begins with the last row of the one before."""


def run_segments(
    segments: Iterable[Segment],
    x0: NDArray[np.float64],
    stepper: Stepper,
    start: float = 0.0,
    sink: Sink | None = None,
) -> Run:
    """Integrate `segments` from the state `x0` at time `start`; stop early when one says so."""
    return run_plan(_Fixed(iter(segments)), x0, stepper, start, sink)


def run_plan(
    plan: Plan,
    x0: NDArray[np.float64],
    stepper: Stepper,
    start: float = 0.0,
    sink: Sink | None = None,
) -> Run:
    """Integrate what `plan` says, from the whole system's state `x0` at time `start`.

    A system that offers a ``ClosedForm`` is not stepped: `stepper` gives the sampling times alone.
    With a `sink` each segment is integrated in pieces of bounded size, which it takes; the run then
    has one piece a segment with its two ends. A stepper with a history starts anew in each.
    Where the time of the machine is limited, a TimeLimitError ends the run, see :func:`time_limit`.
    """
    legs = run_legs(plan, x0, stepper, start)
    try:
        leg = next(legs)
        while True:
            leg = legs.send(carry(leg, stepper) if sink is None else _hand_on(leg, stepper, sink))
    except StopIteration as over:
        run: Run = over.value
        return run


@dataclass(frozen=True)
class Leg:
    """A segment that is to be integrated: its times (n,), and the state of its system at the first."""

    segment: Segment
    times: NDArray[np.float64]
    z: NDArray[np.float64]


@dataclass(frozen=True)
class Carried:
    """What came of a leg: a piece, the state of its system at its end, and how the segment ended.

    `fired` tells whether something ended it early, `status` and `culprit` whether the run is over.
    """

    piece: Piece
    end: NDArray[np.float64]
    fired: bool = False
    status: Status = Status.COMPLETED
    culprit: int | None = None


def run_legs(
    plan: Plan, x0: NDArray[np.float64], stepper: Stepper, start: float = 0.0
) -> Generator[Leg, Carried, Run]:
    """The legs of a run, for someone else to integrate: what comes of one decides about the next."""
    pieces: list[Piece] = []
    time, x = start, x0
    while (segment := plan.next(time, x)) is not None:
        if not segment.until > time:
            raise OptionError(f"segment {segment.label!r} ends at {segment.until}, before {time}")
        times = time_grid(time, segment.until, stepper.step)
        part = yield Leg(segment, times, segment.restrict(x))
        pieces.append(part.piece)
        if part.status is not Status.COMPLETED:
            return Run(tuple(pieces), part.status, part.culprit)
        time, x = float(part.piece.times[-1]), segment.lift(part.end)
    return Run(tuple(pieces), Status.COMPLETED)


def carry(leg: Leg, stepper: Stepper) -> Carried:
    """Integrate a leg, as far as its monitor lets it."""
    return _carry(leg.segment, leg.times, leg.z, stepper)


def _carry(
    segment: Segment, times: NDArray[np.float64], z: NDArray[np.float64], stepper: Stepper
) -> Carried:
    """The segment's system from the state `z` along `times`, as far as its monitor lets it."""
    if segment.monitor is None:
        return _step(segment, times, z, stepper)
    parts: list[Carried] = []
    rows = max([BLOCK, *(4 * getattr(watch, "steps", 1) for watch in segment.switches)])
    for start in range(0, len(times) - 1, rows):
        part = _step(segment, times[start : start + rows + 1], z, stepper)
        until = segment.monitor.look(part.piece.times, part.piece.states)
        parts.append(part if until is None else _cut(segment, part, until, stepper))
        z = parts[-1].end
        if parts[-1].fired:
            break
    return _joined(segment, parts)


def _cut(segment: Segment, part: Carried, until: float, stepper: Stepper) -> Carried:
    """The part up to the time `until` (s), with a shorter last step where no row is there."""
    times, states = part.piece.times, part.piece.states
    if part.fired and until >= times[-1] - _INSTANT:
        return part
    kept = int(np.searchsorted(times, until - _INSTANT))
    if times[kept] <= until + _INSTANT:
        short = Piece(segment, times[: kept + 1], states[: kept + 1], part.piece.seconds)
        return Carried(short, states[kept], fired=True)
    before = Piece(segment, times[:kept], states[:kept], part.piece.seconds)
    last = np.array([times[kept - 1], until])
    rest = _step(segment, last, states[kept - 1], stepper)
    return replace(_joined(segment, [Carried(before, states[kept - 1]), rest]), fired=True)


def _joined(segment: Segment, parts: Sequence[Carried]) -> Carried:
    """Parts that follow one another as one."""
    pieces = [part.piece for part in parts]
    times = np.concatenate([pieces[0].times[:1], *(piece.times[1:] for piece in pieces)])
    states = np.concatenate([pieces[0].states[:1], *(piece.states[1:] for piece in pieces)])
    seconds = sum(piece.seconds for piece in pieces)
    return replace(parts[-1], piece=Piece(segment, times, states, seconds))


def _step(
    segment: Segment, times: NDArray[np.float64], z: NDArray[np.float64], stepper: Stepper
) -> Carried:
    """The segment's system from the state `z` along `times`."""
    began = clock.perf_counter()
    result = _integrate(segment, times, z, stepper)
    seconds = clock.perf_counter() - began
    if isinstance(result, _Formula):
        return Carried(Piece(segment, times, result.states, seconds), result.end)
    return carried(segment, times, result, seconds)


def carried(
    segment: Segment, times: NDArray[np.float64], result: Integration, seconds: float
) -> Carried:
    """What came of a segment, from what an integration along its `times` gave."""
    finite = _finite_rows(result.states)
    piece = Piece(segment, times[:finite], result.states[:finite], seconds)
    end = result.states[finite - 1]
    if finite < len(result.states):
        culprit = int(np.flatnonzero(~np.isfinite(result.states[finite]))[0])
        return Carried(piece, end, True, Status.NOT_FINITE, culprit)
    if 0 < result.fired <= len(segment.stops):
        watch, status = segment.stops[result.fired - 1]
        return Carried(piece, end, True, status, int(np.argmax(watch.distances(end))))
    return Carried(piece, end, result.fired > 0)


def _hand_on(leg: Leg, stepper: Stepper, sink: Sink) -> Carried:
    """The same in pieces that `sink` takes; what is left is a piece with both ends."""
    segment, times, z = leg.segment, leg.times, leg.z
    rows = max(_HANDED_ON // (8 * max(len(z), 1)), BLOCK)
    begin, seconds, taken, last = z, 0.0, 0, times[0]
    for start in range(0, len(times) - 1, rows):
        part = _carry(segment, times[start : start + rows + 1], z, stepper)
        sink.take(part.piece)
        seconds += part.piece.seconds
        taken += part.piece.step_count
        z, last = part.end, part.piece.times[-1]
        if part.fired:
            break
    ends = np.array([times[0], last])
    return replace(part, piece=Piece(segment, ends, np.array([begin, z]), seconds, taken))


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
