"""The implicit trapezoidal rule, for systems with time constants far below the time step.

x_new = x + h/2 (f(x) + f(x_new)), solved by Newton's method with a Jacobian that is kept as long as the
iteration converges. A-stable, of order 2. Hairer & Wanner, Solving Ordinary Differential Equations II,
2nd ed., sections IV.3 and IV.8 (the iteration and when to stop it).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numba import njit
from numpy.typing import NDArray

from gridfold.errors import OptionError
from gridfold.numerics.compiled import FAST, invoke
from gridfold.numerics.implicit import CompiledSolver, dense_solver, numerical_jacobian
from gridfold.numerics.rhs import CompiledRhs
from gridfold.numerics.steppers.base import Integration, check_step
from gridfold.numerics.watch import Watch, first_watch, pack_watches

#: Largest error of the iteration in a state, relative to its size or 1.
_TOLERANCE = 1e-8
#: Iterations of a step, and the rate of convergence from which a new Jacobian is worth its price.
_ITERATIONS, _SLOW = 10, 0.3
#: Steps between two new Jacobians for the sake of speed.
_PATIENCE = 5
#: A step that does not converge is halved up to this many times.
_HALVINGS = 10


class _Outcome(IntEnum):
    """Why the compiled loop came back."""

    END = 0
    FIRED = 1
    NEW_STEP_SIZE = 2
    SLOW = 3
    FAILED = 4


@dataclass(frozen=True)
class ImplicitTrapezoidal:
    """Implicit trapezoidal rule with a fixed step (s).

    Parameters
    ----------
    step : float
        Time step in seconds, and distance of the samples.
    tolerance : float, optional
        Largest local error of a step in a state, relative to its size or 1; a step with a larger one
        is divided. None (default): every step that can be solved is taken.
    """

    step: float = 0.01
    tolerance: float | None = None
    name: str = "trapezoidal"

    def __post_init__(self) -> None:
        check_step(self.step)
        if self.tolerance is not None and not 0 < self.tolerance < 1:
            raise OptionError(
                f"the tolerance of a time step must lie between 0 and 1, not {self.tolerance!r}"
            )

    def integrate(
        self,
        rhs: CompiledRhs,
        times: NDArray[np.float64],
        x0: NDArray[np.float64],
        watches: Sequence[Watch] = (),
    ) -> Integration:
        """Integrate from `x0` along `times`."""
        return _Run(rhs, watches, self.tolerance).along(times, x0)


class _Run:
    """One integration: the solver in use, and what to do when the compiled loop comes back."""

    def __init__(self, rhs: CompiledRhs, watches: Sequence[Watch], tolerance: float | None):
        self.rhs, self.watches = rhs, watches
        self.packed = pack_watches(watches)
        self.tolerance = np.inf if tolerance is None else tolerance
        self.work = np.zeros(rhs.work_size)
        self.solver: CompiledSolver | None = None
        self.made: tuple[bytes, float] = (b"", 0.0)

    def along(self, times: NDArray[np.float64], x0: NDArray[np.float64]) -> Integration:
        """All steps; each obstacle that the loop reports is removed, or the step divided."""
        states = np.full((len(times), self.rhs.n_states), np.nan)
        states[0] = x0
        step, last = 0, len(times) - 1
        while step < last:
            step, outcome, fired = self._loop(times, states, step, self.tolerance)
            if outcome == _Outcome.FIRED:
                return Integration(states[: step + 1], fired)
            if outcome == _Outcome.FAILED and not self._renew(times, states, step):
                states[step + 1] = self._divided(times[step : step + 2], states[step])
                step += 1
                if not np.isfinite(states[step]).all():
                    return Integration(states[: step + 1], 0)
                fired = self._fired(states[step])
                if fired:
                    return Integration(states[: step + 1], fired)
            elif outcome in (_Outcome.NEW_STEP_SIZE, _Outcome.SLOW):
                self._renew(times, states, step)
        return Integration(states, 0)

    def _loop(
        self, times: NDArray[np.float64], states: NDArray[np.float64], step: int, tolerance: float
    ) -> tuple[int, int, int]:
        if self.solver is None:
            self._renew(times, states, step)
        assert self.solver is not None
        rhs, solver = self.rhs, self.solver
        step, outcome, fired = _steps(
            rhs.address, rhs.after_step, rhs.integers, rhs.reals, self.work,
            solver.address, solver.integers, solver.reals, np.zeros(solver.scratch_size),
            self.made[1], times, states, step, tolerance, *self.packed,
        )  # fmt: skip
        return int(step), int(outcome), int(fired)

    def _renew(self, times: NDArray[np.float64], states: NDArray[np.float64], step: int) -> bool:
        """Make the solver for the state and size of a step; False if it is that already."""
        if step >= len(times) - 1:
            return True
        x, h = states[step], float(times[step + 1] - times[step])
        if self.made == (x.tobytes(), h):
            return False
        if self.rhs.solver is not None:
            self.solver = self.rhs.solver(x, h / 2)
        else:
            self.solver = dense_solver(numerical_jacobian(self.rhs, x), h / 2)
        self.made = (x.tobytes(), h)
        return True

    def _divided(self, ends: NDArray[np.float64], x: NDArray[np.float64]) -> NDArray[np.float64]:
        """The state after one step in ever more parts, until it can be solved and is accurate."""
        before = None
        for halving in range(_HALVINGS):
            parts = np.linspace(ends[0], ends[1], 2**halving + 1)
            found = self._parts(parts, x)
            if found is None:
                continue
            if self.tolerance == np.inf:
                return found
            if before is not None:
                error = np.max(np.abs(found - before) / np.maximum(1.0, np.abs(found))) / 3
                if error <= self.tolerance:
                    return found
            before = found
        return np.full(len(x), np.nan)

    def _parts(
        self, times: NDArray[np.float64], x: NDArray[np.float64]
    ) -> NDArray[np.float64] | None:
        """The state at the end of a few steps, None where one cannot be solved."""
        states: NDArray[np.float64] = np.empty((len(times), len(x)))
        states[0] = x
        step, packed = 0, self.packed
        self.packed = pack_watches(())
        try:
            while step < len(times) - 1:
                self._renew(times, states, step)
                step, outcome, _ = self._loop(times, states, step, np.inf)
                if outcome == _Outcome.FAILED and not self._renew(times, states, step):
                    return None
        finally:
            self.packed = packed
        last: NDArray[np.float64] = states[-1]
        return last

    def _fired(self, x: NDArray[np.float64]) -> int:
        """Number, counted from 1, of the first watch that holds at `x`; 0 if there is none."""
        return next((k for k, w in enumerate(self.watches, start=1) if w.holds(x)), 0)


@njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)
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


@njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)
def _solve_step(
    address, integers, reals, work, s_address, s_integers, s_reals, scratch,
    x, f, h, x_new, f_new, residual, correction,
):  # fmt: skip
    """Newton's iteration from x_new; returns its slowest rate, or -1 where it does not converge."""
    n = len(x)
    before, slowest = -1.0, 0.0
    for _ in range(_ITERATIONS):
        invoke(address, (integers, reals, work, x_new, f_new))
        for i in range(n):
            residual[i] = x[i] + 0.5 * h * (f[i] + f_new[i]) - x_new[i]
        invoke(s_address, (s_integers, s_reals, residual, correction, scratch))
        size = 0.0
        for i in range(n):
            x_new[i] += correction[i]
            size = max(size, abs(correction[i]) / max(1.0, abs(x_new[i])))
            if not abs(correction[i]) < 1e6:
                return -1.0
        if size <= 0.01 * _TOLERANCE:
            return slowest
        if before > 0:
            rate = size / before
            slowest = max(slowest, rate)
            if rate >= 0.9:
                return -1.0
            if rate / (1 - rate) * size <= _TOLERANCE:
                return slowest
        before = size
    return -1.0


@njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)
def _steps(
    address, after, integers, reals, work, s_address, s_integers, s_reals, scratch, h_solver,
    times, states, first, tolerance, table, w_integers, w_reals,
):  # fmt: skip
    """Steps from `first` on until something comes up; returns (steps done, why, watch fired)."""
    n = states.shape[1]
    f, f_new, residual, correction = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    guess, verdict = np.empty(n), np.zeros(1)
    for step in range(first, len(times) - 1):
        x, x_new = states[step], states[step + 1]
        h = times[step + 1] - times[step]
        if abs(h - h_solver) > 1e-6 * h_solver:
            return step, 2, 0
        known = _extrapolate(times, states, step, guess)
        if known < 3 and tolerance < np.inf:
            return step, 4, 0
        for i in range(n):
            x_new[i] = guess[i]
        invoke(address, (integers, reals, work, x, f))
        rate = _solve_step(
            address, integers, reals, work, s_address, s_integers, s_reals, scratch,
            x, f, h, x_new, f_new, residual, correction,
        )  # fmt: skip
        if rate < 0:
            return step, 4, 0
        # The third difference tells both the error of the guess and, 13 times smaller, of the rule.
        for i in range(n):
            if abs(x_new[i] - guess[i]) > 13 * tolerance * max(1.0, abs(x_new[i])):
                return step, 4, 0
        if after:
            invoke(after, (integers, reals, work, x_new, f_new))
        fired = first_watch(table, w_integers, w_reals, x_new, verdict)
        if fired:
            return step + 1, 1, fired
        if rate > _SLOW and step > first + _PATIENCE:
            return step + 1, 3, 0
    return len(times) - 1, 0, 0
