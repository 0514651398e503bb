"""Modes of a large system that decay slowly or grow, by inverse iteration along the imaginary axis.

Source: Y. Saad, "Numerical Methods for Large Eigenvalue Problems", revised ed., SIAM, 2011, section
8.2 (shift-and-invert Arnoldi).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigs

from gridfold.errors import OptionError
from gridfold.numerics.blas import one_blas_thread
from gridfold.systems.descriptor import DescriptorSystem

Matrix = NDArray[np.float64]
ComplexMatrix = NDArray[np.complex128]
Values = NDArray[np.complex128]

#: Eigenvalues found about one shift; twice as many where these do not reach across the strip.
_NEIGHBOURS, _DOUBLINGS = 24, 4

#: Up to this many states all modes are found from the matrix itself.
_SMALL = 200

#: Relative distance of eigenvalues that may be one, and relative residual of a mode.
_SAME, _RESIDUAL = 1e-7, 1e-8


@one_blas_thread
def slow_modes(system: DescriptorSystem, decay: float) -> tuple[Values, ComplexMatrix]:
    """All modes with a real part above -`decay` in 1/s, one of each pair.

    Each shift on the axis gives the eigenvalues in a disc about it. Discs are added until they cover
    the strip from -`decay` to the axis. A mode that grows is found if it is as near to the axis as a
    disc reaches. Of modes with the same eigenvalue to rounding only one may be found.

    Parameters
    ----------
    system : DescriptorSystem
    decay : float
        Positive.

    Returns
    -------
    values : ndarray of complex, shape (j,)
        Eigenvalues in 1/s, none below the real axis, in the order of their frequencies.
    vectors : ndarray of complex, shape (n, j)
        Eigenvectors of length 1.

    Raises
    ------
    OptionError
        If `decay` is not positive, or the strip holds more modes than can be found.
    """
    if not 0 < decay < np.inf:
        raise OptionError(f"the decay of slow modes must be a positive number of 1/s, not {decay}")
    if system.n <= _SMALL:
        values, vectors = np.linalg.eig(system.dense().a)
        upper = values.imag >= 0
        return _chosen(values[upper] + 0j, vectors[:, upper] + 0j, decay)
    found: list[tuple[Values, ComplexMatrix]] = []
    highest = 1.01 * system.radius
    open_parts, reach = [(0.0, highest)], 0.0
    while open_parts:
        low, high = open_parts.pop()
        centre = min(low + reach, (low + high) / 2)
        reach, values, vectors = _disc(system, centre, decay)
        found.append((values, vectors))
        if centre + reach < high:
            open_parts.append((centre + reach, high))
        if centre - reach > low:
            open_parts.append((low, centre - reach))
    values, vectors = (np.concatenate(parts, axis=-1) for parts in zip(*found, strict=True))
    return _distinct(system, *_chosen(values, vectors, decay))


def _disc(
    system: DescriptorSystem, centre: float, decay: float
) -> tuple[float, Values, ComplexMatrix]:
    """How far along the axis all modes about j `centre` are known, and these modes."""
    # Beside the axis, so that a mode on it does no harm.
    shift = complex(1e-3 * system.radius, centre)
    resolvent = system.at(shift)
    inverse = LinearOperator(
        (system.n,) * 2, matvec=lambda x: -resolvent.solve(x.reshape(-1, 1))[:, 0], dtype=complex
    )
    start = np.random.default_rng(0).normal(size=system.n).astype(np.complex128)
    for doubling in range(_DOUBLINGS + 1):
        count = min(_NEIGHBOURS << doubling, system.n // 3)
        try:
            inverted, vectors = eigs(inverse, count, v0=start, ncv=2 * count + 20)
        except ArpackNoConvergence as error:
            inverted, vectors = error.eigenvalues, error.eigenvectors
        if len(inverted):
            values = shift + 1 / inverted
            radius = float(np.abs(values - shift).max())
            inside = radius**2 - (decay + shift.real) ** 2
            if inside > 0:
                return 0.99 * float(np.sqrt(inside)), values, vectors
    raise OptionError(f"more modes than can be found decay more slowly than {decay:g} 1/s")


def _chosen(values: Values, vectors: ComplexMatrix, decay: float) -> tuple[Values, ComplexMatrix]:
    """Those in the strip; eigenvalues below the real axis are turned up."""
    below = values.imag < 0
    values, vectors = (
        np.where(below, values.conj(), values),
        np.where(below, vectors.conj(), vectors),
    )
    inside = np.flatnonzero(values.real > -decay)
    order = inside[np.lexsort((values.real[inside], values.imag[inside]))]
    return values[order], vectors[:, order]


def _distinct(
    system: DescriptorSystem, values: Values, vectors: ComplexMatrix
) -> tuple[Values, ComplexMatrix]:
    """Each mode once: true ones whose vectors are independent of those of equal eigenvalues."""
    applied = system.apply(vectors.real) + 1j * system.apply(vectors.imag)
    residuals = np.linalg.norm(applied - vectors * values, axis=0)
    kept: list[int] = []
    for k in np.flatnonzero(residuals <= _RESIDUAL * system.radius):
        equal = [i for i in kept if abs(values[i] - values[k]) <= _SAME * system.radius]
        basis = np.linalg.qr(vectors[:, equal])[0]
        rest = vectors[:, k] - basis @ (basis.conj().T @ vectors[:, k])
        if np.linalg.norm(rest) > np.sqrt(_SAME):
            kept.append(int(k))
    return values[kept], vectors[:, kept]
