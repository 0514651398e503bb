"""Columns of the tables of a run: angles, speeds, voltages, and any signal of a machine."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase

import numpy as np
from numpy.typing import NDArray

from gridfold.dynamics.model import DetailedModel
from gridfold.errors import OptionError
from gridfold.runs.parts import Part

TIME, ANGLE, SPEED, VOLTAGE = "time", "angle_deg", "speed_pu", "voltage_pu"


@dataclass(frozen=True)
class Columns:
    """What a table of a run shows beside the time.

    Parameters
    ----------
    names : tuple of str
        ``angle_deg:BUS:ID``, ``speed_pu:BUS:ID``, ``voltage_pu:BUS`` or ``SIGNAL:BUS:ID``.
    places : ndarray of int, shape (n,)
        Position in the signal vector, or -1 - (position of the bus) for a voltage.
    """

    names: tuple[str, ...]
    places: NDArray[np.int64]

    @property
    def header(self) -> tuple[str, ...]:
        """Names of all columns of the table."""
        return (TIME, *self.names)

    def rows(self, part: Part) -> NDArray[np.float64]:
        """The table along a part of a run, shape (n_times, 1 + n)."""
        result = np.empty((len(part), 1 + len(self.names)))
        result[:, 0] = part.times
        values = result[:, 1:]
        signals, voltages = self.places >= 0, self.places < 0
        values[:, signals] = part.signals(self.places[signals])
        if voltages.any():
            values[:, voltages] = np.abs(part.bus_voltages()[:, -1 - self.places[voltages]])
        for column, name in enumerate(self.names):
            kind, _, of = name.partition(":")
            if kind == ANGLE:
                values[:, column] = np.rad2deg(values[:, column])
            if kind != VOLTAGE and any(str(unit) == of for unit in part.model.state.units_out):
                values[:, column] = np.nan
        return result


def all_columns(model: DetailedModel, signals: Sequence[str] = ()) -> Columns:
    """Angles and speeds of all machines, voltages of all buses, and further `signals` by name.

    Raises
    ------
    OptionError
        No machine has one of the signals.
    """
    known = _signals(model)
    if unknown := [name for name in signals if name not in known]:
        names = ", ".join(sorted(known))
        raise OptionError(f"no machine has a signal {unknown[0]!r}; there are: {names}")
    places = _places(model, signals)
    return Columns(tuple(places), np.array(list(places.values()), dtype=np.int64))


def chosen_columns(model: DetailedModel, patterns: Sequence[str]) -> Columns:
    """The columns that `patterns` name, such as ``speed_pu:*`` or ``voltage_pu:3``, in their order.

    Raises
    ------
    OptionError
        A pattern fits no column.
    """
    places = _places(model, _signals(model))
    names: dict[str, None] = {}
    for pattern in patterns:
        found = [pattern] if pattern in places else [n for n in places if fnmatchcase(n, pattern)]
        if not found:
            close = difflib.get_close_matches(pattern, places, n=1)
            kinds = ", ".join(sorted({name.partition(":")[0] for name in places}))
            hint = f"did you mean {close[0]!r}?" if close else f"known: {kinds}, each with :BUS:ID"
            raise OptionError(f"there is no column {pattern!r}; {hint}")
        names |= dict.fromkeys(found)
    return Columns(tuple(names), np.array([places[name] for name in names], dtype=np.int64))


def _signals(model: DetailedModel) -> list[str]:
    return list(dict.fromkeys(signal for _, signal in model.layout.signal_slots))


def _places(model: DetailedModel, signals: Iterable[str]) -> dict[str, int]:
    """Place of every column by its name: what all tables have, then `signals`."""
    known = model.layout.signal_slots
    places = {f"{ANGLE}:{unit}": known[unit, "rotor_angle"] for unit in model.machines}
    places |= {f"{SPEED}:{unit}": known[unit, "speed"] for unit in model.machines}
    places |= {f"{VOLTAGE}:{bus.number}": -1 - k for k, bus in enumerate(model.case.buses)}
    for name in signals:
        units = [unit for unit in model.layout.source_units if (unit, name) in known]
        places |= {f"{name}:{unit}": known[unit, name] for unit in units}
    return places
