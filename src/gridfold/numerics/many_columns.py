"""Solves with sparse factors for many right-hand sides at once.

SuperLU goes through its factors anew for every few right-hand sides. Here a row of all of them lies
side by side, so that each entry of a factor is read once and works on a whole row.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.linalg import SuperLU

from gridfold.numerics.compiled import FAST, jit

ComplexMatrix = NDArray[np.complex128]


def solve_rows(
    factors: SuperLU, rows: NDArray[np.int64], rhs: NDArray[Any], adjoint: bool = False
) -> ComplexMatrix:
    """The `rows` of M^-1 R, or of M^-H R, shape (k, j).

    Parameters
    ----------
    factors : SuperLU
        Of the complex matrix M, shape (n, n).
    rows : ndarray of int, shape (k,)
        Where R is not zero.
    rhs : ndarray, shape (k, j)
        These rows of R.
    """
    lower, upper = factors.L, factors.U
    before, after = factors.perm_r[rows], factors.perm_c[rows]
    if adjoint:
        before, after = after, before
    x = np.zeros((factors.shape[0], 2, rhs.shape[1]))
    x[before, 0], x[before, 1] = rhs.real, rhs.imag
    kernel = _solve_adjoint if adjoint else _solve
    kernel(
        lower.indptr, lower.indices, lower.data.real, lower.data.imag,
        upper.indptr, upper.indices, upper.data.real, upper.data.imag, x,
    )  # fmt: skip
    found = np.empty(rhs.shape, dtype=np.complex128)
    found.real, found.imag = x[after, 0], x[after, 1]
    return found


@jit(nogil=True, error_model="numpy", fastmath=FAST)
def _subtract(x, i, k, real, imag):
    for c in range(x.shape[2]):
        a, b = x[k, 0, c], x[k, 1, c]
        x[i, 0, c] -= real * a - imag * b
        x[i, 1, c] -= real * b + imag * a


@jit(nogil=True, error_model="numpy", fastmath=FAST)
def _divide(x, i, real, imag):
    size = real * real + imag * imag
    real, imag = real / size, imag / size
    for c in range(x.shape[2]):
        a, b = x[i, 0, c], x[i, 1, c]
        x[i, 0, c], x[i, 1, c] = a * real + b * imag, b * real - a * imag


# The diagonal is the first entry of each column of L, where it is one, and the last of those of U.
@jit(nogil=True, error_model="numpy", fastmath=FAST)
def _solve(l_start, l_row, l_real, l_imag, u_start, u_row, u_real, u_imag, x):
    for k in range(len(x)):
        for e in range(l_start[k] + 1, l_start[k + 1]):
            _subtract(x, l_row[e], k, l_real[e], l_imag[e])
    for k in range(len(x) - 1, -1, -1):
        last = u_start[k + 1] - 1
        _divide(x, k, u_real[last], u_imag[last])
        for e in range(u_start[k], last):
            _subtract(x, u_row[e], k, u_real[e], u_imag[e])


@jit(nogil=True, error_model="numpy", fastmath=FAST)
def _solve_adjoint(l_start, l_row, l_real, l_imag, u_start, u_row, u_real, u_imag, x):
    for k in range(len(x)):
        last = u_start[k + 1] - 1
        for e in range(u_start[k], last):
            _subtract(x, k, u_row[e], u_real[e], -u_imag[e])
        _divide(x, k, u_real[last], -u_imag[last])
    for k in range(len(x) - 1, -1, -1):
        for e in range(l_start[k] + 1, l_start[k + 1]):
            _subtract(x, k, l_row[e], l_real[e], -l_imag[e])
