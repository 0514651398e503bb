"""The Adams-Bashforth-Moulton method of order 4 as a PECE scheme, started by Runge-Kutta.

The difference of predictor and corrector tells the leading error of the corrector (Milne's device,
19/270 of it), which is taken off: local extrapolation.

Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, 2nd ed., section III.1
(coefficients, PECE). Two evaluations a step, against four of Runge-Kutta.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gridfold.numerics.compiled import FAST, invoke, jit
from gridfold.numerics.rhs import CompiledRhs
from gridfold.numerics.steppers.base import Integration, check_step, run_loop
from gridfold.numerics.steppers.rk4 import rk4_step
from gridfold.numerics.watch import Watch, first_watch

#: Weights of the derivatives in predictor and corrector, that at t_n first, in parts of h/24.
_PREDICTOR, _CORRECTOR = np.array([55, -59, 37, -9]), np.array([19, -5, 1, 0])
#: Weight of the derivative at the predicted state, and part of the predictor in the new state.
_IMPLICIT, _MILNE = 9, 19 / 270


@dataclass(frozen=True)
class AdamsBashforthMoulton4:
    """Adams-Bashforth-Moulton PECE of order 4 with a fixed step (s).

    Runge-Kutta steps fill the history at the start of each segment and take every step that is
    shorter than the others.
    """

    step: float = 0.02
    name: str = "abm4"

    def __post_init__(self) -> None:
        check_step(self.step)

    @property
    def fixed_step(self) -> bool:
        """Always."""
        return True

    def growth(self, z: complex) -> float:
        """Factor by which a step changes y' = lambda y, z = h lambda, in the long run.

        A step is linear in the four states before it; it is the largest root of that recurrence.
        """
        old = np.eye(4)[0]
        predicted = old + z / 24 * _PREDICTOR
        corrected = old + z / 24 * (_IMPLICIT * predicted + _CORRECTOR)
        companion = np.eye(4, k=-1, dtype=np.complex128)
        companion[0] = corrected - _MILNE * (corrected - predicted)
        return float(np.abs(np.linalg.eigvals(companion)).max())

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
def _abm4_step(address, integers, reals, work, x, f, h, stage, k, x_new):
    """Predict, evaluate, correct, extrapolate; f[j] is the derivative at t_(n-j), j = 0 ... 3."""
    n = len(x)
    c = h / 24
    for i in range(n):
        stage[i] = x[i] + c * (55 * f[0, i] - 59 * f[1, i] + 37 * f[2, i] - 9 * f[3, i])
    invoke(address, (integers, reals, work, stage, k))
    for i in range(n):
        corrected = x[i] + c * (9 * k[i] + 19 * f[0, i] - 5 * f[1, i] + f[2, i])
        x_new[i] = corrected - 19 / 270 * (corrected - stage[i])


@jit(nogil=True, error_model="numpy", fastmath=FAST)
def _loop(
    address, after, integers, reals, work, times, full_step, states, table, w_integers, w_reals
):
    n = states.shape[1]
    f = np.empty((4, n))
    stage, k = np.empty(n), np.empty(n)
    verdict = np.zeros(1)
    history = 0
    invoke(address, (integers, reals, work, states[0], f[0]))
    for step in range(len(times) - 1):
        x, x_new = states[step], states[step + 1]
        h = times[step + 1] - times[step]
        full = abs(h - full_step) < 1e-6 * full_step
        if full and history >= 3:
            _abm4_step(address, integers, reals, work, x, f, h, stage, k, x_new)
        else:
            rk4_step(address, integers, reals, work, x, f[0], h, stage, k, x_new)
        if after:
            invoke(after, (integers, reals, work, x_new, k))
        history = history + 1 if full else 0
        for row in range(3, 0, -1):
            f[row] = f[row - 1]
        invoke(address, (integers, reals, work, x_new, f[0]))
        fired = first_watch(table, w_integers, w_reals, x_new, verdict)
        if fired:
            return step + 1, fired
    return len(times) - 1, 0
