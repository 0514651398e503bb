"""Columns in which legs of many runs are stepped side by side: detailed ones, or of one port model."""

from __future__ import annotations

import time as clock
from collections import deque
from collections.abc import Collection, Sequence
from itertools import zip_longest
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from gridfold.dynamics.batch.change import NetworkChange
from gridfold.dynamics.batch.ports import batch_ports
from gridfold.dynamics.batch.rhs import batch_rhs
from gridfold.dynamics.model import DetailedModel
from gridfold.dynamics.port_model import PortModel
from gridfold.grid.case import UnitKey
from gridfold.grid.network_state import NetworkState
from gridfold.numerics.columns import BEYOND, GOES_ON, Columns, Spread
from gridfold.numerics.lanes import WIDTH
from gridfold.numerics.rhs import CompiledRhs
from gridfold.numerics.steppers import AdamsBashforthMoulton4, Stepper
from gridfold.numerics.steppers.base import Integration
from gridfold.numerics.watch import SpreadWatch, Watch
from gridfold.runs.synchronism import angle_frame
from gridfold.simulation.run import Carried, Leg, carried
from gridfold.simulation.segment import Segment

#: Bytes of the states of detailed legs that stand side by side.
_LARGEST_RECORD = 2**25
#: Whoever runs a leg.
Runner = TypeVar("Runner")


def watches_of(segment: Segment) -> tuple[Watch, ...]:
    """All that may end a segment early, stops first."""
    return (*(stop.watch for stop in segment.stops), *segment.switches)


class LegColumns(Generic[Runner]):
    """Legs in columns; one that is over makes room for one that waits.

    Parameters
    ----------
    rhs : CompiledRhs
        The right-hand side of eight runs.
    rest : ndarray, shape (n,)
        The state in which an empty column stays.
    length : int
        Rows that a leg has at most.
    stepper : Stepper
        RK4 or ABM4.
    spreads : tuple of Spread, judges : sequence of Watch
        What ends legs, see :class:`Columns`.
    """

    def __init__(
        self,
        rhs: CompiledRhs,
        rest: NDArray[np.float64],
        length: int,
        stepper: Stepper,
        spreads: tuple[Spread, Spread] | None = None,
        judges: Sequence[Watch] = (),
    ):
        none = np.zeros(0, dtype=np.int64)
        self.waiting: deque[tuple[Runner, Leg]] = deque()
        self.length = length
        self._rest = rest
        self._seats: list[tuple[Runner, Leg] | None] = [None] * WIDTH
        self.columns = Columns(
            rhs, WIDTH, length, stepper.step, isinstance(stepper, AdamsBashforthMoulton4),
            np.arange(len(rest)), spreads or (Spread.over(none, WIDTH), Spread.over(none, WIDTH)),
            None, judges,
        )  # fmt: skip
        self._stepping, self._steps = 0.0, 0
        for column in range(WIDTH):
            self._empty(column)

    @property
    def seated(self) -> int:
        """Legs that have a column."""
        return sum(seat is not None for seat in self._seats)

    @property
    def count(self) -> int:
        """Legs that are not over."""
        return len(self.waiting) + self.seated

    def advance(self) -> list[tuple[Runner, Carried]]:
        """Seat who waits, and step until some are over: who they are, and what came of their legs."""
        columns = self.columns
        for column, seat in enumerate(self._seats):
            if seat is None and self.waiting:
                self._seat(column, *self.waiting.popleft())
        before, began = columns.row.sum(), clock.perf_counter()
        columns.advance()
        self._stepping += clock.perf_counter() - began
        self._steps += int(columns.row.sum() - before)
        over = []
        for column, seat in enumerate(self._seats):
            row = columns.row[column]
            if seat and (row == columns.last[column] or columns.verdict[column] != GOES_ON):
                over.append((seat[0], self._carried(column, seat[1])))
                self._empty(column)
        return over

    def _seat(self, column: int, runner: Runner, leg: Leg) -> None:
        self._seats[column] = runner, leg
        self.columns.begin(column, leg.times, leg.z)
        self.columns.enter(column, 0, len(leg.times) - 1)
        self._put(column, leg)

    def _empty(self, column: int) -> None:
        self._seats[column] = None
        self.columns.begin(column, np.zeros(1), self._rest)
        self._put(column, None)

    def _put(self, column: int, leg: Leg | None) -> None:
        """What is a column's own."""

    def _fired(self, column: int, leg: Leg) -> int:
        """The number of the watch that ended a leg, from 1; 0 if none did."""
        return int(self.columns.fired[column])

    def _carried(self, column: int, leg: Leg) -> Carried:
        columns = self.columns
        states = columns.record[column, : columns.row[column] + 1].copy()
        found = Integration(states, self._fired(column, leg))
        per_step = self._stepping / max(self._steps, 1)
        return carried(leg.segment, leg.times, found, per_step * (len(states) - 1))


class PortColumns(LegColumns[Runner]):
    """Legs of one port model with the same watches."""

    def __init__(self, system: PortModel, watches: Sequence[Watch], length: int, stepper: Stepper):
        self.system = system
        rest = system.restrict(system.parts.model.x0)
        rhs = batch_ports(system.parts, WIDTH)
        super().__init__(rhs, rest, length, stepper, judges=watches)

    def takes(self, leg: Leg) -> bool:
        """Whether there is room for a leg."""
        return len(leg.times) <= self.length


class DetailedColumns(LegColumns[Runner]):
    """Legs of the detailed model, each in a network state of its own.

    Parameters
    ----------
    model : DetailedModel
        The intact network.
    changes : mapping
        What network states that legs may be in change about it.
    """

    def __init__(
        self,
        model: DetailedModel,
        changes: dict[NetworkState, NetworkChange | None],
        length: int,
        stepper: Stepper,
    ):
        rank = max((len(c.buses) for c in changes.values() if c is not None), default=0)
        self._changes, self._rhs = changes, batch_rhs(model, WIDTH, rank)
        room = _LARGEST_RECORD // (8 * WIDTH * max(model.n_states, 1))
        frame = angle_frame(model)
        angles, speeds = (np.sort(slots) for slots in (frame.slots, frame.speed_slots))
        spreads = Spread.over(angles, WIDTH), Spread.over(speeds, WIDTH)
        super().__init__(self._rhs.compiled, model.x0, min(length, room), stepper, spreads)

    def takes(self, leg: Leg) -> bool:
        """Whether a leg is a detailed one that nothing ends but loss of synchronism."""
        segment = leg.segment
        return (
            isinstance(segment.system, DetailedModel)
            and segment.system.state in self._changes
            and segment.coordinates is None
            and segment.monitor is None
            and len(leg.times) <= self.length
            and all(isinstance(watch, SpreadWatch) for watch in watches_of(segment))
        )

    def _put(self, column: int, leg: Leg | None) -> None:
        change: NetworkChange | None = None
        out: Collection[UnitKey] = ()
        watches: tuple[Watch, ...] = ()
        if leg is not None:
            system = leg.segment.system
            assert isinstance(system, DetailedModel)
            change, out = self._changes[system.state], system.state.units_out
            watches = watches_of(leg.segment)
        self._rhs.put(column, change, out)
        for spread, watch in zip_longest(self.columns.watches, watches):
            assert watch is None or isinstance(watch, SpreadWatch)
            spread.put(column, watch)

    def _fired(self, column: int, leg: Leg) -> int:
        if self.columns.verdict[column] != BEYOND:
            return 0
        x = self.columns.states[:, column].copy()
        watches = watches_of(leg.segment)
        return next((k for k, watch in enumerate(watches, start=1) if watch.holds(x)), 1)
