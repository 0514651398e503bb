"""Network equations with the slopes of nonlinear loads: real, since these turn with the voltage.

Currents and voltages are real parts before imaginary parts, over all live nodes.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import block_array, csc_array, csr_array, tril, triu
from scipy.sparse.linalg import splu

from gridfold.dynamics.network.backend import NETWORK_SIGNATURE, CompiledNetwork
from gridfold.dynamics.network.equations import NetworkEquations
from gridfold.dynamics.network.loads import NonlinearLoads
from gridfold.errors import NetworkError
from gridfold.numerics.compiled import compile_callback
from gridfold.powerflow.rounding import rounding_current

_HEADER = 4


def solve_with_loads(
    equations: NetworkEquations,
    currents: NDArray[np.complex128],
    loads: NonlinearLoads,
    at: NDArray[np.int64],
) -> NDArray[np.complex128]:
    """Voltages of all live nodes, (n_live,), by Newton's method with full Jacobians.

    Parameters
    ----------
    equations : NetworkEquations
        The linear network.
    currents : ndarray of complex, shape (n_terminals,)
        Currents of the machines.
    loads : NonlinearLoads
        The loads.
    at : ndarray of int, shape (n_loads,)
        Their positions among the terminals.

    Raises
    ------
    NetworkError
        No solution was found from that with constant impedances.
    """
    n = len(equations.live)
    present = equations.terminals >= 0
    injected = np.zeros(n, dtype=np.complex128)
    np.add.at(injected, equations.terminals[present], currents[present])
    rows = equations.terminals[at]
    live = rows >= 0
    v: NDArray[np.complex128] = equations.factors.solve(injected)
    for _ in range(50):
        drawn = loads.currents(_at(v, rows))
        error = injected - equations.matrix @ v
        np.add.at(error, rows[live], drawn[live])
        if np.all(np.abs(error) < np.maximum(1e-10, rounding_current(equations.matrix, v))):
            return v
        matrix = real_matrix(equations, loads.slopes(_at(v, rows)), rows)
        step = splu(matrix).solve(np.concatenate([error.real, error.imag]))
        v = v + step[:n] + 1j * step[n:]
    raise NetworkError("the network has no solution with these loads")


def _at(v: NDArray[np.complex128], rows: NDArray[np.int64]) -> NDArray[np.complex128]:
    return np.where(rows >= 0, v[rows], 0.0)


def near_solution(
    equations: NetworkEquations,
    currents: NDArray[np.complex128],
    loads: NonlinearLoads,
    at: NDArray[np.int64],
) -> NDArray[np.complex128]:
    """Voltages of the terminals, (n_terminals,), where the network is solved.

    Without a solution, those of the network with constant impedances.
    """
    try:
        v = solve_with_loads(equations, currents, loads, at)
    except NetworkError:
        present = equations.terminals >= 0
        injected = np.zeros(len(equations.live), dtype=np.complex128)
        np.add.at(injected, equations.terminals[present], currents[present])
        v = equations.factors.solve(injected)
    return _at(v, equations.terminals)


def real_matrix(
    equations: NetworkEquations, slopes: NDArray[np.float64], rows: NDArray[np.int64]
) -> csc_array:
    """Admittances less slopes (n_loads, 2, 2) at `rows`, shape (2 n_live, 2 n_live)."""
    y, n = equations.matrix, len(equations.live)
    real = csc_array(block_array([[y.real, -y.imag], [y.imag, y.real]]))
    live = rows >= 0
    at = rows[live][:, None, None]
    half = n * np.arange(2)
    row = np.broadcast_to(at + half[None, :, None], (len(at), 2, 2)).ravel()
    column = np.broadcast_to(at + half[None, None, :], (len(at), 2, 2)).ravel()
    return csc_array(real - csc_array((slopes[live].ravel(), (row, column)), shape=real.shape))


def real_sparse_network(matrix: csc_array, terminals: NDArray[np.int64]) -> CompiledNetwork:
    """Compile the real equations of `matrix`, (2 n_live, 2 n_live), into two triangular solves.

    `terminals` are the rows of the terminals among the live nodes, -1 where the voltage is zero.
    """
    factors = splu(matrix)
    n, size = matrix.shape[0] // 2, matrix.shape[0]
    low, up = csc_array(tril(factors.L, k=-1)), csr_array(triu(factors.U, k=1))
    rows = np.concatenate([terminals, np.where(terminals >= 0, terminals + n, -1)])
    to_low = np.where(rows >= 0, factors.perm_r[rows], -1)
    from_up = np.where(rows >= 0, factors.perm_c[rows], -1)
    parts = (to_low, from_up, low.indptr, low.indices, up.indptr, up.indices)
    return CompiledNetwork(
        address=_compiled().address,
        integers=np.concatenate([[len(rows), size, low.nnz, up.nnz], *parts]).astype(np.int64),
        reals=np.concatenate([low.data, up.data, 1 / factors.U.diagonal()]),
        scratch_size=size,
    )


def _solve(integers, reals, currents, voltages, scratch):
    count, size, low_count, up_count = integers[0], integers[1], integers[2], integers[3]
    to_low = _HEADER
    from_up = to_low + count
    low = from_up + count
    low_rows = low + size + 1
    up = low_rows + low_count
    up_columns = up + size + 1
    inverse = low_count + up_count
    for j in range(size):
        scratch[j] = 0.0
    for t in range(count):
        if integers[to_low + t] >= 0:
            scratch[integers[to_low + t]] += currents[t]
    for j in range(size):
        b = scratch[j]
        if b != 0.0:
            for e in range(integers[low + j], integers[low + j + 1]):
                scratch[integers[low_rows + e]] -= reals[e] * b
    for j in range(size - 1, -1, -1):
        b = scratch[j]
        for e in range(integers[up + j], integers[up + j + 1]):
            b -= reals[low_count + e] * scratch[integers[up_columns + e]]
        scratch[j] = b * reals[inverse + j]
    for t in range(count):
        k = integers[from_up + t]
        voltages[t] = scratch[k] if k >= 0 else 0.0


@cache
def _compiled() -> Any:
    return compile_callback(_solve, NETWORK_SIGNATURE)
