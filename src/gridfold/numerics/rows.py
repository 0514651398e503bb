"""What is asked of a table of curves, each a column, in one pass over it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from gridfold.numerics.compiled import FAST, jit

Table = NDArray[np.float64]


def less_reference(values: Table, reference: NDArray[np.float64]) -> Table:
    """`values` (n, m) less the `reference` (n,) of each row."""
    result = np.empty(values.shape)
    _subtract(values, reference, result)
    return result


def widest_row(values: Table) -> tuple[float, int]:
    """The largest distance of two entries of a row of `values` (n, m), and the first row that has it.

    Rows with an entry that is not a number do not count; -1 where there is no other.
    """
    found: tuple[float, int] = _widest(values)
    return found


def extreme_rows(values: Table) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The first rows in which each column of `values` (n, m) is highest and lowest, each (m,).

    What is not a number does not count; 0 where there is nothing else.
    """
    columns = values.shape[1]
    highest, lowest = np.zeros((2, columns), dtype=np.int64)
    _find_rows(values, np.full(columns, -np.inf), np.full(columns, np.inf), highest, lowest)
    return highest, lowest


def column_range(values: Table) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The lowest and the highest entry of each column of `values` (n, m), each (m,).

    What is not a number does not count; NaN where there is nothing else.
    """
    low, high = np.full(values.shape[1], np.inf), np.full(values.shape[1], -np.inf)
    _find_range(values, low, high)
    none = low > high
    low[none] = high[none] = np.nan
    return low, high


@jit(nogil=True, error_model="numpy", fastmath=FAST)
def _find_rows(values: Any, high: Any, low: Any, highest: Any, lowest: Any) -> None:
    for i in range(values.shape[0]):
        for j in range(values.shape[1]):
            value = values[i, j]
            highest[j] = i if value > high[j] else highest[j]
            high[j] = value if value > high[j] else high[j]
            lowest[j] = i if value < low[j] else lowest[j]
            low[j] = value if value < low[j] else low[j]


@jit(nogil=True, error_model="numpy", fastmath=FAST)
def _find_range(values: Any, low: Any, high: Any) -> None:
    for i in range(values.shape[0]):
        for j in range(values.shape[1]):
            value = values[i, j]
            high[j] = value if value > high[j] else high[j]
            low[j] = value if value < low[j] else low[j]


@jit(nogil=True, error_model="numpy", fastmath=FAST)
def _subtract(values: Any, reference: Any, result: Any) -> None:
    for i in range(values.shape[0]):
        for j in range(values.shape[1]):
            result[i, j] = values[i, j] - reference[i]


@jit(nogil=True, error_model="numpy", fastmath=FAST)
def _widest(values: Any) -> Any:
    widest, at = -1.0, -1
    for i in range(values.shape[0]):
        low, high, known = np.inf, -np.inf, 0.0
        for j in range(values.shape[1]):
            value = values[i, j]
            low = value if value < low else low
            high = value if value > high else high
            known += 0.0 * value
        if known == 0.0 and high - low > widest:
            widest, at = high - low, i
    return widest, at
