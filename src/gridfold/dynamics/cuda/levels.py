"""Sparse factors in levels: the rows of a level wait for those of earlier levels alone.

A block of threads takes the rows of a level at once (Anderson & Saad, Solving sparse triangular
linear systems on parallel computers, Int. J. High Speed Computing 1, 1989). Factors of power networks
end in a long chain of levels with one or two rows each. That tail is solved by the inverse of its
matrix, where no row waits for another one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array, csr_array, tril, triu

from gridfold.dynamics.network.equations import NetworkEquations
from gridfold.errors import NetworkError

#: Most rows of the tail.
TAIL = 64


@dataclass(frozen=True)
class LevelFactors:
    """Factors L U of the network, their rows in levels.

    Parameters
    ----------
    starts : ndarray of int, shape (n_levels + 1,)
        First row of each level, and of the tail.
    lower : csr_array, shape (n_rows, starts[-1])
        Rows of L without its diagonal and without columns of the tail.
    upper : csr_array, shape (starts[-1], n_rows)
        Rows of U above the tail without its diagonal.
    inverse_diagonal : ndarray of complex, shape (starts[-1],)
        Of U, outside of the tail.
    tail_inverse : ndarray of complex
        Inverse of the tail's part of L U.
    rows : ndarray of int, shape (n_buses,)
        Row of each bus; -1 where its voltage is zero.
    terminal_rows : ndarray of int, shape (n_terminals,)
        The same of each terminal.
    """

    starts: NDArray[np.int64]
    lower: csr_array
    upper: csr_array
    inverse_diagonal: NDArray[np.complex128]
    tail_inverse: NDArray[np.complex128]
    rows: NDArray[np.int64]
    terminal_rows: NDArray[np.int64]

    @property
    def vector_size(self) -> int:
        """Numbers of the vector that a run is solved in."""
        return 2 * (int(self.lower.shape[0]) + len(self.tail_inverse))


def level_factors(equations: NetworkEquations, tail: int = TAIL) -> LevelFactors:
    """Factors of the network of `equations` with at most `tail` rows in the tail.

    Raises
    ------
    NetworkError
        The factors had to be pivoted.
    """
    factors = equations.factors
    if not np.array_equal(factors.perm_r, factors.perm_c):
        raise NetworkError("runs on a GPU need factors of the network without pivoting")
    lower, upper = csc_array(factors.L), csc_array(factors.U)
    level = _levels(csr_array(lower), csr_array(upper.T))
    order = np.argsort(level, kind="stable")
    counts = np.bincount(level)
    left = np.cumsum(counts[::-1])[::-1]  # rows of each level and of those after it
    starts = np.concatenate([[0], np.cumsum(counts[: int(np.count_nonzero(left > tail))])])
    lower, upper = lower[order][:, order], upper[order][:, order]
    first = int(starts[-1])
    matrix = lower[first:, first:].toarray() @ upper[first:, first:].toarray()
    place = np.empty_like(order)
    place[order] = np.arange(len(order))

    def rows_of(live: NDArray[np.int64]) -> NDArray[np.int64]:
        return np.where(live >= 0, place[factors.perm_r[live]], -1)

    size = len(order)
    return LevelFactors(
        starts.astype(np.int64),
        _rows(tril(lower, -1)[:, :first], (size, first)),
        _rows(triu(upper, 1)[:first], (first, size)),
        1 / upper.diagonal()[:first],
        np.linalg.inv(matrix),
        rows_of(equations.bus_rows),
        rows_of(equations.terminals),
    )


def _levels(*patterns: csr_array) -> NDArray[np.int64]:
    """Level of each row: one more than the highest of the earlier rows in its patterns."""
    level = np.zeros(patterns[0].shape[0], dtype=np.int64)
    for row in range(len(level)):
        for pattern in patterns:
            needs = pattern.indices[pattern.indptr[row] : pattern.indptr[row + 1]]
            level[row] = max(level[row], level[needs[needs < row]].max(initial=-1) + 1)
    return level


def _rows(matrix: csr_array, shape: tuple[int, int]) -> csr_array:
    rows = csr_array(matrix, shape=shape)
    rows.sort_indices()
    return rows
