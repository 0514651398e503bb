"""Links between modes of one rate, of which one drives the other: what a chain of equal lags has."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from gridfold.errors import OptionError
from gridfold.numerics.checked_arrays import require_positions, require_shapes


@dataclass(frozen=True, eq=False)
class ModeLinks:
    """The part N of w' = L w + N w: gains by which coordinates drive others of the same rate.

    Parameters
    ----------
    driven, driving : ndarray of int, shape (n_links,)
        Coordinates. None drives itself, nor in a circle.
    gains : ndarray, shape (n_links,)
        In 1/s.
    """

    driven: NDArray[np.int64]
    driving: NDArray[np.int64]
    gains: NDArray[np.float64]

    def __post_init__(self) -> None:
        shape = np.shape(self.gains)
        require_shapes("links of modes", self, {"driven": shape, "driving": shape})

    @classmethod
    def of(cls, matrix: NDArray[np.float64], weakest: float) -> ModeLinks:
        """Those of N, shape (n, n), that are `weakest` (1/s) or stronger."""
        driven, driving = np.nonzero(np.abs(matrix) >= weakest)
        return cls(driven, driving, np.ascontiguousarray(matrix[driven, driving]))

    def require_within(self, n: int) -> None:
        """Raise an OptionError unless they are between `n` coordinates, and in no circle."""
        require_positions("links of modes", np.concatenate([self.driven, self.driving]), n)
        if self.depth > n:
            raise OptionError("links of modes run in a circle")

    @property
    def depth(self) -> int:
        """Most links in a row: the power of N above which all are zero."""
        last = max(self.driven.max(initial=-1), self.driving.max(initial=-1)) + 1
        reached, depth = np.ones(last, dtype=np.bool_), 0
        while depth <= last and (ends := self.driven[reached[self.driving]]).size:
            reached = np.zeros(last, dtype=np.bool_)
            reached[ends] = True
            depth += 1
        return depth

    def drive(self, w: NDArray[np.float64]) -> NDArray[np.float64]:
        """N w, shape (..., n)."""
        n = w.shape[-1]
        links = sparse.csr_array((self.gains, (self.driven, self.driving)), shape=(n, n))
        return np.asarray((links @ w.reshape(-1, n).T).T.reshape(w.shape))

    def matrix(self, n: int) -> NDArray[np.float64]:
        """N, shape (n, n)."""
        result = np.zeros((n, n))
        result[self.driven, self.driving] = self.gains
        return result

    def sizes(self) -> ModeLinks:
        """The same with the sizes of the gains."""
        return ModeLinks(self.driven, self.driving, np.abs(self.gains))

    def only(self, kept: NDArray[np.bool_]) -> ModeLinks:
        """Those between coordinates that are `kept` (n,), at their places among these."""
        place, both = np.cumsum(kept) - 1, kept[self.driven] & kept[self.driving]
        return ModeLinks(place[self.driven[both]], place[self.driving[both]], self.gains[both])


#: Where all modes can be told apart.
NO_LINKS = ModeLinks(np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64), np.zeros(0))
