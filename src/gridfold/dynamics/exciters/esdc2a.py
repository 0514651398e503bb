"""ESDC2A: IEEE type DC2A of 1992, a DC commutator exciter whose regulator is fed from the terminals.

    VR  = KA / (1 + s TA) (1 + s TC) / (1 + s TB) (VREF + VS - VT / (1 + s TR) - VF)
    VF  = s KF / (1 + s TF1) EFD
    EFD = (VR - (KE + SE(EFD)) EFD) / (s TE)

with VT VRMIN <= VR <= VT VRMAX and EFD >= 0, all non-windup. PSS/E Model Library; IEEE Std
421.5-1992, type DC2A. The gate for an underexcitation limiter has no input here. For KE = 0 and the
start see ``gridfold.dynamics.exciters.dc_commutator``.
"""

from __future__ import annotations

from gridfold.dynamics.blocks import held, lag, rate_feedback
from gridfold.dynamics.device import Bound, Device, Limit, Parameter, Role, Side
from gridfold.dynamics.exciters import dc_commutator
from gridfold.dynamics.exciters.dc_commutator import exciter_rate, regulator, start_condition

TR, KA, TA, TB, TC, VRMAX, VRMIN, KE, TE, KF, TF, E1, SE1, E2, SE2, ADDED, EMIN = range(17)
VREF, KEU, BASE_SPEED = range(17, 20)
VC, LEAD, VR, VF, VE = range(5)
VT, VS, SUPPLY = range(3)
START, EFD = range(2)
NO_MAXIMUM = 1e12

DYR_COLUMNS = dc_commutator.COMPENSATED_COLUMNS


def output(x, u, p, y, dx):
    """Field voltage, not below its limit, and the condition that decides KE at the start."""
    for i in range(x.shape[1]):
        y[EFD, i] = x[VE, i]
        if x[VE, i].real < p[EMIN, i].real:
            y[EFD, i] = p[EMIN, i]
        y[START, i] = start_condition(
            y[EFD, i], p[KE, i], p[KEU, i], p[VRMAX, i], p[E1, i], p[SE1, i], p[E2, i], p[SE2, i]
        )


def derivative(x, u, p, y, dx):
    """Measurement, rate feedback, lead-lag, regulator and exciter."""
    for i in range(x.shape[1]):
        v_c, dx[VC, i] = lag(u[VT, i], x[VC, i], p[TR, i])
        v_f, dx[VF, i] = rate_feedback(y[EFD, i], x[VF, i], p[KF, i], p[TF, i])
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
        rate = exciter_rate(
            v_r, y[EFD, i], p[KEU, i], p[TE, i], p[E1, i], p[SE1, i], p[E2, i], p[SE2, i]
        )
        dx[VE, i] = held(rate, x[VE, i], p[EMIN, i], p[EMIN, i] + NO_MAXIMUM)


ESDC2A = Device(
    model="esdc2a",
    title="IEEE type DC2A excitation system (PSS/E ESDC2A)",
    role=Role.EXCITER,
    parameters=(
        dc_commutator.MEASURING
        + dc_commutator.REGULATOR
        + dc_commutator.COMPENSATOR
        + dc_commutator.EXCITER
        + (Parameter("field_voltage_minimum", "EFDMIN", "p.u.", Bound.ANY, default=0.0),)
    ),
    set_points=dc_commutator.SET_POINTS,
    states=(
        "measured_voltage",
        "lead_lag_state",
        "regulator_voltage",
        "feedback_state",
        "exciter_voltage",
    ),
    inputs=("terminal_voltage", "stabilizer_signal", "supply_voltage"),
    outputs=(dc_commutator.START_CONDITION, "field_voltage"),
    output=output,
    derivative=derivative,
    targets=("field_voltage", dc_commutator.START_CONDITION),
    defaults=dc_commutator.DEFAULTS,
    guess=dc_commutator.guess,
    resolve=dc_commutator.resolve,
    check=dc_commutator.CHECK,
    limits=(
        *dc_commutator.LIMITS,
        Limit("field_voltage_minimum", Side.LOWEST, state="exciter_voltage"),
    ),
    psse_record=DYR_COLUMNS,
)
