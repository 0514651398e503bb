"""No reduction at all: the linear system as it is, for comparison."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gridfold.reduction.base import Reduction
from gridfold.systems.linear import LinearSystem
from gridfold.systems.statemap import StateMap


@dataclass(frozen=True)
class Unreduced:
    """T = I: every state is kept, the bound is zero."""

    def reduce(self, system: LinearSystem, reference: NDArray[np.float64]) -> Reduction:
        """The system itself."""
        return Reduction(system, StateMap.identity(reference), None, 0.0, 0)
