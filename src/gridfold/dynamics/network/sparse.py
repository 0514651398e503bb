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
from scipy.sparse import csc_array

from gridfold.dynamics.network.backend import NETWORK_SIGNATURE, CompiledNetwork
from gridfold.dynamics.network.equations import NetworkEquations
from gridfold.errors import NetworkError
from gridfold.numerics.compiled import compile_callback

_HEADER = 5


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
        reached = _paths_to_root(lower, places)
        lower, upper = lower[reached][:, reached], upper[reached][:, reached]
        terminals[present] = np.searchsorted(reached, places)
    low, low_values = _strict_columns(lower, below=True)
    up, up_values = _strict_columns(upper, below=False)
    inverse = 1 / upper.diagonal()
    values = np.concatenate([low_values, up_values, inverse])
    header = [len(terminals), lower.shape[0], len(low_values), len(up_values), len(low)]
    integers = np.concatenate([header, terminals, low, up]).astype(np.int64)
    reals = np.concatenate([values.real, values.imag])
    return CompiledNetwork(_compiled().address, integers, reals, 2 * lower.shape[0])


def _paths_to_root(lower: csc_array, starts: NDArray[np.int64]) -> NDArray[np.int64]:
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


def _strict_columns(
    triangle: csc_array, below: bool
) -> tuple[NDArray[np.int64], NDArray[np.complex128]]:
    """Columns without the diagonal, as (pointers then row numbers, values)."""
    entries = triangle.tocoo()
    rows, columns = entries.row, entries.col
    keep = rows > columns if below else rows < columns
    n = triangle.shape[0]
    strict = csc_array((entries.data[keep], (rows[keep], columns[keep])), shape=(n, n))
    return np.concatenate([strict.indptr, strict.indices]).astype(np.int64), strict.data


def _solve(integers, reals, currents, voltages, scratch):
    n, m, n_low, n_up, low_size = (
        integers[0], integers[1], integers[2], integers[3], integers[4],
    )  # fmt: skip
    at = _HEADER
    low = at + n
    up = low + low_size
    imag = n_low + n_up + m
    inverse = n_low + n_up
    for k in range(2 * m):
        scratch[k] = 0.0
    for t in range(n):
        k = integers[at + t]
        if k >= 0:
            scratch[k] += currents[t]
            scratch[m + k] += currents[n + t]
    for j in range(m):
        b_r, b_i = scratch[j], scratch[m + j]
        for e in range(integers[low + j], integers[low + j + 1]):
            i = integers[low + m + 1 + e]
            a_r, a_i = reals[e], reals[imag + e]
            scratch[i] -= a_r * b_r - a_i * b_i
            scratch[m + i] -= a_r * b_i + a_i * b_r
    for j in range(m - 1, -1, -1):
        d_r, d_i = reals[inverse + j], reals[imag + inverse + j]
        b_r = d_r * scratch[j] - d_i * scratch[m + j]
        b_i = d_r * scratch[m + j] + d_i * scratch[j]
        scratch[j] = b_r
        scratch[m + j] = b_i
        for e in range(integers[up + j], integers[up + j + 1]):
            i = integers[up + m + 1 + e]
            a_r, a_i = reals[n_low + e], reals[imag + n_low + e]
            scratch[i] -= a_r * b_r - a_i * b_i
            scratch[m + i] -= a_r * b_i + a_i * b_r
    for t in range(n):
        k = integers[at + t]
        if k >= 0:
            voltages[t] = scratch[k]
            voltages[n + t] = scratch[m + k]
        else:
            voltages[t] = 0.0
            voltages[n + t] = 0.0


@cache
def _compiled() -> Any:
    return compile_callback(_solve, NETWORK_SIGNATURE)
