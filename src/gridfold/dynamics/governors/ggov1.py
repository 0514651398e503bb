"""General governor and turbine GGOV1, for gas turbines and diesel engines.

Model GGOV1 of the PSS/E Model Library, turbine-governor models; IEEE Power & Energy Society, PES-TR1,
Dynamic Models for Turbine-Governors in Power System Studies, 2013. All is in per unit of the turbine's
rating. With the speed deviation dw, three controllers ask for fuel, and the lowest of them is given:

    e    = Pref + M - dw - R feedback, beyond a dead band db, within minerr and maxerr
    fsrn = Kpgov e + s Kdgov / (1 + s Tdgov) e + xgov
    fsrt = Kpload (Ldref / Kturb + Wfnl - T) + xload
    fsra = xfsr + TAU Ka (aset - s / (1 + s Ta) dw)
    fsr  = lowest of the three, within Vmin and Vmax

    xgov'  = Kigov / Kpgov (fsr - fsrn + Kpgov e),   xload' = Kiload / Kpload (fsr - xload)
    xfsr   = fsr / (1 + s TAU),                      M' = Kimw (Pset - P), within -1.1 R and 1.1 R

While a controller is the lowest these are its integrals; else they follow the fuel, so that none winds
up. The feedback is the electric power P, measured with Tpelec (Rselect = 1), the fuel that is asked for
(-1), the stroke of the valve (-2), or nothing (0). PSS/E lets the acceleration add Ka (aset - a) in
each of its time steps to the fuel before; that is an integral, for which any TAU stands that is short.

    stroke' = (fsr - stroke) / Tact, within Rclose and Ropen; stroke within Vmin and Vmax
    flow    = stroke (1 + dw) if Flag = 1, else stroke
    Pm      = (1 + s Tc) / (1 + s Tb) exp(-s Teng) Kturb (flow - Wfnl) - Dm dw        Dm > 0
    T       = 1 / (1 + s Tfload) (1 + s Tsa) / (1 + s Tsb) flow (1 + dw)^Dm           Dm < 0

The damping Dm acts in one of the last two only, by its sign. The delay Teng is a Pade approximation of
order two. The rates of the load reference, Rup and Rdown, have nothing to act on.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numba import njit

from gridfold.dynamics.blocks import (
    clip,
    dead_band,
    delay,
    held,
    lag,
    lead_lag,
    lower,
    rate_feedback,
    washout,
)
from gridfold.dynamics.checks import checks
from gridfold.dynamics.device import (
    Bound,
    Device,
    Limit,
    Parameter,
    Role,
    Scaling,
    Side,
    Values,
    limits,
)

(
    RSELECT, FLAG, R, TPELEC, MAXERR, MINERR, KPGOV, KIGOV, KDGOV, TDGOV, VMAX, VMIN, TACT, KTURB,
    WFNL, TB, TC, TENG, TFLOAD, KPLOAD, KILOAD, LDREF, DM, ROPEN, RCLOSE, KIMW, ASET, KA, TA, TRATE,
    DB, TSA, TSB, RUP, RDOWN, POWER_BASE, PREF, PSET, BASE_SPEED,
) = range(39)  # fmt: skip
(
    MEASURED, DIFFERENCE, GOVERNOR, LOAD, FUEL, SUPERVISORY, ACCELERATION, STROKE,
    LATE_1, LATE_2, TURBINE, TEMPERATURE_LEAD, TEMPERATURE,
) = range(13)  # fmt: skip
OMEGA, PE = range(2)
REQUESTED, PM, START = range(3)
#: Time in s within which the fuel before an acceleration is forgotten.
TAU = 0.02
#: Fuel that asks for no less than any other.
NO_LIMIT = 1e3
ELECTRIC_POWER, REQUESTED_STROKE, VALVE_STROKE = 1, -1, -2

PARAMETERS = (
    Parameter("feedback_code", "Rselect", "-", Bound.ANY),
    Parameter("flow_code", "Flag", "-", Bound.ANY),
    Parameter("droop", "R", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("power_time", "Tpelec", "s", Bound.NOT_NEGATIVE),
    Parameter("highest_error", "maxerr", "p.u.", Bound.ANY),
    Parameter("lowest_error", "minerr", "p.u.", Bound.ANY),
    Parameter("proportional_gain", "Kpgov", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("governor_integral_gain", "Kigov", "1/s", Bound.NOT_NEGATIVE),
    Parameter("governor_derivative_gain", "Kdgov", "s", Bound.NOT_NEGATIVE),
    Parameter("governor_derivative_time", "Tdgov", "s", Bound.NOT_NEGATIVE),
    Parameter("highest_valve", "Vmax", "p.u.", Bound.ANY),
    Parameter("lowest_valve", "Vmin", "p.u.", Bound.ANY),
    Parameter("valve_time", "Tact", "s"),
    Parameter("power_by_fuel", "Kturb", "p.u."),
    Parameter("no_load_flow", "Wfnl", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("turbine_lag_time", "Tb", "s", Bound.NOT_NEGATIVE),
    Parameter("turbine_lead_time", "Tc", "s", Bound.NOT_NEGATIVE),
    Parameter("engine_delay", "Teng", "s", Bound.NOT_NEGATIVE),
    Parameter("temperature_time", "Tfload", "s", Bound.NOT_NEGATIVE),
    Parameter("load_gain", "Kpload", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("load_integral_gain", "Kiload", "1/s", Bound.NOT_NEGATIVE),
    Parameter("load_limit", "Ldref", "p.u.", Bound.ANY),
    Parameter("turbine_damping", "Dm", "p.u.", Bound.ANY),
    Parameter("opening_rate", "Ropen", "p.u./s"),
    Parameter("closing_rate", "Rclose", "p.u./s", Bound.ANY),
    Parameter("supervisory_gain", "Kimw", "1/s", Bound.NOT_NEGATIVE),
    Parameter("acceleration_limit", "aset", "p.u./s", Bound.ANY),
    Parameter("acceleration_gain", "Ka", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("acceleration_time", "Ta", "s", Bound.NOT_NEGATIVE),
    Parameter("turbine_rating", "Trate", "MW", Bound.NOT_NEGATIVE),
    Parameter("dead_band", "db", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("temperature_lead_time", "Tsa", "s", Bound.NOT_NEGATIVE),
    Parameter("temperature_lag_time", "Tsb", "s", Bound.NOT_NEGATIVE),
    Parameter("limit_rise_rate", "Rup", "p.u./s", Bound.ANY, default=99.0),
    Parameter("limit_fall_rate", "Rdown", "p.u./s", Bound.ANY, default=-99.0),
    Parameter("power_base", "MBASE/SBASE", "p.u.", scaling=Scaling.POWER, default=1.0),
)
DYR_COLUMNS: tuple[str | None, ...] = tuple(p.name for p in PARAMETERS[:-1])


@njit
def speed_error(x, u, p, i, stroke):
    """Error of speed and load of unit `i`, beyond the dead band and within its limits."""
    feedback = 0.0 * stroke
    if p[RSELECT, i].real == ELECTRIC_POWER:
        feedback, _ = lag(u[PE, i] / p[POWER_BASE, i], x[MEASURED, i], p[TPELEC, i])
    elif p[RSELECT, i].real == REQUESTED_STROKE:
        feedback = x[FUEL, i]
    elif p[RSELECT, i].real == VALVE_STROKE:
        feedback = stroke
    wanted = p[PREF, i] + clip(x[SUPERVISORY, i], -1.1 * p[R, i], 1.1 * p[R, i])
    error = wanted - (u[OMEGA, i] - 1.0) - p[R, i] * feedback
    return clip(dead_band(error, p[DB, i]), p[MINERR, i], p[MAXERR, i])


@njit
def governor_fuel(x, p, i, error):
    """Fsrn of unit `i`."""
    rate_part, _ = rate_feedback(error, x[DIFFERENCE, i], p[KDGOV, i], p[TDGOV, i])
    return p[KPGOV, i] * error + rate_part + x[GOVERNOR, i]


@njit
def exhaust_flow(x, u, p, i, stroke):
    """Fuel flow of unit `i`, and what the exhaust temperature follows."""
    flow = stroke * u[OMEGA, i] if p[FLAG, i].real == 1 else stroke
    if p[DM, i].real < 0:
        return flow, flow * np.exp(p[DM, i] * np.log(u[OMEGA, i]))
    return flow, flow


@njit
def temperature_excess(x, u, p, i, stroke):
    """Limit less measured exhaust temperature of unit `i`, then both derivatives of the latter."""
    _, heat = exhaust_flow(x, u, p, i, stroke)
    sensed, d_lead = lead_lag(heat, x[TEMPERATURE_LEAD, i], p[TSA, i], p[TSB, i])
    temperature, d_temperature = lag(sensed, x[TEMPERATURE, i], p[TFLOAD, i])
    highest = p[LDREF, i] / p[KTURB, i] + p[WFNL, i]
    return highest - temperature, d_lead, d_temperature


@njit
def load_fuel(x, p, i, excess):
    """Fsrt of unit `i`; without gains there is no such limit."""
    if p[KPLOAD, i].real == 0 and p[KILOAD, i].real == 0:
        return 0.0 * excess + NO_LIMIT
    return p[KPLOAD, i] * excess + x[LOAD, i]


@njit
def acceleration_fuel(x, u, p, i):
    """Fsra of unit `i`; without a gain there is no such limit."""
    if p[KA, i].real == 0:
        return 0.0 * x[FUEL, i] + NO_LIMIT
    acceleration, _ = washout(u[OMEGA, i] - 1.0, x[ACCELERATION, i], 1.0, p[TA, i])
    return x[FUEL, i] + TAU * p[KA, i] * (p[ASET, i] - acceleration)


def output(x, u, p, y, dx):
    """Fuel that is asked for, and mechanical power on the system base."""
    for i in range(x.shape[1]):
        stroke = clip(x[STROKE, i], p[VMIN, i], p[VMAX, i])
        error = speed_error(x, u, p, i, stroke)
        excess, _, _ = temperature_excess(x, u, p, i, stroke)
        lowest = lower(governor_fuel(x, p, i, error), load_fuel(x, p, i, excess))
        lowest = lower(lowest, acceleration_fuel(x, u, p, i))
        y[REQUESTED, i] = clip(lowest, p[VMIN, i], p[VMAX, i])
        flow, _ = exhaust_flow(x, u, p, i, stroke)
        wanted = p[KTURB, i] * (flow - p[WFNL, i])
        late, _, _ = delay(wanted, x[LATE_1, i], x[LATE_2, i], p[TENG, i])
        power, _ = lead_lag(late, x[TURBINE, i], p[TC, i], p[TB, i])
        if p[DM, i].real > 0:
            power = power - p[DM, i] * (u[OMEGA, i] - 1.0)
        y[PM, i] = p[POWER_BASE, i] * power
        if p[KIMW, i].real > 0:
            y[START, i] = x[SUPERVISORY, i]
        else:
            y[START, i] = p[PSET, i] - u[PE, i] / p[POWER_BASE, i]


def derivative(x, u, p, y, dx):
    """Measurements, controllers, valve and turbine."""
    for i in range(x.shape[1]):
        stroke = clip(x[STROKE, i], p[VMIN, i], p[VMAX, i])
        fuel = y[REQUESTED, i]
        measured, dx[MEASURED, i] = lag(u[PE, i] / p[POWER_BASE, i], x[MEASURED, i], p[TPELEC, i])
        if p[KIMW, i].real > 0:
            rate = p[KIMW, i] * (p[PSET, i] - measured)
            dx[SUPERVISORY, i] = held(rate, x[SUPERVISORY, i], -1.1 * p[R, i], 1.1 * p[R, i])
        else:
            dx[SUPERVISORY, i] = -x[SUPERVISORY, i]
        error = speed_error(x, u, p, i, stroke)
        _, dx[DIFFERENCE, i] = rate_feedback(error, x[DIFFERENCE, i], p[KDGOV, i], p[TDGOV, i])
        asked = governor_fuel(x, p, i, error)
        if p[KPGOV, i].real > 0:
            behind = fuel - asked + p[KPGOV, i] * error
            dx[GOVERNOR, i] = p[KIGOV, i] / p[KPGOV, i] * behind
        else:
            dx[GOVERNOR, i] = held(p[KIGOV, i] * error, asked, p[VMIN, i], p[VMAX, i])
        _, dx[TEMPERATURE_LEAD, i], dx[TEMPERATURE, i] = temperature_excess(x, u, p, i, stroke)
        if p[KPLOAD, i].real > 0 and p[KILOAD, i].real > 0:
            dx[LOAD, i] = p[KILOAD, i] / p[KPLOAD, i] * (fuel - x[LOAD, i])
        else:
            dx[LOAD, i] = fuel - x[LOAD, i]
        dx[FUEL, i] = (fuel - x[FUEL, i]) / TAU
        _, dx[ACCELERATION, i] = lag(u[OMEGA, i] - 1.0, x[ACCELERATION, i], p[TA, i])
        rate = clip((fuel - stroke) / p[TACT, i], p[RCLOSE, i], p[ROPEN, i])
        dx[STROKE, i] = held(rate, x[STROKE, i], p[VMIN, i], p[VMAX, i])
        flow, _ = exhaust_flow(x, u, p, i, stroke)
        late, dx[LATE_1, i], dx[LATE_2, i] = delay(
            p[KTURB, i] * (flow - p[WFNL, i]), x[LATE_1, i], x[LATE_2, i], p[TENG, i]
        )
        _, dx[TURBINE, i] = lead_lag(late, x[TURBINE, i], p[TC, i], p[TB, i])


def resolve(parameters: Mapping[str, float], base_mva: float) -> Mapping[str, float]:
    """The base is the turbine's rating where that is given."""
    if parameters["turbine_rating"] == 0:
        return parameters
    return {**parameters, "power_base": parameters["turbine_rating"] / base_mva}


def guess(p: Values, known: Mapping[str, Any]) -> Mapping[str, Any]:
    """The fuel that gives the power, the governor in charge."""
    power = known["mechanical_power"] / p["power_base"]
    fuel = power / p["power_by_fuel"] + p["no_load_flow"]
    electric = known["active_power"] / p["power_base"]
    feedback = np.select(
        [p["feedback_code"] == 0, p["feedback_code"] == ELECTRIC_POWER], [0.0, electric], fuel
    )
    states = ("governor_integral", "load_integral", "fuel_before", "valve_stroke")
    heat = ("temperature_lead_state", "exhaust_temperature")
    return {
        **dict.fromkeys((*states, *heat), fuel),
        "measured_power": electric,
        "engine_delay_1": power,
        "turbine_power": power,
        "power_reference": p["droop"] * feedback,
        "load_set_point": electric,
    }


def codes(parameters: Mapping[str, float]) -> Iterable[str]:
    """Choices that exist, and times that must not be zero."""
    if parameters["feedback_code"] not in (1, 0, -1, -2):
        yield f"feedback_code Rselect {parameters['feedback_code']:g} is none of 1, 0, -1 and -2"
    if parameters["flow_code"] not in (0, 1):
        yield f"flow_code Flag {parameters['flow_code']:g} is neither 0 nor 1"
    if parameters["closing_rate"] >= 0:
        yield "closing_rate Rclose is the rate of closing, less than 0"
    if parameters["acceleration_gain"] > 0 and parameters["acceleration_time"] == 0:
        yield "acceleration_time Ta is 0: acceleration_gain Ka has to be 0 then"
    if (parameters["load_gain"] == 0) != (parameters["load_integral_gain"] == 0):
        yield "load_gain Kpload and load_integral_gain Kiload have to be 0 both or neither"
    if parameters["governor_integral_gain"] == 0:
        yield "governor_integral_gain Kigov is 0: nothing decides the fuel at the start"


GGOV1 = Device(
    model="ggov1",
    title="general governor and turbine GGOV1",
    role=Role.GOVERNOR,
    parameters=PARAMETERS,
    set_points=("power_reference", "load_set_point"),
    states=(
        "measured_power",
        "governor_difference",
        "governor_integral",
        "load_integral",
        "fuel_before",
        "supervisory_power",
        "acceleration_filter",
        "valve_stroke",
        "engine_delay_1",
        "engine_delay_2",
        "turbine_power",
        "temperature_lead_state",
        "exhaust_temperature",
    ),
    inputs=("speed", "active_power"),
    outputs=("requested_fuel", "mechanical_power", "governor_start"),
    output=output,
    derivative=derivative,
    targets=("mechanical_power", "governor_start"),
    defaults={"governor_start": 0.0},
    guess=guess,
    resolve=resolve,
    check=checks(
        PARAMETERS,
        ordered=[("lowest_error", "highest_error"), ("lowest_valve", "highest_valve")],
        proper=[
            ("governor_derivative_gain", "governor_derivative_time"),
            ("turbine_lead_time", "turbine_lag_time"),
            ("temperature_lead_time", "temperature_lag_time"),
        ],
        more=[codes],
    ),
    limits=(
        *limits("lowest_error", "highest_error"),
        *limits("lowest_valve", "highest_valve", state="valve_stroke"),
        *limits("closing_rate", "opening_rate"),
        Limit("load_limit", Side.HIGHEST),
        Limit("acceleration_limit", Side.HIGHEST),
    ),
    psse_record=DYR_COLUMNS,
)
