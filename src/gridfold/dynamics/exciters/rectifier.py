"""The loaded rectifier of static and AC exciters, and its compound source.

IEEE Std 421.5-1992, annex D; the source is that of the types ST3A and ST4B.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray


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


@njit
def compound_voltage(v_t, power, reactive, current_squared, k_p, angle_deg, k_i, x_l):
    """VE from quantities on the machine's base; the angle in degrees."""
    k_cos = k_i * np.cos(np.pi / 180.0 * angle_deg)
    k_sin = k_i * np.sin(np.pi / 180.0 * angle_deg)
    k_x = k_p * x_l
    coupling = k_p * (k_sin * power + (k_cos + k_x) * reactive)
    through = (k_i * k_i + 2.0 * k_cos * k_x + k_x * k_x) * current_squared
    squared = k_p * k_p * v_t * v_t + through + 2.0 * coupling
    if squared.real <= 0:
        return 0.0 * squared
    return np.sqrt(squared)


def unloaded(field: NDArray[np.float64], drop: NDArray[np.float64]) -> NDArray[np.float64]:
    """The source VE that gives the `field` voltage at a `drop` KC IFD: the inverse of `rectified`."""
    modes = [drop <= 0, drop <= 0.433 * (field + 0.577 * drop), field >= 1.732 / 3 * drop]
    sources = [field, field + 0.577 * drop, np.sqrt((field**2 + drop**2) / 0.75)]
    return np.asarray(np.select(modes, sources, field / 1.732 + drop))
