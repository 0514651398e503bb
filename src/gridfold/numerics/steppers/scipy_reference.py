"""SciPy's adaptive integrators behind the stepper contract, for reference runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gridfold.errors import OptionError
from gridfold.numerics.rhs import CompiledRhs
from gridfold.numerics.steppers.base import Integration, check_step
from gridfold.numerics.watch import Watch


@dataclass(frozen=True)
class ScipyReference:
    """`scipy.integrate.solve_ivp` with tight tolerances, sampled every `step` seconds.

    Slow, and independent of gridfold's own steppers: the yardstick for their errors. The watch is
    applied to the samples after the segment has been integrated.
    """

    step: float = 0.01
    method: str = "DOP853"
    relative_tolerance: float = 1e-10
    absolute_tolerance: float = 1e-10
    name: str = "scipy"

    def __post_init__(self) -> None:
        check_step(self.step)

    @property
    def fixed_step(self) -> bool:
        """Never."""
        return False

    def growth(self, z: complex) -> float:
        """1: its own steps are as small as they need to be."""
        return 1.0

    def integrate(
        self,
        rhs: CompiledRhs,
        times: NDArray[np.float64],
        x0: NDArray[np.float64],
        watches: Sequence[Watch] = (),
    ) -> Integration:
        """Integrate from `x0` along `times`."""
        if rhs.after_step:
            raise OptionError("a continuous integrator cannot hold values during a step")
        from scipy.integrate import solve_ivp  # slow to import, seldom needed

        solution = solve_ivp(
            lambda _, x: rhs(x),
            (times[0], times[-1]),
            x0,
            method=self.method,
            t_eval=times,
            rtol=self.relative_tolerance,
            atol=self.absolute_tolerance,
        )
        if not solution.success:
            raise OptionError(f"solve_ivp({self.method}) stopped: {solution.message}")
        states = np.ascontiguousarray(solution.y.T)
        for row, state in enumerate(states[1:], start=2):
            for number, watch in enumerate(watches, start=1):
                if watch.holds(state):
                    return Integration(states[:row], number)
        return Integration(states, 0)
