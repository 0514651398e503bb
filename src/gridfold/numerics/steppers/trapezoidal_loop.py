"""The compiled loop of the implicit trapezoidal rule: extrapolate, iterate, note what comes up."""

from __future__ import annotations

from enum import IntEnum

import numpy as np

from gridfold.numerics.compiled import FAST, invoke, jit
from gridfold.numerics.watch import first_watch

#: Largest error of the iteration in a state, relative to its size or 1.
TOLERANCE = 1e-8
#: Iterations of a step, and the rate of convergence from which they are given up.
ITERATIONS, _DIVERGED = 10, 0.9
#: Iterations of a step that are taken for granted; so many more in all are worth a new Jacobian.
_USUAL, _PATIENCE = 2, 60
#: Largest correction that may be a step's only one, on trust in the rate of the steps before, and what
#: becomes of that rate, which counts for less with every step (Hairer & Wanner, section IV.8).
_TRUSTED, _AGEING = 1e-6, 0.8
#: A correction in a state from which an iteration is given up.
FAR = 1e6


class Outcome(IntEnum):
    """Why the compiled loop came back."""

    END = 0
    FIRED = 1
    NEW_STEP_SIZE = 2
    SLOW = 3
    FAILED = 4


@jit(nogil=True, error_model="numpy", fastmath=FAST)
def _extrapolate(times, states, step, x_new):
    """A polynomial through up to three equidistant states; returns how many there were."""
    h, n = times[step + 1] - times[step], states.shape[1]
    known = 1
    while known < 3 and step >= known:
        if abs(times[step - known + 1] - times[step - known] - h) > 1e-6 * h:
            break
        known += 1
    for i in range(n):
        x_new[i] = states[step, i]
        if known == 2:
            x_new[i] = 2 * states[step, i] - states[step - 1, i]
        if known == 3:
            x_new[i] = 3 * (states[step, i] - states[step - 1, i]) + states[step - 2, i]
    return known


@jit(nogil=True, error_model="numpy", fastmath=FAST)
def _solve_step(
    address, integers, reals, work, s_address, s_integers, s_reals, scratch,
    x, f, h, x_new, f_new, residual, correction, known_rate,
):  # fmt: skip
    """Newton's iteration from x_new; returns (iterations, slowest rate or -1 where not known).

    No iterations mean that it does not converge; x_new is then where it was given up.
    """
    n = len(x)
    before, slowest = -1.0, -1.0
    for iteration in range(1, ITERATIONS + 1):
        invoke(address, (integers, reals, work, x_new, f_new))
        for i in range(n):
            residual[i] = x[i] + 0.5 * h * (f[i] + f_new[i]) - x_new[i]
        invoke(s_address, (s_integers, s_reals, residual, correction, scratch))
        size = 0.0
        for i in range(n):
            if not abs(correction[i]) < FAR:
                return 0, -1.0
            size = max(size, abs(correction[i]) / max(1.0, abs(x[i])))
        rate = known_rate if size <= _TRUSTED else -1.0
        if before > 0:
            rate = size / before
            slowest = max(slowest, rate)
        if rate >= _DIVERGED and before > 0 and size > TOLERANCE:
            return 0, -1.0
        for i in range(n):
            x_new[i] += correction[i]
        if size <= 0.01 * TOLERANCE or (0 <= rate < 1 and rate / (1 - rate) * size <= TOLERANCE):
            return iteration, slowest
        before = size
    return 0, -1.0


@jit(nogil=True, error_model="numpy", fastmath=FAST)
def one_step(
    address, integers, reals, work, s_address, s_integers, s_reals, scratch, x, h, x_new
):  # fmt: skip
    """Newton's iteration from x_new; returns whether it converged."""
    n = len(x)
    f, f_new, residual, correction = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    invoke(address, (integers, reals, work, x, f))
    count, _ = _solve_step(
        address, integers, reals, work, s_address, s_integers, s_reals, scratch,
        x, f, h, x_new, f_new, residual, correction, -1.0,
    )  # fmt: skip
    return count > 0


@jit(nogil=True, error_model="numpy", fastmath=FAST)
def _local_error(guess, x_new):
    """Largest error of a step: the third difference is the error of the guess, 13 times that."""
    worst = 0.0
    for i in range(len(guess)):
        worst = max(worst, abs(x_new[i] - guess[i]) / max(1.0, abs(x_new[i])) / 13)
    return worst


@jit(nogil=True, error_model="numpy", fastmath=FAST)
def _derivative_behind(f_new, correction, residual, h, f):
    """The derivative behind the last correction c: f + J c, where (I - h/2 J) c is the residual."""
    for i in range(len(f)):
        f[i] = f_new[i] + (correction[i] - residual[i]) * 2 / h


@jit(nogil=True, error_model="numpy", fastmath=FAST)
def run_steps(
    address, after, integers, reals, work, s_address, s_integers, s_reals, scratch, h_solver,
    times, states, first, table, w_integers, w_reals,
):  # fmt: skip
    """Steps from `first` on until something comes up.

    Returns (steps done, why, watch fired, largest local error).
    """
    n = states.shape[1]
    f, f_new, residual, correction = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    guess, verdict, worst = np.empty(n), np.zeros(1), 0.0
    rate, excess = -1.0, 0
    invoke(address, (integers, reals, work, states[first], f))
    for step in range(first, len(times) - 1):
        x, x_new = states[step], states[step + 1]
        h = times[step + 1] - times[step]
        if abs(h - h_solver) > 1e-6 * h_solver:
            return step, 2, 0, worst
        known = _extrapolate(times, states, step, guess)
        for i in range(n):
            x_new[i] = guess[i]
        count, slowest = _solve_step(
            address, integers, reals, work, s_address, s_integers, s_reals, scratch,
            x, f, h, x_new, f_new, residual, correction, rate,
        )  # fmt: skip
        if count == 0:
            return step, 4, 0, worst
        if slowest >= 0:
            rate = max(slowest, 1e-16)
        elif rate > 0:
            rate = rate**_AGEING
        excess += max(count - _USUAL, 0)
        if known == 3:
            worst = max(worst, _local_error(guess, x_new))
        if after:
            invoke(after, (integers, reals, work, x_new, f_new))
            invoke(address, (integers, reals, work, x_new, f))
        else:
            _derivative_behind(f_new, correction, residual, h, f)
        fired = first_watch(table, w_integers, w_reals, x_new, verdict)
        if fired:
            return step + 1, 1, fired, worst
        if excess > _PATIENCE:
            return step + 1, 3, 0, worst
    return len(times) - 1, 0, 0, worst
