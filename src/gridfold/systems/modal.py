"""A linear system in modal coordinates, for compiled loops."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gridfold.errors import OptionError
from gridfold.numerics.checked_arrays import require_shapes
from gridfold.numerics.compiled import FAST, compile_callback, jit
from gridfold.numerics.modal_form import ModalForm
from gridfold.numerics.mode_links import ModeLinks
from gridfold.numerics.rhs import RHS_SIGNATURE, CompiledRhs

#: |lambda t| below which what an offset adds is taken from its series, and the terms of that.
_SERIES, _TERMS = 1.0, 20
#: Squared magnitude (1/s^2) below which an eigenvalue counts as 0.
_NO_MOTION = 1e-40
#: Times closer than this, in relation to the step, are the same.
_SAME_TIME = 1e-9


@dataclass(frozen=True, eq=False)
class ModalSystem:
    """w' = L w + N w + offset, with modes L and the links N between some of them.

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
        n, form, links = len(self.offset), self.form, self.form.links
        integers = np.concatenate(
            [[n, len(links.gains)], form.partner, links.driven, links.driving]
        ).astype(np.int64)
        reals = np.concatenate([form.diagonal, form.coupling, self.offset, links.gains])
        return CompiledRhs(_compiled().address, integers, reals, 0, n)

    @cached_property
    def _offsets(self) -> NDArray[np.float64]:
        """N^k offset for k = 0, 1 ... up to the depth of the links, one a row."""
        rows, links = [self.offset], self.form.links
        for _ in range(links.depth):
            rows.append(links.drive(rows[-1]))
        return np.array(rows)

    def states_after(
        self,
        start: NDArray[np.float64],
        elapsed: NDArray[np.float64],
        out: NDArray[np.float64] | None = None,
    ) -> NDArray[np.float64]:
        """States at the times `elapsed` (s), in ascending order, after the state `start`.

        Each mode is an exponential, times a polynomial where it is linked. It is carried over steps of
        equal length by one multiplication; the first time, and any that lies on no such step, is
        computed from `start`.

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
        links = form.links.driven, form.links.driving, form.links.gains
        _fill(
            form.eigenvalues, form.partner, links, self._offsets,
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
            if form.links.gains.size:
                size = _summed(size, span, form.links.sizes())
            size *= np.exp(np.maximum(form.diagonal, 0.0) * span)
        _bound(form.partner, size, np.ascontiguousarray(rows), bounds)
        return bounds


def _inner_step(elapsed: NDArray[np.float64]) -> float:
    """Length of the steps between the times, which may be shorter at both ends; 0 for too few."""
    return float(elapsed[-2] - elapsed[1]) / (len(elapsed) - 3) if len(elapsed) > 3 else 0.0


def _summed(w: NDArray[np.float64], t: float, links: ModeLinks) -> NDArray[np.float64]:
    """Exp(N t) w."""
    term, result = w, w
    for k in range(links.depth):
        term = links.drive(term) * (t / (k + 1))
        result = result + term
    return result


@jit(nogil=True, error_model="numpy", fastmath=FAST)
def _fill(eigenvalues, partner, links, offsets, start, elapsed, step, states):
    """Solution from `start`: rows of `states` at the times `elapsed`, most of them `step` apart."""
    n = len(start)
    one_step, since_start, space = np.empty((3, n)), np.empty((3, n)), np.empty((3, n))
    _propagator(eigenvalues, partner, offsets, step, one_step)
    anchor, count = 0.0, 0
    for row in range(len(elapsed)):
        count += 1
        late = elapsed[row] - (anchor + count * step)
        if row > 0 and abs(late) <= _SAME_TIME * step:
            linked = _follow(links, len(offsets) - 1, step, states[row - 1], space)
            _propagate(one_step, partner, linked, states[row])
        else:
            _propagator(eigenvalues, partner, offsets, elapsed[row], since_start)
            linked = _follow(links, len(offsets) - 1, elapsed[row], start, space)
            _propagate(since_start, partner, linked, states[row])
            anchor, count = elapsed[row], 0


@jit(nogil=True, error_model="numpy", fastmath=FAST)
def _follow(links, depth, t, w, space):
    """Exp(N t) w, in `space` (3, n) where there are links."""
    if depth == 0:
        return w
    driven, driving, gains = links
    before, now = 1, 2
    space[0] = space[before] = w
    for k in range(depth):
        space[now] = 0.0
        for i in range(len(gains)):
            space[now, driven[i]] += gains[i] * t / (k + 1) * space[before, driving[i]]
        space[0] += space[now]
        before, now = now, before
    return space[0]


@jit(nogil=True, error_model="numpy", fastmath=FAST)
def _propagate(propagator, partner, w, w_new):
    for i in range(len(w)):
        w_new[i] = propagator[0, i] * w[i] + propagator[1, i] * w[partner[i]] + propagator[2, i]


@jit(nogil=True, error_model="numpy", fastmath=FAST)
def _propagator(eigenvalues, partner, offsets, t, propagator):
    """Factors of w_i and w_partner(i), and what the offset adds, in the time t."""
    for i in range(len(eigenvalues)):
        p = partner[i]
        if p < i:
            continue
        rate = eigenvalues[i]
        decay, ramp = _once(rate, t)
        own, other = 0.0, 0.0
        for k in range(len(offsets)):
            if k > 0:
                ramp = _ramp(rate, t, decay, k, ramp)
            own += ramp.real * offsets[k, i] + ramp.imag * offsets[k, p]
            other += ramp.real * offsets[k, p] - ramp.imag * offsets[k, i]
        propagator[0, p], propagator[1, p], propagator[2, p] = decay.real, -decay.imag, other
        propagator[0, i], propagator[1, i], propagator[2, i] = decay.real, decay.imag, own


@jit(nogil=True, error_model="numpy", fastmath=FAST)
def _once(rate, t):
    """Exp(z) and t (exp(z) - 1) / z for z = rate t; the latter is t where the rate is 0."""
    alpha, beta = rate.real, rate.imag
    growth, cosine, sine = np.exp(alpha * t), np.cos(beta * t), np.sin(beta * t)
    # exp(z) - 1, without cancellation where z is small
    real = np.expm1(alpha * t) * cosine - 2 * np.sin(beta * t / 2) ** 2
    imaginary = growth * sine
    square = alpha**2 + beta**2
    ramp = complex(t, 0.0)
    if square > _NO_MOTION:
        own = (real * alpha + imaginary * beta) / square
        ramp = complex(own, (imaginary * alpha - real * beta) / square)
    return complex(growth * cosine, imaginary), ramp


@jit(nogil=True, error_model="numpy", fastmath=FAST)
def _ramp(rate, t, decay, k, before):
    """Integral of exp(rate s) s^k / k! from 0 to t; `decay` is exp(rate t), `before` that of k - 1."""
    z = rate * t
    power = 1.0
    for m in range(k):
        power *= t / (m + 1)
    if abs(z) >= _SERIES:
        return (power * decay - before) / rate
    term, total = 1.0 + 0j, 0j
    for m in range(_TERMS):
        total += term / (m + k + 1)
        term *= z / (m + 1)
    return power * t * total


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
    n, n_links = integers[0], integers[1]
    for i in range(n):
        dw[i] = reals[i] * w[i] + reals[n + i] * w[integers[2 + i]] + reals[2 * n + i]
    for i in range(n_links):
        driven, driving = integers[2 + n + i], integers[2 + n + n_links + i]
        dw[driven] += reals[3 * n + i] * w[driving]


@cache
def _compiled() -> Any:
    return compile_callback(_modal_rhs, RHS_SIGNATURE)
