"""True unstable modes of a large system, from the guesses of a projected one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gridfold.numerics.spectral_split import InvariantPart
from gridfold.reduction.petrov import Bases, SpannedPart
from gridfold.reduction.sampling import Spectrum
from gridfold.systems.descriptor import DescriptorSystem

Matrix = NDArray[np.float64]
ComplexMatrix = NDArray[np.complex128]

#: Relative distance of eigenvalues that are iterated together, and of the shift from them.
_TOGETHER, _BESIDE = 1e-3, 1e-3

#: Steps of inverse iteration, and relative residual of a true mode.
_STEPS, _RESIDUAL = 8, 1e-9


def no_part(n: int) -> InvariantPart:
    """The invariant subspace that has nothing but zero."""
    return InvariantPart(np.zeros((0, 0)), np.zeros((n, 0)), np.zeros((0, n)))


def refined(
    system: DescriptorSystem,
    bases: Bases,
    values: NDArray[np.complex128],
    limit: float,
    exact: InvariantPart,
) -> InvariantPart:
    """The part `exact`, and the true modes with a real part of at least `limit` near `values`.

    Inverse iteration with the sparse factors; guesses that lead to no such mode are dropped. The
    shift stands a little beside the guess, so that the factors exist.
    """
    for group in _groups(values[(values.real >= limit) & (values.imag >= 0)], system.radius):
        middle = group.mean()
        shift = middle + _BESIDE * max(abs(middle), _BESIDE * system.radius)
        resolvent = system.at(shift)
        rng = np.random.default_rng(0)
        right = bases.v.times(rng.normal(size=(bases.k, len(group)))).astype(np.complex128)
        left = bases.w.times(rng.normal(size=(bases.k, len(group)))).astype(np.complex128)
        for _ in range(_STEPS):
            right = np.linalg.qr(resolvent.solve(right - exact.lift @ (exact.restrict @ right)))[0]
            left = left - exact.restrict.T @ (exact.lift.T @ left)
            left = np.linalg.qr(resolvent.solve_adjoint(left))[0]
        exact = _joined(system, exact, right, left, limit)
    return exact


def stable_rest(bases: Bases, spectrum: Spectrum, limit: float) -> SpannedPart:
    """The projected system without its poles at `limit` and beyond.

    These are either those of the exact part or of no meaning. With their right and left
    eigenvectors R and L, the rest lives in the null space of L^T, along R.
    """
    a, unit, vectors = bases.reduced.a, np.eye(bases.k), spectrum.vectors
    wrong = np.flatnonzero((spectrum.values.real >= limit) & (spectrum.values.imag >= 0))
    if len(wrong) == 0:
        return SpannedPart(a, unit, unit, bases.v, bases.w)
    pairs = spectrum.values[wrong].imag > 0
    left, right = (
        np.hstack([x.real, x.imag[:, pairs]])
        for x in (np.linalg.solve(vectors.T, unit[:, wrong] + 0j), vectors[:, wrong])
    )
    rest = np.linalg.qr(left, mode="complete")[0][:, left.shape[1] :]
    inner = rest.T - (rest.T @ right) @ np.linalg.solve(left.T @ right, left.T)
    return SpannedPart(inner @ a @ rest, rest, inner, bases.v, bases.w)


def _groups(values: NDArray[np.complex128], radius: float) -> list[NDArray[np.complex128]]:
    """Values that lie close together."""
    groups: list[list[complex]] = []
    for value in sorted(values.tolist(), key=lambda z: (z.imag, z.real)):
        for group in groups:
            if min(abs(value - other) for other in group) < _TOGETHER * radius:
                group.append(value)
                break
        else:
            groups.append([value])
    return [np.array(group) for group in groups]


def _joined(
    system: DescriptorSystem,
    exact: InvariantPart,
    right: ComplexMatrix,
    left: ComplexMatrix,
    limit: float,
) -> InvariantPart:
    """The part `exact` with the subspaces `right` and `left` besides, if they are true and new."""
    inner = left.conj().T @ right
    applied = system.apply(right.real) + 1j * system.apply(right.imag)
    try:
        matrix = np.linalg.solve(inner, left.conj().T @ applied)
    except np.linalg.LinAlgError:
        return exact
    residual = np.linalg.norm(applied - right @ matrix)
    values = np.linalg.eigvals(matrix).astype(np.complex128)
    if residual > _RESIDUAL * system.radius or (values.real < limit).any():
        return exact
    lift = np.hstack([exact.lift, _real_basis(right, values, system.radius)])
    dual = np.hstack([exact.restrict.T, _real_basis(left, values, system.radius)])
    restrict = np.asarray(np.linalg.solve(dual.T @ lift, dual.T), dtype=np.float64)
    return InvariantPart(restrict @ system.apply(lift), lift, restrict)


def _real_basis(x: ComplexMatrix, values: NDArray[np.complex128], radius: float) -> Matrix:
    """Orthonormal real basis of the subspace of `x`, or of it and its conjugate for pairs."""
    both = np.hstack([x.real, x.imag])
    count = x.shape[1] * (2 if np.abs(values.imag).max() > _TOGETHER * radius else 1)
    return np.asarray(np.linalg.svd(both, full_matrices=False)[0][:, :count])
