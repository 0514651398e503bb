"""The error of an approximate solution of x' = f(x), carried along in a few linear modes.

With the approximation y(t) and the error e = x - y,

    e' = f(y + e) - y'

exactly. For e = S^T w in modes that come close to those of f, w' = L w, the rest is slow and small:

    w' = L w + g(t, w),   g = T (f(y + S^T w) - y') - L w

An exponential integrator solves it: the modes by their exponentials, g linear over each step, from
its value at the step's start and at the predicted end (Cox & Matthews, J. Comput. Phys. 176, 2002,
pp. 430-455, ETD2RK, with the predicted value kept for the next step). So e need not be small, and one
evaluation of f a step will do.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gridfold.errors import OptionError
from gridfold.numerics.compiled import FAST, invoke, jit
from gridfold.numerics.modal_form import ModalForm
from gridfold.numerics.rhs import CompiledRhs

#: |L h| below which the quotients of exponentials are taken from their series.
_SERIES = 1e-3


def carry_error(
    rhs: CompiledRhs,
    form: ModalForm,
    slopes: NDArray[np.float64],
    restrict: NDArray[np.float64],
    times: NDArray[np.float64],
    states: NDArray[np.float64],
    rates: NDArray[np.float64],
    start: NDArray[np.float64],
) -> NDArray[np.float64]:
    """The error along an approximate solution, in modal coordinates.

    Parameters
    ----------
    rhs : CompiledRhs
        f.
    form : ModalForm
        L.
    slopes, restrict : ndarray, shape (n_modes, n_states)
        S and T.
    times : ndarray, shape (n_times,)
        In seconds; one or two samples for each radian of the fastest error that matters.
    states, rates : ndarray, shape (n_times, n_states)
        y and y'.
    start : ndarray, shape (n_modes,)
        w at the first time.

    Returns
    -------
    ndarray, shape (n_times, n_modes)
        w.

    Raises
    ------
    OptionError
        An array has another shape.
    """
    n_modes, along = len(form.partner), (len(times), rhs.n_states)
    for name, array, shape in (
        ("slopes", slopes, (n_modes, rhs.n_states)), ("restrict", restrict, (n_modes, rhs.n_states)),
        ("states", states, along), ("rates", rates, along), ("start", start, (n_modes,)),
    ):  # fmt: skip
        if array.shape != shape:
            raise OptionError(f"{name} has shape {array.shape}, expected {shape}")
    errors = np.empty((len(times), n_modes))
    errors[0] = start
    _carry(
        rhs.address, rhs.integers, rhs.reals, np.zeros(rhs.work_size),
        form.eigenvalues, form.partner, *map(np.ascontiguousarray, (slopes, restrict)),
        np.diff(times), *map(np.ascontiguousarray, (states, rates)), errors,
    )  # fmt: skip
    return errors


@jit(nogil=True, error_model="numpy", fastmath=FAST)
def _carry(
    address, integers, reals, work, eigenvalues, partner, slopes, restrict, steps, states, rates, errors
):  # fmt: skip
    n_modes, n = slopes.shape
    x, dx = np.empty(n), np.empty(n)
    before, after, rate = np.empty(n_modes), np.empty(n_modes), np.empty(n_modes)
    factors = np.empty((3, n_modes), dtype=np.complex128)
    known = -1.0

    for row in range(states.shape[0]):
        if row > 0:
            h = steps[row - 1]
            if abs(h - known) > 1e-9 * h:
                _factors(eigenvalues, h, factors)
                known = h
            predicted = errors[row]
            _apply(factors[0], partner, errors[row - 1], predicted, False)
            _apply(factors[1], partner, before, predicted, True)
        np.dot(errors[row], slopes, x)
        for i in range(n):
            x[i] += states[row, i]
        invoke(address, (integers, reals, work, x, dx))
        for i in range(n):
            dx[i] -= rates[row, i]
        np.dot(restrict, dx, after)
        _apply(eigenvalues, partner, errors[row], rate, False)
        for i in range(n_modes):
            after[i] -= rate[i]
        if row > 0:
            for i in range(n_modes):
                rate[i] = after[i] - before[i]
            _apply(factors[2], partner, rate, errors[row], True)
        for i in range(n_modes):
            before[i] = after[i]


@jit(nogil=True, error_model="numpy", fastmath=FAST)
def _factors(eigenvalues, h, factors):
    """exp(z), h (exp(z) - 1) / z and h (exp(z) - 1 - z) / z^2 with z = L h, for each mode."""
    for i in range(len(eigenvalues)):
        z = eigenvalues[i] * h
        factors[0, i] = np.exp(z)
        if abs(z) < _SERIES:
            factors[1, i] = h * (1 + z / 2 * (1 + z / 3 * (1 + z / 4)))
            factors[2, i] = h / 2 * (1 + z / 3 * (1 + z / 4 * (1 + z / 5)))
        else:
            factors[1, i] = h * (factors[0, i] - 1) / z
            factors[2, i] = h * (factors[0, i] - 1 - z) / (z * z)


@jit(nogil=True, error_model="numpy", fastmath=FAST)
def _apply(factor, partner, w, result, add):
    """A function of L times w; the eigenvalue alpha + j beta of w_i couples it to its partner."""
    for i in range(len(w)):
        value = factor[i].real * w[i] + factor[i].imag * w[partner[i]]
        result[i] = result[i] + value if add else value
