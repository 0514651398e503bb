"""Where on the imaginary axis a large system is sampled next."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gridfold.systems.linear import LinearSystem

Matrix = NDArray[np.float64]
ComplexMatrix = NDArray[np.complex128]

#: First samples, and the grid on which models are compared, in parts of the largest eigenvalue.
_FIRST = (1e-6, 1e-3, 0.01, 0.04, 0.12, 0.25, 0.45, 0.7, 1.0)
_LOWEST, _HIGHEST, _GRID = 1e-6, 10.0, 300

#: Samples a round where models differ: at least, and at most where they differ by more than is wanted;
#: and in gaps between those before.
_LEAST, _BATCH, _GAPS = 4, 12, 4

#: Poles nearer to the axis than this part of their modulus count as peaks.
_NEAR_AXIS = 0.2

#: Relative distance of samples: what is nearer than that has been seen already.
_APART = 0.02

#: Random directions of inputs and outputs in which models are compared.
_DIRECTIONS = 5


@dataclass(frozen=True, eq=False)
class Spectrum:
    """A transfer matrix as a sum over its poles, sum of r_i l_i / (s - values_i).

    Parameters
    ----------
    values : ndarray of complex, shape (k,)
    right : ndarray of complex, shape (p, k)
        Columns r_i.
    left : ndarray of complex, shape (k, m)
        Rows l_i.
    vectors : ndarray of complex, shape (k, k)
        Right eigenvectors of A.
    """

    values: NDArray[np.complex128]
    right: ComplexMatrix
    left: ComplexMatrix
    vectors: ComplexMatrix

    @classmethod
    def of(cls, system: LinearSystem) -> Spectrum:
        """The poles of `system`; what they say of a defective matrix is a guess only."""
        values, vectors = np.linalg.eig(system.a)
        try:
            left = np.linalg.solve(vectors, system.b.astype(np.complex128))
        except np.linalg.LinAlgError:
            left = np.linalg.lstsq(vectors, system.b.astype(np.complex128), rcond=None)[0]
        return cls(values.astype(np.complex128), system.c @ vectors, left, vectors)

    def sketched(self) -> Spectrum:
        """The same seen in a few random directions; Frobenius norms are the same on average."""
        rng = np.random.default_rng(0)
        outputs = rng.normal(size=(_DIRECTIONS, len(self.right))) / _DIRECTIONS
        inputs = rng.normal(size=(self.left.shape[1], _DIRECTIONS))
        return replace(self, right=outputs @ self.right, left=self.left @ inputs)

    def response(self, omega: Matrix) -> ComplexMatrix:
        """The transfer matrix at j omega in rad/s, shape (len(omega), p, m)."""
        with np.errstate(divide="ignore", invalid="ignore"):
            weights = 1 / (1j * omega[:, None, None] - self.values)
        return np.asarray((self.right * weights) @ self.left)

    def heights(self) -> Matrix:
        """Largest value on the imaginary axis of the term of each pole, shape (k,)."""
        sizes = np.linalg.norm(self.right, axis=0) * np.linalg.norm(self.left, axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(np.nan_to_num(sizes / np.abs(self.values.real), nan=0.0))


def first_points(radius: float) -> Matrix:
    """Frequencies in rad/s to begin with, where the largest eigenvalue has the modulus `radius`."""
    return np.asarray(_FIRST) * (radius or 1.0)


def next_points(
    now: Spectrum, before: Spectrum, sampled: Matrix, radius: float, level: float
) -> Matrix:
    """Frequencies in rad/s that tell whether the model `now` can be trusted, apart from `sampled`.

    They are those where it differs most from the model `before`, more of them where by more than
    `level`, the middles of the widest gaps between samples, and unstable poles of the model whose
    terms reach `level`.
    """
    known = np.unique(np.clip(sampled, _LOWEST * radius, _HIGHEST * radius))
    widest = np.argsort(-np.diff(np.log(known)), kind="stable")[:_GAPS]
    middles = np.sqrt(known[widest] * known[widest + 1])
    doubtful = (now.values.real >= 0) & (now.values.imag >= 0) & (now.heights() > level)
    poles = np.maximum(now.values.imag[doubtful], _LOWEST * radius)[:_GAPS]
    changed = _changed(now, before, sampled, radius, level)
    return _apart(np.concatenate([changed, middles, poles]), sampled)


def _apart(points: Matrix, sampled: Matrix) -> Matrix:
    """Those of `points` that are apart from `sampled` and from each other, in ascending order."""
    chosen: list[float] = []
    for point in points:
        if (np.abs(np.append(sampled, chosen) / point - 1) > _APART).all():
            chosen.append(point)
    return np.sort(chosen)


def _changed(
    now: Spectrum, before: Spectrum, sampled: Matrix, radius: float, level: float
) -> Matrix:
    """Frequencies in rad/s where the two models differ most."""
    omega = _grid(now, radius)
    omega = omega[(np.abs(omega[:, None] / sampled - 1) > _APART).all(axis=1)]
    gap = now.sketched().response(omega) - before.sketched().response(omega)
    height = np.nan_to_num(np.linalg.norm(gap, axis=(1, 2)))
    around = np.concatenate([[-1.0], height, [-1.0]])
    peaks = np.flatnonzero((height >= around[:-2]) & (height > around[2:]))
    count = np.clip(np.count_nonzero(height[peaks] > level), _LEAST, _BATCH)
    chosen = peaks[np.argsort(-height[peaks], kind="stable")][:count]
    return np.asarray(omega[chosen])


def widths(points: Matrix) -> Matrix:
    """Part of the axis in rad/s that each of `points`, in ascending order, stands for."""
    return np.diff(np.concatenate([[0.0], np.sqrt(points[:-1] * points[1:]), [2 * points[-1]]]))


def _grid(spectrum: Spectrum, radius: float) -> Matrix:
    """Evenly spread on a logarithmic scale, and the poles near the axis."""
    even = np.geomspace(_LOWEST, _HIGHEST, _GRID) * (radius or 1.0)
    values = spectrum.values
    near = (values.imag > even[0]) & (np.abs(values.real) < _NEAR_AXIS * values.imag)
    return np.unique(np.concatenate([even, values.imag[near]]))
