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
def pole_pair(v, dv, ddv, a1, a2, x, slope):
    """W = v / (1 + a1 s + a2 s^2) with its slopes: w, w', w'', then the derivatives of both states.

    `dv` and `ddv` are the slopes of `v`; they count where a2, or both coefficients, are zero.
    """
    if a2.real > 0:
        ddw = (v - x - a1 * slope) / a2
        return x, slope, ddw, slope, ddw
    if a1.real > 0:
        dw = (v - x) / a1
        return x, dw, (dv - dw) / a1, dw, -slope
    return v, dv, ddv, v - x, -slope


@njit
def delay(u, x, slope, time):
    """exp(-s T) by the Pade approximation of order two: output, then the derivatives of both states.

    (1 - s T/2 + s^2 T^2/12) / (1 + s T/2 + s^2 T^2/12)
    """
    if time.real > 0:
        return u - time * slope, slope, 12.0 * (u - x) / (time * time) - 6.0 * slope / time
    return u, u - x, -slope


@njit
def dead_band(u, width):
    """Zero within `width` of zero on either side, and beyond it what exceeds it."""
    if u.real >= width.real:
        return u - width
    if u.real <= -width.real:
        return u + width
    return 0.0 * u


@njit
def dead_band_between(u, low, high):
    """Zero between `low` and `high`, which hold zero, and beyond them what exceeds them."""
    if u.real >= high.real:
        return u - high
    if u.real <= low.real:
        return u - low
    return 0.0 * u


@njit
def limited_integral(rate, x, lowest, highest):
    """1 / s with non-windup limits: the output, then the derivative of the state."""
    return clip(x, lowest, highest), held(rate, x, lowest, highest)


@njit
def rate_feedback(u, x, gain, time):
    """K s / (1 + s T), a rate feedback or part of a PID; nothing where T, and so K, is zero."""
    if time.real > 0:
        return washout(u, x, gain, time)
    return 0.0 * u, u - x


@njit
def lower(a, b):
    """Low-value gate."""
    return a if a.real <= b.real else b


@njit
def higher(a, b):
    """High-value gate."""
    return a if a.real >= b.real else b


@njit
def limited_pi(u, x, proportional, integral, lowest, highest):
    """KP + KI / s, whose output is limited; the integral stands where it would lead it further out.

    Without an integral its idle state goes to zero within a second.
    """
    wanted = proportional * u + x
    rate = held(integral * u, wanted, lowest, highest) if integral.real > 0 else -x
    return clip(wanted, lowest, highest), rate


@njit
def limited_pid(u, x, x_slow, proportional, integral, derivative, time, lowest, highest):
    """KP + KI / s + s KD / (1 + s TD) with a limited output, and the derivatives of both states.

    The integral stands where it would lead the output further out; without one see `limited_pi`.
    """
    rate_part, d_slow = rate_feedback(u, x_slow, derivative, time)
    wanted = proportional * u + rate_part + x
    rate = held(integral * u, wanted, lowest, highest) if integral.real > 0 else -x
    return clip(wanted, lowest, highest), rate, d_slow


@njit
def quadratic_saturation(e, e_1, s_1, e_2, s_2):
    """E S(E) = B (E - A)^2 above A, through the points (E1, S1) and (E2, S2); zero below A.

    The scaled quadratic fit of PSS/E. A point with S = 0 means that nothing saturates.
    """
    if e_2.real < e_1.real:
        e_1, s_1, e_2, s_2 = e_2, s_2, e_1, s_1
    if not (s_1.real > 0 and s_2.real > 0):
        return 0.0 * e
    root = np.sqrt(s_1 * e_1 / (s_2 * e_2))
    knee = (e_1 - root * e_2) / (1.0 - root)
    if e.real <= knee.real:
        return 0.0 * e
    return s_2 * e_2 * ((e - knee) / (e_2 - knee)) ** 2


@njit
def exponential_saturation(e, s_10, s_12):
    """S(E) = S(1.0) E^n through (1.0, S(1.0)) and (1.2, S(1.2)); zero where E is not positive.

    The exponential fit of PSS/E. A point with S = 0 means that nothing saturates.
    """
    if not (s_10.real > 0 and s_12.real > 0 and e.real > 0):
        return 0.0 * e
    return s_10 * np.exp(np.log(s_12 / s_10) / np.log(1.2) * np.log(e))
