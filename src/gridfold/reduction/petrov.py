"""Oblique projection of a large linear system onto two growing bases of samples.

All inner products of samples, and those with A between them, follow from the transfer matrix at the
points of the samples: no more of them is computed in the large space than those at one point.

Source: A. J. Mayo, A. C. Antoulas, "A Framework for the Solution of the Generalized Realization
Problem", Linear Algebra and its Applications 425 (2007), pp. 634-662.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gridfold.numerics.spectral_split import InvariantPart
from gridfold.systems.descriptor import DescriptorSystem
from gridfold.systems.linear import LinearSystem

Matrix = NDArray[np.float64]
ComplexMatrix = NDArray[np.complex128]

#: Part of the largest overlap of new directions below which one is rounding.
_ROUNDING = 1e-13

#: Part of the level from which overlaps of old directions matter once there are new ones.
_SMALL = 0.03


@dataclass(frozen=True, eq=False)
class Directions:
    """Directions of samples G(s) = C (s I - A)^-1 B: the states (s I - A)^-1 B z and their duals.

    The duals are (s I - A)^-H C^T u. Each has a point s, which is not real.

    Parameters
    ----------
    points : ndarray of complex, shape (j,)
        s in rad/s.
    inputs, answers : ndarrays of complex, shapes (m, j) and (p, j)
        Columns z and G(s) z.
    outputs, asked : ndarrays of complex, shapes (p, j) and (j, m)
        Columns u, and rows u^H G(s).
    """

    points: NDArray[np.complex128]
    inputs: ComplexMatrix
    answers: ComplexMatrix
    outputs: ComplexMatrix
    asked: ComplexMatrix

    @classmethod
    def at(
        cls, s: complex, response: ComplexMatrix, u: ComplexMatrix, z: ComplexMatrix
    ) -> Directions:
        """Columns `u` and `z` at one point with G(s) = `response`."""
        return cls(np.full(z.shape[1], s), z, response @ z, u, u.conj().T @ response)

    @classmethod
    def joined(cls, *parts: Directions) -> Directions:
        """All of them in turn."""
        return cls(
            np.concatenate([part.points for part in parts]),
            np.hstack([part.inputs for part in parts]),
            np.hstack([part.answers for part in parts]),
            np.hstack([part.outputs for part in parts]),
            np.vstack([part.asked for part in parts]),
        )

    def overlap(self, other: Directions) -> Matrix:
        """Y^T X of the duals with the states of `other`, real and imaginary parts apart.

        Y^H X = u^H (G(s') - G(s)) z / (s - s'); those at the same point are left out. Shape
        (2 j, 2 j'), the imaginary part of each direction after the real one.
        """
        s, at = self.points[:, None], other.points
        u, z, answers = self.outputs.conj().T, other.inputs, other.answers
        gap = s - at
        same = gap == 0
        straight = np.where(same, 0.0, (u @ answers - self.asked @ z) / np.where(same, 1.0, gap))
        turned = (u @ answers.conj() - self.asked @ z.conj()) / (s - at.conj())
        return _parts(straight, turned)

    def into(self, x: Matrix) -> Matrix:
        """The coefficients of A X x with X, without what B adds: X has columns as in `overlap`."""
        turned = np.empty_like(x)
        omega = self.points.imag[:, None]
        turned[0::2], turned[1::2] = omega * x[1::2], -omega * x[0::2]
        return turned


@dataclass(frozen=True, eq=False)
class Spanned:
    """A real basis V = X R that is not formed.

    Parameters
    ----------
    blocks : tuple of ndarrays of complex, shapes (n, ...)
        Columns whose real and imaginary parts in turn are X, shape (n, 2 j).
    coefficients : ndarray, shape (2 j, k)
        R.
    """

    blocks: tuple[ComplexMatrix, ...]
    coefficients: Matrix

    def times(self, z: Matrix) -> Matrix:
        """V z, shape (n, ...), for columns `z` of shape (k, ...)."""
        ends = np.cumsum([2 * block.shape[1] for block in self.blocks])
        first, *parts = np.split(self.coefficients @ z, ends[:-1])
        found = reals(self.blocks[0]) @ first
        for block, part in zip(self.blocks[1:], parts, strict=True):
            found += reals(block) @ part
        return found

    def inner(self, x: Matrix) -> Matrix:
        """V^T x, shape (k, ...), for columns `x` of shape (n, ...)."""
        return self.coefficients.T @ np.vstack([reals(block).T @ x for block in self.blocks])


@dataclass(frozen=True, eq=False)
class Bases:
    """V and W with W^T V near I, spanned by samples, and the projection onto them.

    The projected system is x = V z with z' = W^T (A V z + B u).

    Source: A. C. Antoulas, "Approximation of Large-Scale Dynamical Systems", SIAM, 2005, section 11.3.

    Parameters
    ----------
    system : DescriptorSystem
        Gives A.
    b, c : ndarrays, shapes (n, m) and (p, n)
        Inputs and outputs; those of the system, or of a part of it.
    directions : Directions
        All j of them that there are.
    x, y : tuples of ndarrays of complex, shapes (n, ...)
        Their states and duals, j columns in all.
    overlap : ndarray, shape (2 j, 2 j)
        Y^T X.
    left, values, right : ndarrays, shapes (2 j, q), (q,) and (2 j, q)
        Its singular vectors and values; what is small is left out.
    k : int
        Number of columns of each basis.
    """

    system: DescriptorSystem
    b: Matrix
    c: Matrix
    directions: Directions
    x: tuple[ComplexMatrix, ...]
    y: tuple[ComplexMatrix, ...]
    overlap: Matrix
    left: Matrix
    values: Matrix
    right: Matrix
    k: int

    @classmethod
    def empty(
        cls, system: DescriptorSystem, without: InvariantPart, most: int | None = None
    ) -> Bases:
        """No columns yet, for the rest of the system `without` a part.

        Where inputs act alike, or outputs are alike, fewer stand for them: B = B^ Q with the rows of
        Q orthonormal, and the same for C. Norms of the transfer matrix do not change. If there are
        more than `most` of them, so many random combinations take their place.
        """
        b, c = _independent(system.b, most), _independent(system.c.T, most).T
        b = b - without.lift @ (without.restrict @ b)
        c = c - (c @ without.lift) @ without.restrict
        (p, n), m = c.shape, b.shape[1]
        none, small = np.zeros((n, 0), dtype=np.complex128), np.zeros((0, 0))
        nothing = Directions.at(0.0, np.zeros((p, m), dtype=np.complex128), none[:p], none[:m])
        return cls(system, b, c, nothing, (none,), (none,), small, small, small.ravel(), small, 0)

    @property
    def v(self) -> Spanned:
        """V."""
        return Spanned(self.x, self.right[:, : self.k] / np.sqrt(self.values[: self.k]))

    @property
    def w(self) -> Spanned:
        """W."""
        return Spanned(self.y, self.left[:, : self.k] / np.sqrt(self.values[: self.k]))

    def extended(self, new: Directions, x: ComplexMatrix, y: ComplexMatrix, level: float) -> Bases:
        """With `new` directions, whose states are the columns of `x` and the duals those of `y`.

        The bases are the singular vectors of Y^T X with values above `level`. If the directions are
        samples on the axis, times the root of their distance over pi, these values are near the Hankel
        singular values.

        Source: I. V. Gosea, S. Gugercin, C. Beattie, "Data-Driven Balancing of Linear Dynamical
        Systems", SIAM Journal on Scientific Computing 44 (2022), pp. A554-A582.
        """
        old = self.directions
        within = new.overlap(new) + _at_one_point(new.points, x, y)
        after, before = old.overlap(new), new.overlap(old)
        core = [[np.diag(self.values), self.left.T @ after], [before @ self.right, within]]
        u, values, vt = np.linalg.svd(np.block(core))
        level = max(level, _ROUNDING * values.max(initial=0.0))
        kept = slice(np.count_nonzero(values > _SMALL * level))
        return replace(
            self,
            directions=Directions.joined(old, new),
            x=(*self.x, x),
            y=(*self.y, y),
            overlap=np.block([[self.overlap, after], [before, within]]),
            left=_turned(self.left, u[:, kept]),
            values=values[kept],
            right=_turned(self.right, vt[kept].T),
            k=int(np.count_nonzero(values > level)),
        )

    @cached_property
    def reduced(self) -> LinearSystem:
        """The projected system."""
        at, right, left = self.directions, self.v.coefficients, self.w.coefficients
        b = left.T @ reals(at.asked.conj().T).T
        a = left.T @ (self.overlap @ at.into(right)) - b @ (reals(at.inputs) @ right)
        return LinearSystem(a, b, reals(at.answers) @ right)


@dataclass(frozen=True, eq=False)
class SpannedPart:
    """A part of a large system as :class:`InvariantPart` has it, whose maps are not formed.

    Parameters
    ----------
    matrix, lift, restrict : ndarrays, shapes (s, s), (k, s) and (s, k)
        The part of the projected system.
    v, w : Spanned
        The bases of the projection.
    """

    matrix: Matrix
    lift: Matrix
    restrict: Matrix
    v: Spanned
    w: Spanned

    @property
    def order(self) -> int:
        """Dimension s of the part."""
        return len(self.matrix)

    def states(self, z: Matrix) -> Matrix:
        """Full states, shape (n, ...), of coordinates `z`, shape (s, ...)."""
        return self.v.times(self.lift @ z)

    def coordinates(self, x: Matrix) -> Matrix:
        """Coordinates, shape (s, ...), of full states `x`, shape (n, ...)."""
        return self.restrict @ self.w.inner(x)

    def rows(self, t: Matrix) -> Matrix:
        """What `t`, shape (r, s), does to coordinates, as done to full states: shape (r, n)."""
        return self.w.times((t @ self.restrict).T).T

    def outputs(self, c: Matrix) -> Matrix:
        """What `c`, shape (p, n), does to full states, as done to coordinates: shape (p, s)."""
        return self.v.inner(c.T).T @ self.lift


def _turned(vectors: Matrix, by: Matrix) -> Matrix:
    """Columns of `vectors`, and units for what there is besides, combined by those of `by`."""
    return np.vstack([vectors @ by[: vectors.shape[1]], by[vectors.shape[1] :]])


def _parts(straight: ComplexMatrix, turned: ComplexMatrix) -> Matrix:
    """Y^T X by real and imaginary parts, from Y^H X and Y^H X*."""
    found = np.empty((2 * straight.shape[0], 2 * straight.shape[1]))
    both, apart = (straight + turned) / 2, (straight - turned) / 2
    found[0::2, 0::2], found[0::2, 1::2] = both.real, apart.imag
    found[1::2, 0::2], found[1::2, 1::2] = -both.imag, apart.real
    return found


def _at_one_point(points: NDArray[np.complex128], x: ComplexMatrix, y: ComplexMatrix) -> Matrix:
    """What :meth:`Directions.overlap` leaves out."""
    straight = np.zeros((len(points),) * 2, dtype=np.complex128)
    for point in np.unique(points):
        at = np.flatnonzero(points == point)
        straight[np.ix_(at, at)] = y[:, at].conj().T @ x[:, at]
    return _parts(straight, np.zeros_like(straight))


def reals(x: ComplexMatrix) -> Matrix:
    """Columns with the same real range as those of `x` (n, j) and their conjugates, (n, 2 j)."""
    return np.ascontiguousarray(x).view(np.float64)


def _independent(b: Matrix, most: int | None) -> Matrix:
    """Columns B^ with B B^T = B^ B^^T, no more than the rank of `b`; or `most` that are mixed."""
    left, sizes, _ = np.linalg.svd(b, full_matrices=False)
    rank = int(
        np.count_nonzero(sizes > len(sizes) * np.finfo(np.float64).eps * sizes.max(initial=0))
    )
    found = left[:, :rank] * sizes[:rank]
    if most is not None and rank > most:
        found = found @ np.random.default_rng(0).normal(size=(rank, most))
    return np.asarray(found)
