"""For how long quantities lie beyond a threshold, at a stretch, to the sample."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray


@dataclass
class Spells:
    """The spells of `count` quantities, made from their rows in order of time.

    A spell lasts from its first row to the first row that is not beyond any more; one that is not over,
    to the last row.

    Attributes
    ----------
    since : ndarray, shape (count,)
        Start of the spell that is not over, NaN where there is none (s).
    longest, longest_from : ndarray, shape (count,)
        Length and start of the longest one, 0 and NaN where there was none (s).
    back : ndarray, shape (count,)
        First row after the last spell, minus infinity where there was none (s).
    """

    count: int
    since: NDArray[np.float64] = field(init=False)
    longest: NDArray[np.float64] = field(init=False)
    longest_from: NDArray[np.float64] = field(init=False)
    back: NDArray[np.float64] = field(init=False)

    def __post_init__(self) -> None:
        self.since = np.full(self.count, np.nan)
        self.longest = np.zeros(self.count)
        self.longest_from = np.full(self.count, np.nan)
        self.back = np.full(self.count, -np.inf)

    @property
    def open(self) -> NDArray[np.bool_]:
        """Which spells are not over, shape (count,)."""
        return np.isfinite(self.since)

    def take(self, times: NDArray[np.float64], beyond: NDArray[np.bool_]) -> None:
        """Further rows: `times` (n,) in s, and which quantities are `beyond` (n, count) then."""
        if not (beyond.any() or self.open.any()):
            return
        for time, row in zip(times, beyond, strict=True):
            ended = self.open & ~row
            self._lengthen(time, ended)
            self.back[ended] = time
            self.since[ended] = np.nan
            self.since[row & ~self.open] = time

    def finish(self, time: float) -> None:
        """The last row was at `time` (s): those that are not over count until then."""
        self._lengthen(time, self.open)

    def _lengthen(self, time: float, chosen: NDArray[np.bool_]) -> None:
        longer = chosen & (np.nan_to_num(time - self.since) >= self.longest)
        self.longest[longer] = time - self.since[longer]
        self.longest_from[longer] = self.since[longer]
