"""The implicit trapezoidal rule, for systems with time constants far below the time step.

x_new = x + h/2 (f(x) + f(x_new)), solved by Newton's method with a Jacobian that is kept as long as the
iteration converges. A-stable, of order 2. Hairer & Wanner, Solving Ordinary Differential Equations II,
2nd ed., sections IV.3 and IV.8 (the iteration and when to stop it).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gridfold.errors import OptionError
from gridfold.numerics.checked_arrays import checked_state
from gridfold.numerics.implicit import CompiledSolver, dense_solver, numerical_jacobian
from gridfold.numerics.rhs import CompiledRhs
from gridfold.numerics.steppers.base import Integration, check_step
from gridfold.numerics.steppers.trapezoidal_loop import (
    FAR,
    ITERATIONS,
    TOLERANCE,
    Outcome,
    one_step,
    run_steps,
)
from gridfold.numerics.watch import Watch, pack_watches

#: New Jacobians with which a step is tried again, from where its iteration was given up.
_RETRIES = 4
#: A step is halved up to this many times; with a tolerance, so often at the start of a segment.
_HALVINGS, _FIRST_LEVEL = 10, 3
#: After so many sampling intervals with errors below this part of the tolerance steps are doubled.
_CALM_INTERVALS, _CALM = 3, 1 / 10


@dataclass(frozen=True)
class ImplicitTrapezoidal:
    """Implicit trapezoidal rule with a fixed step (s).

    Parameters
    ----------
    step : float
        Time step in seconds, and distance of the samples.
    tolerance : float, optional
        Largest local error of a step in a state, relative to its size or 1; sampling intervals are
        divided into as many steps as it takes. None (default): one step each.
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

    @property
    def fixed_step(self) -> bool:
        """Where there is no tolerance."""
        return self.tolerance is None

    def growth(self, z: complex) -> float:
        """Factor by which a step changes y' = lambda y, z = h lambda; below 1 if Re z is."""
        return np.inf if z == 2 else abs((2 + z) / (2 - z))

    def integrate(
        self,
        rhs: CompiledRhs,
        times: NDArray[np.float64],
        x0: NDArray[np.float64],
        watches: Sequence[Watch] = (),
    ) -> Integration:
        """Integrate from `x0` along `times`."""
        run = _Run(rhs, watches)
        if self.tolerance is None:
            return run.along(times, x0)
        return run.controlled(times, x0, self.tolerance)


class _Run:
    """One integration: the solver in use, and what to do when the compiled loop comes back."""

    def __init__(self, rhs: CompiledRhs, watches: Sequence[Watch]):
        self.rhs, self.watches = rhs, watches
        self.packed = pack_watches(watches, rhs.n_states)
        self.unwatched = pack_watches((), rhs.n_states)
        self.work = np.zeros(rhs.work_size)
        self.solver: CompiledSolver | None = None
        self.made: tuple[bytes, float] = (b"", 0.0)
        self.worst = 0.0

    def along(self, times: NDArray[np.float64], x0: NDArray[np.float64]) -> Integration:
        """All steps; each obstacle that the loop reports is removed, or the step divided."""
        states = np.full((len(times), self.rhs.n_states), np.nan)
        states[0] = checked_state(x0, self.rhs.n_states)
        step, last = 0, len(times) - 1
        while step < last:
            step, outcome, fired = self._loop(times, states, step, self.packed)
            if outcome == Outcome.FAILED and not (
                self._retry(times, states, step) or self._persist(times, states, step)
            ):
                states[step + 1] = self._divided(times[step : step + 2], states[step])
                step += 1
                if not np.isfinite(states[step]).all():
                    return Integration(states[: step + 1], 0)
                fired = self._fired(states[step])
            elif outcome == Outcome.FAILED:
                step += 1
                fired = self._fired(states[step])
            elif outcome in (Outcome.NEW_STEP_SIZE, Outcome.SLOW):
                self._renew(times, states, step)
            if fired:
                return Integration(states[: step + 1], fired)
        return Integration(states, 0)

    def controlled(
        self, times: NDArray[np.float64], x0: NDArray[np.float64], tolerance: float
    ) -> Integration:
        """Every sampling interval in so many equal steps that the local error is within bounds."""
        states = np.full((len(times), self.rhs.n_states), np.nan)
        states[0] = checked_state(x0, self.rhs.n_states)
        level, calm = _FIRST_LEVEL, 0
        past: NDArray[np.float64] = states[:1]
        for step in range(len(times) - 1):
            ends = times[step : step + 2]
            fine = self._parts(ends, past, level)
            while level < _HALVINGS and (fine is None or self.worst > tolerance):
                level, calm, past = level + 1, 0, states[step : step + 1]
                fine = self._parts(ends, past, level)
            if fine is None:
                return Integration(states[: step + 2], 0)
            states[step + 1], past = fine[-1], fine[-3:]
            fired = self._fired(states[step + 1])
            if fired:
                return Integration(states[: step + 2], fired)
            calm = calm + 1 if self.worst < _CALM * tolerance else 0
            if calm >= _CALM_INTERVALS and level > 0:
                level, calm, past = level - 1, 0, states[step + 1 : step + 2]
        return Integration(states, 0)

    def _loop(
        self,
        times: NDArray[np.float64],
        states: NDArray[np.float64],
        step: int,
        watches: tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]],
    ) -> tuple[int, int, int]:
        if self.solver is None:
            self._renew(times, states, step)
        assert self.solver is not None
        rhs, solver = self.rhs, self.solver
        step, outcome, fired, worst = run_steps(
            rhs.address, rhs.after_step, rhs.integers, rhs.reals, self.work,
            solver.address, solver.integers, solver.reals, np.zeros(solver.scratch_size),
            self.made[1], times, states, step, *watches,
        )  # fmt: skip
        self.worst = max(self.worst, worst)
        return int(step), int(outcome), int(fired)

    def _renew(self, times: NDArray[np.float64], states: NDArray[np.float64], step: int) -> bool:
        """Make the solver for the state and size of a step; False if it is that already."""
        if step >= len(times) - 1:
            return True
        return self._make(states[step], float(times[step + 1] - times[step]))

    def _make(self, x: NDArray[np.float64], h: float) -> bool:
        if self.made == (x.tobytes(), h):
            return False
        if self.rhs.solver is not None:
            self.solver = self.rhs.solver(x, h / 2)
        else:
            self.solver = dense_solver(numerical_jacobian(self.rhs, x), h / 2)
        self.made = (x.tobytes(), h)
        return True

    def _retry(self, times: NDArray[np.float64], states: NDArray[np.float64], step: int) -> bool:
        """One step from where its iteration was given up, with a new Jacobian from there."""
        h, rhs = float(times[step + 1] - times[step]), self.rhs
        x_new = states[step + 1]
        for _ in range(_RETRIES):
            if not np.isfinite(x_new).all() or not self._make(x_new, h):
                return False
            assert self.solver is not None
            solver = self.solver
            if one_step(
                rhs.address, rhs.integers, rhs.reals, self.work, solver.address, solver.integers,
                solver.reals, np.zeros(solver.scratch_size), states[step], h, x_new,
            ):  # fmt: skip
                states[step + 1] = rhs.held_after_step(x_new)
                return True
        return False

    def _persist(self, times: NDArray[np.float64], states: NDArray[np.float64], step: int) -> bool:
        """One step with a new Jacobian for each iteration; whether the equation was solved.

        That is what a step needs in which limits begin or end to act.
        """
        h = float(times[step + 1] - times[step])
        x, x_new = states[step], states[step].copy()
        f = self.rhs(x)
        scale = np.maximum(1.0, np.abs(x))
        for _ in range(ITERATIONS):
            residual = x + h / 2 * (f + self.rhs(x_new)) - x_new
            self._make(x_new, h)
            assert self.solver is not None
            correction = self.solver(residual)
            x_new = x_new + correction
            size = float(np.max(np.abs(correction) / scale, initial=0.0))
            if not size < FAR:
                return False
            if size <= TOLERANCE:
                states[step + 1] = self.rhs.held_after_step(x_new)
                return True
        return False

    def _divided(self, ends: NDArray[np.float64], x: NDArray[np.float64]) -> NDArray[np.float64]:
        """The state after one step in ever more parts, until it can be solved; else not a number."""
        for level in range(1, _HALVINGS + 1):
            fine = self._parts(ends, x[None, :], level)
            if fine is not None:
                last: NDArray[np.float64] = fine[-1]
                return last
        return np.full(len(x), np.nan)

    def _parts(
        self, ends: NDArray[np.float64], past: NDArray[np.float64], level: int
    ) -> NDArray[np.float64] | None:
        """States of 2^level steps behind up to three `past` ones; None if one cannot be solved."""
        parts, known = 2**level, len(past)
        h = (ends[1] - ends[0]) / parts
        times = ends[0] + h * np.arange(1 - known, parts + 1)
        states: NDArray[np.float64] = np.empty((len(times), past.shape[1]))
        states[:known] = past
        step, self.worst = known - 1, 0.0
        while step < len(times) - 1:
            step, outcome, _ = self._loop(times, states, step, self.unwatched)
            if outcome == Outcome.END:
                break
            if not self._renew(times, states, step) and outcome == Outcome.FAILED:
                return None
        return states

    def _fired(self, x: NDArray[np.float64]) -> int:
        """Number, counted from 1, of the first watch that holds at `x`; 0 if there is none."""
        return next((k for k, w in enumerate(self.watches, start=1) if w.holds(x)), 0)
