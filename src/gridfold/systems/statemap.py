"""The way from full to reduced states and back."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gridfold.errors import OptionError

#: Largest entry of T T~ - I that is accepted.
INVERSE_TOLERANCE = 1e-8


@dataclass(frozen=True, eq=False)
class StateMap:
    """An affine map between n full states x and r reduced states z.

    x = x0 + T~ z and z = T (x - x0), where T T~ = I: what is lifted and then restricted comes back.
    Equations (7) to (9) of Osipov & Sun.

    Parameters
    ----------
    reference : ndarray, shape (n,)
        The state x0 that has z = 0.
    lift_matrix : ndarray, shape (n, r)
        T~.
    restrict_matrix : ndarray, shape (r, n)
        T.

    Raises
    ------
    OptionError
        If the shapes do not fit, or an entry of T T~ - I exceeds 1e-8.
    """

    reference: NDArray[np.float64]
    lift_matrix: NDArray[np.float64]
    restrict_matrix: NDArray[np.float64]

    def __post_init__(self) -> None:
        for name in ("reference", "lift_matrix", "restrict_matrix"):
            object.__setattr__(self, name, np.asarray(getattr(self, name), dtype=np.float64))
        if self.reference.ndim != 1 or self.lift_matrix.ndim != 2:
            raise OptionError("a state map needs a reference vector and a lift matrix")
        n, r = len(self.reference), self.lift_matrix.shape[1]
        for name, shape in (("lift_matrix", (n, r)), ("restrict_matrix", (r, n))):
            found = getattr(self, name).shape
            if found != shape:
                raise OptionError(f"{name} of a state map has shape {found}, expected {shape}")
        error = np.abs(self.restrict_matrix @ self.lift_matrix - np.eye(r)).max(initial=0.0)
        if not error <= INVERSE_TOLERANCE:
            raise OptionError(
                f"restricting a lifted state does not give it back: T T~ is off I by {error:.1e}"
            )

    @classmethod
    def identity(cls, reference: NDArray[np.float64]) -> StateMap:
        """The map that only shifts the origin to `reference`, shape (n,)."""
        return cls(reference, np.eye(len(reference)), np.eye(len(reference)))

    @property
    def order(self) -> int:
        """Number r of reduced states."""
        return int(self.lift_matrix.shape[1])

    def lift(self, z: NDArray[np.float64]) -> NDArray[np.float64]:
        """Full states x0 + T~ z of the reduced states `z`, shape (..., r): shape (..., n)."""
        lifted: NDArray[np.float64] = self.reference + z @ self.lift_matrix.T
        return lifted

    def lift_rows(self, z: NDArray[np.float64], index: NDArray[np.int64]) -> NDArray[np.float64]:
        """Only the full states at the positions `index` (m,): shape (..., m)."""
        lifted: NDArray[np.float64] = self.reference[index] + z @ self.lift_matrix[index].T
        return lifted

    def restrict(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Reduced states T (x - x0) of the full states `x`, shape (..., n): shape (..., r)."""
        restricted: NDArray[np.float64] = (x - self.reference) @ self.restrict_matrix.T
        return restricted
