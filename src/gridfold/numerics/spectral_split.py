"""Split a matrix into its unstable or marginal part and its stable rest.

An ordered real Schur form A = Q [[S11, S12], [0, S22]] Q^T puts the first part in front; the
solution X of the Sylvester equation S11 X - X S22 = -S12 takes the coupling away. The bases are not
changed otherwise, so that a defective part (two integrators in series) does no harm.

Source: G. H. Golub, C. F. Van Loan, "Matrix Computations", 4th ed., section 7.6.3.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from gridfold.errors import OptionError

#: An eigenvalue counts as stable if its real part is below minus this times the spectral radius.
STABILITY_MARGIN = 1e-6

Matrix = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class InvariantPart:
    """The restriction of a matrix A to one invariant subspace: x = lift w, w' = matrix w.

    Parameters
    ----------
    matrix : ndarray, shape (k, k)
        restrict A lift.
    lift : ndarray, shape (n, k)
        Basis of the subspace.
    restrict : ndarray, shape (k, n)
        Coordinates along this subspace and the other part's; restrict lift = I.
    """

    matrix: Matrix
    lift: Matrix
    restrict: Matrix

    @property
    def order(self) -> int:
        """Dimension k of the subspace."""
        return len(self.matrix)

    def states(self, z: Matrix) -> Matrix:
        """Full states, shape (n, ...), of coordinates `z`, shape (k, ...)."""
        return self.lift @ z

    def coordinates(self, x: Matrix) -> Matrix:
        """Coordinates, shape (k, ...), of full states `x`, shape (n, ...)."""
        return self.restrict @ x

    def rows(self, t: Matrix) -> Matrix:
        """What `t`, shape (r, k), does to coordinates, as done to full states: shape (r, n)."""
        return t @ self.restrict

    def outputs(self, c: Matrix) -> Matrix:
        """What `c`, shape (p, n), does to full states, as done to coordinates: shape (p, k)."""
        return c @ self.lift


def split_spectrum(
    a: Matrix, margin: float = STABILITY_MARGIN
) -> tuple[InvariantPart, InvariantPart]:
    """Split `a` into the part with eigenvalues in Re >= -margin * max|lambda|, and the rest.

    Parameters
    ----------
    a : ndarray, shape (n, n)
    margin : float
        Relative to the largest modulus of an eigenvalue.

    Returns
    -------
    unstable, stable : InvariantPart
        A part may be empty. If there is no unstable part, the stable one is `a` itself.

    Raises
    ------
    OptionError
        If eigenvalues at the limit cannot be told apart.
    """
    n = len(a)
    values = np.linalg.eigvals(a)
    limit = -margin * np.abs(values).max(initial=0.0)
    if not (values.real >= limit).any():
        return _nothing(n), InvariantPart(a, np.eye(n), np.eye(n))
    try:
        schur, basis, count = linalg.schur(a, sort=lambda re, im=0.0: np.real(re) >= limit)
    except np.linalg.LinAlgError as error:
        raise OptionError(
            f"eigenvalues near the limit of stability {limit:.3g} cannot be told apart ({error})"
        ) from error
    first, second = basis[:, :count], basis[:, count:]
    top, bottom = schur[:count, :count], schur[count:, count:]
    if count == n:
        return InvariantPart(top, first, first.T), _nothing(n)
    coupling = linalg.solve_sylvester(top, -bottom, -schur[:count, count:])
    unstable = InvariantPart(top, first, first.T - coupling @ second.T)
    return unstable, InvariantPart(bottom, second + first @ coupling, second.T)


def _nothing(n: int) -> InvariantPart:
    return InvariantPart(np.zeros((0, 0)), np.zeros((n, 0)), np.zeros((0, n)))
