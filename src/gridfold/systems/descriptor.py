"""Large linear systems whose matrix is known by sparse blocks only.

A grid is such a system: blocks of devices, joined by the algebraic equations of a sparse network.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import block_array, csc_array, diags_array
from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, SuperLU, eigs, splu

from gridfold.errors import OptionError
from gridfold.numerics.many_columns import solve_rows
from gridfold.systems.linear import LinearSystem

Matrix = NDArray[np.float64]

#: Pivots on the diagonal unless they are this much smaller than the largest entry of their column;
#: the columns of a grid are too sparse to be worked on in panels.
_FACTORS: dict[str, Any] = {
    "diag_pivot_thresh": 0.01,
    "panel_size": 1,
    "options": {"SymmetricMode": True},
}

#: Columns that are solved for together: more of them leave the cache.
_BLOCK = 8

#: Up to this many states the largest eigenvalue is found from the matrix itself.
_SMALL, _RADIUS_TOLERANCE = 60, 1e-3


@dataclass(frozen=True, eq=False)
class DescriptorSystem:
    """x' = A11 x + A12 v + B1 u, 0 = A21 x + A22 v + B2 u, y = C x, with A22 regular.

    The same as x' = A x + B u with A = A11 - A12 A22^-1 A21 and B = B1 - A12 A22^-1 B2, neither of
    which is formed: no matrix of n x n or k x k numbers is dense.

    Parameters
    ----------
    a11, a12, a21, a22 : sparse arrays, shapes (n, n), (n, k), (k, n), (k, k)
        The blocks of the states x and of the algebraic unknowns v.
    b1, b2 : ndarrays, shapes (n, m) and (k, m)
        Where the inputs act.
    c : ndarray, shape (p, n)
        The outputs.
    state_names, input_names, output_names : tuple of str, optional
        Names of the n states, m inputs and p outputs.
    """

    a11: csc_array
    a12: csc_array
    a21: csc_array
    a22: csc_array
    b1: Matrix
    b2: Matrix
    c: Matrix
    state_names: tuple[str, ...] = ()
    input_names: tuple[str, ...] = ()
    output_names: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name in ("a11", "a12", "a21", "a22"):
            object.__setattr__(self, name, csc_array(getattr(self, name)))
        n, k = self.a12.shape
        expected = {
            "a11": (n, n),
            "a21": (k, n),
            "a22": (k, k),
            "b1": (n, self.m),
            "b2": (k, self.m),
            "c": (self.p, n),
        }
        for name, shape in expected.items():
            found = getattr(self, name).shape
            if found != shape:
                raise OptionError(f"block {name.upper()} has shape {found}, expected {shape}")

    @property
    def n(self) -> int:
        """Number of states."""
        return int(self.a11.shape[0])

    @property
    def m(self) -> int:
        """Number of inputs."""
        return int(self.b1.shape[1])

    @property
    def p(self) -> int:
        """Number of outputs."""
        return len(self.c)

    @property
    def b(self) -> Matrix:
        """B, shape (n, m)."""
        return np.asarray(self.b1 - self.a12 @ self._algebraic(self.b2))

    def apply(self, x: Matrix) -> Matrix:
        """A x for the columns of `x`, shape (n, j): shape (n, j)."""
        return np.asarray(self.a11 @ x - self.a12 @ self._algebraic(self.a21 @ x))

    def with_outputs(self, c: Matrix) -> DescriptorSystem:
        """The same with the outputs y = C x."""
        return replace(self, c=c)

    def with_input_weights(self, weights: Matrix) -> DescriptorSystem:
        """The same with the first k inputs u = L w, for `weights` L of shape (k, k)."""
        k = len(weights)
        b1, b2 = (np.hstack([b[:, :k] @ weights, b[:, k:]]) for b in (self.b1, self.b2))
        return replace(self, b1=b1, b2=b2)

    def algebraic_transposed(self, rhs: Matrix) -> Matrix:
        """A22^-T R for the columns of `rhs`, shape (k, j)."""
        return np.asarray(self._factors.solve(rhs, "T") if self.a22.shape[0] else rhs)

    @property
    def d(self) -> Matrix:
        """D = 0, shape (p, m)."""
        return np.zeros((self.p, self.m))

    @cached_property
    def radius(self) -> float:
        """Largest modulus of an eigenvalue of A in 1/s, to about a hundredth."""
        if self.n < _SMALL:
            return float(np.abs(np.linalg.eigvals(self.dense().a)).max(initial=0.0))
        operator = LinearOperator(
            (self.n, self.n), matvec=lambda x: self.apply(x.reshape(-1, 1))[:, 0], dtype=np.float64
        )
        start = np.random.default_rng(0).normal(size=self.n)
        try:
            found = eigs(operator, 1, v0=start, tol=_RADIUS_TOLERANCE, return_eigenvectors=False)
        except ArpackNoConvergence:
            raise OptionError("the largest eigenvalue of a linear system was not found") from None
        return float(np.abs(found).max())

    def at(self, s: complex) -> Resolvent:
        """The factored matrix s I - A, for many right-hand sides.

        The algebraic equations border it, so that its factors stay sparse. Their order is found
        once and serves all `s`.

        Raises
        ------
        OptionError
            If `s` is an eigenvalue of A.
        """
        matrix, unit, rows = self._ordered
        try:
            factors = splu(s * unit - matrix, permc_spec="NATURAL", **_FACTORS)
        except RuntimeError:
            raise OptionError(f"{s} is an eigenvalue of the system") from None
        return Resolvent(factors, rows)

    def transfer_once(self, s: float) -> Matrix:
        """C (s I - A)^-1 B at one real s in 1/s, (p, m), where no other will be asked for."""
        matrix = block_array([[self.a11, self.a12], [self.a21, self.a22]], format="csc")
        unit = diags_array((np.arange(matrix.shape[0]) < self.n).astype(float), format="csc")
        factors = splu(matrix - s * unit, permc_spec="MMD_AT_PLUS_A", **_FACTORS)
        solution = factors.solve(np.vstack([-self.b1, -self.b2]))
        return np.asarray(self.c @ solution[: self.n])

    @cached_property
    def _ordered(self) -> tuple[csc_array, csc_array, NDArray[np.int64]]:
        """The bordered A and what stands for I, rows and columns in an order of little fill-in.

        Minimum degree of the pattern of M + M^T is best for grids: devices and buses are small
        blocks near the diagonal. With them come the places of the states in that order.
        """
        matrix = block_array([[self.a11, self.a12], [self.a21, self.a22]], format="csc")
        unit = diags_array((np.arange(matrix.shape[0]) < self.n).astype(float), format="csc")
        away = matrix - 1j * max(self.radius, 1.0) * unit
        order = np.argsort(splu(away, permc_spec="MMD_AT_PLUS_A", **_FACTORS).perm_c)
        ordered, place = (csc_array(m[:, order].tocsr()[order]) for m in (matrix, unit))
        return ordered, place, np.argsort(order)[: self.n]

    def transfer(self, s: ArrayLike) -> NDArray[np.complex128]:
        """C (s I - A)^-1 B at the complex frequencies `s` in rad/s, shape (j,): shape (j, p, m)."""
        points = np.atleast_1d(np.asarray(s, dtype=np.complex128))
        b = self.b
        return np.array([self.c @ self.at(point).solve(b) for point in points])

    def dense(self) -> LinearSystem:
        """The same with its matrices formed."""
        return LinearSystem(
            self.apply(np.eye(self.n)), self.b, self.c,
            state_names=self.state_names, input_names=self.input_names,
            output_names=self.output_names,
        )  # fmt: skip

    @cached_property
    def _factors(self) -> SuperLU:
        return splu(self.a22)

    def _algebraic(self, rhs: Matrix) -> Matrix:
        if not self.a22.shape[0]:
            return rhs
        solution = np.empty(rhs.shape, order="F")
        for first in range(0, rhs.shape[1], _BLOCK):
            block = slice(first, first + _BLOCK)
            solution[:, block] = self._factors.solve(np.asarray(rhs[:, block]))
        return solution


@dataclass(frozen=True, eq=False)
class Resolvent:
    """Factors of s I - A, bordered by the algebraic equations; `rows` are those of the states."""

    factors: SuperLU
    rows: NDArray[np.int64]

    def solve(self, rhs: NDArray[Any]) -> NDArray[np.complex128]:
        """(s I - A)^-1 R for the columns of `rhs`, shape (n, j)."""
        return solve_rows(self.factors, self.rows, rhs)

    def solve_adjoint(self, rhs: NDArray[Any]) -> NDArray[np.complex128]:
        """(s I - A)^-H R for the columns of `rhs`, shape (n, j)."""
        return solve_rows(self.factors, self.rows, rhs, adjoint=True)
