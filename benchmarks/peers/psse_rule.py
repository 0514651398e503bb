"""The rule by which PSS/E steps, as its trajectories tell: Adams and Bashforth's of order two."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from gridfold.numerics.compiled import invoke
from gridfold.numerics.rhs import CompiledRhs
from gridfold.numerics.steppers import Integration
from gridfold.numerics.watch import Watch


@dataclass(frozen=True)
class AdamsBashforth2:
    """x(t + h) = x(t) + h (1.5 f(t) - 0.5 f(t - h)); one step of Euler's after every event."""

    step: float
    name: str = "ab2"
    fixed_step: bool = True

    def growth(self, z: complex) -> float:
        """Largest root of r^2 = r + z (1.5 r - 0.5)."""
        return float(np.abs(np.roots([1.0, -1.0 - 1.5 * z, 0.5 * z])).max())

    def integrate(
        self,
        rhs: CompiledRhs,
        times: NDArray[np.float64],
        x0: NDArray[np.float64],
        watches: Sequence[Watch] = (),
    ) -> Integration:
        """Integrate from `x0` along `times`; nothing is watched."""
        states = np.empty((len(times), rhs.n_states))
        states[0] = x0
        _loop(rhs.address, rhs.integers, rhs.reals, np.zeros(rhs.work_size), times, states)
        return Integration(states, 0)


@njit
def _loop(address, integers, reals, work, times, states):
    rate, before = np.empty(states.shape[1]), np.empty(states.shape[1])
    for k in range(len(times) - 1):
        invoke(address, (integers, reals, work, states[k], rate))
        if k == 0:
            before[:] = rate
        states[k + 1] = states[k] + (times[k + 1] - times[k]) * (1.5 * rate - 0.5 * before)
        before[:] = rate
