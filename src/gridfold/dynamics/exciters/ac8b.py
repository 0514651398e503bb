"""AC8B: IEEE type AC8B of 2005, an alternator whose regulator is a PID.

    VPID = (KPR + KIR / s + s KDR / (1 + s TDR)) (VREF + VS - VT / (1 + s TR))
    VR   = KA / (1 + s TA) VPID

with VPIDMIN <= VPID <= VPIDMAX and VRMIN <= VR <= VRMAX, both non-windup; alternator and rectifier as
in :mod:`~gridfold.dynamics.exciters.ac_alternator`. VE is at most (VFEMAX - KD IFD) / (KE + SE(VE)),
where VFE is VFEMAX; it stands where a growing field current moves that limit below it. PSS/E Model
Library; IEEE Std 421.5-2005, type AC8B.
"""

from __future__ import annotations

from numba import njit

from gridfold.dynamics.blocks import held, higher, lag, limited_lag, limited_pid
from gridfold.dynamics.checks import checks
from gridfold.dynamics.device import Bound, Device, Limit, Parameter, Role, Side, limits
from gridfold.dynamics.exciters import ac_alternator
from gridfold.dynamics.exciters.ac_alternator import NO_MAXIMUM, demand_and_field
from gridfold.dynamics.exciters.dc_commutator import saturation_faults
from gridfold.dynamics.exciters.pid import PID, some_gain

(
    TR, KPR, KIR, KDR, TDR, VPIDMAX, VPIDMIN, KA, TA, VRMAX, VRMIN, KC, KD, KE, TE, VFEMAX, VEMIN,
    E1, SE1, E2, SE2, VREF, BASE_SPEED,
) = range(23)  # fmt: skip
VC, INTEGRAL, DIFFERENCE, VR, VE = range(5)
VT, VS, IFD = range(3)
VFE, EFD = range(2)

PARAMETERS = (
    ac_alternator.MEASURING,
    *PID,
    Parameter("pid_maximum", "VPIDMAX", "p.u.", Bound.ANY),
    Parameter("pid_minimum", "VPIDMIN", "p.u.", Bound.ANY),
    *ac_alternator.AMPLIFIER,
    Parameter("regulator_maximum", "VRMAX", "p.u.", Bound.ANY),
    Parameter("regulator_minimum", "VRMIN", "p.u.", Bound.ANY),
    *ac_alternator.LOADING,
    ac_alternator.EXCITER_TIME,
    Parameter("field_limit", "VFEMAX", "p.u.", Bound.ANY),
    Parameter("exciter_voltage_minimum", "VEMIN", "p.u.", Bound.ANY),
    *ac_alternator.SATURATION,
)
DYR_COLUMNS: tuple[str | None, ...] = tuple(p.name for p in PARAMETERS)


@njit
def highest_voltage(left, own, v_e, lowest):
    """VE at which the field of the exciter is at its limit.

    `left` is the limit less KD IFD, `own` is (KE + SE) VE at `v_e`; there is no limit where that is not
    positive.
    """
    if own.real > 0 and v_e.real > 0:
        return higher(left * v_e / own, lowest)
    return lowest + NO_MAXIMUM


def output(x, u, p, y, dx):
    """What the alternator takes of its own field, and the field voltage."""
    for i in range(x.shape[1]):
        y[VFE, i], y[EFD, i] = demand_and_field(
            x[VE, i], p[VEMIN, i], u[IFD, i], p[KC, i], p[KD, i], p[KE, i],
            p[E1, i], p[SE1, i], p[E2, i], p[SE2, i],
        )  # fmt: skip


def derivative(x, u, p, y, dx):
    """Measurement, PID, amplifier and alternator."""
    for i in range(x.shape[1]):
        v_c, dx[VC, i] = lag(u[VT, i], x[VC, i], p[TR, i])
        pid, dx[INTEGRAL, i], dx[DIFFERENCE, i] = limited_pid(
            p[VREF, i] + u[VS, i] - v_c, x[INTEGRAL, i], x[DIFFERENCE, i],
            p[KPR, i], p[KIR, i], p[KDR, i], p[TDR, i], p[VPIDMIN, i], p[VPIDMAX, i],
        )  # fmt: skip
        v_r, dx[VR, i] = limited_lag(p[KA, i] * pid, x[VR, i], p[TA, i], p[VRMIN, i], p[VRMAX, i])
        own = y[VFE, i] - p[KD, i] * u[IFD, i]
        highest = highest_voltage(p[VFEMAX, i] - p[KD, i] * u[IFD, i], own, x[VE, i], p[VEMIN, i])
        dx[VE, i] = held((v_r - y[VFE, i]) / p[TE, i], x[VE, i], p[VEMIN, i], highest)


AC8B = Device(
    model="ac8b",
    title="IEEE type AC8B excitation system (PSS/E AC8B)",
    role=Role.EXCITER,
    parameters=PARAMETERS,
    set_points=("voltage_reference",),
    states=(
        "measured_voltage",
        "regulator_integral",
        "regulator_difference",
        "regulator_voltage",
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
            ("pid_minimum", "pid_maximum"),
            ("regulator_minimum", "regulator_maximum"),
        ],
        proper=[("derivative_gain", "derivative_time")],
        more=[some_gain, saturation_faults],
    ),
    limits=(
        *limits("pid_minimum", "pid_maximum"),
        *limits("regulator_minimum", "regulator_maximum", state="regulator_voltage"),
        Limit("field_limit", Side.HIGHEST),
        ac_alternator.LOWEST_LIMIT,
    ),
    psse_record=DYR_COLUMNS,
)
