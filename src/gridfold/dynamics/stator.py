"""What all machines share: a voltage E behind a stator impedance R + jX, at a bus of voltage V.

The network sees the Norton current E / (R + jX) beside the admittance 1 / (R + jX).
"""

from __future__ import annotations

import numpy as np
from numba import njit


@njit
def over_impedance(a_r, a_i, r, x):
    """(a_r + j a_i) / (r + j x), part by part so that parts may be complex steps."""
    scale = 1.0 / (r * r + x * x)
    return (a_r * r + a_i * x) * scale, (a_i * r - a_r * x) * scale


@njit
def terminal(source_r, source_i, v_r, v_i, r, x):
    """Current into the network, active and reactive power, voltage magnitude."""
    own_r, own_i = over_impedance(v_r, v_i, r, x)
    i_r, i_i = source_r - own_r, source_i - own_i
    return i_r, i_i, v_r * i_r + v_i * i_i, v_i * i_r - v_r * i_i, np.sqrt(v_r * v_r + v_i * v_i)
