"""Hydro turbine and governor IEEEG3, on the base of its machine.

Model IEEEG3 of the PSS/E Model Library, turbine-governor models (IEEE Committee Report, Dynamic
models for steam and hydro turbines in power system studies, 1973). With the speed deviation dw,

    pilot = (Pref - dw - (Rperm + Rtemp s TR / (1 + s TR)) gate) / (TG (1 + s TP))
    gate' = pilot
    Pm    = a23 (1 + (a11 - a13 a21 / a23) s TW) / (1 + a11 s TW) gate

with UC <= pilot <= UO and PMIN <= gate <= PMAX, both non-windup. PSS/E calls the droops sigma and
delta. The water column is linear: an ideal turbine at full load has a11 = 0.5, a13 = 1, a21 = 1.5 and
a23 = 1.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from numba import njit

from gridfold.dynamics.blocks import clip, held, lead_lag, limited_lag, rate_feedback
from gridfold.dynamics.checks import checks
from gridfold.dynamics.device import Bound, Device, Parameter, Role, Scaling, Values, limits

(
    TG, TP, UO, UC, PMAX, PMIN, SIGMA, DELTA, TR, TW, A11, A13, A21, A23,
    POWER_BASE, PREF, BASE_SPEED,
) = range(17)  # fmt: skip
PILOT, GATE, DASHPOT, COLUMN = range(4)
OMEGA = 0
PM = 0

PARAMETERS = (
    Parameter("gate_time", "TG", "s"),
    Parameter("pilot_time", "TP", "s", Bound.NOT_NEGATIVE),
    Parameter("opening_rate", "UO", "p.u./s", Bound.NOT_NEGATIVE),
    Parameter("closing_rate", "UC", "p.u./s", Bound.ANY),
    Parameter("highest_gate", "PMAX", "p.u.", Bound.ANY),
    Parameter("lowest_gate", "PMIN", "p.u.", Bound.ANY),
    Parameter("droop", "Rperm", "p.u."),
    Parameter("temporary_droop", "Rtemp", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("reset_time", "TR", "s", Bound.NOT_NEGATIVE),
    Parameter("water_time", "TW", "s", Bound.NOT_NEGATIVE),
    Parameter("flow_by_head", "a11", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("flow_by_gate", "a13", "p.u.", Bound.ANY),
    Parameter("power_by_head", "a21", "p.u.", Bound.ANY),
    Parameter("power_by_gate", "a23", "p.u."),
    Parameter("power_base", "MBASE/SBASE", "p.u.", scaling=Scaling.POWER, default=1.0),
)
DYR_COLUMNS: tuple[str | None, ...] = tuple(p.name for p in PARAMETERS[:-1])


@njit
def _turbine(gate, column, water_time, a11, a13, a21, a23):
    """Power of the turbine and the derivative of its water column."""
    lead = (a11 - a13 * a21 / a23) * water_time
    out, rate = lead_lag(gate, column, lead, a11 * water_time)
    return a23 * out, rate


def output(x, u, p, y, dx):
    """Mechanical power on the system base."""
    for i in range(x.shape[1]):
        gate = clip(x[GATE, i], p[PMIN, i], p[PMAX, i])
        power, _ = _turbine(
            gate, x[COLUMN, i], p[TW, i], p[A11, i], p[A13, i], p[A21, i], p[A23, i]
        )
        y[PM, i] = p[POWER_BASE, i] * power


def derivative(x, u, p, y, dx):
    """Droops, pilot valve, gate and water column."""
    for i in range(x.shape[1]):
        gate = clip(x[GATE, i], p[PMIN, i], p[PMAX, i])
        temporary, dx[DASHPOT, i] = rate_feedback(
            gate, x[DASHPOT, i], p[DELTA, i] * p[TR, i], p[TR, i]
        )
        error = p[PREF, i] - (u[OMEGA, i] - 1) - p[SIGMA, i] * gate - temporary
        rate, dx[PILOT, i] = limited_lag(
            error / p[TG, i], x[PILOT, i], p[TP, i], p[UC, i], p[UO, i]
        )
        dx[GATE, i] = held(rate, x[GATE, i], p[PMIN, i], p[PMAX, i])
        _, dx[COLUMN, i] = _turbine(
            gate, x[COLUMN, i], p[TW, i], p[A11, i], p[A13, i], p[A21, i], p[A23, i]
        )


def guess(p: Values, known: Mapping[str, Any]) -> Mapping[str, Any]:
    """The gate that gives the power."""
    gate = known["mechanical_power"] / (p["power_base"] * p["power_by_gate"])
    return {
        "gate": gate,
        "dashpot_state": gate,
        "water_column": gate,
        "power_reference": p["droop"] * gate,
    }


def rates_and_column(parameters: Mapping[str, float]) -> Iterator[str]:
    """A rate of closing that closes, and a water column that is a proper block."""
    if parameters["closing_rate"] > 0:
        yield "closing_rate UC is positive: it is the rate of closing, 0 or less"
    moved = parameters["flow_by_gate"] * parameters["power_by_head"] * parameters["water_time"]
    if parameters["flow_by_head"] == 0 and moved != 0:
        yield "flow_by_head a11 is 0: a13, a21 or TW has to be 0 then"


IEEEG3 = Device(
    model="ieeeg3",
    title="hydro turbine and governor IEEEG3",
    role=Role.GOVERNOR,
    parameters=PARAMETERS,
    set_points=("power_reference",),
    states=("pilot_rate", "gate", "dashpot_state", "water_column"),
    inputs=("speed",),
    outputs=("mechanical_power",),
    output=output,
    derivative=derivative,
    targets=("mechanical_power",),
    guess=guess,
    check=checks(PARAMETERS, ordered=[("lowest_gate", "highest_gate")], more=[rates_and_column]),
    limits=(
        *limits("closing_rate", "opening_rate"),
        *limits("lowest_gate", "highest_gate", state="gate"),
    ),
    psse_record=DYR_COLUMNS,
)
