"""What the Woodward diesel governors share: the electric control box, the actuator and the engine.

    box      = (1 + s T3) / (1 + s T1 + s^2 T1 T2) e
    throttle = K (1 + s T4) / (s (1 + s T5) (1 + s T6)) box,  within TMIN and TMAX
    Pm       = exp(-s TD) throttle (1 + dw)

Models DEGOV and DEGOV1 of the PSS/E Model Library, turbine-governor models. The limits are those of the
integrator, which stands last here, so that it does not wind up. The delay of the engine TD is a Pade
approximation of order two.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from numba import njit

from gridfold.dynamics.blocks import delay, lag, lead_lag, limited_integral, pole_pair
from gridfold.dynamics.device import Bound, Parameter, Values, limits

BOX = (
    Parameter("box_time_1", "T1", "s", Bound.NOT_NEGATIVE),
    Parameter("box_time_2", "T2", "s", Bound.NOT_NEGATIVE),
    Parameter("box_lead_time", "T3", "s", Bound.NOT_NEGATIVE),
)
ENGINE = (
    Parameter("actuator_gain", "K", "1/s"),
    Parameter("actuator_lead_time", "T4", "s", Bound.NOT_NEGATIVE),
    Parameter("actuator_time_1", "T5", "s", Bound.NOT_NEGATIVE),
    Parameter("actuator_time_2", "T6", "s", Bound.NOT_NEGATIVE),
    Parameter("engine_delay", "TD", "s", Bound.NOT_NEGATIVE),
    Parameter("highest_throttle", "TMAX", "p.u.", Bound.ANY),
    Parameter("lowest_throttle", "TMIN", "p.u.", Bound.ANY),
)
STATES = (
    "box_output",
    "box_slope",
    "actuator_lead",
    "actuator_lag",
    "throttle",
    "engine_delay_1",
    "engine_delay_2",
)
LIMITS = limits("lowest_throttle", "highest_throttle", state="throttle")
ORDERED = ("lowest_throttle", "highest_throttle")


@njit
def control_box(error, x, slope, t_1, t_2, t_3):
    """Output of the box, then the derivatives of both states."""
    none = 0.0 * error
    out, d_out, _, rate, slope_rate = pole_pair(error, none, none, t_1, t_1 * t_2, x, slope)
    return out + t_3 * d_out, rate, slope_rate


@njit
def actuator(box, x_lead, x_lag, x, gain, t_4, t_5, t_6, lowest, highest):
    """Throttle, then the derivatives of its three states.

    Where T5 is zero, the lag T6 is the denominator of the lead T4.
    """
    if t_5.real > 0:
        lead, d_lead = lead_lag(box, x_lead, t_4, t_5)
        late, d_lag = lag(lead, x_lag, t_6)
    else:
        late, d_lead = lead_lag(box, x_lead, t_4, t_6)
        d_lag = late - x_lag
    throttle, rate = limited_integral(gain * late, x, lowest, highest)
    return throttle, d_lead, d_lag, rate


@njit
def engine(throttle, x, slope, delay_time, speed):
    """Mechanical power, then the derivatives of both states of the delay."""
    late, rate, slope_rate = delay(throttle, x, slope, delay_time)
    return late * speed, rate, slope_rate


def guess(p: Values, known: Mapping[str, Any]) -> Mapping[str, Any]:
    """The throttle that gives the power."""
    power = known["mechanical_power"] / p["power_base"]
    return {"throttle": power, "engine_delay_1": power}


def proper_blocks(parameters: Mapping[str, float]) -> list[str]:
    """Faults of leads without a lag."""
    faults = []
    if parameters["box_time_1"] == 0 and parameters["box_lead_time"] != 0:
        faults.append("box_time_1 T1 is 0: box_lead_time T3 has to be 0 then")
    lag = parameters["actuator_time_1"] + parameters["actuator_time_2"]
    if lag == 0 and parameters["actuator_lead_time"] != 0:
        faults.append("T5 and T6 are 0: actuator_lead_time T4 has to be 0 then")
    return faults
