"""ESST4B: IEEE type ST4B of 2005, a rectifier with two PI regulators, fed by voltage and current.

    VR  = (KPR + KIR / s) (VREF + VS - VT / (1 + s TR))                VRMIN <= VR <= VRMAX
    VM  = (KPM + KIM / s) (VR / (1 + s TA) - KG EFD)                   VMMIN <= VM <= VMMAX
    EFD = VM VB,  VB = VE FEX(KC IFD / VE) <= VBMAX
    VE  = | KP VT + j (KI + KP XL) IT |,  KP = |KP| exp(j THETAP)

An integral stands where it would lead its regulator's output further beyond a limit. The loop through
KPM and KG has no delay; it is solved. VBMAX may hold at the start, VM makes up for it. PSS/E Model
Library; IEEE Std 421.5-2005, type ST4B. VE as in ESST3A, on the machine's base. The gate for an
overexcitation limiter has no input here.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from numba import njit

from gridfold.dynamics.blocks import clip, held, lag, limited_pi, lower
from gridfold.dynamics.checks import checks
from gridfold.dynamics.device import (
    Bound,
    Device,
    Parameter,
    Role,
    Scaling,
    Values,
    limits,
)
from gridfold.dynamics.exciters.rectifier import compound_voltage, rectified

(
    TR, KPR, KIR, VRMAX, VRMIN, TA, KPM, KIM, VMMAX, VMMIN, KG, KP, KI, VBMAX, KC, XL, THETAP, BASE,
    VREF, BASE_SPEED,
) = range(20)  # fmt: skip
VC, OUTER, VA, INNER = range(4)
VT, VS, IFD, P, Q, ID, IQ, SUPPLY = range(8)
VB, EFD = range(2)

PARAMETERS = (
    Parameter("measuring_time", "TR", "s", Bound.NOT_NEGATIVE),
    Parameter("proportional_gain", "KPR", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("integral_gain", "KIR", "1/s", Bound.NOT_NEGATIVE),
    Parameter("regulator_maximum", "VRMAX", "p.u.", Bound.ANY),
    Parameter("regulator_minimum", "VRMIN", "p.u.", Bound.ANY),
    Parameter("regulator_time", "TA", "s", Bound.NOT_NEGATIVE),
    Parameter("inner_proportional_gain", "KPM", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("inner_integral_gain", "KIM", "1/s", Bound.NOT_NEGATIVE),
    Parameter("inner_maximum", "VMMAX", "p.u.", Bound.ANY),
    Parameter("inner_minimum", "VMMIN", "p.u.", Bound.ANY),
    Parameter("inner_feedback_gain", "KG", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("potential_gain", "KP", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("current_gain", "KI", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("source_maximum", "VBMAX", "p.u."),
    Parameter("rectifier_loading", "KC", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("source_reactance", "XL", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("potential_angle", "THETAP", "deg", Bound.ANY),
    Parameter("power_base", "MBASE/SBASE", "p.u.", scaling=Scaling.POWER, default=1.0),
)
DYR_COLUMNS: tuple[str | None, ...] = tuple(p.name for p in PARAMETERS[:-1])


@njit
def inner_voltage(v_a, x, v_b, k_pm, k_g, lowest, highest):
    """VM, the solution of the inner loop; its feedback is negative, so there is one."""
    return clip((k_pm * v_a + x) / (1.0 + k_pm * k_g * v_b), lowest, highest)


def output(x, u, p, y, dx):
    """Rectified source voltage and field voltage."""
    for i in range(x.shape[1]):
        base = p[BASE, i]
        squared = (u[ID, i] * u[ID, i] + u[IQ, i] * u[IQ, i]) / (base * base)
        v_e = compound_voltage(
            u[SUPPLY, i], u[P, i] / base, u[Q, i] / base, squared,
            p[KP, i], p[THETAP, i], p[KI, i], p[XL, i],
        )  # fmt: skip
        y[VB, i] = lower(rectified(v_e, p[KC, i] * u[IFD, i]), p[VBMAX, i])
        v_c, _ = lag(u[VT, i], x[VC, i], p[TR, i])
        error = p[VREF, i] + u[VS, i] - v_c
        v_r, _ = limited_pi(error, x[OUTER, i], p[KPR, i], p[KIR, i], p[VRMIN, i], p[VRMAX, i])
        v_a, _ = lag(v_r, x[VA, i], p[TA, i])
        v_m = inner_voltage(
            v_a, x[INNER, i], y[VB, i], p[KPM, i], p[KG, i], p[VMMIN, i], p[VMMAX, i]
        )
        y[EFD, i] = v_m * y[VB, i]


def derivative(x, u, p, y, dx):
    """Measurement and both regulators."""
    for i in range(x.shape[1]):
        v_c, dx[VC, i] = lag(u[VT, i], x[VC, i], p[TR, i])
        error = p[VREF, i] + u[VS, i] - v_c
        v_r, dx[OUTER, i] = limited_pi(
            error, x[OUTER, i], p[KPR, i], p[KIR, i], p[VRMIN, i], p[VRMAX, i]
        )
        v_a, dx[VA, i] = lag(v_r, x[VA, i], p[TA, i])
        behind = v_a - p[KG, i] * y[EFD, i]
        if p[KIM, i].real > 0:
            wanted = p[KPM, i] * behind + x[INNER, i]
            dx[INNER, i] = held(p[KIM, i] * behind, wanted, p[VMMIN, i], p[VMMAX, i])
        else:
            dx[INNER, i] = -x[INNER, i]


def guess(p: Values, known: Mapping[str, Any]) -> Mapping[str, Any]:
    """All equations are linear as the source voltage is known."""
    return {}


def gains(parameters: Mapping[str, float]) -> Iterable[str]:
    """Regulators that regulate, a source that gives something."""
    if parameters["proportional_gain"] == 0 and parameters["integral_gain"] == 0:
        yield "proportional_gain KPR and integral_gain KIR are both 0: nothing holds the voltage"
    if parameters["inner_proportional_gain"] == 0 and parameters["inner_integral_gain"] == 0:
        yield "inner_proportional_gain KPM and inner_integral_gain KIM are both 0: nothing drives it"
    if parameters["potential_gain"] == 0 and parameters["current_gain"] == 0:
        yield "potential_gain KP and current_gain KI are both 0: the rectifier has no source"


ESST4B = Device(
    model="esst4b",
    title="IEEE type ST4B excitation system (PSS/E ESST4B)",
    role=Role.EXCITER,
    parameters=PARAMETERS,
    set_points=("voltage_reference",),
    states=("measured_voltage", "regulator_integral", "regulator_voltage", "inner_integral"),
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
    outputs=("source_voltage", "field_voltage"),
    output=output,
    derivative=derivative,
    targets=("field_voltage",),
    defaults={"stabilizer_signal": 0.0},
    guess=guess,
    check=checks(
        PARAMETERS,
        ordered=[
            ("regulator_minimum", "regulator_maximum"),
            ("inner_minimum", "inner_maximum"),
        ],
        more=[gains],
    ),
    limits=(
        *limits("regulator_minimum", "regulator_maximum"),
        *limits("inner_minimum", "inner_maximum"),
    ),
    psse_record=DYR_COLUMNS,
)
