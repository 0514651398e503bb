"""The waist of gridfold: what the mathematics needs to know of any dynamic system."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from gridfold.numerics.rhs import CompiledRhs


class System(Protocol):
    """A smooth autonomous system x' = f(x)."""

    @property
    def state_names(self) -> Sequence[str]:
        """Name of each entry of the state vector."""

    @property
    def compiled(self) -> CompiledRhs:
        """The right-hand side f for compiled loops; also callable from Python."""

    def jacobian(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """df/dx at the state `x`, shape (n_states, n_states)."""
