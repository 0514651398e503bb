"""ESST3A: IEEE type ST3A of 1992, a rectifier with an inner loop, fed by voltage and current.

    VI  = VREF + VS - VT / (1 + s TR)                                  VIMIN <= VI <= VIMAX
    VR  = KA / (1 + s TA) (1 + s TC) / (1 + s TB) VI                   VRMIN <= VR <= VRMAX
    VM  = KM / (1 + s TM) (VR - VG),  VG = KG EFD <= VGMAX             VMMIN <= VM <= VMMAX
    EFD = VM VB,  VB = VE FEX(KC IFD / VE) <= VBMAX
    VE  = | KP VT + j (KI + KP XL) IT |,  KP = |KP| exp(j THETAP)

Limits of the lags are non-windup. PSS/E Model Library; IEEE Std 421.5-1992, type ST3A. With
VT conj(IT) = P + j Q,

    VE^2 = |KP|^2 VT^2 + |KI + KP XL|^2 IT^2 + 2 |KP| (KI sin(THETAP) P + (KI cos(THETAP) + |KP| XL) Q)

so that no angle is needed; current and power are on the machine's base in it. IFD is on the base in
which it equals the field voltage in steady state. The gate for an underexcitation limiter has no
input here.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from numba import njit

from gridfold.dynamics.blocks import clip, lag, lead_lag, limited_lag
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
from gridfold.dynamics.exciters.rectifier import compound_voltage, rectified

TR, VIMAX, VIMIN, KM, TC, TB, KA, TA, VRMAX, VRMIN, KG, KP, KI, VBMAX, KC, XL = range(16)
VGMAX, THETAP, TM, VMMAX, VMMIN, BASE, VREF, BASE_SPEED = range(16, 24)
VC, LEAD, VR, VM = range(4)
VT, VS, IFD, P, Q, ID, IQ, SUPPLY = range(8)
REGULATED, VB, EFD = range(3)

DYR_COLUMNS: tuple[str | None, ...] = (
    "measuring_time",
    "error_maximum",
    "error_minimum",
    "inner_gain",
    "lead_time",
    "lag_time",
    "regulator_gain",
    "regulator_time",
    "regulator_maximum",
    "regulator_minimum",
    "inner_feedback_gain",
    "potential_gain",
    "current_gain",
    "source_maximum",
    "rectifier_loading",
    "source_reactance",
    "inner_feedback_maximum",
    "potential_angle",
    "inner_time",
    "inner_maximum",
    "inner_minimum",
)


@njit
def inner_voltage(v_r, x, v_b, k_m, t_m, k_g, v_gmax, lowest, highest):
    """VM; without a delay the solution of the inner loop, unique as its feedback is negative."""
    if t_m.real > 0:
        return clip(x, lowest, highest)
    v_m = k_m * v_r / (1.0 + k_m * k_g * v_b)
    if (k_g * v_m * v_b).real > v_gmax.real:
        v_m = k_m * (v_r - v_gmax)
    return clip(v_m, lowest, highest)


def output(x, u, p, y, dx):
    """Regulator output, rectified source voltage and field voltage."""
    for i in range(x.shape[1]):
        v_c, _ = lag(u[VT, i], x[VC, i], p[TR, i])
        v_i = clip(p[VREF, i] + u[VS, i] - v_c, p[VIMIN, i], p[VIMAX, i])
        lead, _ = lead_lag(v_i, x[LEAD, i], p[TC, i], p[TB, i])
        y[REGULATED, i], _ = limited_lag(
            p[KA, i] * lead, x[VR, i], p[TA, i], p[VRMIN, i], p[VRMAX, i]
        )
        base = p[BASE, i]
        v_e = compound_voltage(
            u[SUPPLY, i],
            u[P, i] / base,
            u[Q, i] / base,
            (u[ID, i] * u[ID, i] + u[IQ, i] * u[IQ, i]) / (base * base),
            p[KP, i],
            p[THETAP, i],
            p[KI, i],
            p[XL, i],
        )
        v_b = rectified(v_e, p[KC, i] * u[IFD, i])
        y[VB, i] = p[VBMAX, i] if v_b.real > p[VBMAX, i].real else v_b
        v_m = inner_voltage(
            y[REGULATED, i],
            x[VM, i],
            y[VB, i],
            p[KM, i],
            p[TM, i],
            p[KG, i],
            p[VGMAX, i],
            p[VMMIN, i],
            p[VMMAX, i],
        )
        y[EFD, i] = v_m * y[VB, i]


def derivative(x, u, p, y, dx):
    """Measurement, lead-lag, regulator and inner loop."""
    for i in range(x.shape[1]):
        v_c, dx[VC, i] = lag(u[VT, i], x[VC, i], p[TR, i])
        v_i = clip(p[VREF, i] + u[VS, i] - v_c, p[VIMIN, i], p[VIMAX, i])
        lead, dx[LEAD, i] = lead_lag(v_i, x[LEAD, i], p[TC, i], p[TB, i])
        _, dx[VR, i] = limited_lag(p[KA, i] * lead, x[VR, i], p[TA, i], p[VRMIN, i], p[VRMAX, i])
        v_g = p[KG, i] * y[EFD, i]
        if v_g.real > p[VGMAX, i].real:
            v_g = p[VGMAX, i]
        demand = p[KM, i] * (y[REGULATED, i] - v_g)
        _, dx[VM, i] = limited_lag(demand, x[VM, i], p[TM, i], p[VMMIN, i], p[VMMAX, i])


def guess(p: Values, known: Mapping[str, Any]) -> Mapping[str, Any]:
    """All equations are linear as the source voltage is known."""
    return {"inner_voltage": known["field_voltage"]}


def check(parameters: Mapping[str, float]) -> Iterable[str]:
    """Blocks that do not exist, limits that cross, a source that gives nothing."""
    if parameters["lag_time"] == 0 and parameters["lead_time"] > 0:
        yield "lag_time TB is 0 but lead_time TC is not: that is no lead-lag block"
    if parameters["potential_gain"] == 0 and parameters["current_gain"] == 0:
        yield "potential_gain KP and current_gain KI are both 0: the rectifier has no source"
    pairs = (("error", "VI"), ("regulator", "VR"), ("inner", "VM"))
    for name, symbol in pairs:
        if parameters[f"{name}_minimum"] > parameters[f"{name}_maximum"]:
            yield f"{name}_minimum {symbol}MIN is above {name}_maximum {symbol}MAX"


ESST3A = Device(
    model="esst3a",
    title="IEEE type ST3A excitation system (PSS/E ESST3A)",
    role=Role.EXCITER,
    parameters=(
        Parameter("measuring_time", "TR", "s", Bound.NOT_NEGATIVE),
        Parameter("error_maximum", "VIMAX", "p.u.", Bound.ANY),
        Parameter("error_minimum", "VIMIN", "p.u.", Bound.ANY),
        Parameter("inner_gain", "KM", "p.u."),
        Parameter("lead_time", "TC", "s", Bound.NOT_NEGATIVE),
        Parameter("lag_time", "TB", "s", Bound.NOT_NEGATIVE),
        Parameter("regulator_gain", "KA", "p.u."),
        Parameter("regulator_time", "TA", "s", Bound.NOT_NEGATIVE),
        Parameter("regulator_maximum", "VRMAX", "p.u.", Bound.ANY),
        Parameter("regulator_minimum", "VRMIN", "p.u.", Bound.ANY),
        Parameter("inner_feedback_gain", "KG", "p.u.", Bound.NOT_NEGATIVE),
        Parameter("potential_gain", "KP", "p.u.", Bound.NOT_NEGATIVE),
        Parameter("current_gain", "KI", "p.u.", Bound.NOT_NEGATIVE),
        Parameter("source_maximum", "VBMAX", "p.u."),
        Parameter("rectifier_loading", "KC", "p.u.", Bound.NOT_NEGATIVE),
        Parameter("source_reactance", "XL", "p.u.", Bound.NOT_NEGATIVE),
        Parameter("inner_feedback_maximum", "VGMAX", "p.u.", Bound.ANY),
        Parameter("potential_angle", "THETAP", "deg", Bound.ANY),
        Parameter("inner_time", "TM", "s", Bound.NOT_NEGATIVE),
        Parameter("inner_maximum", "VMMAX", "p.u.", Bound.ANY),
        Parameter("inner_minimum", "VMMIN", "p.u.", Bound.ANY),
        Parameter("power_base", "MBASE/SBASE", "p.u.", scaling=Scaling.POWER, default=1.0),
    ),
    set_points=("voltage_reference",),
    states=("measured_voltage", "lead_lag_state", "regulator_voltage", "inner_voltage"),
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
    outputs=("regulated_voltage", "source_voltage", "field_voltage"),
    output=output,
    derivative=derivative,
    targets=("field_voltage",),
    defaults={"stabilizer_signal": 0.0},
    guess=guess,
    check=check,
    limits=(
        *limits("error_minimum", "error_maximum"),
        *limits("regulator_minimum", "regulator_maximum", state="regulator_voltage"),
        *limits("inner_minimum", "inner_maximum", state="inner_voltage"),
        Limit("source_maximum", Side.HIGHEST),
        Limit("inner_feedback_maximum", Side.HIGHEST),
    ),
    psse_record=DYR_COLUMNS,
)
