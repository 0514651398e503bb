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
from numpy.typing import NDArray
from scipy import linalg
from scipy.linalg.blas import zgeru, ztpsv

from gridfold.errors import OptionError

Matrix = NDArray[np.float64]
ComplexMatrix = NDArray[np.complex128]


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
    if len(a) == 0:
        return np.zeros((0, 0), complex), np.zeros((0, 0), complex)
    triangle, basis = linalg.rsf2csf(*linalg.schur(a))
    poles = np.diag(triangle)
    rightmost = poles[np.argmax(poles.real)]
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

    S is packed by columns, of which S1 is the front: what is solved with is never copied.
    """
    n, poles = len(triangle), np.diag(triangle)
    packed = np.ascontiguousarray(triangle.T)[np.tril_indices(n)]
    diagonal = np.cumsum(np.arange(1, n + 1)) - 1
    g = np.array(right, dtype=np.complex128, order="C")
    factor = np.zeros((n, n), dtype=np.complex128)
    for k in reversed(range(n)):
        size = np.linalg.norm(g[k])
        if size == 0:
            continue
        alpha = np.sqrt(-2 * poles[k].real)
        factor[k, k] = size / alpha
        if k == 0:
            break
        direction = g[k] / size
        component = g[:k] @ direction.conj()
        packed[diagonal[:k]] = poles[:k] + poles[k].conj()
        column = ztpsv(k, packed, -(triangle[:k, k] * factor[k, k] + alpha * component))
        factor[:k, k] = column
        # In place: the transpose of rows in C order is in the order of the library.
        zgeru(-alpha, direction, column, a=g[:k].T, overwrite_a=True)
    return factor
