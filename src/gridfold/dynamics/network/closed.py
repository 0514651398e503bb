"""The network with slopes of currents at its terminals: (Y - G) v = i.

G has a real 2 x 2 block for each terminal, and is all that changes from one solver to the next. With
many terminals all nodes that are on no path from a terminal to the root of the elimination tree are
eliminated once, and what remains is factored anew for each G, in 2 x 2 blocks whose places are found
once (Davis, Direct Methods for Sparse Linear Systems, 2006, chapter 4). With few terminals the
impedance matrix between them is closed.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array

from gridfold.dynamics.network.backend import NETWORK_SIGNATURE, CompiledNetwork
from gridfold.dynamics.network.dense import real_dense_network
from gridfold.dynamics.network.equations import NetworkEquations
from gridfold.dynamics.network.loads import real_form
from gridfold.dynamics.network.sparse import paths_to_root
from gridfold.numerics.compiled import FAST, compile_callback, jit

#: Number of terminals from which factoring the network is faster than closing its impedance matrix.
FACTORED_FROM = 60

_HEADER = 3


@dataclass(frozen=True)
class ClosedNetworks:
    """Compiles the network of one state for one set of slopes after another."""

    equations: NetworkEquations
    factored_from: int = FACTORED_FROM

    def __call__(self, slopes: NDArray[np.float64]) -> CompiledNetwork:
        """Solver of (Y - G) v = i for slopes of shape (n_terminals, 2, 2)."""
        if self._factored:
            return self._tree.compiled(slopes)
        n, network = len(slopes), self._impedance
        halves = network[:, :n, None], network[:, n:, None]
        driven = halves[0] * slopes[:, 0] + halves[1] * slopes[:, 1]
        loop = np.eye(2 * n) - driven.transpose(0, 2, 1).reshape(2 * n, 2 * n)
        return real_dense_network(np.asarray(np.linalg.solve(loop, network), dtype=np.float64))

    @cached_property
    def _factored(self) -> bool:
        present = self.equations.terminals >= 0
        if len(present) < self.factored_from or not present.any():
            return False
        factors = self.equations.factors
        return np.array_equal(factors.perm_r, factors.perm_c)

    @cached_property
    def _impedance(self) -> NDArray[np.float64]:
        return real_form(self.equations.terminal_impedance())

    @cached_property
    def _tree(self) -> Elimination:
        return eliminated(self.equations)


@dataclass(frozen=True)
class Elimination:
    """Nodes in order of elimination, and the places of their blocks.

    Blocks are numbered: first those on the diagonal, then those below it by columns, then those
    right of it by rows. `starts` and `nodes` give the nodes below each, `targets` the block that each
    product of an elimination is taken from, in order.
    """

    terminals: NDArray[np.int64]
    starts: NDArray[np.int64]
    nodes: NDArray[np.int64]
    targets: NDArray[np.int64]
    blocks: NDArray[np.float64]

    def factored(self, slopes: NDArray[np.float64]) -> NDArray[np.float64]:
        """Blocks (n_blocks, 4) of L and U with slopes (n_terminals, 2, 2); diagonal ones inverted."""
        blocks = self.blocks.copy()
        present = self.terminals >= 0
        np.subtract.at(blocks, self.terminals[present], slopes[present].reshape(-1, 4))
        _factor(self.starts, self.nodes, self.targets, blocks)
        return blocks

    def compiled(self, slopes: NDArray[np.float64]) -> CompiledNetwork:
        """The factors with slopes (n_terminals, 2, 2), compiled into two triangular solves."""
        blocks = self.factored(slopes)
        n, size = len(self.terminals), len(self.starts) - 1
        return CompiledNetwork(
            _compiled().address,
            np.concatenate([[n, size, len(self.nodes)], self.terminals, self.starts, self.nodes]),
            blocks.ravel(),
            2 * size,
        )


def eliminated(equations: NetworkEquations) -> Elimination:
    """The network without the nodes on no path from a terminal to the root."""
    factors, present = equations.factors, equations.terminals >= 0
    lower, upper = csc_array(factors.L), csc_array(factors.U)
    places = factors.perm_r[equations.terminals[present]]
    reached = paths_to_root(lower, places)
    reduced = csc_array(lower[reached][:, reached] @ upper[reached][:, reached])
    terminals = np.full(len(present), -1, dtype=np.int64)
    terminals[present] = np.searchsorted(reached, places)
    below = _fill(csc_array(abs(reduced) + abs(reduced).T))
    starts = np.concatenate([[0], np.cumsum([len(nodes) for nodes in below])]).astype(np.int64)
    nodes = np.concatenate([*below, np.zeros(0)]).astype(np.int64)
    entries = reduced.tocoo()
    at = _places(starts, nodes, entries.row.astype(np.int64), entries.col.astype(np.int64))
    values = entries.data
    blocks = np.zeros((len(below) + 2 * len(nodes), 4))
    blocks[at] = np.stack([values.real, -values.imag, values.imag, values.real], axis=1)
    return Elimination(terminals, starts, nodes, _targets(starts, nodes), blocks)


def _fill(pattern: csc_array) -> list[NDArray[np.int64]]:
    """Nodes below the diagonal in each column of the factors of a symmetric pattern."""
    n = pattern.shape[0]
    below: list[set[int]] = []
    for j in range(n):
        rows = pattern.indices[pattern.indptr[j] : pattern.indptr[j + 1]]
        below.append({int(i) for i in rows if i > j})
    for nodes in below:
        if nodes:
            parent = min(nodes)
            below[parent] |= nodes - {parent}
    return [np.array(sorted(nodes), dtype=np.int64) for nodes in below]


@jit()
def _places(starts, nodes, rows, columns):
    """Numbers of the blocks at rows and columns."""
    size, result = len(starts) - 1, np.empty(len(rows), dtype=np.int64)
    for e in range(len(rows)):
        i, j = max(rows[e], columns[e]), min(rows[e], columns[e])
        if i == j:
            result[e] = i
            continue
        place = starts[j] + np.searchsorted(nodes[starts[j] : starts[j + 1]], i)
        result[e] = size + place + (0 if rows[e] > columns[e] else len(nodes))
    return result


@jit()
def _targets(starts, nodes):
    """Blocks from which the products of each elimination are taken, in its order."""
    total = 0
    for k in range(len(starts) - 1):
        total += (starts[k + 1] - starts[k]) ** 2
    rows, columns = np.empty(total, dtype=np.int64), np.empty(total, dtype=np.int64)
    at = 0
    for k in range(len(starts) - 1):
        for i in nodes[starts[k] : starts[k + 1]]:
            for j in nodes[starts[k] : starts[k + 1]]:
                rows[at], columns[at] = i, j
                at += 1
    return _places(starts, nodes, rows, columns)


@jit(nogil=True, error_model="numpy", fastmath=FAST)
def _factor(starts, nodes, targets, blocks):
    """Blocks of L and U in place of those of the matrix; diagonal blocks are inverted."""
    size, count, at = len(starts) - 1, len(nodes), 0
    for k in range(size):
        d = blocks[k]
        scale = 1.0 / (d[0] * d[3] - d[1] * d[2])
        d[0], d[1], d[2], d[3] = d[3] * scale, -d[1] * scale, -d[2] * scale, d[0] * scale
        for e in range(starts[k], starts[k + 1]):
            a = blocks[size + e]
            l_0, l_1 = a[0] * d[0] + a[1] * d[2], a[0] * d[1] + a[1] * d[3]
            l_2, l_3 = a[2] * d[0] + a[3] * d[2], a[2] * d[1] + a[3] * d[3]
            a[0], a[1], a[2], a[3] = l_0, l_1, l_2, l_3
            for g in range(starts[k], starts[k + 1]):
                u, t = blocks[size + count + g], blocks[targets[at]]
                t[0] -= l_0 * u[0] + l_1 * u[2]
                t[1] -= l_0 * u[1] + l_1 * u[3]
                t[2] -= l_2 * u[0] + l_3 * u[2]
                t[3] -= l_2 * u[1] + l_3 * u[3]
                at += 1


def _solve(integers, reals, currents, voltages, scratch):
    """Forward by columns of L, backward by rows of U; both parts of a node lie side by side."""
    n, size, count = integers[0], integers[1], integers[2]
    starts = _HEADER + n
    nodes = starts + size + 1
    for k in range(2 * size):
        scratch[k] = 0.0
    for t in range(n):
        k = 2 * integers[_HEADER + t]
        if k >= 0:
            scratch[k] += currents[t]
            scratch[k + 1] += currents[n + t]
    for k in range(size):
        b_r, b_i = scratch[2 * k], scratch[2 * k + 1]
        for e in range(integers[starts + k], integers[starts + k + 1]):
            i, at = 2 * integers[nodes + e], 4 * (size + e)
            scratch[i] -= reals[at] * b_r + reals[at + 1] * b_i
            scratch[i + 1] -= reals[at + 2] * b_r + reals[at + 3] * b_i
    for k in range(size - 1, -1, -1):
        b_r, b_i = scratch[2 * k], scratch[2 * k + 1]
        for e in range(integers[starts + k], integers[starts + k + 1]):
            i, at = 2 * integers[nodes + e], 4 * (size + count + e)
            b_r -= reals[at] * scratch[i] + reals[at + 1] * scratch[i + 1]
            b_i -= reals[at + 2] * scratch[i] + reals[at + 3] * scratch[i + 1]
        scratch[2 * k] = reals[4 * k] * b_r + reals[4 * k + 1] * b_i
        scratch[2 * k + 1] = reals[4 * k + 2] * b_r + reals[4 * k + 3] * b_i
    for t in range(n):
        k = 2 * integers[_HEADER + t]
        voltages[t] = scratch[k] if k >= 0 else 0.0
        voltages[n + t] = scratch[k + 1] if k >= 0 else 0.0


@cache
def _compiled() -> Any:
    return compile_callback(_solve, NETWORK_SIGNATURE)
