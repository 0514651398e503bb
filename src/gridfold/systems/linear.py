"""Linear time-invariant systems x' = A x + B u, y = C x + D u."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gridfold.errors import OptionError
from gridfold.numerics.schur import complex_schur

Matrix = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class LinearSystem:
    """A linear system x' = A x + B u, y = C x + D u in deviations from an equilibrium.

    Equation (3) of Osipov & Sun, with a feed-through D. States, inputs and outputs have the units
    of whatever was linearized; time is in seconds.

    Parameters
    ----------
    a : ndarray, shape (n, n)
    b : ndarray, shape (n, m)
    c : ndarray, shape (p, n)
    d : ndarray, shape (p, m), optional
        Zero if left out.
    state_names, input_names, output_names : tuple of str, optional
        Names of the n states, m inputs and p outputs; empty where there are none.

    Raises
    ------
    OptionError
        If the shapes do not fit each other, or an entry is not finite.
    """

    a: Matrix
    b: Matrix
    c: Matrix
    d: Matrix = field(default_factory=lambda: np.zeros((0, 0)))
    state_names: tuple[str, ...] = ()
    input_names: tuple[str, ...] = ()
    output_names: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name in ("a", "b", "c", "d"):
            object.__setattr__(self, name, np.asarray(getattr(self, name), dtype=np.float64))
        if any(matrix.ndim != 2 for matrix in (self.a, self.b, self.c, self.d)):
            raise OptionError("A, B, C and D of a linear system must be matrices")
        if self.d.size == 0:
            object.__setattr__(self, "d", np.zeros((self.p, self.m)))
        self._check_shapes()
        for name in ("a", "b", "c", "d"):
            if not np.isfinite(getattr(self, name)).all():
                raise OptionError(f"matrix {name.upper()} of a linear system is not finite")

    def _check_shapes(self) -> None:
        expected = {
            "a": (self.n, self.n),
            "b": (self.n, self.m),
            "c": (self.p, self.n),
            "d": (self.p, self.m),
        }
        for name, shape in expected.items():
            found = getattr(self, name).shape
            if found != shape:
                raise OptionError(f"matrix {name.upper()} has shape {found}, expected {shape}")
        counts = {"state": self.n, "input": self.m, "output": self.p}
        for kind, count in counts.items():
            names = getattr(self, f"{kind}_names")
            if names and len(names) != count:
                raise OptionError(f"{len(names)} {kind} names for {count} {kind}s")

    @property
    def n(self) -> int:
        """Number of states."""
        return len(self.a)

    @property
    def m(self) -> int:
        """Number of inputs."""
        return int(self.b.shape[1])

    @property
    def p(self) -> int:
        """Number of outputs."""
        return len(self.c)

    @property
    def poles(self) -> NDArray[np.complex128]:
        """Eigenvalues of A in 1/s, shape (n,), the rightmost first."""
        values = np.linalg.eigvals(self.a).astype(np.complex128)
        return values[np.lexsort((-values.imag, -values.real))]

    @property
    def dc_gain(self) -> Matrix:
        """Steady outputs for constant unit inputs, D - C A^-1 B, shape (p, m).

        Raises
        ------
        OptionError
            If A is singular: a pole at zero has no steady state.
        """
        try:
            return self.d - self.c @ np.linalg.solve(self.a, self.b)
        except np.linalg.LinAlgError:
            raise OptionError("a linear system with a pole at zero has no DC gain") from None

    def transfer(self, s: ArrayLike) -> NDArray[np.complex128]:
        """Transfer function C (s I - A)^-1 B + D.

        One complex Schur form serves all frequencies; the triangular systems of all of them are
        solved together.

        Parameters
        ----------
        s : array_like of complex, shape (k,)
            Complex frequencies in rad/s. At a pole the result is not finite.

        Returns
        -------
        ndarray of complex, shape (k, p, m)
        """
        points = np.atleast_1d(np.asarray(s, dtype=np.complex128))
        if self.n == 0:
            return np.tile(self.d.astype(np.complex128), (len(points), 1, 1))
        triangle, basis = complex_schur(self.a)
        right = basis.conj().T @ self.b
        solution = np.zeros((self.n, len(points) * self.m), dtype=np.complex128)
        with np.errstate(divide="ignore", invalid="ignore"):
            for i in reversed(range(self.n)):
                row = (triangle[i, i + 1 :] @ solution[i + 1 :]).reshape(len(points), self.m)
                row = (row + right[i]) / (points - triangle[i, i])[:, None]
                solution[i] = row.ravel()
            outputs = (self.c @ basis) @ solution
        response = outputs.reshape(self.p, len(points), self.m).transpose(1, 0, 2)
        return np.ascontiguousarray(response + self.d)
