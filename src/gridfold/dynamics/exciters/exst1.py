"""EXST1: IEEE type ST1 of 1981, a rectifier fed from the generator's terminals.

    VI  = VREF + VS - VT / (1 + s TR) - s KF / (1 + s TF) VA         VIMIN <= VI <= VIMAX
    VA  = KA / (1 + s TA) (1 + s TC) / (1 + s TB) VI
    EFD = VA within VT VRMIN - KC IFD and VT VRMAX - KC IFD

The limits are windup limits. PSS/E Model Library; IEEE Committee Report, Excitation System Models for
Power System Stability Studies, 1981. The field current IFD is on the base in which it equals the field
voltage in steady state.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from numba import njit

from gridfold.dynamics.blocks import clip, lag, lead_lag
from gridfold.dynamics.device import Bound, Device, Parameter, Role, Values, limits

TR, VIMAX, VIMIN, TC, TB, KA, TA, VRMAX, VRMIN, KC, KF, TF, VREF, BASE_SPEED = range(14)
VC, LEAD, VA, VF = range(4)
VT, VS, IFD, SUPPLY = range(4)
AMPLIFIED, EFD = range(2)

DYR_COLUMNS: tuple[str | None, ...] = (
    "measuring_time",
    "error_maximum",
    "error_minimum",
    "lead_time",
    "lag_time",
    "regulator_gain",
    "regulator_time",
    "regulator_maximum",
    "regulator_minimum",
    "rectifier_loading",
    "feedback_gain",
    "feedback_time",
)


@njit
def through(error, v_a, x_feedback, x_lead, feedback, lead, lag_time, lowest, highest):
    """Output and state derivative of the lead-lag block behind the limited error."""
    v_i = clip(error - feedback * (v_a - x_feedback), lowest, highest)
    return lead_lag(v_i, x_lead, lead, lag_time)


@njit
def undelayed(error, x_feedback, x_lead, gain, feedback, lead, lag_time):
    """VA where TA = 0 and VI is between its limits: the rate feedback acts at once.

    With VI on a limit the true VA is beyond the same limit, so VI is found to be on it all the same.
    """
    at_once = lead / lag_time if lag_time.real > 0 else 1.0 + 0.0 * lag_time
    open_loop = (1.0 - at_once) * x_lead + at_once * (error + feedback * x_feedback)
    return gain * open_loop / (1.0 + gain * at_once * feedback)


def output(x, u, p, y, dx):
    """Regulator output and, within its limits, the field voltage."""
    for i in range(x.shape[1]):
        y[AMPLIFIED, i] = x[VA, i]
        if p[TA, i].real <= 0:
            v_c, _ = lag(u[VT, i], x[VC, i], p[TR, i])
            error = p[VREF, i] + u[VS, i] - v_c
            feedback = p[KF, i] / p[TF, i] if p[TF, i].real > 0 else 0.0 * p[TF, i]
            v_a = undelayed(error, x[VF, i], x[LEAD, i], p[KA, i], feedback, p[TC, i], p[TB, i])
            lead, _ = through(
                error,
                v_a,
                x[VF, i],
                x[LEAD, i],
                feedback,
                p[TC, i],
                p[TB, i],
                p[VIMIN, i],
                p[VIMAX, i],
            )
            y[AMPLIFIED, i] = p[KA, i] * lead
        drop = p[KC, i] * u[IFD, i]
        lowest, highest = u[SUPPLY, i] * p[VRMIN, i] - drop, u[SUPPLY, i] * p[VRMAX, i] - drop
        y[EFD, i] = clip(y[AMPLIFIED, i], lowest, highest)


def derivative(x, u, p, y, dx):
    """Measurement, rate feedback, lead-lag and regulator."""
    for i in range(x.shape[1]):
        v_c, dx[VC, i] = lag(u[VT, i], x[VC, i], p[TR, i])
        feedback = p[KF, i] / p[TF, i] if p[TF, i].real > 0 else 0.0 * p[TF, i]
        _, dx[VF, i] = lag(y[AMPLIFIED, i], x[VF, i], p[TF, i])
        error = p[VREF, i] + u[VS, i] - v_c
        v_a = y[AMPLIFIED, i]
        if p[TA, i].real <= 0:
            v_a = undelayed(error, x[VF, i], x[LEAD, i], p[KA, i], feedback, p[TC, i], p[TB, i])
        lead, dx[LEAD, i] = through(
            error, v_a, x[VF, i], x[LEAD, i], feedback, p[TC, i], p[TB, i], p[VIMIN, i], p[VIMAX, i]
        )
        _, dx[VA, i] = lag(p[KA, i] * lead, x[VA, i], p[TA, i])


def guess(p: Values, known: Mapping[str, Any]) -> Mapping[str, Any]:
    """All equations are linear; the field voltage is prescribed."""
    return {"regulator_voltage": known["field_voltage"]}


def check(parameters: Mapping[str, float]) -> Iterable[str]:
    """Blocks that do not exist, limits that cross."""
    if parameters["lag_time"] == 0 and parameters["lead_time"] > 0:
        yield "lag_time TB is 0 but lead_time TC is not: that is no lead-lag block"
    if parameters["feedback_time"] == 0 and parameters["feedback_gain"] > 0:
        yield "feedback_time TF is 0 but feedback_gain KF is not: that is a pure differentiator"
    if parameters["regulator_minimum"] > parameters["regulator_maximum"]:
        yield "regulator_minimum VRMIN is above regulator_maximum VRMAX"
    if parameters["error_minimum"] > parameters["error_maximum"]:
        yield "error_minimum VIMIN is above error_maximum VIMAX"


EXST1 = Device(
    model="exst1",
    title="IEEE type ST1 excitation system (PSS/E EXST1)",
    role=Role.EXCITER,
    parameters=(
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
        Parameter("feedback_gain", "KF", "p.u.", Bound.NOT_NEGATIVE),
        Parameter("feedback_time", "TF", "s", Bound.NOT_NEGATIVE),
    ),
    set_points=("voltage_reference",),
    states=("measured_voltage", "lead_lag_state", "regulator_voltage", "feedback_state"),
    inputs=("terminal_voltage", "stabilizer_signal", "field_current", "supply_voltage"),
    outputs=("amplified_voltage", "field_voltage"),
    output=output,
    derivative=derivative,
    targets=("field_voltage",),
    defaults={"stabilizer_signal": 0.0},
    guess=guess,
    check=check,
    limits=limits("error_minimum", "error_maximum")
    + limits("regulator_minimum", "regulator_maximum"),
    psse_record=DYR_COLUMNS,
)
