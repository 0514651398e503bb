"""Frequency and damping of a decaying oscillation: the matrix pencil method.

Y. Hua and T. K. Sarkar, "Matrix pencil method for estimating parameters of exponentially
damped/undamped sinusoids in noise", IEEE Trans. Acoustics, Speech and Signal Processing 38 (1990) 814.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lstsq

#: Singular values below this part of the first are put down to noise, and most modes looked for.
_NOISE, _MOST = 1e-4, 30
#: Most samples that are looked at: more add time, not accuracy.
_SAMPLES = 240
_LEAST = 24


class Ringdown(NamedTuple):
    """The swing with the most energy: Hz, damping ratio (1 is critical), its part of the energy."""

    frequency_hz: float
    damping_ratio: float
    share: float


def ringdown(
    signal: NDArray[np.float64],
    step: float,
    band_hz: tuple[float, float] = (0.05, 3.0),
    most_damped: float = 0.5,
) -> Ringdown | None:
    """The dominant oscillation of a signal.

    Parameters
    ----------
    signal : ndarray, shape (n_times,)
        Equally spaced samples.
    step : float
        Their distance in seconds.
    band_hz : (float, float)
        Frequencies that count as a swing.
    most_damped : float
        Damping ratio above which a mode counts as decay, not as a swing.

    Returns
    -------
    Ringdown or None
        None if nothing in the band swings, or the signal is too short.
    """
    every = max(1, -(-len(signal) // _SAMPLES))
    y = np.asarray(signal[::every], dtype=np.float64)
    y = y - y.mean()
    spacing = step * every
    n = len(y)
    if n < _LEAST or not np.isfinite(y).all() or not np.any(y):
        return None
    pencil = n // 2
    hankel = np.lib.stride_tricks.sliding_window_view(y, pencil + 1)
    _, values, right = np.linalg.svd(hankel, full_matrices=False)
    order = min(int(np.count_nonzero(values > _NOISE * values[0])), _MOST, pencil - 1)
    basis = right[:order].T
    z = np.linalg.eigvals(_shift(basis))
    z = z[np.abs(z) > 1e-6]
    powers = np.cumprod(np.vstack([np.ones_like(z), np.broadcast_to(z, (n - 1, len(z)))]), axis=0)
    amplitudes = lstsq(powers, y.astype(complex), lapack_driver="gelsy", check_finite=False)[0]
    sizes = np.sum(powers.real**2 + powers.imag**2, axis=0)
    energies = (amplitudes.real**2 + amplitudes.imag**2) * sizes
    roots = np.log(z) / spacing
    frequency = np.abs(roots.imag) / (2 * np.pi)
    damping = -roots.real / np.maximum(np.abs(roots), 1e-12)
    swings = (frequency >= band_hz[0]) & (frequency <= band_hz[1]) & (damping <= most_damped)
    if not swings.any():
        return None
    best = int(np.argmax(np.where(swings, energies, -1.0)))
    return Ringdown(
        float(frequency[best]),
        float(damping[best]),
        float(min(1.0, 2 * energies[best] / energies.sum())),
    )


def _shift(basis: NDArray[np.float64]) -> NDArray[np.float64]:
    """M such that ``basis[:-1] @ M`` is nearest to ``basis[1:]``, for a basis with orthonormal columns.

    Without its last row b the basis has the Gram matrix I - b b', whose inverse is known.
    """
    last = basis[-1]
    right = basis[:-1].T @ basis[1:]
    return np.asarray(right + np.outer(last, last @ right) / (1.0 - last @ last))
