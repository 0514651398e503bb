"""Real block-diagonal form of a matrix: decoupled modes, cheap to step and to truncate."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gridfold.numerics.blas import one_blas_thread
from gridfold.numerics.checked_arrays import require_partners, require_shapes
from gridfold.numerics.mode_links import NO_LINKS, ModeLinks

#: Largest condition number of the eigenvector basis that is accepted.
CONDITION_LIMIT = 1e10
#: Largest relative residual of the form that is accepted.
RESIDUAL_LIMIT = 1e-8
#: Largest entry of V^-1 V - I that is accepted.
INVERSE_LIMIT = 1e-9


@dataclass(frozen=True, eq=False)
class ModalForm:
    """x' = A x in coordinates x = V w in which modes do not see each other.

    w_i' = diagonal_i w_i + coupling_i w_partner(i). A real eigenvalue is its own partner, with
    coupling zero. A complex pair alpha +- j beta occupies two neighbours, the first with coupling
    beta and the second with -beta. Modes of one rate may drive each other besides, by `links`.

    Parameters
    ----------
    basis : ndarray, shape (n, n)
        V.
    inverse : ndarray, shape (n, n)
        V^-1.
    diagonal : ndarray, shape (n,)
        Real parts of the eigenvalues.
    coupling : ndarray, shape (n,)
    partner : ndarray of int, shape (n,)
    links : ModeLinks
        None where modes can be told apart.
    """

    basis: NDArray[np.float64]
    inverse: NDArray[np.float64]
    diagonal: NDArray[np.float64]
    coupling: NDArray[np.float64]
    partner: NDArray[np.int64]
    links: ModeLinks = NO_LINKS

    def __post_init__(self) -> None:
        n = len(self.diagonal)
        square = {"basis": (n, n), "inverse": (n, n)}
        require_shapes("a modal form", self, {**square, "diagonal": (n,), "coupling": (n,)})
        require_partners("partners of a modal form", self.partner, n)
        self.links.require_within(n)

    @property
    def eigenvalues(self) -> NDArray[np.complex128]:
        """Eigenvalue of each coordinate, shape (n,); a pair has the positive imaginary part first."""
        return self.diagonal + 1j * self.coupling

    def derivative(self, w: NDArray[np.float64]) -> NDArray[np.float64]:
        """W' at the modal coordinates `w`, shape (..., n)."""
        rate: NDArray[np.float64] = self.diagonal * w + self.coupling * w[..., self.partner]
        return rate + self.links.drive(w)

    def matrix(self) -> NDArray[np.float64]:
        """The block-diagonal matrix V^-1 A V, shape (n, n)."""
        result = np.diag(self.diagonal)
        result[np.arange(len(result)), self.partner] += self.coupling
        return result + self.links.matrix(len(result))


@one_blas_thread
def modal_form(
    a: NDArray[np.float64],
    condition_limit: float = CONDITION_LIMIT,
    residual_limit: float = RESIDUAL_LIMIT,
) -> ModalForm | None:
    """Real block-diagonal form of `a`, or None where it is numerically worthless.

    Parameters
    ----------
    a : ndarray, shape (n, n)
    condition_limit : float
        Largest condition number of V (2-norm). A defective matrix has none.
    residual_limit : float
        Largest |V M V^-1 - A| / |A| (Frobenius norms), with M the block-diagonal matrix.

    Returns
    -------
    ModalForm or None
        None if V is too ill-conditioned, its inverse too inexact or the residual too large: the
        caller goes on with the dense matrix.
    """
    n = len(a)
    values, vectors = np.linalg.eig(a)
    first = np.flatnonzero(values.imag > 0)
    partner = np.arange(n)
    partner[first], partner[first + 1] = first + 1, first
    # Of all phases of a complex eigenvector, take that with orthogonal real and imaginary parts.
    phase = np.exp(-0.5j * np.angle(np.einsum("ij,ij->j", vectors, vectors)))
    basis = np.where(values.imag == 0, vectors, vectors * phase).real
    basis[:, first + 1] = (vectors * phase).imag[:, first]
    if n and not np.linalg.cond(basis) <= condition_limit:
        return None
    inverse = np.linalg.inv(basis)
    inverse = 2 * inverse - inverse @ basis @ inverse  # a step of Newton's method: less rounding
    form = ModalForm(basis, inverse, values.real.copy(), values.imag.copy(), partner)
    return form if is_exact(form, a, residual_limit) else None


def is_exact(
    form: ModalForm, a: NDArray[np.float64], residual_limit: float = RESIDUAL_LIMIT
) -> bool:
    """Whether a form of `a`, shape (n, n), gives it back, and its inverse is one."""
    basis, inverse = form.basis, form.inverse
    if not np.abs(inverse @ basis - np.eye(len(a))).max(initial=0.0) <= INVERSE_LIMIT:
        return False
    residual = np.linalg.norm(basis @ form.matrix() @ inverse - a)
    return bool(residual <= residual_limit * np.linalg.norm(a))
