"""Oblique projection of a large linear system onto two growing bases."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from gridfold.systems.descriptor import DescriptorSystem
from gridfold.systems.linear import LinearSystem

Matrix = NDArray[np.float64]
ComplexMatrix = NDArray[np.complex128]

#: Part of a direction outside a basis below which it is taken to be in it already.
_NEW = 1e-10

#: Reciprocal condition number of W^T V below which both bases are replaced by their sum.
_CONDITION = 1e-11


@dataclass(frozen=True, eq=False)
class Bases:
    """V and W with orthonormal columns, and what the projection onto them needs.

    The projected system is x = V z with W^T (x' - A x - B u) = 0.

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
    gram, middle : ndarrays, shape (k, k)
        W^T V and W^T A V.
    wb, cv : ndarrays, shapes (k, m) and (p, k)
        W^T B and C V.
    """

    system: DescriptorSystem
    b: Matrix
    c: Matrix
    v: Matrix
    w: Matrix
    av: Matrix
    gram: Matrix
    middle: Matrix
    wb: Matrix
    cv: Matrix

    @classmethod
    def empty(cls, system: DescriptorSystem) -> Bases:
        """No columns yet.

        Where inputs act alike, or outputs are alike, fewer stand for them: B = B^ Q with the rows of
        Q orthonormal, and the same for C. Norms of the transfer matrix do not change.
        """
        v, gram = np.zeros((system.n, 0)), np.zeros((0, 0))
        b, c = _independent(system.b), _independent(system.c.T).T
        wb, cv = np.zeros((0, b.shape[1])), np.zeros((len(c), 0))
        return cls(system, b, c, v, v, v, gram, gram, wb, cv)

    def seen(self, b: Matrix, c: Matrix) -> Bases:
        """The same for other inputs and outputs."""
        return replace(self, b=b, c=c, wb=self.w.T @ b, cv=c @ self.v)

    @property
    def k(self) -> int:
        """Number of columns of each basis."""
        return len(self.gram)

    def extended(self, x: Matrix, y: Matrix) -> Bases:
        """With the columns of `x` in the range of V and those of `y` in that of W, as far as new.

        Both get as many columns. What has next to nothing outside the basis adds none.
        """
        new_v, new_w = _outside(self.v, x), _outside(self.w, y)
        count = min(new_v.shape[1], new_w.shape[1])
        if count == 0:
            return self
        new_v, new_w = new_v[:, :count], new_w[:, :count]
        new_av = self.system.apply(new_v)
        v, w, av = (
            np.hstack(pair) for pair in ((self.v, new_v), (self.w, new_w), (self.av, new_av))
        )
        gram = np.vstack([np.hstack([self.gram, self.w.T @ new_v]), new_w.T @ v])
        middle = np.vstack([np.hstack([self.middle, self.w.T @ new_av]), new_w.T @ av])
        wb = np.vstack([self.wb, new_w.T @ self.b])
        cv = np.hstack([self.cv, self.c @ new_v])
        found = replace(self, v=v, w=w, av=av, gram=gram, middle=middle, wb=wb, cv=cv)
        return found if _well_conditioned(gram) else found.united()

    def united(self) -> Bases:
        """The sum of both ranges as one basis for both: an orthogonal projection.

        It has all the directions of the oblique one and cannot break down, but up to twice as many.
        """
        q = np.hstack([self.v, _outside(self.v, self.w)])
        aq = np.hstack([self.av, self.system.apply(q[:, self.k :])])
        found = replace(self, v=q, w=q, av=aq, gram=q.T @ q, middle=q.T @ aq)
        return found.seen(self.b, self.c)

    def transfer(self, s: complex) -> ComplexMatrix:
        """Transfer matrix of the projected system at `s`, shape (p, m)."""
        states = np.linalg.solve(s * self.gram - self.middle, self.wb)
        return np.asarray(self.cv @ states, dtype=np.complex128)

    def restrict(self) -> Matrix:
        """(W^T V)^-1 W^T, shape (k, n)."""
        return np.asarray(np.linalg.solve(self.gram, self.w.T))

    def reduced(self) -> LinearSystem:
        """The projected system."""
        both: Matrix = np.asarray(
            np.linalg.solve(self.gram, np.hstack([self.middle, self.wb])), dtype=np.float64
        )
        return LinearSystem(both[:, : self.k], both[:, self.k :], self.cv)


def real_columns(x: ComplexMatrix) -> Matrix:
    """Columns with the same real range as those of `x` (n, j) and their conjugates, of length 1."""
    both = np.hstack([x.real, x.imag]) if x.imag.any() else x.real
    sizes = np.linalg.norm(both, axis=0)
    return np.asarray(both[:, sizes > 0] / sizes[sizes > 0])


def _independent(b: Matrix) -> Matrix:
    """Columns B^ with B B^T = B^ B^^T, no more than the rank of `b`."""
    left, sizes, _ = np.linalg.svd(b, full_matrices=False)
    rank = int(
        np.count_nonzero(sizes > len(sizes) * np.finfo(np.float64).eps * sizes.max(initial=0))
    )
    return np.asarray(left[:, :rank] * sizes[:rank])


def _outside(basis: Matrix, x: Matrix) -> Matrix:
    """Orthonormal columns for the part of `x` outside `basis`, the largest first."""
    rest = x - basis @ (basis.T @ x)
    q, r = np.linalg.qr(rest)
    left, sizes, _ = np.linalg.svd(r)
    new = q @ left[:, : len(sizes)][:, sizes > _NEW]
    # What rounding has left of the basis has been made large.
    return np.asarray(np.linalg.qr(new - basis @ (basis.T @ new))[0])


def _well_conditioned(matrix: Matrix) -> bool:
    size = np.abs(matrix).sum(axis=0).max()
    factors, _, info = linalg.lapack.dgetrf(matrix)
    if info:
        return False
    return float(linalg.lapack.dgecon(factors, size)[0]) > _CONDITION
