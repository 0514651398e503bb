"""What a table of a run holds at a glance: start, end, and extremes of every column."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Extremes:
    """A column: its first and last value, its extremes, and when they were (s); NaN if it has none."""

    name: str
    start: float
    lowest: float
    lowest_at: float
    highest: float
    highest_at: float
    end: float


def extremes(names: Sequence[str], table: NDArray[np.float64]) -> list[Extremes]:
    """Extremes of columns `names` of a `table` (n, 1 + n_columns) whose first column is the time."""
    return [_of(name, table[:, 0], values) for name, values in zip(names, table.T[1:], strict=True)]


def _of(name: str, times: NDArray[np.float64], values: NDArray[np.float64]) -> Extremes:
    there = np.flatnonzero(np.isfinite(values))
    if not len(there):
        return Extremes(name, *(6 * [float("nan")]))
    shown = values[there]
    low, high = there[shown.argmin()], there[shown.argmax()]
    figures = (shown[0], values[low], times[low], values[high], times[high], shown[-1])
    return Extremes(name, *map(float, figures))
