"""Square-root factors of Gramians, without forming the Gramians.

The square roots of the eigenvalues of a computed product of Gramians are right to about 1e-8 of the
largest only, since rounding is as large as the square of that. Hammarling's method computes a
triangular factor straight from the Lyapunov equation; singular values of products of such factors
are right to rounding of the largest.

Source: S. J. Hammarling, "Numerical Solution of the Stable, Non-negative Definite Lyapunov
Equation", IMA Journal of Numerical Analysis 2 (1982), pp. 303-323; here in complex arithmetic.
"""

from __future__ import annotations

import numpy as np

from gridfold.errors import OptionError
from gridfold.numerics.compiled import FAST, jit
from gridfold.numerics.schur import ComplexMatrix, Matrix, complex_schur


def controllability_factor(a: Matrix, b: Matrix) -> Matrix:
    """Factor L of the controllability Gramian W = L L^T, where A W + W A^T + B B^T = 0.

    Equation (4) of Osipov & Sun, first line.

    Parameters
    ----------
    a : ndarray, shape (n, n)
        A stable matrix.
    b : ndarray, shape (n, m)

    Returns
    -------
    ndarray, shape (n, n)
        Lower triangular, with a diagonal that is not negative.

    Raises
    ------
    OptionError
        If an eigenvalue of `a` has a real part that is not negative.
    """
    return _factor_from_schur(*_stable_schur(a), b)


def observability_factor(a: Matrix, c: Matrix) -> Matrix:
    """Factor L of the observability Gramian W = L L^T, where A^T W + W A + C^T C = 0.

    Equation (4) of Osipov & Sun, second line; the controllability factor of the pair (A^T, C^T).

    Parameters
    ----------
    a : ndarray, shape (n, n)
        A stable matrix.
    c : ndarray, shape (p, n)

    Returns
    -------
    ndarray, shape (n, n)
        Lower triangular, with a diagonal that is not negative.

    Raises
    ------
    OptionError
        If an eigenvalue of `a` has a real part that is not negative.
    """
    return _factor_from_schur(*_adjoint(*_stable_schur(a)), c.T)


def gramian_factors(a: Matrix, b: Matrix, c: Matrix) -> tuple[Matrix, Matrix]:
    """Controllability and observability factor of (A, B, C) from one Schur form of A."""
    triangle, basis = _stable_schur(a)
    reachable = _factor_from_schur(triangle, basis, b)
    return reachable, _factor_from_schur(*_adjoint(triangle, basis), c.T)


def _stable_schur(a: Matrix) -> tuple[ComplexMatrix, ComplexMatrix]:
    """Upper triangular S and unitary U with A = U S U^H."""
    triangle, basis = complex_schur(a)
    rightmost = max(np.diag(triangle), key=lambda pole: pole.real, default=-1.0)
    if not rightmost.real < 0:
        raise OptionError(
            f"Gramians need a stable matrix; its rightmost eigenvalue is {rightmost:.6g}"
        )
    return triangle, basis


def _adjoint(triangle: ComplexMatrix, basis: ComplexMatrix) -> tuple[ComplexMatrix, ComplexMatrix]:
    """Schur form of A^H from that of A: the same with the order of the basis reversed."""
    return triangle.conj().T[::-1, ::-1], basis[:, ::-1]


def _factor_from_schur(triangle: ComplexMatrix, basis: ComplexMatrix, b: Matrix) -> Matrix:
    """Real lower triangular factor of the Gramian of (U S U^H, B)."""
    factor = basis @ _hammarling(triangle, basis.conj().T @ b)
    # The Gramian is real, so [Re L, Im L] is a factor too; a QR decomposition makes it square.
    stacked = np.vstack([factor.real.T, factor.imag.T])
    upper: Matrix = np.asarray(np.linalg.qr(stacked, mode="r"))
    signs = np.where(np.diag(upper) < 0, -1.0, 1.0)
    lower: Matrix = (signs[:, None] * upper).T
    return lower


def _hammarling(triangle: ComplexMatrix, right: ComplexMatrix) -> ComplexMatrix:
    """Upper triangular R with S R R^H + R R^H S^H + G G^H = 0, from the last column to the first.

    Let l be the last diagonal entry of S, g the last row of G, and alpha = sqrt(-2 Re l). Then the
    last entry of R is rho = |g| / alpha. The column r above it solves
    (S1 + conj(l) I) r = -(s rho + alpha G1 q), with q = g^H / |g|. What is left is the same problem
    for S1, with the component G1 q of G1 replaced by G1 q - alpha r.
    """
    s_real, s_imag = np.array([triangle.T.real, triangle.T.imag])
    g_real, g_imag = np.array([right.real, right.imag])
    r_real, r_imag = np.zeros((2, *triangle.shape))
    _fill_columns(s_real, s_imag, g_real, g_imag, r_real, r_imag)
    return np.asarray((r_real + 1j * r_imag).T)


# Real and imaginary parts apart, and columns of S and R as rows: what is read in a row is side by side.
@jit(nogil=True, error_model="numpy", fastmath=FAST)
def _fill_columns(s_real, s_imag, g_real, g_imag, r_real, r_imag):
    n, m = g_real.shape
    for k in range(n - 1, -1, -1):
        size = 0.0
        for i in range(m):
            size += g_real[k, i] ** 2 + g_imag[k, i] ** 2
        size = np.sqrt(size)
        if size == 0.0:
            continue
        alpha = np.sqrt(-2.0 * s_real[k, k])
        rho = size / alpha
        q_real, q_imag = g_real[k] / size, g_imag[k] / size
        x, y = r_real[k], r_imag[k]
        x[k] = rho
        for j in range(k):
            along, across = 0.0, 0.0
            for i in range(m):
                along += g_real[j, i] * q_real[i] + g_imag[j, i] * q_imag[i]
                across += g_imag[j, i] * q_real[i] - g_real[j, i] * q_imag[i]
            x[j] = -(s_real[k, j] * rho + alpha * along)
            y[j] = -(s_imag[k, j] * rho + alpha * across)
        for j in range(k - 1, -1, -1):
            pivot = complex(s_real[j, j] + s_real[k, k], s_imag[j, j] - s_imag[k, k])
            value = complex(x[j], y[j]) / pivot
            a, b = value.real, value.imag
            x[j], y[j] = a, b
            for i in range(j):
                x[i] -= s_real[j, i] * a - s_imag[j, i] * b
                y[i] -= s_real[j, i] * b + s_imag[j, i] * a
        for j in range(k):
            a, b = alpha * x[j], alpha * y[j]
            for i in range(m):
                g_real[j, i] -= a * q_real[i] - b * q_imag[i]
                g_imag[j, i] -= a * q_imag[i] + b * q_real[i]
