"""Modes in which the error of an approximate solution travels, and how the solution meets them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gridfold.numerics.checked_arrays import require_positions, require_shapes
from gridfold.numerics.modal_form import ModalForm


@dataclass(frozen=True, eq=False)
class Modes:
    """Modes in which errors travel: e = S^T w, over coordinates v that are states or few linear ones.

    Parameters
    ----------
    form : ModalForm
        L of the modes.
    into, back : ndarray, shape (n, n_modes) and (n_modes, n)
        v = into w and w = back v.
    places : ndarray of int, shape (n_exact,)
        States that the first of v are.
    slopes, restrict : ndarray, shape (n - n_exact, n_states)
        From the rest of v to the states, and from these to it.
    """

    form: ModalForm
    into: NDArray[np.float64]
    back: NDArray[np.float64]
    places: NDArray[np.int64]
    slopes: NDArray[np.float64]
    restrict: NDArray[np.float64]

    def __post_init__(self) -> None:
        n_modes, n_states = len(self.form.partner), self.slopes.shape[1]
        n_linear = len(self.slopes)
        n = len(self.places) + n_linear
        shapes = {"into": (n, n_modes), "back": (n_modes, n), "restrict": (n_linear, n_states)}
        require_shapes("modes of an error", self, shapes)
        require_positions("places of an error", self.places, n_states)

    def only(self, kept: NDArray[np.bool_]) -> Modes:
        """Some of the modes (n_modes,), pairs as a whole."""
        form, place, same = self.form, np.cumsum(kept) - 1, np.eye(int(kept.sum()))
        partner = place[form.partner[kept]]
        links = form.links.only(kept)
        part = ModalForm(same, same, form.diagonal[kept], form.coupling[kept], partner, links)
        return replace(self, form=part, into=self.into[:, kept], back=self.back[kept])

    def lift(self, w: NDArray[np.float64]) -> NDArray[np.float64]:
        """Errors of the states, shape (..., n_states), from the modes, (..., n_modes)."""
        v, k = w @ self.into.T, len(self.places)
        e = v[..., k:] @ self.slopes
        e[..., self.places] += v[..., :k]
        return np.asarray(e)

    def project(self, e: NDArray[np.float64]) -> NDArray[np.float64]:
        """The modes, shape (n_modes, ...), from errors of the states, shape (n_states, ...)."""
        return np.asarray(self.back @ np.concatenate([e[self.places], self.restrict @ e]))

    def rows(self, index: NDArray[np.int64]) -> NDArray[np.float64]:
        """Errors of the states at the positions `index` (m,) by mode, shape (m, n_modes)."""
        k = len(self.places)
        exact = np.asarray(index[:, np.newaxis] == self.places, dtype=np.float64)
        return np.asarray(exact @ self.into[:k] + self.slopes[:, index].T @ self.into[k:])


@dataclass(frozen=True, eq=False)
class Way:
    """How an approximate solution y = origin + slopes^T z of a smaller system meets the modes.

    Parameters
    ----------
    origin : ndarray, shape (n_states,)
    exact, places : ndarray of int, shape (n_exact,)
        Entries of z that are states themselves, and which.
    linear : ndarray of int, shape (n_linear,)
        The other entries of z.
    lift : ndarray, shape (m + n_linear, n_states)
        From the m linear coordinates of the modes and the linear entries of z to y + e.
    pull : ndarray, shape (n_modes, n)
        From z' to T y'.
    """

    origin: NDArray[np.float64]
    exact: NDArray[np.int64]
    places: NDArray[np.int64]
    linear: NDArray[np.int64]
    lift: NDArray[np.float64]
    pull: NDArray[np.float64]

    @classmethod
    def between(cls, modes: Modes, origin: NDArray[np.float64], slopes: NDArray[np.float64]) -> Way:
        """From the slopes, shape (n, n_states)."""
        itself = (np.count_nonzero(slopes, axis=1) == 1) & (slopes.max(axis=1, initial=0.0) == 1)
        exact, linear = np.flatnonzero(itself), np.flatnonzero(~itself)
        lift = np.concatenate([modes.slopes, slopes[linear]])
        places = slopes[exact].argmax(axis=1)
        return cls(origin, exact, places, linear, lift, modes.project(slopes.T))

    @classmethod
    def itself(cls, modes: Modes) -> Way:
        """Where the solution's system has the states of the whole."""
        n, none = modes.slopes.shape[1], np.zeros(0, dtype=np.int64)
        every = np.arange(n)
        return cls(np.zeros(n), every, every, none, modes.slopes, modes.project(np.eye(n)))
