"""The waist of gridfold: what the mathematics needs to know of any dynamic system."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from gridfold.numerics.rhs import CompiledRhs


class System(Protocol):
    """A smooth autonomous system x' = f(x)."""

    @property
    def state_names(self) -> Sequence[str]:
        """Name of each entry of the state vector."""

    @property
    def compiled(self) -> CompiledRhs:
        """The right-hand side f for compiled loops; also callable from Python."""
