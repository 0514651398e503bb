"""The network equations solved for many members at once, by sparse factors.

Currents and voltages have the shape (2 n, members), real parts before imaginary parts. Members are
taken in groups of eight, for which each entry of the factors is read once: one number where all have
the same network, eight where each has its own, of the same pattern. Rows of L and U are taken in order,
so that what is summed up stays in a register (Davis, Direct Methods for Sparse Linear Systems, 2006,
chapter 3).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

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
    """Where the factors of a network have entries, and where currents go in and which rows buses have.

    Parameters
    ----------
    integers : ndarray
        The pattern, for :func:`solve_group`.
    n_rows : int
        Rows of the factors.
    rows : ndarray of int, shape (n_buses,)
        Row of each bus, -1 where its voltage is zero or not solved for.
    """

    integers: NDArray[np.int64]
    n_rows: int
    rows: NDArray[np.int64]
    _pattern: _Pattern
    _low: NDArray[np.int64]
    _up: NDArray[np.int64]
    _diagonal: NDArray[np.int64]

    @property
    def n_values(self) -> int:
        """Length of the values of one network."""
        return 2 * (len(self._low) + len(self._up) + len(self._diagonal))

    def values(self, equations: NetworkEquations) -> NDArray[np.float64]:
        """Values of the factors of a network with the same pattern, real and imaginary parts in turn.

        Raises
        ------
        NetworkError
            Its factors have another pattern.
        """
        pattern, lower, upper = _factored(equations)
        if not pattern.is_like(self._pattern):
            raise NetworkError("the factors of this network have entries at other places")
        found = (lower[self._low], upper[self._up], 1 / upper[self._diagonal])
        return np.concatenate(found).view(np.float64)

    def spread(self, equations: NetworkEquations, members: int) -> NDArray[np.float64]:
        """The same for each of so many members, for :func:`solve_each`."""
        values = self.values(equations)
        groups = np.broadcast_to(values[:, None], (members // WIDTH, len(values), WIDTH))
        return groups.ravel()

    def put(self, spread: NDArray[np.float64], member: int, equations: NetworkEquations) -> None:
        """Write the values of a network into those of all members; raises as :meth:`values`."""
        columns = spread.reshape(-1, self.n_values, WIDTH)
        columns[member // WIDTH, :, member % WIDTH] = self.values(equations)


@dataclass(frozen=True)
class _Pattern:
    """Order of the rows, and column pointers and rows of the entries of L and U."""

    place: NDArray[np.int64]
    lower: tuple[NDArray[np.int32], NDArray[np.int32]]
    upper: tuple[NDArray[np.int32], NDArray[np.int32]]

    def is_like(self, other: _Pattern) -> bool:
        """Whether all of it is the same."""
        return all(
            np.array_equal(here, there)
            for here, there in zip(self._places(), other._places(), strict=True)
        )

    def _places(self) -> tuple[NDArray[Any], ...]:
        return self.place, *self.lower, *self.upper


def column_factors(equations: NetworkEquations, every_bus: bool) -> ColumnFactors:
    """Factors for currents at the terminals, and voltages there or at every bus.

    Raises
    ------
    NetworkError
        The factors had to be pivoted.
    """
    pattern, _, _ = _factored(equations)
    place = pattern.place
    lower, upper = (_numbered(*part, len(place)) for part in (pattern.lower, pattern.upper))
    present = equations.terminals >= 0
    reached = np.arange(len(place))
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
    header = [len(inputs), len(reached), low.nnz, up.nnz]
    rows = np.where(equations.bus_rows >= 0, row_of[place][equations.bus_rows], -1)
    parts = (header, inputs, low.indptr, low.indices, up.indptr, up.indices)
    integers = np.concatenate(parts).astype(np.int64)
    places = (values.astype(np.int64) - 1 for values in (low.data, up.data, upper.diagonal()))
    return ColumnFactors(integers, len(reached), rows, pattern, *places)


def _factored(
    equations: NetworkEquations,
) -> tuple[_Pattern, NDArray[np.complex128], NDArray[np.complex128]]:
    """Pattern of the factors of a network, and the entries of L and U."""
    factors = equations.factors
    if not np.array_equal(factors.perm_r, factors.perm_c):
        raise NetworkError("a batch needs factors of the network without pivoting")
    lower, upper = csc_array(factors.L), csc_array(factors.U)
    lower.sort_indices()
    upper.sort_indices()
    pattern = _Pattern(
        factors.perm_r.astype(np.int64),
        (lower.indptr, lower.indices),
        (upper.indptr, upper.indices),
    )
    return pattern, lower.data, upper.data


def _numbered(pointers: NDArray[np.int32], rows: NDArray[np.int32], n: int) -> csc_array:
    """A matrix of this pattern whose entries are their own numbers, from 1."""
    return csc_array((np.arange(1.0, len(rows) + 1), rows, pointers), shape=(n, n))


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


def _one_for_all(reals, k):
    return reals[k]


def _one_for_each(reals, k):
    return load_lanes(reals, k * WIDTH)


def _solver(read):
    """Solve for eight members with values that `read` gives; currents by rows become voltages."""
    entry = compiled_part(read)

    @compiled_part
    def product(integers, reals, scratch, columns, values, first, last):
        """A row times what stands at its columns, by four sums that do not wait for one another."""
        rr, ii, ri, ir = all_lanes(0.0), all_lanes(0.0), all_lanes(0.0), all_lanes(0.0)
        for e in range(first, last):
            at = integers[columns + e] * ROW
            b_r, b_i = load_lanes(scratch, at), load_lanes(scratch, at + WIDTH)
            k = 2 * (values + e)
            a_r, a_i = entry(reals, k), entry(reals, k + 1)
            rr = rr + a_r * b_r
            ii = ii + a_i * b_i
            ri = ri + a_r * b_i
            ir = ir + a_i * b_r
        return rr - ii, ri + ir

    @compiled_part
    def solve(integers, reals, scratch):
        m, n_low, n_up = integers[N_ROWS], integers[N_LOW], integers[N_UP]
        low = HEADER + integers[N_INPUTS]
        low_columns = low + m + 1
        up = low_columns + n_low
        up_columns = up + m + 1
        inverse = 2 * (n_low + n_up)
        for j in range(m):
            first, last = integers[low + j], integers[low + j + 1]
            if first < last:
                d_r, d_i = product(integers, reals, scratch, low_columns, 0, first, last)
                real, imaginary = j * ROW, j * ROW + WIDTH
                store_lanes(scratch, real, load_lanes(scratch, real) - d_r)
                store_lanes(scratch, imaginary, load_lanes(scratch, imaginary) - d_i)
        for j in range(m - 1, -1, -1):
            first, last = integers[up + j], integers[up + j + 1]
            d_r, d_i = product(integers, reals, scratch, up_columns, n_low, first, last)
            b_r = load_lanes(scratch, j * ROW) - d_r
            b_i = load_lanes(scratch, j * ROW + WIDTH) - d_i
            a_r, a_i = entry(reals, inverse + 2 * j), entry(reals, inverse + 2 * j + 1)
            store_lanes(scratch, j * ROW, a_r * b_r - a_i * b_i)
            store_lanes(scratch, j * ROW + WIDTH, a_r * b_i + a_i * b_r)

    return solve


#: ``solve_group(integers, reals, scratch)``: currents of eight members in the scratch space, by rows,
#: become voltages; all have the same network.
solve_group = _solver(_one_for_all)
#: The same where each has its own: eight values stand side by side.
solve_each = _solver(_one_for_each)


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
