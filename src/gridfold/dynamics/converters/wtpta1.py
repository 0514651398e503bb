"""WTPTA1 of PSS/E: pitch control of a wind turbine.

PSS/E Model Library, WTPTA1; WECC REMTF, WTGPT_A. With the excess of power d = Pord - Pref,

    theta = 1 / (1 + s Tp) ((Kpw + Kiw / s) (wt - wref + Kcc d) + (Kpc + Kic / s) d)

in degrees. Both regulators and theta are within Tetamin and Tetamax, the rate of theta within RTetamin
and RTetamax.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numba import njit

from gridfold.dynamics.blocks import clip, held, limited_pi
from gridfold.dynamics.checks import checks
from gridfold.dynamics.device import Bound, Device, Parameter, Role, Values, limits

KIW, KPW, KIC, KPC, KCC, TP, TETAMAX, TETAMIN, RTETAMAX, RTETAMIN, BIAS, BASE_SPEED = range(12)
SPEED_INTEGRAL, POWER_INTEGRAL, PITCH = range(3)
SPEED, REFERENCE, ORDER, PREF = range(4)

PARAMETERS = (
    Parameter("speed_integral_gain", "Kiw", "deg/s", Bound.NOT_NEGATIVE),
    Parameter("speed_proportional_gain", "Kpw", "deg", Bound.NOT_NEGATIVE),
    Parameter("power_integral_gain", "Kic", "deg/s", Bound.NOT_NEGATIVE),
    Parameter("power_proportional_gain", "Kpc", "deg", Bound.NOT_NEGATIVE),
    Parameter("power_to_speed_gain", "Kcc", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("pitch_time", "Tp", "s"),
    Parameter("highest_pitch", "Tetamax", "deg", Bound.ANY),
    Parameter("lowest_pitch", "Tetamin", "deg", Bound.ANY),
    Parameter("highest_pitch_rate", "RTetamax", "deg/s"),
    Parameter("lowest_pitch_rate", "RTetamin", "deg/s", Bound.ANY),
)
DYR_COLUMNS: tuple[str | None, ...] = tuple(p.name for p in PARAMETERS)


@njit
def wanted_pitch(x, u, p, i):
    """Pitch that both regulators of unit `i` ask for, and the derivatives of their integrals."""
    excess = u[ORDER, i] - u[PREF, i]
    error = u[SPEED, i] - u[REFERENCE, i] + p[KCC, i] * excess
    low, high = p[TETAMIN, i], p[TETAMAX, i]
    by_speed, d_speed = limited_pi(error, x[SPEED_INTEGRAL, i], p[KPW, i], p[KIW, i], low, high)
    by_power, d_power = limited_pi(excess, x[POWER_INTEGRAL, i], p[KPC, i], p[KIC, i], low, high)
    return by_speed + by_power + p[BIAS, i], d_speed, d_power


def derivative(x, u, p, y, dx):
    """Both integrals and the pitch."""
    for i in range(x.shape[1]):
        wanted, dx[SPEED_INTEGRAL, i], dx[POWER_INTEGRAL, i] = wanted_pitch(x, u, p, i)
        rate = clip((wanted - x[PITCH, i]) / p[TP, i], p[RTETAMIN, i], p[RTETAMAX, i])
        dx[PITCH, i] = held(rate, x[PITCH, i], p[TETAMIN, i], p[TETAMAX, i])


def guess(p: Values, known: Mapping[str, Any]) -> Mapping[str, Any]:
    """The integral of the speed gives the pitch; without one it is a constant."""
    by_speed = np.where(p["speed_integral_gain"] > 0, known["pitch_angle"], 0.0)
    return {
        "pitch_speed_integral": by_speed,
        "pitch_angle": known["pitch_angle"],
        "pitch_bias": known["pitch_angle"] - by_speed,
    }


def signs(parameters: Mapping[str, float]) -> Iterable[str]:
    """A rate of falling is negative."""
    if parameters["lowest_pitch_rate"] > 0:
        yield "lowest_pitch_rate RTetamin is the rate of falling, not above 0"


WTPTA1 = Device(
    model="wtpta1",
    title="wind turbine pitch control WTPTA1",
    role=Role.PITCH_CONTROL,
    parameters=PARAMETERS,
    set_points=("pitch_bias",),
    states=("pitch_speed_integral", "pitch_power_integral", "pitch_angle"),
    inputs=("turbine_speed", "reference_speed", "power_order", "wanted_power"),
    derivative=derivative,
    targets=("pitch_angle",),
    defaults={"turbine_speed": 1.0, "reference_speed": 1.0},
    guess=guess,
    check=checks(PARAMETERS, ordered=[("lowest_pitch", "highest_pitch")], more=[signs]),
    limits=(
        *limits("lowest_pitch", "highest_pitch", state="pitch_angle"),
        *limits("lowest_pitch_rate", "highest_pitch_rate"),
    ),
    psse_names=("WTPTA1", "WTPTAU1"),
    psse_record=DYR_COLUMNS,
)
