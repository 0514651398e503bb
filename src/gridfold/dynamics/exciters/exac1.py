"""EXAC1: IEEE type AC1 of 1981, an alternator with uncontrolled rectifiers and rate feedback.

    VF  = s KF / (1 + s TF) VFE
    VR  = KA / (1 + s TA) (1 + s TC) / (1 + s TB) (VREF + VS - VT / (1 + s TR) - VF)

with VRMIN <= VR <= VRMAX, non-windup; alternator and rectifier as in
:mod:`~gridfold.dynamics.exciters.ac_alternator`. PSS/E Model Library; IEEE Committee Report, Excitation
System Models for Power System Stability Studies, 1981.
"""

from __future__ import annotations

from gridfold.dynamics.blocks import lag, lead_lag, limited_lag, rate_feedback
from gridfold.dynamics.checks import checks
from gridfold.dynamics.device import Bound, Device, Parameter, Role, limits
from gridfold.dynamics.exciters import ac_alternator
from gridfold.dynamics.exciters.ac_alternator import demand_and_field, exciter_rate
from gridfold.dynamics.exciters.dc_commutator import saturation_faults

(
    TR, TB, TC, KA, TA, VRMAX, VRMIN, TE, KF, TF, KC, KD, KE, E1, SE1, E2, SE2,
    VEMIN, VREF, BASE_SPEED,
) = range(20)  # fmt: skip
VC, LEAD, VR, VF, VE = range(5)
VT, VS, IFD = range(3)
VFE, EFD = range(2)

PARAMETERS = (
    ac_alternator.MEASURING,
    *ac_alternator.COMPENSATOR,
    *ac_alternator.AMPLIFIER,
    Parameter("regulator_maximum", "VRMAX", "p.u.", Bound.ANY),
    Parameter("regulator_minimum", "VRMIN", "p.u.", Bound.ANY),
    ac_alternator.EXCITER_TIME,
    *ac_alternator.FEEDBACK,
    *ac_alternator.LOADING,
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
    """Measurement, rate feedback, lead-lag, regulator and alternator."""
    for i in range(x.shape[1]):
        v_c, dx[VC, i] = lag(u[VT, i], x[VC, i], p[TR, i])
        v_f, dx[VF, i] = rate_feedback(y[VFE, i], x[VF, i], p[KF, i], p[TF, i])
        error = p[VREF, i] + u[VS, i] - v_c - v_f
        lead, dx[LEAD, i] = lead_lag(error, x[LEAD, i], p[TC, i], p[TB, i])
        v_r, dx[VR, i] = limited_lag(p[KA, i] * lead, x[VR, i], p[TA, i], p[VRMIN, i], p[VRMAX, i])
        dx[VE, i] = exciter_rate(v_r, y[VFE, i], x[VE, i], p[TE, i], p[VEMIN, i])


EXAC1 = Device(
    model="exac1",
    title="IEEE type AC1 excitation system (PSS/E EXAC1)",
    role=Role.EXCITER,
    parameters=PARAMETERS,
    set_points=("voltage_reference",),
    states=(
        "measured_voltage",
        "lead_lag_state",
        "regulator_voltage",
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
        ordered=[("regulator_minimum", "regulator_maximum")],
        proper=[("lead_time", "lag_time"), ("feedback_gain", "feedback_time")],
        more=[saturation_faults],
    ),
    limits=(
        *limits("regulator_minimum", "regulator_maximum", state="regulator_voltage"),
        ac_alternator.LOWEST_LIMIT,
    ),
    psse_record=DYR_COLUMNS,
)
