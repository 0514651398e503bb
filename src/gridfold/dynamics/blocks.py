"""Blocks of which control systems consist, for kernels on real and on complex-step numbers.

A block with a state returns its output and the derivative of its state. A time constant of zero
makes it algebraic: the output follows the input at once, and the idle state, which nothing reads,
creeps after the input within a second, so that no eigenvalue at zero arises from it.
"""

from __future__ import annotations

import numpy as np
from numba import njit

#: Time constant in seconds with which a non-windup state approaches its limit.
APPROACH = 0.005


@njit
def clip(value, lowest, highest):
    """`value` within its limits."""
    if value.real > highest.real:
        return highest
    if value.real < lowest.real:
        return lowest
    return value


@njit
def held(rate, x, lowest, highest):
    """The derivative `rate` of a non-windup state, which may not lead out of the limits.

    A state approaches a limit no faster than with :data:`APPROACH`, so that the derivative is a
    continuous function of the state, without which implicit rules have no solution there. Beyond a
    limit, where an explicit step may land, it stands until it is led back.
    """
    if rate.real > 0:
        if x.real >= highest.real:
            return 0.0 * rate
        approach = (highest - x) / APPROACH
        return approach if approach.real < rate.real else rate
    if x.real <= lowest.real:
        return 0.0 * rate
    approach = (lowest - x) / APPROACH
    return approach if approach.real > rate.real else rate


@njit
def lag(u, x, time):
    """1 / (1 + s T)."""
    if time.real > 0:
        return x, (u - x) / time
    return u, u - x


@njit
def limited_lag(u, x, time, lowest, highest):
    """1 / (1 + s T) with non-windup limits."""
    if time.real > 0:
        return clip(x, lowest, highest), held((u - x) / time, x, lowest, highest)
    return clip(u, lowest, highest), u - x


@njit
def lead_lag(u, x, lead, time):
    """(1 + s T1) / (1 + s T); where T is zero the block passes its input, T1 has to be zero then."""
    if time.real > 0:
        return x + lead / time * (u - x), (u - x) / time
    return u, u - x


@njit
def washout(u, x, gain, time):
    """K s / (1 + s T); T has to be positive."""
    return gain / time * (u - x), (u - x) / time


@njit
def quadratic_saturation(e, e_1, s_1, e_2, s_2):
    """E S(E) = B (E - A)^2 above A, through the points (E1, S1) and (E2, S2); zero below A.

    The scaled quadratic fit of PSS/E. No saturation where either S2 or E2 is zero.
    """
    if e_2.real < e_1.real:
        e_1, s_1, e_2, s_2 = e_2, s_2, e_1, s_1
    if not (s_2.real > 0 and e_2.real > 0):
        return 0.0 * e
    if s_1.real > 0:
        root = np.sqrt(s_1 * e_1 / (s_2 * e_2))
        knee = (e_1 - root * e_2) / (1.0 - root)
    else:
        knee = e_1 + 0.0 * s_1
    if e.real <= knee.real:
        return 0.0 * e
    return s_2 * e_2 * ((e - knee) / (e_2 - knee)) ** 2
