"""Schur forms, computed without keeping other threads from Python's interpreter.

SciPy's own function holds the interpreter's lock while LAPACK works.
"""

from __future__ import annotations

import ctypes

import numpy as np
from numba.extending import get_cython_function_address
from numpy.typing import NDArray

from gridfold.numerics.compiled import jit

Matrix = NDArray[np.float64]
ComplexMatrix = NDArray[np.complex128]

_DGEES_ARGUMENTS = 15


def real_schur(a: Matrix) -> tuple[Matrix, Matrix]:
    """Quasi upper triangular T and orthogonal Z with A = Z T Z^T, by LAPACK's dgees.

    Parameters
    ----------
    a : ndarray, shape (n, n)

    Returns
    -------
    triangle, basis : ndarray, shape (n, n)
        2 x 2 blocks on the diagonal of T belong to pairs of complex eigenvalues.

    Raises
    ------
    numpy.linalg.LinAlgError
        If the iteration does not converge, or `a` is not finite.
    """
    n = len(a)
    if not np.isfinite(a).all():
        raise np.linalg.LinAlgError("a matrix that is not finite has no Schur form")
    triangle = np.array(a, dtype=np.float64, order="F")
    basis = np.empty((n, n), order="F")
    if n == 0:
        return triangle, basis
    values, unused = np.empty((2, n)), np.zeros(n, dtype=np.intc)
    order, found, info = ctypes.c_int(n), ctypes.c_int(0), ctypes.c_int(0)

    def call(work: Matrix, size: int) -> None:
        _dgees(
            b"V", b"N", None, ctypes.byref(order), triangle.ctypes.data, ctypes.byref(order),
            ctypes.byref(found), values[0].ctypes.data, values[1].ctypes.data, basis.ctypes.data,
            ctypes.byref(order), work.ctypes.data, ctypes.byref(ctypes.c_int(size)),
            unused.ctypes.data, ctypes.byref(info),
        )  # fmt: skip

    best = np.empty(1)
    call(best, -1)
    call(np.empty(int(best[0])), int(best[0]))
    if info.value:
        raise np.linalg.LinAlgError(f"the Schur form was not found (dgees says {info.value})")
    return triangle, basis


def complex_schur(a: Matrix) -> tuple[ComplexMatrix, ComplexMatrix]:
    """Upper triangular S and unitary U with A = U S U^H, from the real form; as above."""
    triangle, basis = real_schur(a)
    s, u = triangle.astype(np.complex128), basis.astype(np.complex128)
    _turn_blocks(s, u)
    return s, u


# LAPACK as SciPy hands it on to compiled code; a call through ctypes releases the lock.
_dgees = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * _DGEES_ARGUMENTS)(
    get_cython_function_address("scipy.linalg.cython_lapack", "dgees")
)


@jit(nogil=True, error_model="numpy")
def _turn_blocks(s, u):
    """Make every 2 x 2 block of s upper triangular by a unitary turn of its two columns.

    The first column of the turn is the block's eigenvector.
    """
    n = len(s)
    for k in range(n - 2, -1, -1):
        if s[k + 1, k] == 0:
            continue
        half = (s[k, k] - s[k + 1, k + 1]) / 2
        root = np.sqrt(half * half + s[k, k + 1] * s[k + 1, k])
        first, second = half + root, s[k + 1, k]
        size = np.sqrt(abs(first) ** 2 + abs(second) ** 2)
        c, d = first / size, second / size
        for j in range(k, n):
            x, y = s[k, j], s[k + 1, j]
            s[k, j] = c.conjugate() * x + d.conjugate() * y
            s[k + 1, j] = c * y - d * x
        for i in range(k + 2):
            x, y = s[i, k], s[i, k + 1]
            s[i, k] = x * c + y * d
            s[i, k + 1] = y * c.conjugate() - x * d.conjugate()
        for i in range(n):
            x, y = u[i, k], u[i, k + 1]
            u[i, k] = x * c + y * d
            u[i, k + 1] = y * c.conjugate() - x * d.conjugate()
        s[k + 1, k] = 0
