"""EXAC4: IEEE type AC4 of 1981, an alternator with a controlled rectifier.

    VI  = VREF + VS - VT / (1 + s TR)                        VIMIN <= VI <= VIMAX
    VA  = KA / (1 + s TA) (1 + s TC) / (1 + s TB) VI
    EFD = VA within VRMIN - KC IFD and VRMAX - KC IFD

The limits are windup limits. PSS/E Model Library; IEEE Committee Report, Excitation System Models for
Power System Stability Studies, 1981. The alternator is held at a constant voltage by a regulator of its
own, so that its load acts on the limits alone. The report draws the lower limit without KC IFD.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from gridfold.dynamics.blocks import clip, lag, lead_lag
from gridfold.dynamics.checks import checks
from gridfold.dynamics.device import Bound, Device, Parameter, Role, Values, limits

TR, VIMAX, VIMIN, TC, TB, KA, TA, VRMAX, VRMIN, KC, VREF, BASE_SPEED = range(12)
VC, LEAD, VA = range(3)
VT, VS, IFD = range(3)
AMPLIFIED, EFD = range(2)

PARAMETERS = (
    Parameter("measuring_time", "TR", "s", Bound.NOT_NEGATIVE),
    Parameter("error_maximum", "VIMAX", "p.u.", Bound.ANY),
    Parameter("error_minimum", "VIMIN", "p.u.", Bound.ANY),
    Parameter("lead_time", "TC", "s", Bound.NOT_NEGATIVE),
    Parameter("lag_time", "TB", "s", Bound.NOT_NEGATIVE),
    Parameter("regulator_gain", "KA", "p.u."),
    Parameter("regulator_time", "TA", "s", Bound.NOT_NEGATIVE),
    Parameter("regulator_maximum", "VRMAX", "p.u.", Bound.ANY),
    Parameter("regulator_minimum", "VRMIN", "p.u.", Bound.ANY),
    Parameter("rectifier_loading", "KC", "p.u.", Bound.NOT_NEGATIVE),
)
DYR_COLUMNS: tuple[str | None, ...] = tuple(p.name for p in PARAMETERS)


def output(x, u, p, y, dx):
    """Regulator output and, within its limits, the field voltage."""
    for i in range(x.shape[1]):
        v_c, _ = lag(u[VT, i], x[VC, i], p[TR, i])
        v_i = clip(p[VREF, i] + u[VS, i] - v_c, p[VIMIN, i], p[VIMAX, i])
        lead, _ = lead_lag(v_i, x[LEAD, i], p[TC, i], p[TB, i])
        y[AMPLIFIED, i], _ = lag(p[KA, i] * lead, x[VA, i], p[TA, i])
        drop = p[KC, i] * u[IFD, i]
        y[EFD, i] = clip(y[AMPLIFIED, i], p[VRMIN, i] - drop, p[VRMAX, i] - drop)


def derivative(x, u, p, y, dx):
    """Measurement, lead-lag and regulator."""
    for i in range(x.shape[1]):
        v_c, dx[VC, i] = lag(u[VT, i], x[VC, i], p[TR, i])
        v_i = clip(p[VREF, i] + u[VS, i] - v_c, p[VIMIN, i], p[VIMAX, i])
        lead, dx[LEAD, i] = lead_lag(v_i, x[LEAD, i], p[TC, i], p[TB, i])
        _, dx[VA, i] = lag(p[KA, i] * lead, x[VA, i], p[TA, i])


def guess(p: Values, known: Mapping[str, Any]) -> Mapping[str, Any]:
    """All equations are linear; the field voltage is prescribed."""
    return {"regulator_voltage": known["field_voltage"]}


EXAC4 = Device(
    model="exac4",
    title="IEEE type AC4 excitation system (PSS/E EXAC4)",
    role=Role.EXCITER,
    parameters=PARAMETERS,
    set_points=("voltage_reference",),
    states=("measured_voltage", "lead_lag_state", "regulator_voltage"),
    inputs=("terminal_voltage", "stabilizer_signal", "field_current"),
    outputs=("amplified_voltage", "field_voltage"),
    output=output,
    derivative=derivative,
    targets=("field_voltage",),
    defaults={"stabilizer_signal": 0.0},
    guess=guess,
    check=checks(
        PARAMETERS,
        ordered=[
            ("error_minimum", "error_maximum"),
            ("regulator_minimum", "regulator_maximum"),
        ],
        proper=[("lead_time", "lag_time")],
    ),
    limits=limits("error_minimum", "error_maximum")
    + limits("regulator_minimum", "regulator_maximum"),
    psse_record=DYR_COLUMNS,
)
