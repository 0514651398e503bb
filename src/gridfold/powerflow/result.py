"""The solved operating point."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gridfold.grid.case import Case


@dataclass(frozen=True)
class PowerFlowResult:
    """Solution of the power flow.

    Parameters
    ----------
    case : Case
        The case that was solved.
    voltage : ndarray of complex, shape (n_buses,)
        Bus voltages in per unit.
    unit_power : ndarray of complex, shape (n_generators,)
        Power of each generator in per unit on the system base; 0 when out of service.
    load_power : ndarray of complex, shape (n_buses,)
        Load at each bus in per unit on the system base.
    iterations : int
        Newton iterations.
    mismatch : float
        Largest remaining power mismatch in per unit.
    """

    case: Case
    voltage: NDArray[np.complex128]
    unit_power: NDArray[np.complex128]
    load_power: NDArray[np.complex128]
    iterations: int
    mismatch: float

    @property
    def losses_mw(self) -> float:
        """Active power lost in branches and shunts, in MW."""
        total = self.unit_power.sum() - self.load_power.sum()
        return float(total.real) * self.case.base_mva
