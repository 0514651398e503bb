"""ST6B: IEEE type ST6B of 2005, a rectifier with a PID regulator and an inner loop.

    VA  = (KPA + KIA / s + s KDA / (1 + s TDA)) (VREF + VS - VT / (1 + s TR)),   VAMIN <= VA <= VAMAX
    VM  = KFF VA + KM (VA - KG / (1 + s TG) EFD),                                VRMIN <= VM <= VRMAX
    VI  = KLR (KCI ILR - IFD),  not below VRMIN
    EFD = VT times the lower of VM and VI

The integral stands where it would lead VA further out. KLR = 0 means that there is no VI. An
overexcitation limiter has no input here, whatever OEL says. PSS/E Model Library; IEEE Std 421.5-2005,
type ST6B.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from numba import njit

from gridfold.dynamics.blocks import clip, higher, lag, limited_pid, lower
from gridfold.dynamics.checks import checks
from gridfold.dynamics.device import Bound, Device, Limit, Parameter, Role, Side, Values, limits
from gridfold.dynamics.exciters.pid import gains, some_gain

(
    OEL, TR, KPA, KIA, KDA, TDA, VAMAX, VAMIN, KFF, KM, KCI, KLR, ILR, VRMAX, VRMIN, KG, TG,
    VREF, BASE_SPEED,
) = range(19)  # fmt: skip
VC, INTEGRAL, DIFFERENCE, VG = range(4)
VT, VS, IFD, SUPPLY = range(4)
EFD = 0

PARAMETERS = (
    Parameter("limiter_code", "OEL", "-", Bound.ANY),
    Parameter("measuring_time", "TR", "s", Bound.NOT_NEGATIVE),
    *gains("A"),
    Parameter("amplifier_maximum", "VAMAX", "p.u.", Bound.ANY),
    Parameter("amplifier_minimum", "VAMIN", "p.u.", Bound.ANY),
    Parameter("forward_gain", "KFF", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("inner_gain", "KM", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("field_limit_gain", "KCI", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("field_limiter_gain", "KLR", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("field_limit", "ILR", "p.u.", Bound.ANY),
    Parameter("regulator_maximum", "VRMAX", "p.u.", Bound.ANY),
    Parameter("regulator_minimum", "VRMIN", "p.u.", Bound.ANY),
    Parameter("inner_feedback_gain", "KG", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("inner_feedback_time", "TG", "s", Bound.NOT_NEGATIVE),
)
DYR_COLUMNS: tuple[str | None, ...] = tuple(p.name for p in PARAMETERS)


@njit
def regulator(x, u, p, i):
    """VA of unit `i`, then the derivatives of measurement, integral and difference."""
    v_c, d_c = lag(u[VT, i], x[VC, i], p[TR, i])
    v_a, d_integral, d_difference = limited_pid(
        p[VREF, i] + u[VS, i] - v_c, x[INTEGRAL, i], x[DIFFERENCE, i],
        p[KPA, i], p[KIA, i], p[KDA, i], p[TDA, i], p[VAMIN, i], p[VAMAX, i],
    )  # fmt: skip
    return v_a, d_c, d_integral, d_difference


def output(x, u, p, y, dx):
    """Field voltage; without a delay TG the inner loop is solved, its feedback being negative."""
    for i in range(x.shape[1]):
        v_a, _, _, _ = regulator(x, u, p, i)
        forward = (p[KFF, i] + p[KM, i]) * v_a
        if p[TG, i].real > 0:
            v_m = forward - p[KM, i] * x[VG, i]
        else:
            v_m = forward / (1.0 + p[KM, i] * p[KG, i] * u[SUPPLY, i])
        v_m = clip(v_m, p[VRMIN, i], p[VRMAX, i])
        if p[KLR, i].real > 0:
            v_i = p[KLR, i] * (p[KCI, i] * p[ILR, i] - u[IFD, i])
            v_m = lower(v_m, higher(v_i, p[VRMIN, i]))
        y[EFD, i] = u[SUPPLY, i] * v_m


def derivative(x, u, p, y, dx):
    """Measurement, PID and inner feedback."""
    for i in range(x.shape[1]):
        _, dx[VC, i], dx[INTEGRAL, i], dx[DIFFERENCE, i] = regulator(x, u, p, i)
        _, dx[VG, i] = lag(p[KG, i] * y[EFD, i], x[VG, i], p[TG, i])


def guess(p: Values, known: Mapping[str, Any]) -> Mapping[str, Any]:
    """All equations are linear; the field voltage is prescribed."""
    return {"inner_feedback": p["inner_feedback_gain"] * known["field_voltage"]}


def forward(parameters: Mapping[str, float]) -> Iterable[str]:
    """A regulator that reaches the rectifier."""
    if parameters["forward_gain"] == 0 and parameters["inner_gain"] == 0:
        yield "forward_gain KFF and inner_gain KM are both 0: nothing drives the rectifier"


ST6B = Device(
    model="st6b",
    title="IEEE type ST6B excitation system (PSS/E ST6B)",
    role=Role.EXCITER,
    parameters=PARAMETERS,
    set_points=("voltage_reference",),
    states=("measured_voltage", "regulator_integral", "regulator_difference", "inner_feedback"),
    inputs=("terminal_voltage", "stabilizer_signal", "field_current", "supply_voltage"),
    outputs=("field_voltage",),
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
        ],
        proper=[("derivative_gain", "derivative_time")],
        more=[some_gain, forward],
    ),
    limits=(
        *limits("amplifier_minimum", "amplifier_maximum"),
        *limits("regulator_minimum", "regulator_maximum"),
        Limit("field_limit", Side.HIGHEST),
    ),
    psse_record=DYR_COLUMNS,
)
