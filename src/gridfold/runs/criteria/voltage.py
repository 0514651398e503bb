"""Voltages of a run against a dip or a recovery."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from gridfold.grid.criteria import VoltageDip, VoltageRecovery
from gridfold.runs.criteria.course import Course
from gridfold.runs.criteria.finding import Finding, Verdict
from gridfold.runs.criteria.spells import Spells

#: Times that differ by less (s) are the same: sampling times are sums of steps.
GRAIN = 1e-9
_ON = "a fault is on until the end of the run"
_DARK = "none of the buses is energized after the fault"


@dataclass
class VoltageWatch:
    """Takes the voltages of the buses of one criterion.

    Parameters
    ----------
    criterion : VoltageDip or VoltageRecovery
        What is asked.
    buses : sequence of int
        Bus numbers.
    levels : ndarray, shape (n_buses,)
        The level of each in per unit.
    course : Course
        How the run went.
    """

    criterion: VoltageDip | VoltageRecovery
    buses: Sequence[int]
    levels: NDArray[np.float64]
    course: Course
    spells: Spells = field(init=False)
    lowest: NDArray[np.float64] = field(init=False)
    lowest_at: NDArray[np.float64] = field(init=False)

    def __post_init__(self) -> None:
        self.spells = Spells(len(self.buses))
        self.lowest = np.full(len(self.buses), np.nan)
        self.lowest_at = np.full(len(self.buses), np.nan)

    def take(self, times: NDArray[np.float64], voltages: NDArray[np.float64]) -> None:
        """Further rows: `times` (n,) in s, magnitudes (n, n_buses) in p.u., NaN where there is none."""
        if self.course.cleared is None:
            return
        rows = times >= self.course.cleared
        times, voltages = times[rows], voltages[rows]
        if not len(times):
            return
        self.spells.take(times, voltages < self.levels)
        there = np.nan_to_num(voltages, nan=np.inf)
        row, column = there.argmin(axis=0), np.arange(len(self.buses))
        lower = there[row, column] < np.nan_to_num(self.lowest, nan=np.inf)
        self.lowest[lower] = there[row, column][lower]
        self.lowest_at[lower] = times[row][lower]

    def finding(self) -> Finding:
        """What they came to."""
        if self.course.cleared is None:
            return Finding(self.criterion, Verdict.OPEN, told=_ON)
        if np.isnan(self.lowest).all():
            return Finding(self.criterion, Verdict.OPEN, told=_DARK)
        self.spells.finish(self.course.end)
        if isinstance(self.criterion, VoltageRecovery):
            return self._recovery(self.criterion, self.course.cleared)
        if self.criterion.longest > 0:
            return self._spell(self.criterion)
        return self._dip()

    def _dip(self) -> Finding:
        shares = (self.lowest - self.levels) / self.levels
        k = int(np.nanargmin(shares))
        at = f"bus {self.buses[k]}"
        value, limit, time = float(self.lowest[k]), float(self.levels[k]), float(self.lowest_at[k])
        found = Finding(
            self.criterion,
            Verdict.VIOLATED if value < limit else Verdict.KEPT,
            value,
            limit,
            value - limit,
            float(shares[k]),
            "p.u.",
            f"voltage_pu:{self.buses[k]}",
            at,
            time,
            f"lowest voltage {value:.3f} p.u. at {at} at {time:g} s" + self._more(shares < 0),
        )
        return self.course.answer(found)

    def _spell(self, criterion: VoltageDip) -> Finding:
        spells, limit = self.spells, criterion.longest
        k = int(spells.longest.argmax())
        value, at = float(spells.longest[k]), f"bus {self.buses[k]}"
        if not value:
            k = int(np.nanargmin(self.lowest - self.levels))
            at = f"bus {self.buses[k]}"
            told = f"never below; lowest voltage {self.lowest[k]:.3f} p.u. at {at}"
        else:
            told = f"{at} is below for {value:.4g} s from {spells.longest_from[k]:g} s on"
        verdict = Verdict.VIOLATED if value > limit + GRAIN else Verdict.KEPT
        if verdict is Verdict.KEPT and spells.open.any():
            verdict, told = Verdict.OPEN, f"{told}, until the end of the run"
        found = Finding(
            criterion,
            verdict,
            value,
            limit,
            limit - value,
            (limit - value) / limit,
            "s",
            f"voltage_pu:{self.buses[k]}",
            at,
            float(spells.longest_from[k]) if value else float(self.lowest_at[k]),
            told + self._more(spells.longest > limit + GRAIN),
        )
        return self.course.answer(found)

    def _recovery(self, criterion: VoltageRecovery, cleared: float) -> Finding:
        spells, limit = self.spells, criterion.within
        took = np.where(spells.open, self.course.end, np.fmax(spells.back, cleared)) - cleared
        late = spells.open | (took > limit + GRAIN)
        k = int(np.argmax(np.where(spells.open, np.inf, took)))
        if not took.any():
            k = int(np.nanargmin(self.lowest - self.levels))
        value, at, back = float(took[k]), f"bus {self.buses[k]}", not spells.open[k]
        short = self.course.end - cleared < limit - GRAIN
        verdict = Verdict.VIOLATED if late[k] else Verdict.KEPT
        told = f"{at} is back after {value:.4g} s" if value else "never below after the fault"
        if short:
            verdict = Verdict.OPEN
            told = f"the run ends {self.course.end - cleared:g} s after the fault"
        elif not back:
            told = f"{at} is below at the end of the run"
        found = Finding(
            criterion,
            verdict,
            value,
            limit,
            limit - value,
            (limit - value) / limit,
            "s",
            f"voltage_pu:{self.buses[k]}",
            at,
            cleared + value,
            told if short else told + self._more(late),
        )
        return self.course.answer(found)

    def _more(self, violating: NDArray[np.bool_]) -> str:
        count = int(np.count_nonzero(violating)) - 1
        return f", and {count} more {'bus' if count == 1 else 'buses'} too" if count > 0 else ""
