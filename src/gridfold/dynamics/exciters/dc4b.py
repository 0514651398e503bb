"""DC4B: IEEE type DC4B of 2005, a DC commutator exciter whose PID regulator is fed from the terminals.

    VPID = (KP + KI / s + s KD / (1 + s TD)) (VREF + VS - VT / (1 + s TR) - s KF / (1 + s TF) EFD)
    VR   = KA / (1 + s TA) VT VPID
    EFD  = (VR - (KE + SE(EFD)) EFD) / (s TE)

with VRMIN / KA <= VPID <= VRMAX / KA, VT VRMIN <= VR <= VT VRMAX and EFD >= VEMIN, all non-windup.
PSS/E Model Library; IEEE Std 421.5-2005, type DC4B. The gates of the over- and underexcitation
limiters, which two numbers of the record select, have no inputs here. KE = 0 and VRMAX = 0 are as in
``gridfold.dynamics.exciters.dc_commutator``.
"""

from __future__ import annotations

from gridfold.dynamics.blocks import held, higher, lag, limited_lag, limited_pid, rate_feedback
from gridfold.dynamics.checks import checks
from gridfold.dynamics.device import Bound, Device, Limit, Parameter, Role, Side
from gridfold.dynamics.exciters import dc_commutator
from gridfold.dynamics.exciters.dc_commutator import exciter_rate, start_condition
from gridfold.dynamics.exciters.pid import gains, some_gain

(
    TR, KP, KI, KD, TD, KA, TA, VRMAX, VRMIN, KE, TE, KF, TF, E1, SE1, E2, SE2, ADDED, EMIN,
    VREF, KEU, BASE_SPEED,
) = range(22)  # fmt: skip
VC, INTEGRAL, DIFFERENCE, VR, VF, VE = range(6)
VT, VS, SUPPLY = range(3)
START, EFD = range(2)
NO_MAXIMUM = 1e12

PARAMETERS = (
    *dc_commutator.MEASURING,
    *gains(""),
    *dc_commutator.REGULATOR,
    *dc_commutator.EXCITER,
    Parameter("field_voltage_minimum", "VEMIN", "p.u.", Bound.ANY),
)
DYR_COLUMNS: tuple[str | None, ...] = (
    None,  # where an underexcitation limiter acts
    None,  # where an overexcitation limiter acts
    "measuring_time",
    "proportional_gain",
    "integral_gain",
    "derivative_gain",
    "derivative_time",
    "regulator_maximum",
    "regulator_minimum",
    "regulator_gain",
    "regulator_time",
    "exciter_gain",
    "exciter_time",
    "feedback_gain",
    "feedback_time",
    "field_voltage_minimum",
    "saturation_voltage_1",
    "saturation_1",
    "saturation_voltage_2",
    "saturation_2",
)


def output(x, u, p, y, dx):
    """Field voltage, not below its limit, and the condition that decides KE at the start."""
    for i in range(x.shape[1]):
        y[EFD, i] = higher(x[VE, i], p[EMIN, i])
        y[START, i] = start_condition(
            y[EFD, i], p[KE, i], p[KEU, i], p[VRMAX, i], p[E1, i], p[SE1, i], p[E2, i], p[SE2, i]
        )


def derivative(x, u, p, y, dx):
    """Measurement, rate feedback, PID, amplifier and exciter."""
    for i in range(x.shape[1]):
        v_c, dx[VC, i] = lag(u[VT, i], x[VC, i], p[TR, i])
        v_f, dx[VF, i] = rate_feedback(y[EFD, i], x[VF, i], p[KF, i], p[TF, i])
        highest = p[VRMAX, i] + p[ADDED, i]
        v_pid, dx[INTEGRAL, i], dx[DIFFERENCE, i] = limited_pid(
            p[VREF, i] + u[VS, i] - v_c - v_f,
            x[INTEGRAL, i],
            x[DIFFERENCE, i],
            p[KP, i],
            p[KI, i],
            p[KD, i],
            p[TD, i],
            p[VRMIN, i] / p[KA, i],
            highest / p[KA, i],
        )
        v_r, dx[VR, i] = limited_lag(
            p[KA, i] * u[SUPPLY, i] * v_pid,
            x[VR, i],
            p[TA, i],
            u[SUPPLY, i] * p[VRMIN, i],
            u[SUPPLY, i] * highest,
        )
        rate = exciter_rate(
            v_r, y[EFD, i], p[KEU, i], p[TE, i], p[E1, i], p[SE1, i], p[E2, i], p[SE2, i]
        )
        dx[VE, i] = held(rate, x[VE, i], p[EMIN, i], p[EMIN, i] + NO_MAXIMUM)


DC4B = Device(
    model="dc4b",
    title="IEEE type DC4B excitation system (PSS/E DC4B)",
    role=Role.EXCITER,
    parameters=PARAMETERS,
    set_points=dc_commutator.SET_POINTS,
    states=(
        "measured_voltage",
        "regulator_integral",
        "regulator_difference",
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
    check=checks(
        PARAMETERS,
        proper=[("derivative_gain", "derivative_time")],
        more=[some_gain, dc_commutator.PLAIN_CHECK],
    ),
    limits=(
        *dc_commutator.LIMITS,
        Limit("field_voltage_minimum", Side.LOWEST, state="exciter_voltage"),
    ),
    psse_record=DYR_COLUMNS,
)
