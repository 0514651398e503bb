"""A run is a list of segments: one smooth system each, until an event ends it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, Protocol, TypeGuard

import numpy as np
from numpy.typing import NDArray

from gridfold.numerics.watch import Watch
from gridfold.systems.protocol import System
from gridfold.systems.status import Status


class Coordinates(Protocol):
    """The way between the states of the whole system and those of a segment's system."""

    def lift(self, z: NDArray[np.float64]) -> NDArray[np.float64]:
        """States of the whole system, (..., n), from those of the segment, (..., r)."""

    def restrict(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """State of the segment, (r,), from one of the whole system, (n,)."""


class LiftsRows(Coordinates, Protocol):
    """Coordinates that can lift some states without the others."""

    def lift_rows(self, z: NDArray[np.float64], index: NDArray[np.int64]) -> NDArray[np.float64]:
        """States of the whole system at the positions `index` (m,), from z (..., r): (..., m)."""


def lifts_rows(coordinates: Coordinates | None) -> TypeGuard[LiftsRows]:
    """Whether they can."""
    return hasattr(coordinates, "lift_rows")


class Stop(NamedTuple):
    """A condition that ends the whole run, and how the run has ended then."""

    watch: Watch
    status: Status


class Monitor(Protocol):
    """Looks at the states of a segment once they are there, and may end it earlier."""

    def look(self, times: NDArray[np.float64], states: NDArray[np.float64]) -> float | None:
        """When the segment ends (s), after the first of `times` (n,); None where it goes on.

        `states` (n, r) are those of the segment's system. It is asked with one row after the other, the
        last row of one call being the first of the next.
        """


@dataclass(frozen=True)
class Segment:
    """One smooth piece of a run.

    Parameters
    ----------
    system : System
        What is integrated.
    until : float
        Time at which the segment ends, in seconds.
    label : str
        What characterizes it, for reports ("fault at bus 3").
    stops : tuple of Stop
        Conditions on the segment's state that end the whole run; of those that hold at one step the
        first counts.
    switches : tuple of Watch
        Conditions that end the segment; the plan then says what follows.
    coordinates : Coordinates, optional
        Where the system's states are not those of the whole system.
    monitor : Monitor, optional
        What looks at the states, a few hundred rows at a time.
    """

    system: System
    until: float
    label: str = ""
    stops: tuple[Stop, ...] = ()
    switches: tuple[Watch, ...] = ()
    coordinates: Coordinates | None = None
    monitor: Monitor | None = None

    def restrict(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """State of the segment's system at the state `x` of the whole."""
        return x if self.coordinates is None else self.coordinates.restrict(x)

    def lift(self, z: NDArray[np.float64]) -> NDArray[np.float64]:
        """States of the whole system from those of the segment's."""
        return z if self.coordinates is None else self.coordinates.lift(z)

    def lift_rows(self, z: NDArray[np.float64], index: NDArray[np.int64]) -> NDArray[np.float64]:
        """Those of `lift` at the positions `index` (m,) alone: shape (..., m)."""
        if lifts_rows(self.coordinates):
            return self.coordinates.lift_rows(z, index)
        return self.lift(z)[..., index]


@dataclass(frozen=True)
class Piece:
    """A segment that has been integrated: times (n,) and states (n, r), both ends included.

    States that follow from a formula are given as what computes them, once they are asked for.
    `seconds` is the time that the machine took for it, `taken` the number of steps where the states
    between both ends have been handed on and are not kept.
    """

    segment: Segment
    times: NDArray[np.float64]
    solution: NDArray[np.float64] | Callable[[], NDArray[np.float64]]
    seconds: float = 0.0
    taken: int | None = None

    @property
    def step_count(self) -> int:
        """Number of time steps taken."""
        return len(self.times) - 1 if self.taken is None else self.taken

    @cached_property
    def states(self) -> NDArray[np.float64]:
        """States of the segment's system, shape (n, r)."""
        return self.solution() if callable(self.solution) else self.solution

    @cached_property
    def full_states(self) -> NDArray[np.float64]:
        """States of the whole system, shape (n, n_states)."""
        return self.segment.lift(self.states)

    def states_between(self, first: int, last: int) -> NDArray[np.float64]:
        """Rows `first` to `last` (without it) of these, shape (last - first, n_states)."""
        if "full_states" in vars(self):
            return self.full_states[first:last]
        return self.segment.lift(self.states[first:last])

    def states_at(self, index: NDArray[np.int64], rows: slice = slice(None)) -> NDArray[np.float64]:
        """States of the whole system at the positions `index` (m,) alone, shape (n_rows, m)."""
        if lifts_rows(self.segment.coordinates):
            return self.segment.lift_rows(self.states[rows], index)
        return self.full_states[rows, index]
