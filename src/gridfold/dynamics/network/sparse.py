"""Sparse backend: triangular solves restricted to what the terminals reach.

The factors have a symmetric pattern and no pivoting. A right-hand side that is non-zero only at the
terminals, of which the solution is wanted only there, touches only the rows on the paths from the
terminals to the root of the elimination tree (Davis, Direct Methods for Sparse Linear Systems, 2006,
sections 3.2 and 4.1); the factors are cut down to those rows.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array, csr_array, tril, triu

from gridfold.dynamics.network.backend import NETWORK_SIGNATURE, CompiledNetwork
from gridfold.dynamics.network.equations import NetworkEquations
from gridfold.errors import NetworkError
from gridfold.numerics.compiled import compile_callback

_HEADER = 4


def sparse_network(equations: NetworkEquations) -> CompiledNetwork:
    """Compile the equations into two sparse triangular solves."""
    present = equations.terminals >= 0
    terminals = np.full(len(present), -1)
    lower = upper = csc_array((0, 0), dtype=np.complex128)
    if present.any():
        factors = equations.factors
        if not np.array_equal(factors.perm_r, factors.perm_c):
            raise NetworkError(
                "the sparse network solver needs factors without pivoting; use dense"
            )
        lower, upper = csc_array(factors.L), csc_array(factors.U)
        places = factors.perm_r[equations.terminals[present]]
        reached = paths_to_root(lower, places)
        lower, upper = lower[reached][:, reached], upper[reached][:, reached]
        terminals[present] = np.searchsorted(reached, places)
    low = csc_array(tril(lower, k=-1))
    up = csr_array(triu(upper, k=1))
    inverse = 1 / upper.diagonal()
    parts = (terminals, low.indptr, low.indices, up.indptr, up.indices)
    header = [len(terminals), lower.shape[0], low.nnz, up.nnz]
    values = np.concatenate([low.data, up.data, inverse])
    return CompiledNetwork(
        address=_compiled().address,
        integers=np.concatenate([header, *parts]).astype(np.int64),
        reals=values.view(np.float64),
        scratch_size=2 * lower.shape[0],
    )


def paths_to_root(lower: csc_array, starts: NDArray[np.int64]) -> NDArray[np.int64]:
    """All nodes on the elimination-tree paths from `starts`, ascending."""
    lower.sort_indices()
    reached: set[int] = set()
    for start in starts:
        node = int(start)
        while node not in reached:
            reached.add(node)
            column = lower.indices[lower.indptr[node] : lower.indptr[node + 1]]
            below = column[column > node]
            if len(below) == 0:
                break
            node = int(below[0])
    return np.array(sorted(reached), dtype=np.int64)


def _solve(integers, reals, currents, voltages, scratch):
    """Forward by columns of L, backward by rows of U; complex numbers lie as pairs of reals."""
    n, m, n_low, n_up = integers[0], integers[1], integers[2], integers[3]
    low = _HEADER + n
    low_rows = low + m + 1
    up = low_rows + n_low
    up_columns = up + m + 1
    up_values = 2 * n_low
    inverse = up_values + 2 * n_up
    for k in range(2 * m):
        scratch[k] = 0.0
    for t in range(n):
        k = 2 * integers[_HEADER + t]
        if k >= 0:
            scratch[k] += currents[t]
            scratch[k + 1] += currents[n + t]
    for j in range(m):
        b_r, b_i = scratch[2 * j], scratch[2 * j + 1]
        for e in range(integers[low + j], integers[low + j + 1]):
            i = 2 * integers[low_rows + e]
            a_r, a_i = reals[2 * e], reals[2 * e + 1]
            scratch[i] -= a_r * b_r - a_i * b_i
            scratch[i + 1] -= a_r * b_i + a_i * b_r
    for j in range(m - 1, -1, -1):
        b_r, b_i = scratch[2 * j], scratch[2 * j + 1]
        for e in range(integers[up + j], integers[up + j + 1]):
            i = 2 * integers[up_columns + e]
            a_r, a_i = reals[up_values + 2 * e], reals[up_values + 2 * e + 1]
            b_r -= a_r * scratch[i] - a_i * scratch[i + 1]
            b_i -= a_r * scratch[i + 1] + a_i * scratch[i]
        d_r, d_i = reals[inverse + 2 * j], reals[inverse + 2 * j + 1]
        scratch[2 * j] = d_r * b_r - d_i * b_i
        scratch[2 * j + 1] = d_r * b_i + d_i * b_r
    for t in range(n):
        k = 2 * integers[_HEADER + t]
        voltages[t] = scratch[k] if k >= 0 else 0.0
        voltages[n + t] = scratch[k + 1] if k >= 0 else 0.0


@cache
def _compiled() -> Any:
    return compile_callback(_solve, NETWORK_SIGNATURE)
