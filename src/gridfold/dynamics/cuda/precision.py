"""With how many digits a GPU computes."""

from __future__ import annotations

from collections.abc import Mapping
from enum import Enum
from typing import Any

import numpy as np
from numpy.typing import NDArray


class Precision(Enum):
    """Digits of what a GPU computes in a step; states are kept and summed up in double precision."""

    DOUBLE = "double"
    SINGLE = "single"

    @property
    def number(self) -> type[np.float64] | type[np.float32]:
        """The type of number."""
        return np.float32 if self is Precision.SINGLE else np.float64

    def rounded(self, arrays: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
        """Arrays with the digits of this precision; those of times, states and limits keep all."""
        return {
            name: self._rounded(array) if name not in _DOUBLE else array
            for name, array in arrays.items()
        }

    def _rounded(self, array: NDArray[Any]) -> NDArray[Any]:
        real = array.dtype == np.float64
        return array.astype(self.number, copy=False) if real else array


#: Arrays in double precision always: in single precision a speed near 1 p.u. would lose what a step
#: of 10 ms adds to it, and an angle would walk away with the rounding of all steps.
_DOUBLE = frozenset(
    [
        "start",
        "times",
        "states_of",
        "record",
        "extremes",
        "group_fixed",
        "group_limit",
        "entry_share",
    ]
)
