"""The network equations solved for many members at once, by sparse factors.

Currents and voltages have the shape (2 n, members), real parts before imaginary parts. Members are
taken in groups of eight, for which each entry of the factors is read once. Rows of L and U are
taken in order, so that what is summed up stays in a register (Davis, Direct Methods for Sparse
Linear Systems, 2006, chapter 3).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array, csr_array, tril, triu

from gridfold.dynamics.network.equations import NetworkEquations
from gridfold.dynamics.network.sparse import paths_to_root
from gridfold.errors import NetworkError
from gridfold.numerics.compiled import compiled_part
from gridfold.numerics.lanes import WIDTH, all_lanes, load_lanes, store_lanes

#: Where the parts of the integers begin.
(N_INPUTS, N_ROWS, N_LOW, N_UP) = range(4)
HEADER = 4
#: Numbers of scratch for each row of the factors.
ROW = 2 * WIDTH


@dataclass(frozen=True)
class ColumnFactors:
    """Factors of the network, and where currents go in and which rows buses have.

    Parameters
    ----------
    integers, reals : ndarray
        Data of :func:`solve_group`.
    n_rows : int
        Rows of the factors.
    rows : ndarray of int, shape (n_buses,)
        Row of each bus, -1 where its voltage is zero or not solved for.
    """

    integers: NDArray[np.int64]
    reals: NDArray[np.float64]
    n_rows: int
    rows: NDArray[np.int64]


def column_factors(equations: NetworkEquations, every_bus: bool) -> ColumnFactors:
    """Factors for currents at the terminals, and voltages there or at every bus.

    Raises
    ------
    NetworkError
        The factors had to be pivoted.
    """
    factors = equations.factors
    if not np.array_equal(factors.perm_r, factors.perm_c):
        raise NetworkError("a batch needs factors of the network without pivoting")
    lower, upper = csc_array(factors.L), csc_array(factors.U)
    place = factors.perm_r.astype(np.int64)
    present = equations.terminals >= 0
    reached = np.arange(lower.shape[0])
    if not every_bus:
        reached = paths_to_root(lower, place[equations.terminals[present]])
    reached = reached[_postorder(lower[reached][:, reached])]
    lower, upper = lower[reached][:, reached], upper[reached][:, reached]
    row_of = np.full(len(place), -1)
    row_of[reached] = np.arange(len(reached))
    inputs = np.full(len(present), -1)
    inputs[present] = row_of[place[equations.terminals[present]]]
    low, up = csr_array(tril(lower, k=-1)), csr_array(triu(upper, k=1))
    low.sort_indices()
    up.sort_indices()
    values = np.concatenate([low.data, up.data, 1 / upper.diagonal()])
    header = [len(inputs), len(reached), low.nnz, up.nnz]
    rows = np.where(equations.bus_rows >= 0, row_of[place][equations.bus_rows], -1)
    parts = (header, inputs, low.indptr, low.indices, up.indptr, up.indices)
    return ColumnFactors(
        np.concatenate(parts).astype(np.int64), values.view(np.float64), len(reached), rows
    )


def _postorder(lower: csc_array) -> NDArray[np.int64]:
    """Nodes of the elimination tree, each right behind those below it: what is needed is at hand."""
    lower.sort_indices()
    n = lower.shape[0]
    children: list[list[int]] = [[] for _ in range(n + 1)]
    for node in range(n):
        column = lower.indices[lower.indptr[node] : lower.indptr[node + 1]]
        above = column[column > node]
        children[int(above[0]) if len(above) else n].append(node)
    order: list[int] = []
    waiting = [n]
    while waiting:
        node = waiting.pop()
        order.append(node)
        waiting += children[node]
    return np.array(order[:0:-1], dtype=np.int64)


@compiled_part
def put_currents(integers, currents, members, first, scratch):
    """Put the terminals' currents of the group from member `first` on into the scratch space."""
    n = integers[N_INPUTS]
    zero = all_lanes(0.0)
    for k in range(2 * integers[N_ROWS]):
        store_lanes(scratch, k * WIDTH, zero)
    for t in range(n):
        k = integers[HEADER + t]
        if k >= 0:
            real, imaginary = k * ROW, k * ROW + WIDTH
            here = load_lanes(currents, t * members + first)
            store_lanes(scratch, real, load_lanes(scratch, real) + here)
            here = load_lanes(currents, (n + t) * members + first)
            store_lanes(scratch, imaginary, load_lanes(scratch, imaginary) + here)


@compiled_part
def solve_group(integers, reals, scratch):
    """Solve for eight members; currents in the scratch space, by rows, become voltages."""
    m, n_low, n_up = integers[N_ROWS], integers[N_LOW], integers[N_UP]
    low = HEADER + integers[N_INPUTS]
    low_columns = low + m + 1
    up = low_columns + n_low
    up_columns = up + m + 1
    inverse = 2 * (n_low + n_up)
    for j in range(m):
        first, last = integers[low + j], integers[low + j + 1]
        if first < last:
            d_r, d_i = _product(integers, reals, scratch, low_columns, 0, first, last)
            real, imaginary = j * ROW, j * ROW + WIDTH
            store_lanes(scratch, real, load_lanes(scratch, real) - d_r)
            store_lanes(scratch, imaginary, load_lanes(scratch, imaginary) - d_i)
    for j in range(m - 1, -1, -1):
        first, last = integers[up + j], integers[up + j + 1]
        d_r, d_i = _product(integers, reals, scratch, up_columns, n_low, first, last)
        b_r = load_lanes(scratch, j * ROW) - d_r
        b_i = load_lanes(scratch, j * ROW + WIDTH) - d_i
        a_r, a_i = reals[inverse + 2 * j], reals[inverse + 2 * j + 1]
        store_lanes(scratch, j * ROW, a_r * b_r - a_i * b_i)
        store_lanes(scratch, j * ROW + WIDTH, a_r * b_i + a_i * b_r)


@compiled_part
def _product(integers, reals, scratch, columns, values, first, last):
    """A row times what stands at its columns, by four sums that do not wait for one another."""
    rr, ii, ri, ir = all_lanes(0.0), all_lanes(0.0), all_lanes(0.0), all_lanes(0.0)
    for e in range(first, last):
        at = integers[columns + e] * ROW
        b_r, b_i = load_lanes(scratch, at), load_lanes(scratch, at + WIDTH)
        a_r, a_i = reals[2 * (values + e)], reals[2 * (values + e) + 1]
        rr = rr + a_r * b_r
        ii = ii + a_i * b_i
        ri = ri + a_r * b_i
        ir = ir + a_i * b_r
    return rr - ii, ri + ir


@compiled_part
def take_voltages(integers, scratch, members, first, voltages):
    """Take the terminals' voltages of the group out of the scratch space."""
    n = integers[N_INPUTS]
    for t in range(n):
        k = integers[HEADER + t]
        real, imaginary = all_lanes(0.0), all_lanes(0.0)
        if k >= 0:
            real, imaginary = load_lanes(scratch, k * ROW), load_lanes(scratch, k * ROW + WIDTH)
        store_lanes(voltages, t * members + first, real)
        store_lanes(voltages, (n + t) * members + first, imaginary)
