"""Rows of a matrix that differ from a common row in few places, and those that differ in many.

Rotor angles against the centre of inertia are such rows: each has minus the machine's share at every
other machine. What is left is one entry for an exact machine, and a row of the modes of the area for a
linear one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

#: Most entries of a row that is not taken for dense.
_FEW = 4


@dataclass(frozen=True)
class CommonRow:
    """C = 1 c^T + S.

    Parameters
    ----------
    common : ndarray, shape (n_columns,)
        c.
    few, many : ndarray of int
        Rows of S with few entries, and all others.
    starts : ndarray of int, shape (n_few + 1,)
        Where the entries of each row with few begin.
    places : ndarray of int, shape (n_entries,)
        Their columns.
    entries : ndarray, shape (n_entries,)
        Their values.
    columns : ndarray of int, shape (m,)
        Columns in which the other rows have entries.
    dense : ndarray, shape (n_many, m)
        Their values.
    """

    common: NDArray[np.float64]
    few: NDArray[np.int64]
    many: NDArray[np.int64]
    starts: NDArray[np.int64]
    places: NDArray[np.int64]
    entries: NDArray[np.float64]
    columns: NDArray[np.int64]
    dense: NDArray[np.float64]


def split_rows(matrix: NDArray[np.float64]) -> CommonRow:
    """Split a matrix (n, n_columns): what most rows have in a column is common."""
    common = np.median(matrix, axis=0) if len(matrix) else np.zeros(matrix.shape[1])
    rest = matrix - common
    used = rest != 0.0
    sparse = used.sum(axis=1) <= _FEW
    few, many = np.flatnonzero(sparse), np.flatnonzero(~sparse)
    columns = np.flatnonzero(used[many].any(axis=0))
    row, places = np.nonzero(used[few])
    starts = np.concatenate([[0], np.cumsum(np.bincount(row, minlength=len(few)))])
    dense = np.ascontiguousarray(rest[np.ix_(many, columns)])
    return CommonRow(common, few, many, starts, places, rest[few][row, places], columns, dense)
