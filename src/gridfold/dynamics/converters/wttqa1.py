"""WTTQA1 of PSS/E: torque control of a wind turbine with a doubly-fed or full converter.

PSS/E Model Library, WTTQA1; WECC REMTF, WTGTRQ_A. In per unit of the turbine's rating,

    wref = 1 / (1 + s Twref) f(P / (1 + s Tp))
    e    = wg - wref for Tflag = 0,    (Pplant - P) / wg for Tflag = 1
    Pref = wg (Kpp + Kip / s) e, the torque within Temin and Temax

where f is the speed that belongs to a power. The integral stands while the electrical control sees its
voltage off.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import pairwise
from typing import Any

import numpy as np
from numba import njit

from gridfold.dynamics.blocks import lag, limited_pi
from gridfold.dynamics.checks import checks
from gridfold.dynamics.device import Bound, Device, Parameter, Role, Scaling, Values, limits

(
    TFLAG, KPP, KIP, TP, TWREF, TEMAX, TEMIN, P1, SPD1, P2, SPD2, P3, SPD3, P4, SPD4, TRATE,
    POWER_BASE, RATING, BASE_SPEED,
) = range(19)  # fmt: skip
MEASURED, SPEED_REFERENCE, INTEGRAL = range(3)
PE, SPEED, PLANT, DIP = range(4)
PREF = 0

PARAMETERS = (
    Parameter("torque_code", "Tflag", "-", Bound.ANY),
    Parameter("proportional_gain", "Kpp", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("integral_gain", "Kip", "1/s", Bound.NOT_NEGATIVE),
    Parameter("power_time", "Tp", "s", Bound.NOT_NEGATIVE),
    Parameter("speed_reference_time", "Twref", "s", Bound.NOT_NEGATIVE),
    Parameter("highest_torque", "Temax", "p.u.", Bound.ANY),
    Parameter("lowest_torque", "Temin", "p.u.", Bound.ANY),
    *(
        Parameter(f"{what}_{k}", f"{symbol}{k}", "p.u.", Bound.NOT_NEGATIVE)
        for k in range(1, 5)
        for what, symbol in (("power", "p"), ("speed", "spd"))
    ),
    Parameter("turbine_rating", "TRATE", "MW", Bound.NOT_NEGATIVE, default=0.0),
    Parameter("power_base", "MBASE/SBASE", "p.u.", scaling=Scaling.POWER, default=1.0),
    Parameter("rating_ratio", "TRATE/MBASE", "p.u.", default=1.0),
)
DYR_COLUMNS: tuple[str | None, ...] = tuple(p.name for p in PARAMETERS[:-2])


@njit
def speed_of_power(power, p, i):
    """Speed that belongs to a power of unit `i`, constant beyond the ends of the curve."""
    if power.real <= p[P1, i].real:
        return p[SPD1, i] + 0.0 * power
    for k in range(P2, P4 + 1, 2):
        if power.real <= p[k, i].real:
            share = (power - p[k - 2, i]) / (p[k, i] - p[k - 2, i])
            return p[k - 1, i] + share * (p[k + 1, i] - p[k - 1, i])
    return p[SPD4, i] + 0.0 * power


@njit
def torque(x, u, p, i):
    """Torque of unit `i`, then the derivatives of measured power, speed reference and integral."""
    power = u[PE, i] / (p[POWER_BASE, i] * p[RATING, i])
    measured, d_power = lag(power, x[MEASURED, i], p[TP, i])
    reference, d_speed = lag(speed_of_power(measured, p, i), x[SPEED_REFERENCE, i], p[TWREF, i])
    if p[TFLAG, i].real == 1:
        error = (u[PLANT, i] / p[RATING, i] - power) / u[SPEED, i]
    else:
        error = u[SPEED, i] - reference
    wanted, d_integral = limited_pi(
        error, x[INTEGRAL, i], p[KPP, i], p[KIP, i], p[TEMIN, i], p[TEMAX, i]
    )
    if u[DIP, i].real > 0:
        d_integral = 0.0 * d_integral
    return wanted, d_power, d_speed, d_integral


def output(x, u, p, y, dx):
    """Power reference of the electrical control, in per unit of the converter's rating."""
    for i in range(x.shape[1]):
        wanted, _, _, _ = torque(x, u, p, i)
        y[PREF, i] = wanted * u[SPEED, i] * p[RATING, i]


def derivative(x, u, p, y, dx):
    """Measured power, speed reference and integral."""
    for i in range(x.shape[1]):
        _, dx[MEASURED, i], dx[SPEED_REFERENCE, i], dx[INTEGRAL, i] = torque(x, u, p, i)


def foresee(p: Values, known: Mapping[str, Any]) -> Mapping[str, Any]:
    """The speed that belongs to the power at the start."""
    power = known["active_power"] / (p["power_base"] * p["rating_ratio"])
    powers = np.array([p[f"power_{k}"] for k in range(1, 5)])
    speeds = np.array([p[f"speed_{k}"] for k in range(1, 5)])
    found = [np.interp(x, a, b) for x, a, b in zip(power, powers.T, speeds.T, strict=True)]
    return dict.fromkeys(("generator_speed", "turbine_speed", "reference_speed"), np.array(found))


def guess(p: Values, known: Mapping[str, Any]) -> Mapping[str, Any]:
    """Without an error; the torque gives the power reference."""
    active = known["active_power"] / p["power_base"]
    speed = known["generator_speed"]
    return {
        "measured_turbine_power": active / p["rating_ratio"],
        "reference_speed": foresee(p, known)["reference_speed"],
        "torque_integral": known["active_reference"] / speed / p["rating_ratio"],
        "active_reference_before": active,
    }


def resolve(parameters: Mapping[str, float], base_mva: float) -> Mapping[str, float]:
    """The base is the turbine's rating where that is given."""
    if parameters["turbine_rating"] == 0:
        return parameters
    return {**parameters, "rating_ratio": parameters["turbine_rating"] / base_mva}


def codes(parameters: Mapping[str, float]) -> Iterable[str]:
    """A code that exists, an integral, and a curve whose powers rise."""
    if parameters["torque_code"] not in (0, 1):
        yield f"torque_code Tflag {parameters['torque_code']:g} is neither 0 nor 1"
    if parameters["integral_gain"] == 0:
        yield "integral_gain Kip is 0: nothing decides the torque at the start"
    powers = [parameters[f"power_{k}"] for k in range(1, 5)]
    if not all(a < b for a, b in pairwise(powers)):
        yield f"p1 to p4 do not rise: {powers}"
    if any(parameters[f"speed_{k}"] == 0 for k in range(1, 5)):
        yield "a speed of spd1 to spd4 is 0"


WTTQA1 = Device(
    model="wttqa1",
    title="wind turbine torque control WTTQA1",
    role=Role.TORQUE_CONTROL,
    parameters=PARAMETERS,
    states=("measured_turbine_power", "reference_speed", "torque_integral"),
    inputs=("active_power", "generator_speed", "active_reference_before", "voltage_dip"),
    outputs=("active_reference",),
    output=output,
    derivative=derivative,
    targets=("active_reference",),
    solved_inputs=("active_reference_before",),
    defaults={"generator_speed": 1.0, "voltage_dip": 0.0},
    foresee=foresee,
    guess=guess,
    resolve=resolve,
    check=checks(PARAMETERS, ordered=[("lowest_torque", "highest_torque")], more=[codes]),
    limits=limits("lowest_torque", "highest_torque"),
    psse_names=("WTTQA1", "WTTQAU1"),
    psse_record=DYR_COLUMNS,
    psse_icons=1,
)
