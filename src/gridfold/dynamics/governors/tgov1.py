"""Steam turbine and governor TGOV1, on the base of its machine.

Model TGOV1 of the PSS/E Model Library, turbine-governor models. With the speed deviation dw,

    valve = (Pref - dw / R) / (1 + s T1), within VMIN and VMAX (non-windup)
    Pm    = valve (1 + s T2) / (1 + s T3) - Dt dw

The lead-lag stands for the reheater. Pref is a power here, not PSS/E's reference before 1/R.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from gridfold.dynamics.blocks import lead_lag, limited_lag
from gridfold.dynamics.device import Bound, Device, Parameter, Role, Scaling, Values, limits

R, T1, VMAX, VMIN, T2, T3, DT, POWER_BASE, PREF, BASE_SPEED = range(10)
VALVE, REHEATER = range(2)
OMEGA = 0
PM = 0

DYR_COLUMNS: tuple[str | None, ...] = (
    "droop",
    "valve_time",
    "highest_valve",
    "lowest_valve",
    "reheater_lead_time",
    "reheater_time",
    "turbine_damping",
)


def output(x, u, p, y, dx):
    """Mechanical power on the system base."""
    for i in range(x.shape[1]):
        slip = u[OMEGA, i] - 1
        demand = p[PREF, i] - slip / p[R, i]
        valve, _ = limited_lag(demand, x[VALVE, i], p[T1, i], p[VMIN, i], p[VMAX, i])
        power, _ = lead_lag(valve, x[REHEATER, i], p[T2, i], p[T3, i])
        y[PM, i] = p[POWER_BASE, i] * (power - p[DT, i] * slip)


def derivative(x, u, p, y, dx):
    """Valve and reheater."""
    for i in range(x.shape[1]):
        demand = p[PREF, i] - (u[OMEGA, i] - 1) / p[R, i]
        valve, dx[VALVE, i] = limited_lag(demand, x[VALVE, i], p[T1, i], p[VMIN, i], p[VMAX, i])
        _, dx[REHEATER, i] = lead_lag(valve, x[REHEATER, i], p[T2, i], p[T3, i])


def guess(p: Values, known: Mapping[str, Any]) -> Mapping[str, Any]:
    """Valve, reheater and reference at the power of the turbine."""
    power = known["mechanical_power"] / p["power_base"]
    return {"valve": power, "reheater_power": power, "power_reference": power}


def check(parameters: Mapping[str, float]) -> Iterable[str]:
    """The lead-lag has to be proper, and the limits in order."""
    if parameters["reheater_time"] == 0 and parameters["reheater_lead_time"] != 0:
        yield "reheater_time T3 is 0: reheater_lead_time T2 has to be 0 then"
    if parameters["lowest_valve"] > parameters["highest_valve"]:
        yield "lowest_valve VMIN is above highest_valve VMAX"


TGOV1 = Device(
    model="tgov1",
    title="steam turbine and governor TGOV1",
    role=Role.GOVERNOR,
    parameters=(
        Parameter("droop", "R", "p.u."),
        Parameter("valve_time", "T1", "s", Bound.NOT_NEGATIVE),
        Parameter("highest_valve", "VMAX", "p.u.", Bound.ANY),
        Parameter("lowest_valve", "VMIN", "p.u.", Bound.ANY),
        Parameter("reheater_lead_time", "T2", "s", Bound.NOT_NEGATIVE),
        Parameter("reheater_time", "T3", "s", Bound.NOT_NEGATIVE),
        Parameter("turbine_damping", "Dt", "p.u.", Bound.NOT_NEGATIVE),
        Parameter("power_base", "MBASE/SBASE", "p.u.", scaling=Scaling.POWER, default=1.0),
    ),
    set_points=("power_reference",),
    states=("valve", "reheater_power"),
    inputs=("speed",),
    outputs=("mechanical_power",),
    output=output,
    derivative=derivative,
    targets=("mechanical_power",),
    guess=guess,
    check=check,
    limits=limits("lowest_valve", "highest_valve", state="valve"),
    psse_record=DYR_COLUMNS,
)
