"""The classical Runge-Kutta method of order 4.

Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, 2nd ed., p. 138, Table 1.2.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gridfold.numerics.compiled import FAST, invoke, jit
from gridfold.numerics.rhs import CompiledRhs
from gridfold.numerics.steppers.base import Integration, check_step, run_loop
from gridfold.numerics.watch import Watch, first_watch


@dataclass(frozen=True)
class RungeKutta4:
    """Classical Runge-Kutta method of order 4 with a fixed step (s)."""

    step: float = 0.01
    name: str = "rk4"

    def __post_init__(self) -> None:
        check_step(self.step)

    @property
    def fixed_step(self) -> bool:
        """Always."""
        return True

    def growth(self, z: complex) -> float:
        """Factor by which a step changes y' = lambda y, z = h lambda: the Taylor polynomial."""
        return abs(1 + z * (1 + z / 2 * (1 + z / 3 * (1 + z / 4))))

    def integrate(
        self,
        rhs: CompiledRhs,
        times: NDArray[np.float64],
        x0: NDArray[np.float64],
        watches: Sequence[Watch] = (),
    ) -> Integration:
        """Integrate from `x0` along `times`."""
        return run_loop(_loop, self.step, rhs, times, x0, watches)


@jit(nogil=True, error_model="numpy", fastmath=FAST)
def rk4_step(address, integers, reals, work, x, f, h, stage, k, x_new):
    """One step of size h from x, where f = f(x) is known; `stage` and `k` are scratch."""
    n = len(x)
    for i in range(n):
        x_new[i] = x[i] + h / 6 * f[i]
        stage[i] = x[i] + h / 2 * f[i]
    invoke(address, (integers, reals, work, stage, k))
    for i in range(n):
        x_new[i] += h / 3 * k[i]
        stage[i] = x[i] + h / 2 * k[i]
    invoke(address, (integers, reals, work, stage, k))
    for i in range(n):
        x_new[i] += h / 3 * k[i]
        stage[i] = x[i] + h * k[i]
    invoke(address, (integers, reals, work, stage, k))
    for i in range(n):
        x_new[i] += h / 6 * k[i]


@jit(nogil=True, error_model="numpy", fastmath=FAST)
def _loop(
    address, after, integers, reals, work, times, full_step, states, table, w_integers, w_reals
):
    n = states.shape[1]
    f, stage, k = np.empty(n), np.empty(n), np.empty(n)
    verdict = np.zeros(1)
    for step in range(len(times) - 1):
        x, x_new = states[step], states[step + 1]
        invoke(address, (integers, reals, work, x, f))
        h = times[step + 1] - times[step]
        rk4_step(address, integers, reals, work, x, f, h, stage, k, x_new)
        if after:
            invoke(after, (integers, reals, work, x_new, k))
        fired = first_watch(table, w_integers, w_reals, x_new, verdict)
        if fired:
            return step + 1, fired
    return len(times) - 1, 0
