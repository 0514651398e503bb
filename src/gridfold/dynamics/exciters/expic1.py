"""EXPIC1: a PI regulator with a rectifier that is fed by voltage and current, and an exciter.

    VA  = KA (1 + s TA1) / s (VREF + VS - VT / (1 + s TR) - VF)         VR2 <= VA <= VR1
    VR  = (1 + s TA3) / ((1 + s TA2) (1 + s TA4)) VA                    within VRMIN and VRMAX
    VF  = s KF / ((1 + s TF1) (1 + s TF2)) VR
    E0  = VR VB                                                         within EFDMIN and EFDMAX
    EFD = E0 / (KE + SE(EFD) + s TE), or E0 where TE = 0
    VB  = VE FEX(KC IFD / VE),  VE = | KP VT + j KI IT |, or VB = 1 where KP = KI = 0

The integral of the regulator stands where it would lead its output further out; the other limits are
windup limits. PSS/E Model Library, EXPIC1. The source as in ESST3A, on the machine's base.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numba import njit

from gridfold.dynamics.blocks import (
    clip,
    lag,
    lead_lag,
    limited_pi,
    quadratic_saturation,
    rate_feedback,
)
from gridfold.dynamics.checks import checks
from gridfold.dynamics.device import Bound, Device, Parameter, Role, Scaling, Values, limits
from gridfold.dynamics.exciters import ac_alternator
from gridfold.dynamics.exciters.dc_commutator import saturation_faults
from gridfold.dynamics.exciters.rectifier import compound_voltage, rectified

(
    TR, KA, TA1, VR1, VR2, TA2, TA3, TA4, VRMAX, VRMIN, KF, TF1, TF2, EFDMAX, EFDMIN, KE, TE,
    E1, SE1, E2, SE2, KP, KI, KC, BASE, VREF, BASE_SPEED,
) = range(27)  # fmt: skip
VC, INTEGRAL, FIRST, SECOND, VF1, VF2, VE = range(7)
VT, VS, IFD, P, Q, ID, IQ, SUPPLY = range(8)
REGULATED, LIMITED, EFD = range(3)

PARAMETERS = (
    ac_alternator.MEASURING,
    Parameter("regulator_gain", "KA", "1/s"),
    Parameter("regulator_lead_time", "TA1", "s", Bound.NOT_NEGATIVE),
    Parameter("amplifier_maximum", "VR1", "p.u.", Bound.ANY),
    Parameter("amplifier_minimum", "VR2", "p.u.", Bound.ANY),
    Parameter("filter_time_1", "TA2", "s", Bound.NOT_NEGATIVE),
    Parameter("filter_lead_time", "TA3", "s", Bound.NOT_NEGATIVE),
    Parameter("filter_time_2", "TA4", "s", Bound.NOT_NEGATIVE),
    Parameter("regulator_maximum", "VRMAX", "p.u.", Bound.ANY),
    Parameter("regulator_minimum", "VRMIN", "p.u.", Bound.ANY),
    Parameter("feedback_gain", "KF", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("feedback_time", "TF1", "s", Bound.NOT_NEGATIVE),
    Parameter("second_feedback_time", "TF2", "s", Bound.NOT_NEGATIVE),
    Parameter("field_voltage_maximum", "EFDMAX", "p.u.", Bound.ANY),
    Parameter("field_voltage_minimum", "EFDMIN", "p.u.", Bound.ANY),
    Parameter("exciter_gain", "KE", "p.u.", Bound.ANY),
    Parameter("exciter_time", "TE", "s", Bound.NOT_NEGATIVE),
    *ac_alternator.SATURATION,
    Parameter("potential_gain", "KP", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("current_gain", "KI", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("rectifier_loading", "KC", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("power_base", "MBASE/SBASE", "p.u.", scaling=Scaling.POWER, default=1.0),
)
DYR_COLUMNS: tuple[str | None, ...] = tuple(p.name for p in PARAMETERS[:-1])


@njit
def two_lags(value, x_1, x_2, lead, time_1, time_2):
    """(1 + s T3) / ((1 + s T2) (1 + s T4)) and the derivatives of both states.

    The lead stands over the second lag, or over the first where the second is none.
    """
    if time_2.real > 0:
        late, rate_1 = lag(value, x_1, time_1)
        out, rate_2 = lead_lag(late, x_2, lead, time_2)
    else:
        out, rate_1 = lead_lag(value, x_1, lead, time_1)
        rate_2 = out - x_2
    return out, rate_1, rate_2


@njit
def amplified(x, u, p, i):
    """VR of unit `i` within its limits; its feedback VF is a state, as `check` sees to it."""
    v_c, _ = lag(u[VT, i], x[VC, i], p[TR, i])
    error = p[VREF, i] + u[VS, i] - v_c - x[VF2, i]
    v_a, _ = limited_pi(error, x[INTEGRAL, i], p[KA, i] * p[TA1, i], p[KA, i], p[VR2, i], p[VR1, i])
    v_r, _, _ = two_lags(v_a, x[FIRST, i], x[SECOND, i], p[TA3, i], p[TA2, i], p[TA4, i])
    return clip(v_r, p[VRMIN, i], p[VRMAX, i])


def output(x, u, p, y, dx):
    """Regulator output, exciter input and field voltage."""
    for i in range(x.shape[1]):
        y[REGULATED, i] = amplified(x, u, p, i)
        v_b = 1.0 + 0.0 * u[SUPPLY, i]
        if p[KP, i].real > 0 or p[KI, i].real > 0:
            base = p[BASE, i]
            squared = (u[ID, i] * u[ID, i] + u[IQ, i] * u[IQ, i]) / (base * base)
            none = 0.0 * base
            v_e = compound_voltage(
                u[SUPPLY, i],
                u[P, i] / base,
                u[Q, i] / base,
                squared,
                p[KP, i],
                none,
                p[KI, i],
                none,
            )
            v_b = rectified(v_e, p[KC, i] * u[IFD, i])
        y[LIMITED, i] = clip(y[REGULATED, i] * v_b, p[EFDMIN, i], p[EFDMAX, i])
        y[EFD, i] = x[VE, i] if p[TE, i].real > 0 else y[LIMITED, i]


def derivative(x, u, p, y, dx):
    """Measurement, rate feedback, regulator and exciter."""
    for i in range(x.shape[1]):
        v_c, dx[VC, i] = lag(u[VT, i], x[VC, i], p[TR, i])
        first, dx[VF1, i] = rate_feedback(y[REGULATED, i], x[VF1, i], p[KF, i], p[TF1, i])
        feedback_time = p[TF2, i] if p[TF2, i].real > 0 else 1.0 + 0.0 * p[TF2, i]
        dx[VF2, i] = (first - x[VF2, i]) / feedback_time
        error = p[VREF, i] + u[VS, i] - v_c - x[VF2, i]
        v_a, dx[INTEGRAL, i] = limited_pi(
            error, x[INTEGRAL, i], p[KA, i] * p[TA1, i], p[KA, i], p[VR2, i], p[VR1, i]
        )
        _, dx[FIRST, i], dx[SECOND, i] = two_lags(
            v_a, x[FIRST, i], x[SECOND, i], p[TA3, i], p[TA2, i], p[TA4, i]
        )
        if p[TE, i].real > 0:
            excess = quadratic_saturation(x[VE, i], p[E1, i], p[SE1, i], p[E2, i], p[SE2, i])
            dx[VE, i] = (y[LIMITED, i] - p[KE, i] * x[VE, i] - excess) / p[TE, i]
        else:
            dx[VE, i] = y[LIMITED, i] - x[VE, i]


def guess(p: Values, known: Mapping[str, Any]) -> Mapping[str, Any]:
    """The field voltage is prescribed, the source is known, and the rest is linear."""
    field = known["field_voltage"]
    return {"exciter_voltage": field, "regulator_integral": np.ones_like(field)}


def blocks(parameters: Mapping[str, float]) -> Iterable[str]:
    """Leads without a lag, and a feedback without delay."""
    if (
        parameters["filter_time_1"] + parameters["filter_time_2"] == 0
        and parameters["filter_lead_time"] != 0
    ):
        yield "TA2 and TA4 are 0: filter_lead_time TA3 has to be 0 then"
    if parameters["feedback_gain"] > 0:
        for name, symbol in (("feedback_time", "TF1"), ("second_feedback_time", "TF2")):
            if parameters[name] == 0:
                yield f"{name} {symbol} is 0: feedback_gain KF has to be 0 then"


EXPIC1 = Device(
    model="expic1",
    title="proportional-integral excitation system (PSS/E EXPIC1)",
    role=Role.EXCITER,
    parameters=PARAMETERS,
    set_points=("voltage_reference",),
    states=(
        "measured_voltage",
        "regulator_integral",
        "filter_state_1",
        "filter_state_2",
        "feedback_state",
        "feedback_voltage",
        "exciter_voltage",
    ),
    inputs=(
        "terminal_voltage",
        "stabilizer_signal",
        "field_current",
        "active_power",
        "reactive_power",
        "d_current",
        "q_current",
        "supply_voltage",
    ),
    outputs=("regulated_voltage", "exciter_input", "field_voltage"),
    output=output,
    derivative=derivative,
    targets=("field_voltage",),
    defaults={"stabilizer_signal": 0.0},
    guess=guess,
    check=checks(
        PARAMETERS,
        ordered=[
            ("amplifier_minimum", "amplifier_maximum"),
            ("regulator_minimum", "regulator_maximum"),
            ("field_voltage_minimum", "field_voltage_maximum"),
        ],
        more=[blocks, saturation_faults],
    ),
    limits=(
        *limits("amplifier_minimum", "amplifier_maximum"),
        *limits("regulator_minimum", "regulator_maximum"),
        *limits("field_voltage_minimum", "field_voltage_maximum"),
    ),
    psse_record=DYR_COLUMNS,
)
