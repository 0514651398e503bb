"""The waist of gridfold: what the mathematics needs to know of any dynamic system."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol, TypeGuard

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


class ClosedForm(Protocol):
    """What a system offers whose solution is a formula: it need not be stepped."""

    def states_after(
        self,
        start: NDArray[np.float64],
        elapsed: NDArray[np.float64],
        out: NDArray[np.float64] | None = None,
    ) -> NDArray[np.float64]:
        """States at the times `elapsed` (s), in ascending order, after the state `start`.

        Returns
        -------
        ndarray, shape (n_times, n_states)
            `out`, C-contiguous, where it is given.
        """

    def reach(
        self, start: NDArray[np.float64], span: float, rows: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Bounds of the quantities ``rows @ w`` within the time `span` (s) after the state `start`.

        Returns
        -------
        ndarray, shape (n_rows,)
            What none of their magnitudes exceeds; infinite where nothing can be said.
        """


def has_closed_form(system: Any) -> TypeGuard[ClosedForm]:
    """Whether the solution of a system is a formula."""
    return hasattr(system, "states_after")
