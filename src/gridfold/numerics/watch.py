"""Conditions that end an integration early, checked after every step in compiled code."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any, Protocol

import numpy as np
from numba import types
from numpy.typing import NDArray

from gridfold.errors import OptionError
from gridfold.numerics.checked_arrays import ANY_LENGTH, require_positions, require_shapes
from gridfold.numerics.compiled import (
    compile_callback,
    compiled_part,
    invoke,
    matrix_view,
)

#: ``watch(integers, reals, x, verdict)``: sets verdict[0] to 1 where the condition holds, else to 0.
#: Its data belong to one integration: it may keep in `reals` what it knows from the last state.
WATCH_SIGNATURE = types.void(
    types.int64[::1], types.float64[::1], types.float64[::1], types.float64[::1]
)

#: Margin and verdict of a box watch before the first state: a margin of 0 settles nothing.
_NOTHING_KNOWN = (0.0, 0.0)


@dataclass(frozen=True)
class CompiledWatch:
    """Address of a compiled condition, its data, and how many states it reads."""

    address: int
    integers: NDArray[np.int64]
    reals: NDArray[np.float64]
    n_states: int


#: From rows (n, n_states) to bounds (n,) of the magnitudes of ``rows @ x`` in the time to come.
Reach = Callable[[NDArray[np.float64]], NDArray[np.float64]]


class Watch(Protocol):
    """A condition on the state of a system."""

    def compile(self) -> CompiledWatch:
        """The condition for compiled loops."""

    def distances(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """How far each watched quantity is from its reference."""

    def holds(self, x: NDArray[np.float64]) -> bool:
        """Whether the condition holds at the state `x`; it does where something is not finite."""

    def first(self, states: NDArray[np.float64]) -> int | None:
        """First row of `states`, shape (n, n_states), in which the condition holds, or None."""

    def never(self, reach: Reach) -> bool:
        """Whether it cannot hold where `reach` bounds the magnitudes of linear quantities."""


@dataclass(frozen=True)
class SpreadWatch:
    """Holds when a watched state is further than `limit` from its group's reference.

    Parameters
    ----------
    index : ndarray of int, shape (n,)
        Positions of the watched entries in the state vector.
    group : ndarray of int, shape (n,)
        Group of each watched entry, counted from 0.
    weight : ndarray, shape (n,)
        Its weight in the mean of the group.
    reference : ndarray, shape (n_groups,)
        A fixed reference for the group, or NaN where the reference is the weighted mean.
    limit : float
        Largest distance allowed.
    """

    index: NDArray[np.int64]
    group: NDArray[np.int64]
    weight: NDArray[np.float64]
    reference: NDArray[np.float64]
    limit: float

    def __post_init__(self) -> None:
        n = len(self.index)
        require_shapes("a watch", self, {"index": (n,), "group": (n,), "weight": (n,)})
        require_positions("watched states", self.index, ANY_LENGTH)
        require_positions("groups of watched states", self.group, len(self.reference))

    def distances(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Distance of each watched entry from its group's reference, shape (n,)."""
        values = x[self.index]
        size = len(self.reference)
        total = np.bincount(self.group, self.weight, size)
        mean = np.bincount(self.group, self.weight * values, size) / np.where(total, total, 1.0)
        reference = np.where(np.isnan(self.reference), mean, self.reference)
        return np.asarray(np.abs(values - reference[self.group]))

    def holds(self, x: NDArray[np.float64]) -> bool:
        """Whether an entry is beyond the limit."""
        return not np.max(self.distances(x), initial=0.0) <= self.limit

    def first(self, states: NDArray[np.float64]) -> int | None:
        """First row of `states`, shape (n, n_states), in which the condition holds, or None."""
        return next((row for row, state in enumerate(states) if self.holds(state)), None)

    def never(self, reach: Reach) -> bool:
        """Nothing is known of it."""
        return False

    def compile(self) -> CompiledWatch:
        """The condition for compiled loops."""
        sizes = [len(self.index), len(self.reference)]
        return CompiledWatch(
            _compiled_spread().address,
            np.concatenate([sizes, self.index, self.group]).astype(np.int64),
            np.concatenate([[self.limit], self.weight, self.reference]),
            int(np.max(self.index, initial=-1)) + 1,
        )


@dataclass(frozen=True)
class BoxWatch:
    """Holds when one of the quantities C x leaves its range.

    Most states are judged without forming the quantities: none of them can have moved further than
    the sum of ``reach * abs(x - y)`` since the state y.

    Parameters
    ----------
    matrix : ndarray, shape (n, n_states)
        C.
    lower, upper : ndarrays, shape (n,)
        The ranges; infinite where there is no end.
    """

    matrix: NDArray[np.float64]
    lower: NDArray[np.float64]
    upper: NDArray[np.float64]

    def __post_init__(self) -> None:
        n = len(self.matrix)
        require_shapes("a watch", self, {"lower": (n,), "upper": (n,)})

    def distances(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """How far each quantity is beyond its range, negative inside; shape (..., n)."""
        with np.errstate(invalid="ignore", over="ignore"):
            values = x @ self.matrix.T
            return np.asarray(np.maximum(self.lower - values, values - self.upper))

    def holds(self, x: NDArray[np.float64]) -> bool:
        """Whether a quantity is beyond its range."""
        return not np.max(self.distances(x), initial=-np.inf) <= 0

    @cached_property
    def reach(self) -> NDArray[np.float64]:
        """By how much the most sensitive quantity moves with each state, shape (n_states,)."""
        return np.asarray(np.abs(self.matrix).max(axis=0, initial=0.0))

    def first(self, states: NDArray[np.float64]) -> int | None:
        """First row of `states`, shape (n, n_states), in which the condition holds, or None."""
        room = min(np.min(self.upper, initial=np.inf), np.min(-self.lower, initial=np.inf))
        with np.errstate(invalid="ignore", over="ignore"):
            unclear = np.flatnonzero(~(np.abs(states) @ self.reach <= room))
        beyond = self.distances(states[unclear]).max(axis=1, initial=-np.inf)
        rows = unclear[~(beyond <= 0)]
        return int(rows[0]) if len(rows) else None

    def never(self, reach: Reach) -> bool:
        """Whether all quantities stay in their ranges."""
        bound = reach(self.matrix)
        return bool(((self.lower <= -bound) & (bound <= self.upper)).all())

    def compile(self) -> CompiledWatch:
        """The condition for compiled loops."""
        n, n_states = self.matrix.shape
        ranges = [self.lower, self.upper, self.matrix.ravel(), self.reach, np.zeros(n_states)]
        return CompiledWatch(
            _compiled_box().address,
            np.array([n, n_states], dtype=np.int64),
            np.concatenate([_NOTHING_KNOWN, *ranges]),
            n_states,
        )


def first_fired(watches: Sequence[Watch], states: NDArray[np.float64]) -> tuple[int, int] | None:
    """First row of `states` in which a watch holds, and the number of that watch, from 1.

    In one row the watch with the lower number counts. None if no watch holds anywhere.
    """
    rows = [(watch.first(states), number) for number, watch in enumerate(watches, start=1)]
    return min(((row, number) for row, number in rows if row is not None), default=None)


def pack_watches(
    watches: Sequence[Watch], n_states: int
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
    """Watches as a table (address, integers from, to, reals from, to) and two data blocks.

    Raises an OptionError if one reads more than the `n_states` of a system.
    """
    compiled = [watch.compile() for watch in watches]
    for watch in compiled:
        if watch.n_states > n_states:
            raise OptionError(f"a watch reads {watch.n_states} states of a system with {n_states}")
    table = np.zeros((len(compiled), 5), dtype=np.int64)
    integers_at = reals_at = 0
    for row, watch in zip(table, compiled, strict=True):
        row[:] = (
            watch.address,
            integers_at,
            integers_at + len(watch.integers),
            reals_at,
            reals_at + len(watch.reals),
        )
        integers_at, reals_at = row[2], row[4]
    none = np.zeros(0)
    return (
        table,
        np.concatenate([*(w.integers for w in compiled), none]).astype(np.int64),
        np.concatenate([*(w.reals for w in compiled), none]),
    )


@compiled_part
def first_watch(table, integers, reals, x, verdict):
    """Number, counted from 1, of the first watch whose condition holds; 0 if there is none."""
    for k in range(table.shape[0]):
        row = table[k]
        invoke(row[0], (integers[row[1] : row[2]], reals[row[3] : row[4]], x, verdict))
        if verdict[0] != 0.0:
            return k + 1
    return 0


def _spread(integers, reals, x, verdict):
    n, n_groups = integers[0], integers[1]
    verdict[0] = 0.0
    for g in range(n_groups):
        reference = reals[1 + n + g]
        if np.isnan(reference):
            total = weights = 0.0
            for k in range(n):
                if integers[2 + n + k] == g:
                    total += reals[1 + k] * x[integers[2 + k]]
                    weights += reals[1 + k]
            reference = total / weights
        for k in range(n):
            if integers[2 + n + k] == g and not abs(x[integers[2 + k]] - reference) <= reals[0]:
                verdict[0] = 1.0


def _box(integers, reals, x, verdict):
    # reals: margin and verdict at the last state y that was judged in full; lower, upper, C, reach, y
    n, n_states = integers[0], integers[1]
    matrix_at = 2 + 2 * n
    reach_at = matrix_at + n * n_states
    moved = 0.0
    for j in range(n_states):
        moved += reals[reach_at + j] * abs(x[j] - reals[reach_at + n_states + j])
    if not moved < reals[0]:
        matrix = matrix_view(reals, matrix_at, n, n_states)
        worst = _furthest(reals[2 : 2 + n], reals[2 + n : 2 + 2 * n], matrix, x)
        reals[0] = abs(worst)
        reals[1] = 0.0 if worst <= 0 else 1.0
        for j in range(n_states):
            reals[reach_at + n_states + j] = x[j]
    verdict[0] = reals[1]


@compiled_part
def _furthest(lower, upper, matrix, x):
    """How far C x is beyond its ranges, negative inside; NaN where a quantity is."""
    worst = -np.inf
    for i in range(matrix.shape[0]):
        value = 0.0
        for j in range(matrix.shape[1]):
            value += matrix[i, j] * x[j]
        beyond = max(lower[i] - value, value - upper[i])
        if np.isnan(value) or np.isnan(beyond):
            return np.nan
        worst = max(worst, beyond)
    return worst


@cache
def _compiled_spread() -> Any:
    return compile_callback(_spread, WATCH_SIGNATURE)


@cache
def _compiled_box() -> Any:
    return compile_callback(_box, WATCH_SIGNATURE)
