"""A linear system in modal coordinates, for compiled loops."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gridfold.errors import OptionError
from gridfold.numerics.checked_arrays import require_shapes
from gridfold.numerics.compiled import FAST, compile_callback, jit
from gridfold.numerics.modal_form import ModalForm
from gridfold.numerics.rhs import RHS_SIGNATURE, CompiledRhs

#: Squared magnitude (1/s^2) below which an eigenvalue counts as 0.
_NO_MOTION = 1e-40
#: Times closer than this, in relation to the step, are the same.
_SAME_TIME = 1e-9


@dataclass(frozen=True, eq=False)
class ModalSystem:
    """w' = blockdiag(1x1 and 2x2) w + offset.

    Parameters
    ----------
    form : ModalForm
        The modes.
    offset : ndarray, shape (n,)
        Constant part of the derivative, in modal coordinates.
    """

    form: ModalForm
    offset: NDArray[np.float64]

    def __post_init__(self) -> None:
        require_shapes("a modal system", self, {"offset": (len(self.form.diagonal),)})

    @property
    def state_names(self) -> tuple[str, ...]:
        """``w:1``, ``w:2`` ..."""
        return tuple(f"w:{k + 1}" for k in range(len(self.offset)))

    @property
    def compiled(self) -> CompiledRhs:
        """The right-hand side."""
        n = len(self.offset)
        integers = np.concatenate([[n], self.form.partner]).astype(np.int64)
        reals = np.concatenate([self.form.diagonal, self.form.coupling, self.offset])
        return CompiledRhs(_compiled().address, integers, reals, 0, n)

    def states_after(
        self,
        start: NDArray[np.float64],
        elapsed: NDArray[np.float64],
        out: NDArray[np.float64] | None = None,
    ) -> NDArray[np.float64]:
        """States at the times `elapsed` (s), in ascending order, after the state `start`.

        Each mode is an exponential. It is carried over steps of equal length by one multiplication;
        the first time, and any that lies on no such step, is computed from `start`.

        Returns
        -------
        ndarray, shape (n_times, n)
            `out`, C-contiguous, where it is given.
        """
        shape, form = (len(elapsed), len(self.offset)), self.form
        states = np.empty(shape) if out is None else out
        if states.shape != shape or np.shape(start) != shape[1:]:
            raise OptionError(
                f"states of shape {states.shape} from {np.shape(start)}, expected {shape}"
            )
        _fill(
            form.diagonal, form.coupling, form.partner, self.offset,
            np.ascontiguousarray(start, dtype=np.float64), elapsed, _inner_step(elapsed), states,
        )  # fmt: skip
        return states

    def reach(
        self, start: NDArray[np.float64], span: float, rows: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Bounds of the quantities ``rows @ w`` within the time `span` (s) after the state `start`.

        Each mode is as large as it may become, and all add up.
        """
        form, n = self.form, len(self.offset)
        if np.shape(start) != (n,) or np.ndim(rows) != 2 or np.shape(rows)[1] != n:
            raise OptionError(f"rows of shape {np.shape(rows)} for {n} states")
        bounds = np.zeros(len(rows))
        with np.errstate(over="ignore"):
            size = np.abs(start) + np.abs(self.offset) * span
            size *= np.exp(np.maximum(form.diagonal, 0.0) * span)
        _bound(form.partner, size, np.ascontiguousarray(rows), bounds)
        return bounds


def _inner_step(elapsed: NDArray[np.float64]) -> float:
    """Length of the steps between the times, which may be shorter at both ends; 0 for too few."""
    return float(elapsed[-2] - elapsed[1]) / (len(elapsed) - 3) if len(elapsed) > 3 else 0.0


@jit(nogil=True, error_model="numpy", fastmath=FAST)
def _fill(diagonal, coupling, partner, offset, start, elapsed, step, states):
    """Solution from `start`: rows of `states` at the times `elapsed`, most of them `step` apart."""
    n = len(start)
    one_step, since_start = np.empty((3, n)), np.empty((3, n))
    _propagator(diagonal, coupling, partner, offset, step, one_step)
    anchor, count = 0.0, 0
    for row in range(len(elapsed)):
        count += 1
        late = elapsed[row] - (anchor + count * step)
        if row > 0 and abs(late) <= _SAME_TIME * step:
            _propagate(one_step, partner, states[row - 1], states[row])
        else:
            _propagator(diagonal, coupling, partner, offset, elapsed[row], since_start)
            _propagate(since_start, partner, start, states[row])
            anchor, count = elapsed[row], 0


@jit(nogil=True, error_model="numpy", fastmath=FAST)
def _propagate(propagator, partner, w, w_new):
    for i in range(len(w)):
        w_new[i] = propagator[0, i] * w[i] + propagator[1, i] * w[partner[i]] + propagator[2, i]


@jit(nogil=True, error_model="numpy", fastmath=FAST)
def _propagator(diagonal, coupling, partner, offset, t, propagator):
    """Factors of w_i and w_partner(i), and what the offset adds, in the time t.

    With z = (alpha + j beta) t: real and imaginary part of exp(z); the offset is multiplied by
    t (exp(z) - 1) / z, whose limit is t for an eigenvalue of 0.
    """
    for i in range(len(diagonal)):
        p = partner[i]
        if p < i:
            continue
        alpha, beta = diagonal[i], coupling[i]
        growth, cosine, sine = np.exp(alpha * t), np.cos(beta * t), np.sin(beta * t)
        # exp(z) - 1, without cancellation where z is small
        real = np.expm1(alpha * t) * cosine - 2 * np.sin(beta * t / 2) ** 2
        imaginary = growth * sine
        square = alpha**2 + beta**2
        own, other = t, 0.0
        if square > _NO_MOTION:
            own = (real * alpha + imaginary * beta) / square
            other = (imaginary * alpha - real * beta) / square
        propagator[0, i], propagator[0, p] = growth * cosine, growth * cosine
        propagator[1, i], propagator[1, p] = imaginary, -imaginary
        propagator[2, i] = own * offset[i] + other * offset[p]
        propagator[2, p] = own * offset[p] - other * offset[i]


@jit(nogil=True, error_model="numpy", fastmath=FAST)
def _bound(partner, size, rows, bounds):
    """Add up the modes: a pair turns, so that both its lengths count."""
    for i in range(len(size)):
        p = partner[i]
        if p == i:
            for k in range(len(bounds)):
                bounds[k] += abs(rows[k, i]) * size[i]
        elif p > i:
            both = np.sqrt(size[i] ** 2 + size[p] ** 2)
            for k in range(len(bounds)):
                bounds[k] += np.sqrt(rows[k, i] ** 2 + rows[k, p] ** 2) * both


def _modal_rhs(integers, reals, work, w, dw):
    n = integers[0]
    for i in range(n):
        dw[i] = reals[i] * w[i] + reals[n + i] * w[integers[1 + i]] + reals[2 * n + i]


@cache
def _compiled() -> Any:
    return compile_callback(_modal_rhs, RHS_SIGNATURE)
