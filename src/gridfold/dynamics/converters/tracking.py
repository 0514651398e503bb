"""How a converter follows its terminal voltage: a phase-locked loop and a lag of the magnitude.

The generic models of WECC align the current with the terminal voltage of the same instant. Then the
network with many converters is an implicit equation, which has no solution behind a bolted fault. Here
the current is aligned with three states that follow the voltage V within 5 ms:

    e       = Im(V exp(-j theta)) / max(|V|, WEAK)
    theta'  = e / FOLLOW + w0 (f - 1),    f' = e / (FOLLOW FREQUENCY w0)
    v'      = (|V| - v) / FOLLOW

The loop has no error in a grid that turns at another frequency f, and it measures that frequency.
Below WEAK it becomes slower, and at zero voltage it stands. S.-K. Chung, IEEE Transactions on Power
Electronics 15 (2000), pp. 431-438, has the loop; WECC's model REGC_C has one too.
"""

from __future__ import annotations

import numpy as np
from numba import njit

#: Time in s within which angle and magnitude are followed, and the frequency.
FOLLOW, FREQUENCY = 0.005, 0.05
#: Voltage in p.u. below which the angle is followed more slowly.
WEAK = 0.5


@njit
def follow(v_r, v_i, angle, frequency, voltage, base_speed):
    """Derivatives of angle, frequency and voltage as a converter knows them."""
    size = np.sqrt(v_r * v_r + v_i * v_i)
    ahead = v_i * np.cos(angle) - v_r * np.sin(angle)
    error = ahead / size if size.real > WEAK else ahead / WEAK
    d_angle = error / FOLLOW + base_speed * (frequency - 1.0)
    d_frequency = error / (FOLLOW * FREQUENCY * base_speed)
    return d_angle, d_frequency, (size - voltage) / FOLLOW
