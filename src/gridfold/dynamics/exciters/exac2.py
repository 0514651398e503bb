"""EXAC2: IEEE type AC2 of 1981, a high-initial-response alternator with a limit of its field current.

    VF  = s KF / (1 + s TF) VFE
    VA  = KA / (1 + s TA) (1 + s TC) / (1 + s TB) (VREF + VS - VT / (1 + s TR) - VF)
    VL  = KL (VLR - VFE)
    VR  = KB times the lower of VA - KH VFE and VL, within VRMIN and VRMAX

with VAMIN <= VA <= VAMAX, non-windup; alternator and rectifier as in
:mod:`~gridfold.dynamics.exciters.ac_alternator`. PSS/E Model Library; IEEE Committee Report, Excitation
System Models for Power System Stability Studies, 1981.
"""

from __future__ import annotations

from gridfold.dynamics.blocks import clip, lag, lead_lag, limited_lag, lower, rate_feedback
from gridfold.dynamics.checks import checks
from gridfold.dynamics.device import Bound, Device, Limit, Parameter, Role, Side, limits
from gridfold.dynamics.exciters import ac_alternator
from gridfold.dynamics.exciters.ac_alternator import demand_and_field, exciter_rate
from gridfold.dynamics.exciters.dc_commutator import saturation_faults

(
    TR, TB, TC, KA, TA, VAMAX, VAMIN, KB, VRMAX, VRMIN, TE, KL, KH, KF, TF, KC, KD, KE, VLR,
    E1, SE1, E2, SE2, VEMIN, VREF, BASE_SPEED,
) = range(26)  # fmt: skip
VC, LEAD, VA, VF, VE = range(5)
VT, VS, IFD = range(3)
VFE, EFD = range(2)

PARAMETERS = (
    ac_alternator.MEASURING,
    *ac_alternator.COMPENSATOR,
    *ac_alternator.AMPLIFIER,
    Parameter("amplifier_maximum", "VAMAX", "p.u.", Bound.ANY),
    Parameter("amplifier_minimum", "VAMIN", "p.u.", Bound.ANY),
    Parameter("second_gain", "KB", "p.u."),
    Parameter("regulator_maximum", "VRMAX", "p.u.", Bound.ANY),
    Parameter("regulator_minimum", "VRMIN", "p.u.", Bound.ANY),
    ac_alternator.EXCITER_TIME,
    Parameter("field_limiter_gain", "KL", "p.u."),
    Parameter("field_feedback_gain", "KH", "p.u.", Bound.NOT_NEGATIVE),
    *ac_alternator.FEEDBACK,
    *ac_alternator.LOADING,
    Parameter("field_limit", "VLR", "p.u.", Bound.ANY),
    *ac_alternator.SATURATION,
    ac_alternator.LOWEST,
)
DYR_COLUMNS: tuple[str | None, ...] = tuple(p.name for p in PARAMETERS[:-1])


def output(x, u, p, y, dx):
    """What the alternator takes of its own field, and the field voltage."""
    for i in range(x.shape[1]):
        y[VFE, i], y[EFD, i] = demand_and_field(
            x[VE, i], p[VEMIN, i], u[IFD, i], p[KC, i], p[KD, i], p[KE, i],
            p[E1, i], p[SE1, i], p[E2, i], p[SE2, i],
        )  # fmt: skip


def derivative(x, u, p, y, dx):
    """Measurement, rate feedback, lead-lag, amplifier, gate and alternator."""
    for i in range(x.shape[1]):
        v_c, dx[VC, i] = lag(u[VT, i], x[VC, i], p[TR, i])
        v_f, dx[VF, i] = rate_feedback(y[VFE, i], x[VF, i], p[KF, i], p[TF, i])
        error = p[VREF, i] + u[VS, i] - v_c - v_f
        lead, dx[LEAD, i] = lead_lag(error, x[LEAD, i], p[TC, i], p[TB, i])
        v_a, dx[VA, i] = limited_lag(p[KA, i] * lead, x[VA, i], p[TA, i], p[VAMIN, i], p[VAMAX, i])
        v_l = p[KL, i] * (p[VLR, i] - y[VFE, i])
        gated = lower(v_a - p[KH, i] * y[VFE, i], v_l)
        v_r = clip(p[KB, i] * gated, p[VRMIN, i], p[VRMAX, i])
        dx[VE, i] = exciter_rate(v_r, y[VFE, i], x[VE, i], p[TE, i], p[VEMIN, i])


EXAC2 = Device(
    model="exac2",
    title="IEEE type AC2 excitation system (PSS/E EXAC2)",
    role=Role.EXCITER,
    parameters=PARAMETERS,
    set_points=("voltage_reference",),
    states=(
        "measured_voltage",
        "lead_lag_state",
        "amplifier_voltage",
        "feedback_state",
        "exciter_voltage",
    ),
    inputs=ac_alternator.INPUTS,
    outputs=("exciter_demand", "field_voltage"),
    output=output,
    derivative=derivative,
    targets=("field_voltage",),
    defaults=ac_alternator.DEFAULTS,
    guess=ac_alternator.guess,
    check=checks(
        PARAMETERS,
        ordered=[
            ("amplifier_minimum", "amplifier_maximum"),
            ("regulator_minimum", "regulator_maximum"),
        ],
        proper=[("lead_time", "lag_time"), ("feedback_gain", "feedback_time")],
        more=[saturation_faults],
    ),
    limits=(
        *limits("amplifier_minimum", "amplifier_maximum", state="amplifier_voltage"),
        *limits("regulator_minimum", "regulator_maximum"),
        Limit("field_limit", Side.HIGHEST),
        ac_alternator.LOWEST_LIMIT,
    ),
    psse_record=DYR_COLUMNS,
)
