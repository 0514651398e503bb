"""The one call by which a right-hand side gets the terminal voltages."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np
from numba import types
from numpy.typing import NDArray

#: ``solve(integers, reals, currents, voltages, scratch)``: currents and voltages of shape
#: (2 * n_terminals,), real parts before imaginary parts.
NETWORK_SIGNATURE = types.void(
    types.int64[::1],
    types.float64[::1],
    types.float64[::1],
    types.float64[::1],
    types.float64[::1],
)


class NetworkBackend(Enum):
    """How the network equations are solved; AUTO goes by the number of machine terminals."""

    AUTO = "auto"
    DENSE = "dense"
    SPARSE = "sparse"


@dataclass(frozen=True)
class CompiledNetwork:
    """Address of a compiled solver and its data."""

    address: int
    integers: NDArray[np.int64]
    reals: NDArray[np.float64]
    scratch_size: int
