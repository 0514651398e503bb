"""SEXS: simplified excitation system.

    EFD = K / (1 + s TE) (1 + s TA) / (1 + s TB) (VREF + VS - VT)

with EMIN <= EFD <= EMAX, non-windup. PSS/E Model Library; the record gives the ratio TA/TB. TB = 0
leaves the lead-lag block out, TE = 0 the lag.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from gridfold.dynamics.blocks import lead_lag, limited_lag
from gridfold.dynamics.device import Bound, Device, Parameter, Role, Values, limits

RATIO, TB, K, TE, EMIN, EMAX, VREF, BASE_SPEED = range(8)
LEAD, VE = range(2)
VT, VS = range(2)
EFD = 0

DYR_COLUMNS: tuple[str | None, ...] = (
    "lead_lag_ratio",
    "lag_time",
    "regulator_gain",
    "exciter_time",
    "field_voltage_minimum",
    "field_voltage_maximum",
)


def output(x, u, p, y, dx):
    """Field voltage."""
    for i in range(x.shape[1]):
        error = p[VREF, i] + u[VS, i] - u[VT, i]
        lead, _ = lead_lag(error, x[LEAD, i], p[RATIO, i] * p[TB, i], p[TB, i])
        y[EFD, i], _ = limited_lag(p[K, i] * lead, x[VE, i], p[TE, i], p[EMIN, i], p[EMAX, i])


def derivative(x, u, p, y, dx):
    """Lead-lag and exciter."""
    for i in range(x.shape[1]):
        error = p[VREF, i] + u[VS, i] - u[VT, i]
        lead, dx[LEAD, i] = lead_lag(error, x[LEAD, i], p[RATIO, i] * p[TB, i], p[TB, i])
        _, dx[VE, i] = limited_lag(p[K, i] * lead, x[VE, i], p[TE, i], p[EMIN, i], p[EMAX, i])


def guess(p: Values, known: Mapping[str, Any]) -> Mapping[str, Any]:
    """All equations are linear; the field voltage is prescribed."""
    return {"exciter_voltage": known["field_voltage"]}


def check(parameters: Mapping[str, float]) -> Iterable[str]:
    """The limits must not cross."""
    if parameters["field_voltage_minimum"] > parameters["field_voltage_maximum"]:
        yield "field_voltage_minimum EMIN is above field_voltage_maximum EMAX"


SEXS = Device(
    model="sexs",
    title="simplified excitation system (PSS/E SEXS)",
    role=Role.EXCITER,
    parameters=(
        Parameter("lead_lag_ratio", "TA/TB", "-", Bound.NOT_NEGATIVE),
        Parameter("lag_time", "TB", "s", Bound.NOT_NEGATIVE),
        Parameter("regulator_gain", "K", "p.u."),
        Parameter("exciter_time", "TE", "s", Bound.NOT_NEGATIVE),
        Parameter("field_voltage_minimum", "EMIN", "p.u.", Bound.ANY),
        Parameter("field_voltage_maximum", "EMAX", "p.u.", Bound.ANY),
    ),
    set_points=("voltage_reference",),
    states=("lead_lag_state", "exciter_voltage"),
    inputs=("terminal_voltage", "stabilizer_signal"),
    outputs=("field_voltage",),
    output=output,
    derivative=derivative,
    targets=("field_voltage",),
    defaults={"stabilizer_signal": 0.0},
    guess=guess,
    check=check,
    limits=limits("field_voltage_minimum", "field_voltage_maximum", state="exciter_voltage"),
    psse_record=DYR_COLUMNS,
)
