"""Gas turbine and governor GAST, on the base of its machine.

Model GAST of the PSS/E Model Library, turbine-governor models. With the speed deviation dw,

    demand  = lower of  Pref - dw / R  and  AT + KT (AT - exhaust)
    fuel    = demand / (1 + s T1), within VMIN and VMAX (non-windup)
    turbine = fuel / (1 + s T2),   exhaust = turbine / (1 + s T3)
    Pm      = turbine - Dturb dw

The second demand is that of the exhaust temperature: it takes over where the power stays above AT.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from numba import njit

from gridfold.dynamics.blocks import clip, lag, limited_lag
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

R, T1, T2, T3, AT, KT, VMAX, VMIN, DTURB, POWER_BASE, PREF, BASE_SPEED = range(12)
FUEL, TURBINE, EXHAUST = range(3)
OMEGA = 0
PM = 0

DYR_COLUMNS: tuple[str | None, ...] = (
    "droop",
    "fuel_time",
    "turbine_time",
    "exhaust_time",
    "temperature_limit",
    "temperature_gain",
    "highest_fuel",
    "lowest_fuel",
    "turbine_damping",
)


@njit
def _exhaust(fuel, turbine, exhaust, t2, t3, lowest, highest):
    """Exhaust temperature: the last of the lags that has a time constant."""
    if t3.real > 0:
        return exhaust
    if t2.real > 0:
        return turbine
    return clip(fuel, lowest, highest)


@njit
def _demand(wanted, exhaust, limit, gain):
    """Low-value gate of the wanted fuel and that which the temperature allows."""
    allowed = limit + gain * (limit - exhaust)
    return allowed if allowed.real < wanted.real else wanted


def output(x, u, p, y, dx):
    """Mechanical power on the system base."""
    for i in range(x.shape[1]):
        slip = u[OMEGA, i] - 1
        exhaust = _exhaust(
            x[FUEL, i], x[TURBINE, i], x[EXHAUST, i], p[T2, i], p[T3, i], p[VMIN, i], p[VMAX, i]
        )
        demand = _demand(p[PREF, i] - slip / p[R, i], exhaust, p[AT, i], p[KT, i])
        fuel, _ = limited_lag(demand, x[FUEL, i], p[T1, i], p[VMIN, i], p[VMAX, i])
        turbine, _ = lag(fuel, x[TURBINE, i], p[T2, i])
        y[PM, i] = p[POWER_BASE, i] * (turbine - p[DTURB, i] * slip)


def derivative(x, u, p, y, dx):
    """Fuel, turbine and exhaust temperature."""
    for i in range(x.shape[1]):
        exhaust = _exhaust(
            x[FUEL, i], x[TURBINE, i], x[EXHAUST, i], p[T2, i], p[T3, i], p[VMIN, i], p[VMAX, i]
        )
        wanted = p[PREF, i] - (u[OMEGA, i] - 1) / p[R, i]
        demand = _demand(wanted, exhaust, p[AT, i], p[KT, i])
        fuel, dx[FUEL, i] = limited_lag(demand, x[FUEL, i], p[T1, i], p[VMIN, i], p[VMAX, i])
        turbine, dx[TURBINE, i] = lag(fuel, x[TURBINE, i], p[T2, i])
        _, dx[EXHAUST, i] = lag(turbine, x[EXHAUST, i], p[T3, i])


def guess(p: Values, known: Mapping[str, Any]) -> Mapping[str, Any]:
    """All at the power of the turbine."""
    power = known["mechanical_power"] / p["power_base"]
    names = ("fuel", "turbine_power", "exhaust_temperature", "power_reference")
    return dict.fromkeys(names, power)


def check(parameters: Mapping[str, float]) -> Iterable[str]:
    """One time constant at least in the loop of the exhaust temperature, and limits in order."""
    if not any(parameters[name] for name in ("fuel_time", "turbine_time", "exhaust_time")):
        yield "fuel_time T1, turbine_time T2 and exhaust_time T3 are all 0: an algebraic loop"
    if parameters["lowest_fuel"] > parameters["highest_fuel"]:
        yield "lowest_fuel VMIN is above highest_fuel VMAX"


GAST = Device(
    model="gast",
    title="gas turbine and governor GAST",
    role=Role.GOVERNOR,
    parameters=(
        Parameter("droop", "R", "p.u."),
        Parameter("fuel_time", "T1", "s", Bound.NOT_NEGATIVE),
        Parameter("turbine_time", "T2", "s", Bound.NOT_NEGATIVE),
        Parameter("exhaust_time", "T3", "s", Bound.NOT_NEGATIVE),
        Parameter("temperature_limit", "AT", "p.u.", Bound.ANY),
        Parameter("temperature_gain", "KT", "p.u.", Bound.NOT_NEGATIVE),
        Parameter("highest_fuel", "VMAX", "p.u.", Bound.ANY),
        Parameter("lowest_fuel", "VMIN", "p.u.", Bound.ANY),
        Parameter("turbine_damping", "Dturb", "p.u.", Bound.NOT_NEGATIVE),
        Parameter("power_base", "MBASE/SBASE", "p.u.", scaling=Scaling.POWER, default=1.0),
    ),
    set_points=("power_reference",),
    states=("fuel", "turbine_power", "exhaust_temperature"),
    inputs=("speed",),
    outputs=("mechanical_power",),
    output=output,
    derivative=derivative,
    targets=("mechanical_power",),
    guess=guess,
    check=check,
    limits=(
        Limit("temperature_limit", Side.HIGHEST),
        *limits("lowest_fuel", "highest_fuel", state="fuel"),
    ),
    psse_record=DYR_COLUMNS,
)
