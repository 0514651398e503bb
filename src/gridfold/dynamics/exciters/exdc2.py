"""EXDC2: IEEE type DC2 of 1981, a DC commutator exciter whose regulator is fed from the terminals.

    VR  = KA / (1 + s TA) (1 + s TC) / (1 + s TB) (VREF + VS - VT / (1 + s TR) - VF)
    VF  = s KF / (1 + s TF1) EFD
    EFD = (VR - (KE + SE(EFD)) EFD) / (s TE)

as IEEEX1, but the limits follow the terminal voltage: VT VRMIN <= VR <= VT VRMAX, non-windup. PSS/E
Model Library; IEEE Committee Report, Excitation System Models for Power System Stability Studies,
1981. For KE = 0 and the start see ``gridfold.dynamics.exciters.dc_commutator``.
"""

from __future__ import annotations

from gridfold.dynamics.blocks import lag, rate_feedback
from gridfold.dynamics.device import Device, Role
from gridfold.dynamics.exciters import dc_commutator
from gridfold.dynamics.exciters.dc_commutator import exciter_rate, regulator, start_condition

TR, KA, TA, TB, TC, VRMAX, VRMIN, KE, TE, KF, TF, E1, SE1, E2, SE2, ADDED = range(16)
VREF, KEU, BASE_SPEED = range(16, 19)
VC, LEAD, VR, VF, EFD = range(5)
VT, VS, SUPPLY = range(3)
START = 0

DYR_COLUMNS = dc_commutator.COMPENSATED_COLUMNS


def output(x, u, p, y, dx):
    """The condition that decides KE at the start."""
    for i in range(x.shape[1]):
        y[START, i] = start_condition(
            x[EFD, i], p[KE, i], p[KEU, i], p[VRMAX, i], p[E1, i], p[SE1, i], p[E2, i], p[SE2, i]
        )


def derivative(x, u, p, y, dx):
    """Measurement, rate feedback, lead-lag, regulator and exciter."""
    for i in range(x.shape[1]):
        v_c, dx[VC, i] = lag(u[VT, i], x[VC, i], p[TR, i])
        v_f, dx[VF, i] = rate_feedback(x[EFD, i], x[VF, i], p[KF, i], p[TF, i])
        v_r, dx[LEAD, i], dx[VR, i] = regulator(
            p[VREF, i] + u[VS, i] - v_c - v_f,
            x[LEAD, i],
            x[VR, i],
            p[KA, i],
            p[TA, i],
            p[TC, i],
            p[TB, i],
            u[SUPPLY, i] * p[VRMIN, i],
            u[SUPPLY, i] * (p[VRMAX, i] + p[ADDED, i]),
        )
        dx[EFD, i] = exciter_rate(
            v_r, x[EFD, i], p[KEU, i], p[TE, i], p[E1, i], p[SE1, i], p[E2, i], p[SE2, i]
        )


EXDC2 = Device(
    model="exdc2",
    title="IEEE type DC2 excitation system (PSS/E EXDC2)",
    role=Role.EXCITER,
    parameters=(
        dc_commutator.MEASURING
        + dc_commutator.REGULATOR
        + dc_commutator.COMPENSATOR
        + dc_commutator.EXCITER
    ),
    set_points=dc_commutator.SET_POINTS,
    states=(
        "measured_voltage",
        "lead_lag_state",
        "regulator_voltage",
        "feedback_state",
        "field_voltage",
    ),
    inputs=("terminal_voltage", "stabilizer_signal", "supply_voltage"),
    outputs=(dc_commutator.START_CONDITION,),
    output=output,
    derivative=derivative,
    targets=("field_voltage", dc_commutator.START_CONDITION),
    defaults=dc_commutator.DEFAULTS,
    guess=dc_commutator.guess,
    resolve=dc_commutator.resolve,
    check=dc_commutator.CHECK,
    limits=dc_commutator.LIMITS,
    psse_record=DYR_COLUMNS,
)
