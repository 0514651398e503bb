"""The network with slopes of loads solved for many members at once, by factors of 2 x 2 blocks.

    (Y - J) V = I

over all buses of the intact network. J turns with the voltages, so the equations are real: a block
takes the real and the imaginary part of a node. Members are taken in groups of eight as in
:mod:`gridfold.dynamics.batch.factors`.

What a member's network state changes acts between the two triangular solves. With (Y - J) = L U, what
a current at a bus leaves behind L, and what the voltage of a bus takes from there, lies on the path
from the bus to the root of the elimination tree (Tinney, Brandwajn & Chan, Sparse vector methods,
IEEE Trans. PAS-104, 1985).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gridfold.dynamics.batch.change import NetworkChange
from gridfold.dynamics.network.closed import Elimination, eliminated
from gridfold.dynamics.network.equations import NetworkEquations
from gridfold.errors import NetworkError
from gridfold.numerics.compiled import compiled_part, jit
from gridfold.numerics.lanes import WIDTH, all_lanes, load_lanes, store_lanes

#: Numbers of scratch for each row of the factors: real parts, then imaginary parts of eight members.
ROW = 2 * WIDTH
#: Where the parts of the integers begin.
(N_ROWS, N_BELOW) = range(2)
HEADER = 2


class Compensation(NamedTuple):
    """Compensating currents j = -drawn y, and what they add to y = L^-1 I: caused j.

    `path` (p,) are the rows of the factors that they see; j has 2 r numbers, real and imaginary part in
    turn, as has each row of the path: both matrices have the shape (p, 2, 2 r).
    """

    path: NDArray[np.int64]
    drawn: NDArray[np.float64]
    caused: NDArray[np.float64]


@dataclass(frozen=True)
class BlockFactors:
    """Factors of the intact network with slopes of loads.

    Parameters
    ----------
    tree : Elimination
        The order of the nodes, over all buses.
    blocks : ndarray, shape (n_blocks, 4)
        Blocks of L and U; those on the diagonal are inverted.
    """

    tree: Elimination
    blocks: NDArray[np.float64]
    _known: dict[int, tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]] = field(
        default_factory=dict
    )

    @property
    def rows(self) -> NDArray[np.int64]:
        """Row of each bus, -1 where its voltage is zero."""
        return self.tree.terminals

    @property
    def n_rows(self) -> int:
        """Rows of blocks."""
        return len(self.tree.starts) - 1

    @property
    def integers(self) -> NDArray[np.int64]:
        """Data of :func:`solve_low` and :func:`solve_up`, as :attr:`blocks` are."""
        starts, nodes = self.tree.starts, self.tree.nodes
        return np.concatenate([[self.n_rows, len(nodes)], starts, nodes])

    def longest_path(self) -> int:
        """The most rows on the path from one to the root."""
        length = np.ones(self.n_rows + 1, dtype=np.int64)
        length[-1] = 0
        for row in range(self.n_rows - 1, -1, -1):
            length[row] = 1 + length[self._parent(row)]
        return int(length.max())

    def compensation(self, change: NetworkChange) -> Compensation:
        """What makes a change act; not a number where it leaves a singular network."""
        rows, n_held = self.rows[change.buses], len(change.buses) - len(change.difference)
        paths, lows, ups = zip(*(self._seen_from(int(row)) for row in rows), strict=True)
        path = np.unique(np.concatenate(paths))
        size = 2 * len(rows)
        caused, taken = np.zeros((2, len(path), 2, size))
        for k, (own, low, up) in enumerate(zip(paths, lows, ups, strict=True)):
            at = np.searchsorted(path, own)
            caused[at, :, 2 * k : 2 * k + 2] = low
            taken[at, :, 2 * k : 2 * k + 2] = up.transpose(0, 2, 1)
        taken = taken.reshape(-1, size).T
        moved = np.zeros((size - 2 * n_held, size))
        moved[:, 2 * n_held :] = _real_blocks(change.difference)
        left, right = taken @ caused.reshape(-1, size), np.eye(size)
        left[2 * n_held :] = moved @ left
        left[2 * n_held :, 2 * n_held :] += np.eye(len(moved))
        right[2 * n_held :] = moved
        try:
            drawn = np.linalg.solve(left, right @ taken)
        except np.linalg.LinAlgError:
            drawn = np.full(taken.shape, np.nan)
        return Compensation(path, np.ascontiguousarray(drawn.T).reshape(caused.shape), caused)

    def _seen_from(
        self, row: int
    ) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
        """The path from a row; L^-1 and U^-T of its unit blocks there, (p, 2, 2) each."""
        if row not in self._known:
            path, tree = [row], self.tree
            while (above := self._parent(path[-1])) < self.n_rows:
                path.append(above)
            rows = np.array(path, dtype=np.int64)
            low, up = _along(tree.starts, tree.nodes, self.blocks, rows)
            self._known[row] = rows, low.reshape(-1, 2, 2), up.reshape(-1, 2, 2)
        return self._known[row]

    def _parent(self, row: int) -> int:
        first, last = self.tree.starts[row : row + 2]
        return int(self.tree.nodes[first]) if first < last else self.n_rows


def block_factors(equations: NetworkEquations, slopes: NDArray[np.float64]) -> BlockFactors:
    """Factors of a network with slopes of loads at its buses, (n_buses, 2, 2).

    Raises
    ------
    NetworkError
        The factors had to be pivoted.
    """
    if not np.array_equal(equations.factors.perm_r, equations.factors.perm_c):
        raise NetworkError("a batch needs factors of the network without pivoting")
    tree = eliminated(equations.seen_from(range(equations.n_buses)))
    return BlockFactors(tree, tree.factored(slopes))


def _real_blocks(matrix: NDArray[np.complex128]) -> NDArray[np.float64]:
    """The real matrix that acts on real and imaginary parts in turn."""
    parts = np.array([[matrix.real, -matrix.imag], [matrix.imag, matrix.real]])
    size = 2 * len(matrix)
    return np.asarray(parts.transpose(2, 0, 3, 1).reshape(size, size), dtype=np.float64)


@jit(error_model="numpy")
def _along(starts, nodes, blocks, path):
    """Blocks along a path of L^-1 E and E' U^-1 with E at its first row, (p, 4) each."""
    size, count, n = len(starts) - 1, len(nodes), len(path)
    low, up = np.zeros((n, 4)), np.zeros((n, 4))
    low[0, 0] = low[0, 3] = up[0, 0] = up[0, 3] = 1.0
    for k in range(n):
        row = path[k]
        d, u, b = blocks[row], up[k].copy(), low[k]
        up[k, 0], up[k, 1] = u[0] * d[0] + u[1] * d[2], u[0] * d[1] + u[1] * d[3]
        up[k, 2], up[k, 3] = u[2] * d[0] + u[3] * d[2], u[2] * d[1] + u[3] * d[3]
        g, at = up[k], k
        for e in range(starts[row], starts[row + 1]):
            while path[at] != nodes[e]:
                at += 1
            a, t = blocks[size + e], low[at]
            t[0] -= a[0] * b[0] + a[1] * b[2]
            t[1] -= a[0] * b[1] + a[1] * b[3]
            t[2] -= a[2] * b[0] + a[3] * b[2]
            t[3] -= a[2] * b[1] + a[3] * b[3]
            a, t = blocks[size + count + e], up[at]
            t[0] -= g[0] * a[0] + g[1] * a[2]
            t[1] -= g[0] * a[1] + g[1] * a[3]
            t[2] -= g[2] * a[0] + g[3] * a[2]
            t[3] -= g[2] * a[1] + g[3] * a[3]
    return low, up


@compiled_part
def solve_low(integers, reals, scratch):
    """Forward by columns of L: y = L^-1 I for eight members, in the place of I."""
    size = integers[N_ROWS]
    nodes = HEADER + size + 1
    for k in range(size):
        first, last = integers[HEADER + k], integers[HEADER + k + 1]
        b_r, b_i = load_lanes(scratch, k * ROW), load_lanes(scratch, k * ROW + WIDTH)
        for e in range(first, last):
            at, a = integers[nodes + e] * ROW, 4 * (size + e)
            real, imaginary = load_lanes(scratch, at), load_lanes(scratch, at + WIDTH)
            store_lanes(scratch, at, real - reals[a] * b_r - reals[a + 1] * b_i)
            imaginary = imaginary - reals[a + 2] * b_r - reals[a + 3] * b_i
            store_lanes(scratch, at + WIDTH, imaginary)


@compiled_part
def solve_up(integers, reals, scratch):
    """Backward by rows of U: V = U^-1 y for eight members, in the place of y."""
    size, count = integers[N_ROWS], integers[N_BELOW]
    nodes = HEADER + size + 1
    for k in range(size - 1, -1, -1):
        first, last = integers[HEADER + k], integers[HEADER + k + 1]
        b_r, b_i = load_lanes(scratch, k * ROW), load_lanes(scratch, k * ROW + WIDTH)
        c_r, c_i = all_lanes(0.0), all_lanes(0.0)
        for e in range(first, last):
            at, a = integers[nodes + e] * ROW, 4 * (size + count + e)
            v_r, v_i = load_lanes(scratch, at), load_lanes(scratch, at + WIDTH)
            b_r = b_r - reals[a] * v_r
            b_i = b_i - reals[a + 2] * v_r
            c_r = c_r + reals[a + 1] * v_i
            c_i = c_i + reals[a + 3] * v_i
        b_r, b_i = b_r - c_r, b_i - c_i
        a = 4 * k
        store_lanes(scratch, k * ROW, reals[a] * b_r + reals[a + 1] * b_i)
        store_lanes(scratch, k * ROW + WIDTH, reals[a + 2] * b_r + reals[a + 3] * b_i)
