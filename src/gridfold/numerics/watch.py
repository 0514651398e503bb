"""A watch on how far selected states move away from their group's mean."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from gridfold.numerics.compiled import FAST


@dataclass(frozen=True)
class SpreadWatch:
    """Stop when a watched state is further than `limit` from its group's reference.

    Parameters
    ----------
    index : ndarray of int, shape (n,)
        Positions of the watched entries in the state vector.
    group : ndarray of int, shape (n,)
        Group of each watched entry, counted from 0.
    weight : ndarray, shape (n,)
        Its weight in the mean of the group.
    reference : ndarray, shape (n_groups,)
        A fixed reference for the group, or NaN where the reference is the weighted mean.
    limit : float
        Largest distance allowed.
    """

    index: NDArray[np.int64]
    group: NDArray[np.int64]
    weight: NDArray[np.float64]
    reference: NDArray[np.float64]
    limit: float

    @classmethod
    def nothing(cls) -> SpreadWatch:
        """A watch that never fires."""
        none = np.zeros(0, dtype=np.int64)
        return cls(none, none, np.zeros(0), np.zeros(0), np.inf)

    def distances(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Distance of each watched entry from its group's reference, shape (n,)."""
        result = np.empty(len(self.index))
        spread(x, self.index, self.group, self.weight, self.reference, result)
        return result


@njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)
def spread(x, index, group, weight, reference, distances):
    """Fill `distances` and return their largest; NaN where a watched state is not finite."""
    n_groups = len(reference)
    mean = np.zeros(n_groups)
    total = np.zeros(n_groups)
    for k in range(len(index)):
        mean[group[k]] += weight[k] * x[index[k]]
        total[group[k]] += weight[k]
    for g in range(n_groups):
        if np.isnan(reference[g]):
            mean[g] /= total[g]
        else:
            mean[g] = reference[g]
    largest = 0.0
    for k in range(len(index)):
        distances[k] = abs(x[index[k]] - mean[group[k]])
        if not distances[k] <= largest:
            largest = distances[k]
    return largest
