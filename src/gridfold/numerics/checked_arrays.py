"""Arrays that compiled code is going to read: lengths and positions are checked here, not there."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gridfold.errors import OptionError

#: A length that is not known yet: positions must not be negative.
ANY_LENGTH = 2**31


def require_shapes(what: str, owner: Any, shapes: Mapping[str, tuple[int, ...]]) -> None:
    """Raise an OptionError unless the fields of `owner` are arrays of these shapes; all are told."""
    faults = [
        f"{name} has shape {np.shape(getattr(owner, name))}, expected {shape}"
        for name, shape in shapes.items()
        if np.shape(getattr(owner, name)) != shape
    ]
    if faults:
        raise OptionError(f"{what}: {'; '.join(faults)}")


def require_positions(what: str, positions: NDArray[Any], length: int) -> None:
    """Raise an OptionError unless all are integers from 0 to `length` - 1."""
    found = np.asarray(positions)
    if not found.size:
        return
    if found.dtype.kind not in "iu":
        raise OptionError(f"{what} must be integers, not {found.dtype}")
    lowest, highest = int(found.min()), int(found.max())
    if lowest < 0 or highest >= length:
        worst = lowest if lowest < 0 else highest
        raise OptionError(f"{what}: there is no position {worst}, only 0 to {length - 1}")


def require_partners(what: str, partners: NDArray[Any], n: int) -> None:
    """Raise an OptionError unless each of `n` coordinates is the partner of its partner."""
    if np.shape(partners) != (n,):
        raise OptionError(f"{what} has shape {np.shape(partners)}, expected {(n,)}")
    require_positions(what, partners, n)
    if not np.array_equal(partners[partners], np.arange(n)):
        raise OptionError(f"{what}: a coordinate is not the partner of its partner")


def checked_state(x: Any, n_states: int) -> NDArray[np.float64]:
    """`x` as contiguous numbers; raises an OptionError unless it has shape (..., n_states)."""
    state = np.ascontiguousarray(x, dtype=np.float64)
    if state.ndim == 0 or state.shape[-1] != n_states:
        raise OptionError(f"a state has shape {np.shape(x)}, expected {n_states} numbers")
    return state
