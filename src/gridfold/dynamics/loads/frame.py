"""A frame that follows the voltage of a bus: what phasors are written in that are states.

Its angle theta is a state, and follows the angle of the voltage V with a time constant T,

    dtheta/dt = Im(V exp(-j theta)) / (T |V|),

below 0.1 p.u. of voltage with less and less, at none not at all. A common turn of all angles of a
grid then changes no phasor, which it would in the frame of the network.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from gridfold.dynamics.blocks import higher

#: Voltage in p.u. below which an angle is followed more slowly.
_LEAST = 0.1


@njit
def turned(real, imag, cosine, sine):
    """A phasor times exp(j theta)."""
    return real * cosine - imag * sine, real * sine + imag * cosine


@njit
def frame_rate(v_r, v_i, theta, time):
    """The derivative of theta in rad/s."""
    size = higher(np.sqrt(v_r * v_r + v_i * v_i), _LEAST)
    return (v_i * np.cos(theta) - v_r * np.sin(theta)) / (time * size)
