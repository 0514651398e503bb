"""IEEET2: IEEE type-2 excitation system of 1968, whose rate feedback is that of the regulator.

    VR  = KA / (1 + s TA) (VREF + VS - VT / (1 + s TR) - VF)
    VF  = s KF / ((1 + s TF1) (1 + s TF2)) VR
    EFD = (VR - (KE + SE(EFD)) EFD) / (s TE)

with VRMIN <= VR <= VRMAX, non-windup. PSS/E Model Library; IEEE Committee Report, Computer
Representation of Excitation Systems, 1968. The field of a rotating rectifier cannot be measured; so the
feedback, with a second lag in the place of the exciter's, is taken from the regulator. For KE = 0,
VRMAX = 0 and the start see ``gridfold.dynamics.exciters.dc_commutator``.
"""

from __future__ import annotations

from gridfold.dynamics.blocks import lag, limited_lag, rate_feedback
from gridfold.dynamics.checks import checks
from gridfold.dynamics.device import Bound, Device, Parameter, Role
from gridfold.dynamics.exciters import dc_commutator
from gridfold.dynamics.exciters.dc_commutator import exciter_rate, start_condition

(
    TR, KA, TA, VRMAX, VRMIN, KE, TE, KF, TF, TF2, E1, SE1, E2, SE2, ADDED, VREF, KEU, BASE_SPEED,
) = range(18)  # fmt: skip
VC, VR, VF, VF2, EFD = range(5)
VT, VS = range(2)
START = 0

_BEFORE = dc_commutator.EXCITER[:6]
_AFTER = dc_commutator.EXCITER[6:]
PARAMETERS = (
    *dc_commutator.MEASURING,
    Parameter("regulator_gain", "KA", "p.u."),
    Parameter("regulator_time", "TA", "s"),
    *_BEFORE,
    Parameter("second_feedback_time", "TF2", "s", Bound.NOT_NEGATIVE),
    *_AFTER,
)
DYR_COLUMNS: tuple[str | None, ...] = tuple(p.name for p in PARAMETERS[:-1])


def output(x, u, p, y, dx):
    """The condition that decides KE at the start."""
    for i in range(x.shape[1]):
        y[START, i] = start_condition(
            x[EFD, i], p[KE, i], p[KEU, i], p[VRMAX, i], p[E1, i], p[SE1, i], p[E2, i], p[SE2, i]
        )


def derivative(x, u, p, y, dx):
    """Measurement, rate feedback, regulator and exciter."""
    for i in range(x.shape[1]):
        v_c, dx[VC, i] = lag(u[VT, i], x[VC, i], p[TR, i])
        first, dx[VF, i] = rate_feedback(x[VR, i], x[VF, i], p[KF, i], p[TF, i])
        v_f, dx[VF2, i] = lag(first, x[VF2, i], p[TF2, i])
        error = p[VREF, i] + u[VS, i] - v_c - v_f
        v_r, dx[VR, i] = limited_lag(
            p[KA, i] * error, x[VR, i], p[TA, i], p[VRMIN, i], p[VRMAX, i] + p[ADDED, i]
        )
        dx[EFD, i] = exciter_rate(
            v_r, x[EFD, i], p[KEU, i], p[TE, i], p[E1, i], p[SE1, i], p[E2, i], p[SE2, i]
        )


IEEET2 = Device(
    model="ieeet2",
    title="IEEE type 2 excitation system (PSS/E IEEET2)",
    role=Role.EXCITER,
    parameters=PARAMETERS,
    set_points=dc_commutator.SET_POINTS,
    states=(
        "measured_voltage",
        "regulator_voltage",
        "feedback_state",
        "second_feedback_state",
        "field_voltage",
    ),
    inputs=("terminal_voltage", "stabilizer_signal"),
    outputs=(dc_commutator.START_CONDITION,),
    output=output,
    derivative=derivative,
    targets=("field_voltage", dc_commutator.START_CONDITION),
    defaults=dc_commutator.DEFAULTS,
    guess=dc_commutator.guess,
    resolve=dc_commutator.resolve,
    check=checks(
        PARAMETERS,
        ordered=[("regulator_minimum", "regulator_maximum")],
        proper=[("feedback_gain", "feedback_time")],
        more=[dc_commutator.no_regulator, dc_commutator.saturation_faults],
    ),
    limits=dc_commutator.STATE_LIMITS,
    psse_record=DYR_COLUMNS,
)
