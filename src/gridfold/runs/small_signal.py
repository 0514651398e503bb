"""Small-signal analysis: eigenvalues, damping ratios and participation factors.

Kundur, Power System Stability and Control, 1994, sections 12.2.2 to 12.2.5.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eig

from gridfold.cards import Card
from gridfold.dynamics.model import DetailedModel
from gridfold.dynamics.unit_limits import touched_held
from gridfold.numerics.blas import one_blas_thread


@dataclass(frozen=True, repr=False)
class SmallSignal(Card):
    """Modes of the linearized model, the rightmost first.

    Parameters
    ----------
    eigenvalues : ndarray of complex, shape (n,)
        In 1/s and rad/s.
    participation : ndarray, shape (n_states, n)
        Participation factors, magnitudes; the largest of each mode (column) is 1.
    state_names : tuple of str
        ``name:BUS:ID`` of each state.
    common_angle : ndarray of bool, shape (n,)
        True for the zero eigenvalue of the common angle.
    at_rest : ndarray of bool, shape (n,)
        True for the zero eigenvalues of states that nothing moves, such as an integral whose input is
        within its dead band, or a state that is held at a limit.
    """

    eigenvalues: NDArray[np.complex128]
    participation: NDArray[np.float64]
    state_names: tuple[str, ...]
    common_angle: NDArray[np.bool_]
    at_rest: NDArray[np.bool_]

    @property
    def zero(self) -> NDArray[np.bool_]:
        """Which eigenvalues are zero by nature, and say nothing of stability, shape (n,)."""
        return np.asarray(self.common_angle | self.at_rest)

    def _facts(self) -> dict[str, object]:
        swings = [k for k, value in enumerate(self.eigenvalues) if value.imag > 0]
        ratio, hertz = self.damping_ratio, self.frequency_hz
        least = min(swings, key=lambda k: ratio[k], default=None)
        rightmost = self.rightmost
        return {
            "modes": f"of {len(self.eigenvalues)} modes",
            "rightmost": "none" if rightmost is None else f"{rightmost:.4f} 1/s",
            "least damped": "none"
            if least is None
            else f"{100 * ratio[least]:.1f} % at {hertz[least]:.2f} Hz",
        }

    @property
    def damping_ratio(self) -> NDArray[np.float64]:
        """-real / magnitude of each eigenvalue, shape (n,); NaN for a zero eigenvalue."""
        size = np.abs(self.eigenvalues)
        with np.errstate(invalid="ignore", divide="ignore"):
            ratio = -self.eigenvalues.real / size
        return np.where(self.zero, np.nan, ratio)

    @property
    def frequency_hz(self) -> NDArray[np.float64]:
        """Frequency of each mode in Hz, shape (n,)."""
        return np.abs(self.eigenvalues.imag) / (2 * np.pi)

    @property
    def rightmost(self) -> complex | None:
        """The rightmost eigenvalue that is not zero by nature; None if there is none."""
        others = self.eigenvalues[~self.zero]
        return complex(others[0]) if len(others) else None

    def dominant_states(self, mode: int, count: int = 3) -> list[tuple[str, float]]:
        """The states with the largest participation in a mode, and their factors."""
        column = self.participation[:, mode]
        return [(self.state_names[k], float(column[k])) for k in np.argsort(-column)[:count]]


@one_blas_thread
def small_signal(model: DetailedModel, x: NDArray[np.float64] | None = None) -> SmallSignal:
    """Eigenvalues and participation factors at the state `x` (the equilibrium by default).

    What is just at a limit is held there.
    """
    at = model.x0 if x is None else x
    jacobian = touched_held(model, at, model.layout.source_units).jacobian(at)
    values, left, right = eig(jacobian, left=True, right=True)
    order = np.lexsort((-values.imag, -values.real))
    values, left, right = values[order], left[:, order], right[:, order]
    participation = np.abs(left.conj() * right)
    largest = participation.max(axis=0, initial=0.0)
    participation /= np.where(largest > 0, largest, 1.0)
    rest = _at_rest(jacobian, values)
    common = _common_angle(model, jacobian, values, rest)
    return SmallSignal(values, participation, model.state_names, common, rest)


def _at_rest(jacobian: NDArray[np.float64], values: NDArray[np.complex128]) -> NDArray[np.bool_]:
    """Mark as many of the smallest eigenvalues as there are states that nothing moves."""
    count = int(np.sum(~jacobian.any(axis=1)))
    marked = np.zeros(len(values), dtype=bool)
    marked[np.argsort(np.abs(values), kind="stable")[:count]] = True
    return marked


def _common_angle(
    model: DetailedModel,
    jacobian: NDArray[np.float64],
    values: NDArray[np.complex128],
    at_rest: NDArray[np.bool_],
) -> NDArray[np.bool_]:
    """Mark the eigenvalue nearest to zero of the others if turning all together changes nothing."""
    shift = np.zeros(model.n_states)
    shift[model.layout.angle_states()] = 1.0
    marked = np.zeros(len(values), dtype=bool)
    scale = np.abs(jacobian).max(initial=0.0)
    if len(values) and np.abs(jacobian @ shift).max() <= 1e-9 * scale:
        marked[np.argmin(np.where(at_rest, np.inf, np.abs(values)))] = True
    return marked
