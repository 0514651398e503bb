"""Two runs with the same columns: where they differ most."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Values = Mapping[str, NDArray[np.float64]]


@dataclass(frozen=True)
class Difference:
    """A column of two runs: the largest difference (second less first), when (s), and its mean square.

    `values` are those of both runs then. `gaps` counts the times at which one run alone has a value.
    """

    name: str
    largest: float
    at: float
    root_mean_square: float
    values: tuple[float, float]
    gaps: int


def at_times(
    wanted: NDArray[np.float64], times: NDArray[np.float64], values: NDArray[np.float64]
) -> NDArray[np.float64]:
    """A curve at other times, straight between its samples; NaN before and after them."""
    if len(times) == len(wanted) and np.allclose(times, wanted, rtol=0, atol=1e-9):
        return values
    return np.interp(wanted, times, values, left=np.nan, right=np.nan)


def differences(times: NDArray[np.float64], first: Values, second: Values) -> list[Difference]:
    """Differences of columns at the same `times` (n,), those with the largest first, kind by kind."""
    found = [_of(name, times, first[name], second[name]) for name in first if name in second]
    kinds = list(dict.fromkeys(item.name.partition(":")[0] for item in found))
    return sorted(
        found, key=lambda item: (kinds.index(item.name.partition(":")[0]), -_size(item.largest))
    )


def _size(value: float) -> float:
    return abs(value) if np.isfinite(value) else -1.0


def _of(
    name: str, times: NDArray[np.float64], one: NDArray[np.float64], other: NDArray[np.float64]
) -> Difference:
    apart = other - one
    there = np.flatnonzero(np.isfinite(apart))
    gaps = int((np.isfinite(one) != np.isfinite(other)).sum())
    nothing = float("nan")
    if not len(there):
        return Difference(name, nothing, nothing, nothing, (nothing, nothing), gaps)
    at = int(there[np.abs(apart[there]).argmax()])
    mean = float(np.sqrt(np.mean(apart[there] ** 2)))
    both = float(one[at]), float(other[at])
    return Difference(name, float(apart[at]), float(times[at]), mean, both, gaps)
