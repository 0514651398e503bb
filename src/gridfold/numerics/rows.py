"""What is asked of every row of a table of curves, in one pass over it."""

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
