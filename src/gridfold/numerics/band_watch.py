"""A watch on quantities that stay in a band, such as rotor angles against the centre of inertia."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gridfold.numerics.checked_arrays import require_shapes
from gridfold.numerics.common_row import split_rows
from gridfold.numerics.compiled import compile_callback, compiled_part, matrix_view
from gridfold.numerics.watch import WATCH_SIGNATURE, CompiledWatch, Reach

# Numbers in front of the integers and of the reals.
_HEADER, _KNOWN = 6, 5
#: Margin, verdict, common quantity and states in a row before the first: no margin settles nothing.
_NOTHING_KNOWN = (0.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True)
class BandWatch:
    """Holds when one of the quantities C x + d leaves a band, or when all are inside it.

    C is split into a common row, rows with few entries besides, and dense ones (:func:`split_rows`).
    At most states the dense ones are judged without being formed: since the state y none of them
    can have moved further than the common quantity and the sum of ``reach * abs(x - y)``.

    Parameters
    ----------
    matrix : ndarray, shape (n, n_states)
        C.
    offset : ndarray, shape (n,)
        d.
    limit : float
        Half the width of the band around 0.
    inside : bool
        False: the condition is that one is outside. True: that all are inside.
    steps : int
        States in a row for which that has to be so.
    """

    matrix: NDArray[np.float64]
    offset: NDArray[np.float64]
    limit: float
    inside: bool = False
    steps: int = 1

    def __post_init__(self) -> None:
        require_shapes("a watch", self, {"offset": (len(self.matrix),)})

    def distances(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Magnitudes of the quantities, shape (n,)."""
        return np.asarray(np.abs(self.matrix @ x + self.offset))

    def holds(self, x: NDArray[np.float64]) -> bool:
        """Whether the condition holds."""
        within = bool(np.max(self.distances(x), initial=0.0) <= self.limit)
        return within == self.inside

    @cached_property
    def reach(self) -> NDArray[np.float64]:
        """By how much the most sensitive quantity moves with each state, shape (n_states,)."""
        return np.asarray(np.abs(self.matrix).max(axis=0, initial=0.0))

    def first(self, states: NDArray[np.float64]) -> int | None:
        """First row of `states`, shape (n, n_states), in which the condition holds, or None."""
        with np.errstate(invalid="ignore", over="ignore"):
            largest = np.abs(states) @ self.reach + np.abs(self.offset).max(initial=0.0)
            within = largest <= self.limit
            unclear = np.flatnonzero(~within)
            distances = np.abs(states[unclear] @ self.matrix.T + self.offset)
        within[unclear] = distances.max(axis=1, initial=0.0) <= self.limit
        so = np.concatenate([[0], np.cumsum(within == self.inside)])
        rows = np.flatnonzero(so[self.steps :] - so[: -self.steps] == self.steps)
        return int(rows[0]) + self.steps - 1 if len(rows) else None

    def never(self, reach: Reach) -> bool:
        """Whether all quantities stay in the band; that they stay outside is not told."""
        within = np.abs(self.offset) + reach(self.matrix) <= self.limit
        return not self.inside and bool(within.all())

    def compile(self) -> CompiledWatch:
        """The condition for compiled loops."""
        return self._compiled

    @cached_property
    def _compiled(self) -> CompiledWatch:
        parts = split_rows(self.matrix)
        used = np.flatnonzero(parts.common)
        sizes = [self.inside, self.steps, len(used), len(parts.few), *parts.dense.shape]
        integers = [np.array(sizes), used, parts.columns, parts.starts, parts.places]
        reals = [
            np.array([self.limit, *_NOTHING_KNOWN]),
            parts.common[used],
            self.offset[parts.many],
            parts.dense.ravel(),
            np.abs(parts.dense).max(axis=0, initial=0.0),
            np.zeros(len(parts.columns)),
            self.offset[parts.few],
            parts.entries,
        ]
        return CompiledWatch(
            _compiled_band().address,
            np.concatenate(integers).astype(np.int64),
            np.concatenate(reals),
            self.matrix.shape[1],
        )


def _band(integers, reals, x, verdict):
    # reals: limit; margin of the dense rows, whether they were within, and the common quantity at the
    # last state y at which they were formed; states in a row for which the condition held; the common
    # row, offsets of the dense rows, these, their reach, y; offsets and entries of the other rows
    n_used, n_few, n_many, n_columns = integers[2], integers[3], integers[4], integers[5]
    columns = integers[_HEADER + n_used :]
    offsets_at = _KNOWN + n_used
    matrix_at = offsets_at + n_many
    reach = reals[matrix_at + n_many * n_columns :]
    last = reach[n_columns:]

    common = 0.0
    for k in range(n_used):
        common += reals[_KNOWN + k] * x[integers[_HEADER + k]]
    moved = abs(common - reals[3])
    for j in range(n_columns):
        moved += reach[j] * abs(x[columns[j]] - last[j])
    if not moved < reals[1]:
        for j in range(n_columns):
            last[j] = x[columns[j]]
        reals[3] = common
        dense = matrix_view(reals, matrix_at, n_many, n_columns)
        worst = _largest(reals[offsets_at:matrix_at], dense, common, last)
        reals[1] = abs(worst - reals[0])
        reals[2] = 1.0 if worst <= reals[0] else 0.0
    few = _largest_of_few(columns[n_columns:], last[n_columns:], n_few, common, x)
    within = 1 if reals[2] != 0.0 and few <= reals[0] else 0
    reals[4] = reals[4] + 1.0 if within == integers[0] else 0.0
    verdict[0] = 1.0 if reals[4] >= integers[1] else 0.0


@compiled_part
def _largest(offset, matrix, common, x):
    """Largest magnitude in C x + d with the common quantity; NaN where one is."""
    worst = 0.0
    for i in range(matrix.shape[0]):
        value = offset[i] + common
        for j in range(matrix.shape[1]):
            value += matrix[i, j] * x[j]
        if not abs(value) <= worst:
            worst = abs(value)
        if np.isnan(value):
            return value
    return worst


@compiled_part
def _largest_of_few(integers, reals, n, common, x):
    """The same for rows with few entries: their starts and columns, their offsets and entries."""
    worst = 0.0
    for i in range(n):
        value = reals[i] + common
        for k in range(integers[i], integers[i + 1]):
            value += reals[n + k] * x[integers[n + 1 + k]]
        if not abs(value) <= worst:
            worst = abs(value)
        if np.isnan(value):
            return value
    return worst


@cache
def _compiled_band() -> Any:
    return compile_callback(_band, WATCH_SIGNATURE)
