"""Oblique projection of a large linear system onto two growing bases."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gridfold.numerics.spectral_split import InvariantPart
from gridfold.systems.descriptor import DescriptorSystem
from gridfold.systems.linear import LinearSystem

Matrix = NDArray[np.float64]
ComplexMatrix = NDArray[np.complex128]

#: Part of the largest overlap of new directions below which one is rounding.
_ROUNDING = 1e-13

#: Overlap below which a direction of both bases belongs to a part that is taken away.
_IN_PART = 1e-6


@dataclass(frozen=True, eq=False)
class Bases:
    """V and W with W^T V = I, and what the projection onto them needs.

    The projected system is x = V z with z' = W^T (A V z + B u).

    Source: A. C. Antoulas, "Approximation of Large-Scale Dynamical Systems", SIAM, 2005, section 11.3.

    Parameters
    ----------
    system : DescriptorSystem
        Gives A.
    b, c : ndarrays, shapes (n, m) and (p, n)
        Inputs and outputs; those of the system, or of a part of it.
    v, w : ndarrays, shape (n, k)
        The bases.
    av : ndarray, shape (n, k)
        A V.
    middle : ndarray, shape (k, k)
        W^T A V.
    """

    system: DescriptorSystem
    b: Matrix
    c: Matrix
    v: Matrix
    w: Matrix
    av: Matrix
    middle: Matrix

    @classmethod
    def empty(cls, system: DescriptorSystem) -> Bases:
        """No columns yet.

        Where inputs act alike, or outputs are alike, fewer stand for them: B = B^ Q with the rows of
        Q orthonormal, and the same for C. Norms of the transfer matrix do not change.
        """
        v = np.zeros((system.n, 0))
        b, c = _independent(system.b), _independent(system.c.T).T
        return cls(system, b, c, v, v, v, np.zeros((0, 0)))

    @property
    def k(self) -> int:
        """Number of columns of each basis."""
        return len(self.middle)

    def extended(self, x: Matrix, y: Matrix, level: float = 0.0) -> Bases:
        """With directions of the columns of `x` in the range of V and of those of `y` in that of W.

        Both get as many: the singular vectors of Y^T X, for what is outside the bases, with values
        above `level`. If the columns are samples on the axis, times the root of their distance over
        pi, these values are near the Hankel singular values of the error.

        Source: I. V. Gosea, S. Gugercin, C. Beattie, "Data-Driven Balancing of Linear Dynamical
        Systems", SIAM Journal on Scientific Computing 44 (2022), pp. A554-A582.
        """
        x, y = _outside(x, self.v, self.w), _outside(y, self.w, self.v)
        left, values, right = np.linalg.svd(y.T @ x, full_matrices=False)
        count = int(np.sum(values > max(level, _ROUNDING * values.max(initial=0.0))))
        if count == 0:
            return self
        roots = np.sqrt(values[:count])
        # What rounding has left of the bases has been made large.
        new_v = _outside(x @ (right[:count].T / roots), self.v, self.w)
        new_w = _outside(y @ (left[:, :count] / roots), self.w, self.v)
        new_v = np.asarray(np.linalg.solve((new_w.T @ new_v).T, new_v.T).T, dtype=np.float64)
        new_av = self.system.apply(new_v)
        v, w, av = (
            np.hstack(pair) for pair in ((self.v, new_v), (self.w, new_w), (self.av, new_av))
        )
        middle = np.vstack([np.hstack([self.middle, self.w.T @ new_av]), new_w.T @ av])
        return replace(self, v=v, w=w, av=av, middle=middle)

    def united(self, x: Matrix, y: Matrix) -> Bases:
        """With the columns of `x` and of `y` in the ranges of both, where they do not meet."""
        both = np.linalg.qr(np.hstack([x, y]))[0]
        return self.extended(both, both)

    def without(self, part: InvariantPart) -> Bases:
        """Bases for the rest of the system without `part`, of its inputs and of its outputs."""
        b = self.b - part.lift @ (part.restrict @ self.b)
        c = self.c - (self.c @ part.lift) @ part.restrict
        nothing = replace(Bases.empty(self.system), b=b, c=c)
        v = _outside(self.v, part.lift, part.restrict.T)
        return nothing.extended(v, _outside(self.w, part.restrict.T, part.lift), _IN_PART)

    def reduced(self) -> LinearSystem:
        """The projected system."""
        return LinearSystem(self.middle, self.w.T @ self.b, self.c @ self.v)


def real_columns(x: ComplexMatrix) -> Matrix:
    """Columns with the same real range as those of `x` (n, j) and their conjugates."""
    return np.hstack([x.real, x.imag])


def _independent(b: Matrix) -> Matrix:
    """Columns B^ with B B^T = B^ B^^T, no more than the rank of `b`."""
    left, sizes, _ = np.linalg.svd(b, full_matrices=False)
    rank = int(
        np.count_nonzero(sizes > len(sizes) * np.finfo(np.float64).eps * sizes.max(initial=0))
    )
    return np.asarray(left[:, :rank] * sizes[:rank])


def _outside(x: Matrix, basis: Matrix, dual: Matrix) -> Matrix:
    """The part of `x` outside `basis`, along the null space of the transposed `dual`."""
    return np.asarray(x - basis @ (dual.T @ x))
