"""What is known of the signals of units while their start values are found."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gridfold.dynamics.device import Device, taken
from gridfold.dynamics.layout import BEFORE, Block, Layout
from gridfold.grid.case import UnitKey

Columns = NDArray[np.int64]


class Row(NamedTuple):
    """A signal of all units: values, and where there is one."""

    values: NDArray[np.float64]
    there: NDArray[np.bool_]


class StartSignals:
    """Signals by name, each a row over all units of a layout, as far as they are known.

    With several `points` a row goes over the units of the first operating point, then of the others.
    What a device of a unit takes and gives on has two values; the one before is that of another name
    (:func:`gridfold.dynamics.layout.given_as`).
    """

    def __init__(self, layout: Layout, points: int = 1):
        self.points = points
        units = (unit for block in layout.blocks for unit in block.units)
        every = dict.fromkeys((*layout.source_units, *units))
        self._place = {unit: k for k, unit in enumerate(every)}
        self._rows: dict[str, Row] = {}
        self._relayed: dict[str, NDArray[np.bool_]] = {}
        for unit, name in layout.relayed:
            mask = self._relayed.setdefault(name, np.zeros(len(every) * points, dtype=bool))
            mask[self.columns((unit,))] = True

    def columns(self, units: Iterable[UnitKey]) -> Columns:
        """Columns of some units: of the first operating point, then of the others."""
        own = np.array([self._place[unit] for unit in units], dtype=np.int64)
        return (own + len(self._place) * np.arange(self.points)[:, None]).ravel()

    def columns_of(self, block: Block) -> Columns:
        """Columns of the units of a block, of all points one after the other."""
        return self.columns(block.units[: len(block.units) // self.points])

    def knows(self, name: str, at: Columns) -> NDArray[np.bool_]:
        """For which of the columns a signal is known."""
        row = self._rows.get(name)
        return np.zeros(len(at), dtype=bool) if row is None else row.there[at]

    def row(self, name: str, at: Columns) -> NDArray[np.float64]:
        """The values of a signal; not a number where none is known."""
        return self.seen(name, at).values

    def put(self, name: str, at: Columns, values: NDArray[np.float64] | float) -> None:
        """Values of a signal."""
        row = self._row(name)
        row.values[at], row.there[at] = values, True

    def put_default(self, name: str, at: Columns, value: float) -> None:
        """The value of a signal where none is known."""
        self.put(name, at[~self.knows(name, at)], value)

    def each(self, unit: UnitKey, name: str) -> NDArray[np.float64]:
        """The value of a signal of one unit at each point, which has to be known."""
        at = self.columns((unit,))
        if not self.knows(name, at).all():
            raise KeyError((unit, name))
        return self.row(name, at)

    def give(self, device: Device, name: str, at: Columns, values: NDArray[np.float64]) -> None:
        """Values of a signal that a device gives."""
        before = self._given_before(device, name, at)
        self.put(name, at[~before], values[~before])
        self.put(name + BEFORE, at[before], values[before])

    def wanted(self, device: Device, at: Columns) -> Wanted:
        """What a device has to give, where that is known; it goes before what else is known."""
        targets = {}
        for name in device.targets:
            before = self._given_before(device, name, at)
            targets[name] = _chosen(before, self.seen(name + BEFORE, at), self.seen(name, at))
        return Wanted(self, device, at, targets)

    def _given_before(self, device: Device, name: str, at: Columns) -> NDArray[np.bool_]:
        relayed = self._relayed.get(name)
        if relayed is None or name + BEFORE in device.inputs:
            return np.zeros(len(at), dtype=bool)
        return relayed[at]

    def seen(self, name: str, at: Columns) -> Row:
        """A signal of the columns."""
        row = self._rows.get(name)
        if row is None:
            return Row(np.full(len(at), np.nan), np.zeros(len(at), dtype=bool))
        return Row(row.values[at], row.there[at])

    def _row(self, name: str) -> Row:
        if name not in self._rows:
            n = len(self._place) * self.points
            self._rows[name] = Row(np.full(n, np.nan), np.zeros(n, dtype=bool))
        return self._rows[name]


class Wanted(NamedTuple):
    """Start values as a device sees them: what it has to give, then what is known."""

    signals: StartSignals
    device: Device
    at: Columns
    targets: dict[str, Row]

    def row(self, name: str) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Start values of what an input or target of the device is, and which are known."""
        first = self._signal(taken(self.device, name, lambda signal: True))
        other = taken(self.device, name, lambda signal: False)
        return _chosen(first.there, first, self._signal(other))

    def _signal(self, name: str) -> Row:
        known = self.signals.seen(name, self.at)
        target = self.targets.get(name)
        return known if target is None else _chosen(target.there, target, known)


def _chosen(first: NDArray[np.bool_], yes: Row, no: Row) -> Row:
    """One row where `first`, else the other."""
    if first.all():
        return yes
    return Row(np.where(first, yes.values, no.values), np.where(first, yes.there, no.there))
