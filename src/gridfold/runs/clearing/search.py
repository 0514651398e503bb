"""The bisection of one clearing time on a grid, and what it may ask for next."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from heapq import heappop, heappush
from itertools import count

from gridfold.errors import OptionError

#: Finest grid of clearing times in seconds.
_FINEST = 1e-6
#: First clearing time that is tried, in seconds.
_FIRST_TRY = 0.16
#: How likely a trial is to be stable while none has been lost; between two that are known 0.5.
_STABLE = 0.6


@dataclass(frozen=True)
class TimeGrid:
    """Clearing times that are tried: multiples of `resolution` up to `longest`, in seconds.

    `t_end` is the end of each run after the fault starts.
    """

    resolution: float = 0.01
    longest: float = 2.0
    t_end: float = 16.0

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not (math.isfinite(value) and value > 0):
                raise OptionError(f"{name} must be a positive number of seconds, not {value!r}")
        if self.resolution < _FINEST:
            raise OptionError(
                f"the resolution of clearing times must be {_FINEST:g} s or more, not "
                f"{self.resolution:g} s"
            )
        if not self.resolution <= self.longest < self.t_end:
            raise OptionError(
                f"the longest clearing time {self.longest:g} s must lie between the resolution "
                f"{self.resolution:g} s and the end of the run {self.t_end:g} s"
            )

    def seconds(self, steps: int) -> float:
        """The clearing time of a number of steps."""
        return round(steps * self.resolution, 9)

    @property
    def search(self) -> Search:
        """A search that has tried nothing yet."""
        most = math.floor(self.longest / self.resolution + 1e-9)
        return Search(most, 0, min(most, max(1, round(_FIRST_TRY / self.resolution))))


@dataclass(frozen=True)
class Search:
    """How far a bisection is: times up to `low` steps are stable, `high` is tried or lost.

    It doubles the time until synchronism is lost once, then halves what is between.

    Parameters
    ----------
    most : int
        Steps of the longest clearing time.
    low, high : int
        Steps that are known to be stable, and the end of what is looked at.
    lost : bool
        Whether synchronism is lost at `high`.
    """

    most: int
    low: int
    high: int
    lost: bool = False

    @property
    def trial(self) -> int | None:
        """Steps that are tried next; None when the time is found."""
        if self.low == self.most or (self.lost and self.high - self.low <= 1):
            return None
        return (self.low + self.high) // 2 if self.lost else self.high

    def after(self, stable: bool) -> Search:
        """The search once its trial is known to be stable, or not."""
        steps = self.trial
        if steps is None:
            return self
        if not stable:
            return replace(self, high=steps, lost=True)
        return replace(self, low=steps, high=self.high if self.lost else min(2 * steps, self.most))

    def ahead(self, known: Mapping[int, bool]) -> Iterator[int]:
        """Trials that may be asked for, the likeliest first; of those that are `known` what follows."""
        # Of equal likelihood the first that was put there.
        number = count()
        heap = [(-1.0, next(number), self)]
        while heap:
            odds, _, search = heappop(heap)
            steps = search.trial
            if steps is None:
                continue
            stable = 0.5 if search.lost else _STABLE
            shares = {True: stable, False: 1 - stable}
            if steps in known:
                shares = {known[steps]: 1.0}
            else:
                yield steps
            for outcome, share in shares.items():
                heappush(heap, (odds * share, next(number), search.after(outcome)))
