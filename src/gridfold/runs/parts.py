"""Rows of a run with the detailed model of their network."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from gridfold.dynamics.model import DetailedModel
from gridfold.runs.synchronism import angle_frame
from gridfold.simulation.segment import Piece


@dataclass(frozen=True)
class Part:
    """Rows `first` to `last` (without it) of a piece, and the detailed model of its network."""

    piece: Piece
    model: DetailedModel
    first: int
    last: int

    @property
    def rows(self) -> slice:
        """Which rows of the piece."""
        return slice(self.first, self.last)

    def __len__(self) -> int:
        return self.last - self.first

    @property
    def times(self) -> NDArray[np.float64]:
        """Times in seconds, shape (n,)."""
        return self.piece.times[self.rows]

    @property
    def states(self) -> NDArray[np.float64]:
        """States of the whole system, shape (n, n_states)."""
        return self.piece.states_between(self.first, self.last)

    def states_at(self, index: NDArray[np.int64]) -> NDArray[np.float64]:
        """States of the whole system at the positions `index` (m,) alone, shape (n, m)."""
        return self.piece.states_at(index, self.rows)

    def signals(self, slots: NDArray[np.int64]) -> NDArray[np.float64]:
        """Entries `slots` (m,) of the signal vector, of which the states are the first: (n, m)."""
        if np.all(slots < self.model.n_states):
            return self.states_at(slots)
        return self.model.signals(self.states, slots)

    def bus_voltages(self) -> NDArray[np.complex128]:
        """Voltage phasors of all buses in per unit, shape (n, n_buses)."""
        if self.piece.segment.coordinates is None:
            return self.model.bus_voltages(self.states)
        states = np.tile(self.model.x0, (len(self), 1))
        states[:, self.model.source_states] = self.states_at(self.model.source_states)
        return self.model.bus_voltages(states)

    def centres_of_inertia(self) -> NDArray[np.float64]:
        """Reference angle of each machine in rad, shape (n, n_machines); NaN for those out."""
        frame = angle_frame(self.model)
        return self._of_machines(frame.references_of(self.states_at(frame.slots)))

    def relative_angles(self) -> NDArray[np.float64]:
        """Rotor angles in rad against these references, shape (n, n_machines)."""
        frame = angle_frame(self.model)
        angles = self.states_at(frame.slots)
        return self._of_machines(angles - frame.references_of(angles))

    def _of_machines(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Columns of the machines in service as columns of all machines."""
        units, machines = angle_frame(self.model).units, self.model.machines
        if units == machines:
            return values
        column = {unit: k for k, unit in enumerate(machines)}
        result = np.full((len(self), len(machines)), np.nan)
        result[:, [column[unit] for unit in units]] = values
        return result

    @property
    def following(self) -> Part:
        """The row of the piece after the last one, at whose time the next part begins; maybe none."""
        return replace(self, first=self.last, last=min(self.last + 1, len(self.piece.times)))

    def blocks(self, rows: int) -> Iterator[Part]:
        """The same in parts of at most so many rows."""
        for first in range(self.first, self.last, rows):
            yield replace(self, first=first, last=min(first + rows, self.last))


class Taker(Protocol):
    """Takes the rows of a run while it is stepped."""

    def take(self, part: Part) -> None:
        """The next rows, in order of time."""


@dataclass
class RowsOnce:
    """Hands the rows of a detailed run to `takers`, that of an event once, after it."""

    takers: Sequence[Taker]
    _open: Part | None = None

    def take(self, piece: Piece) -> None:
        """The next piece: its last row waits until it is known what follows."""
        model, last = piece.segment.system, len(piece.times) - 1
        assert isinstance(model, DetailedModel)
        self._hand_on(Part(piece, model, 0, last))
        self._open = Part(piece, model, last, last + 1)

    def finish(self) -> None:
        """The run is over: its last row goes with what came before."""
        if self._open is not None:
            self._hand_on(self._open)

    def _hand_on(self, part: Part) -> None:
        if len(part):
            for taker in self.takers:
                taker.take(part)
