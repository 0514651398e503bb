"""Hydro turbine and governor HYGOV, on the base of its machine.

Model HYGOV of the PSS/E Model Library, turbine-governor models; the turbine is that of Kundur, Power
System Stability and Control, 1994, section 9.1. With the speed deviation dw and the desired gate c,

    e_f  = (Pref - dw - R c) / (1 + s Tf)
    c'   = (e_f' + e_f / Tr) / r,    within VELM; c within GMIN and GMAX (non-windup)
    gate = c / (1 + s Tg)
    q'   = (1 - h) / TW,             h = (q / gate)^2
    Pm   = At h (q - qNL) - Dturb gate dw

Pref is PSS/E's reference: a speed in per unit, R times the gate of the start. As h has no value at a
closed gate, the gate in h is at least 0.01 p.u.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from numba import njit

from gridfold.dynamics.blocks import clip, held, lag
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
    R, TEMPORARY, TR, TF, TG, VELM, GMAX, GMIN, TW, AT, DTURB, QNL, POWER_BASE, PREF, BASE_SPEED,
) = range(15)  # fmt: skip
FILTER, DESIRED, GATE, FLOW = range(4)
OMEGA = 0
PM = 0
SMALLEST_GATE = 0.01

DYR_COLUMNS: tuple[str | None, ...] = (
    "droop",
    "temporary_droop",
    "reset_time",
    "filter_time",
    "servo_time",
    "gate_velocity",
    "highest_gate",
    "lowest_gate",
    "water_time",
    "turbine_gain",
    "turbine_damping",
    "no_load_flow",
)


@njit
def head_at(flow, gate):
    """Head (q / g)^2; a gate that is almost closed counts as 0.01 p.u."""
    if gate.real < SMALLEST_GATE:
        return (flow / SMALLEST_GATE) ** 2
    return (flow / gate) ** 2


def output(x, u, p, y, dx):
    """Mechanical power on the system base."""
    for i in range(x.shape[1]):
        gate, _ = lag(clip(x[DESIRED, i], p[GMIN, i], p[GMAX, i]), x[GATE, i], p[TG, i])
        head = head_at(x[FLOW, i], gate)
        power = p[AT, i] * head * (x[FLOW, i] - p[QNL, i])
        y[PM, i] = p[POWER_BASE, i] * (power - p[DTURB, i] * gate * (u[OMEGA, i] - 1))


def derivative(x, u, p, y, dx):
    """Governor, gate and water column."""
    for i in range(x.shape[1]):
        desired = clip(x[DESIRED, i], p[GMIN, i], p[GMAX, i])
        error = p[PREF, i] - (u[OMEGA, i] - 1) - p[R, i] * desired
        filtered, dx[FILTER, i] = lag(error, x[FILTER, i], p[TF, i])
        wanted = (dx[FILTER, i] + filtered / p[TR, i]) / p[TEMPORARY, i]
        rate = clip(wanted, -p[VELM, i], p[VELM, i])
        dx[DESIRED, i] = held(rate, x[DESIRED, i], p[GMIN, i], p[GMAX, i])
        gate, dx[GATE, i] = lag(desired, x[GATE, i], p[TG, i])
        dx[FLOW, i] = (1 - head_at(x[FLOW, i], gate)) / p[TW, i]


def guess(p: Values, known: Mapping[str, Any]) -> Mapping[str, Any]:
    """The gate that gives the power at full head."""
    power = known["mechanical_power"] / p["power_base"]
    gate = power / p["turbine_gain"] + p["no_load_flow"]
    start = dict.fromkeys(("desired_gate", "gate", "water_flow"), gate)
    return {**start, "power_reference": p["droop"] * gate}


def check(parameters: Mapping[str, float]) -> Iterable[str]:
    """Limits in order."""
    if parameters["lowest_gate"] > parameters["highest_gate"]:
        yield "lowest_gate GMIN is above highest_gate GMAX"


HYGOV = Device(
    model="hygov",
    title="hydro turbine and governor HYGOV",
    role=Role.GOVERNOR,
    parameters=(
        Parameter("droop", "R", "p.u.", Bound.NOT_NEGATIVE),
        Parameter("temporary_droop", "r", "p.u."),
        Parameter("reset_time", "Tr", "s"),
        Parameter("filter_time", "Tf", "s"),
        Parameter("servo_time", "Tg", "s", Bound.NOT_NEGATIVE),
        Parameter("gate_velocity", "VELM", "p.u./s"),
        Parameter("highest_gate", "GMAX", "p.u."),
        Parameter("lowest_gate", "GMIN", "p.u.", Bound.ANY),
        Parameter("water_time", "TW", "s"),
        Parameter("turbine_gain", "At", "p.u."),
        Parameter("turbine_damping", "Dturb", "p.u.", Bound.NOT_NEGATIVE),
        Parameter("no_load_flow", "qNL", "p.u.", Bound.NOT_NEGATIVE),
        Parameter("power_base", "MBASE/SBASE", "p.u.", scaling=Scaling.POWER, default=1.0),
    ),
    set_points=("power_reference",),
    states=("speed_filter", "desired_gate", "gate", "water_flow"),
    inputs=("speed",),
    outputs=("mechanical_power",),
    output=output,
    derivative=derivative,
    targets=("mechanical_power",),
    guess=guess,
    check=check,
    limits=(
        Limit("gate_velocity", Side.HIGHEST),
        *limits("lowest_gate", "highest_gate", state="desired_gate"),
    ),
    psse_record=DYR_COLUMNS,
)
