"""ESST1A: IEEE type ST1A of 1992, a rectifier fed from the generator's terminals.

    VI  = VREF + VS1 - VT / (1 + s TR) - s KF / (1 + s TF) E             VIMIN <= VI <= VIMAX
    VA  = KA / (1 + s TA) (1 + s TC) / (1 + s TB) (1 + s TC1) / (1 + s TB1) VI,  VAMIN <= VA <= VAMAX
    E   = VA + VS2 - KLR (IFD - ILR), the last where it is positive
    EFD = E within VT VRMIN and VT VRMAX - KC IFD

VAMIN and VAMAX are non-windup. The signal of a stabilizer is VS1 for VOS = 1 and VS2 for VOS = 2. An
underexcitation limiter has no input here, whatever UEL says. PSS/E Model Library; IEEE Std 421.5-1992,
type ST1A.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from numba import njit

from gridfold.dynamics.blocks import clip, lag, lead_lag, limited_lag, rate_feedback
from gridfold.dynamics.checks import checks
from gridfold.dynamics.device import Bound, Device, Limit, Parameter, Role, Side, Values, limits

(
    UEL, VOS, TR, VIMAX, VIMIN, TC, TB, TC1, TB1, KA, TA, VAMAX, VAMIN, VRMAX, VRMIN, KC, KF, TF,
    KLR, ILR, VREF, BASE_SPEED,
) = range(22)  # fmt: skip
VC, LEAD, LEAD_1, VA, VF = range(5)
VT, VS, IFD, SUPPLY = range(4)
AMPLIFIED, EFD = range(2)

PARAMETERS = (
    Parameter("limiter_code", "UEL", "-", Bound.ANY),
    Parameter("stabilizer_code", "VOS", "-", Bound.ANY),
    Parameter("measuring_time", "TR", "s", Bound.NOT_NEGATIVE),
    Parameter("error_maximum", "VIMAX", "p.u.", Bound.ANY),
    Parameter("error_minimum", "VIMIN", "p.u.", Bound.ANY),
    Parameter("lead_time", "TC", "s", Bound.NOT_NEGATIVE),
    Parameter("lag_time", "TB", "s", Bound.NOT_NEGATIVE),
    Parameter("second_lead_time", "TC1", "s", Bound.NOT_NEGATIVE),
    Parameter("second_lag_time", "TB1", "s", Bound.NOT_NEGATIVE),
    Parameter("regulator_gain", "KA", "p.u."),
    Parameter("regulator_time", "TA", "s", Bound.NOT_NEGATIVE),
    Parameter("amplifier_maximum", "VAMAX", "p.u.", Bound.ANY),
    Parameter("amplifier_minimum", "VAMIN", "p.u.", Bound.ANY),
    Parameter("regulator_maximum", "VRMAX", "p.u.", Bound.ANY),
    Parameter("regulator_minimum", "VRMIN", "p.u.", Bound.ANY),
    Parameter("rectifier_loading", "KC", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("feedback_gain", "KF", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("feedback_time", "TF", "s", Bound.NOT_NEGATIVE),
    Parameter("field_limiter_gain", "KLR", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("field_limit", "ILR", "p.u.", Bound.ANY),
)
DYR_COLUMNS: tuple[str | None, ...] = tuple(p.name for p in PARAMETERS)
AT_THE_OUTPUT = 2


@njit
def regulator(x, u, p, i, v_f):
    """VA of unit `i`, then the derivatives of measurement, both lead-lags and amplifier."""
    v_c, d_c = lag(u[VT, i], x[VC, i], p[TR, i])
    error = p[VREF, i] - v_c - v_f
    if p[VOS, i].real != AT_THE_OUTPUT:
        error = error + u[VS, i]
    v_i = clip(error, p[VIMIN, i], p[VIMAX, i])
    first, d_first = lead_lag(v_i, x[LEAD, i], p[TC, i], p[TB, i])
    second, d_second = lead_lag(first, x[LEAD_1, i], p[TC1, i], p[TB1, i])
    v_a, d_a = limited_lag(p[KA, i] * second, x[VA, i], p[TA, i], p[VAMIN, i], p[VAMAX, i])
    return v_a, d_c, d_first, d_second, d_a


def output(x, u, p, y, dx):
    """Regulator output less what the limiter takes and, within its limits, the field voltage.

    The rate feedback counts only where TA makes VA a state, see `check`.
    """
    for i in range(x.shape[1]):
        v_a, _, _, _, _ = regulator(x, u, p, i, 0.0 * x[VF, i])
        if p[VOS, i].real == AT_THE_OUTPUT:
            v_a = v_a + u[VS, i]
        excess = p[KLR, i] * (u[IFD, i] - p[ILR, i])
        y[AMPLIFIED, i] = v_a - excess if excess.real > 0 else v_a
        highest = u[SUPPLY, i] * p[VRMAX, i] - p[KC, i] * u[IFD, i]
        y[EFD, i] = clip(y[AMPLIFIED, i], u[SUPPLY, i] * p[VRMIN, i], highest)


def derivative(x, u, p, y, dx):
    """Measurement, rate feedback, lead-lags and amplifier."""
    for i in range(x.shape[1]):
        v_f, dx[VF, i] = rate_feedback(y[AMPLIFIED, i], x[VF, i], p[KF, i], p[TF, i])
        _, dx[VC, i], dx[LEAD, i], dx[LEAD_1, i], dx[VA, i] = regulator(x, u, p, i, v_f)


def guess(p: Values, known: Mapping[str, Any]) -> Mapping[str, Any]:
    """All equations are linear; the field voltage is prescribed."""
    return {"amplifier_voltage": known["field_voltage"]}


def codes(parameters: Mapping[str, float]) -> Iterable[str]:
    """VOS is a choice of two; a rate feedback needs a regulator that is a state."""
    if parameters["stabilizer_code"] not in (1, 2):
        yield f"stabilizer_code VOS {parameters['stabilizer_code']:g} is neither 1 nor 2"
    if parameters["regulator_time"] == 0 and parameters["feedback_gain"] > 0:
        yield "regulator_time TA is 0: feedback_gain KF has to be 0 then, or it is an algebraic loop"


ESST1A = Device(
    model="esst1a",
    title="IEEE type ST1A excitation system (PSS/E ESST1A)",
    role=Role.EXCITER,
    parameters=PARAMETERS,
    set_points=("voltage_reference",),
    states=(
        "measured_voltage",
        "lead_lag_state",
        "second_lead_lag_state",
        "amplifier_voltage",
        "feedback_state",
    ),
    inputs=("terminal_voltage", "stabilizer_signal", "field_current", "supply_voltage"),
    outputs=("regulated_voltage", "field_voltage"),
    output=output,
    derivative=derivative,
    targets=("field_voltage",),
    defaults={"stabilizer_signal": 0.0},
    guess=guess,
    check=checks(
        PARAMETERS,
        ordered=[
            ("error_minimum", "error_maximum"),
            ("amplifier_minimum", "amplifier_maximum"),
            ("regulator_minimum", "regulator_maximum"),
        ],
        proper=[
            ("lead_time", "lag_time"),
            ("second_lead_time", "second_lag_time"),
            ("feedback_gain", "feedback_time"),
        ],
        more=[codes],
    ),
    limits=(
        *limits("error_minimum", "error_maximum"),
        *limits("amplifier_minimum", "amplifier_maximum", state="amplifier_voltage"),
        *limits("regulator_minimum", "regulator_maximum"),
        Limit("field_limit", Side.HIGHEST),
    ),
    psse_record=DYR_COLUMNS,
)
