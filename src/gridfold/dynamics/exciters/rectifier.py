"""The loaded rectifier of static and AC exciters: IEEE Std 421.5-1992, annex D."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit
def rectified(source, drop):
    """VE FEX(IN) with IN = KC IFD / VE, from `source` VE >= 0 and `drop` KC IFD, both in p.u.

    The three modes of a bridge: FEX = 1 - 0.577 IN up to 0.433, sqrt(0.75 - IN^2) up to 0.75,
    1.732 (1 - IN) up to 1, and 0 beyond; 1 for a current below zero. Multiplied by VE nothing is
    divided by it, and a source of zero does no harm.
    """
    if drop.real <= 0:
        return source + 0.0 * drop
    if drop.real <= 0.433 * source.real:
        return source - 0.577 * drop
    if drop.real < 0.75 * source.real:
        return np.sqrt(0.75 * source * source - drop * drop)
    if drop.real < source.real:
        return 1.732 * (source - drop)
    return 0.0 * source
