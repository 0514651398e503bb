"""ESAC6A: IEEE type AC6A of 1992, an alternator whose regulator is fed from the terminals.

    VL  = KA (1 + s TK) / (1 + s TA) (VREF + VS - VT / (1 + s TR))
    VA  = (1 + s TC) / (1 + s TB) VL,                                   VAMIN <= VA <= VAMAX
    VH  = (1 + s TJ) / (1 + s TH) [KH (VFE - VFELIM) within 0 and VHMAX]
    VR  = VA - VH within VT VRMIN and VT VRMAX

Alternator and rectifier are those of :mod:`~gridfold.dynamics.exciters.ac_alternator`. The state of
the block of VA is bounded with its output. PSS/E Model Library; IEEE Std 421.5-1992, type AC6A.
"""

from __future__ import annotations

from gridfold.dynamics.blocks import clip, held, lag, lead_lag
from gridfold.dynamics.checks import checks
from gridfold.dynamics.device import Bound, Device, Limit, Parameter, Role, Side, limits
from gridfold.dynamics.exciters import ac_alternator
from gridfold.dynamics.exciters.ac_alternator import demand_and_field, exciter_rate
from gridfold.dynamics.exciters.dc_commutator import saturation_faults

(
    TR, KA, TA, TK, TB, TC, VAMAX, VAMIN, VRMAX, VRMIN, TE, VFELIM, KH, VHMAX, TH, TJ, KC, KD, KE,
    E1, SE1, E2, SE2, VEMIN, VREF, BASE_SPEED,
) = range(26)  # fmt: skip
VC, FIRST, SECOND, LIMITER, VE = range(5)
VT, VS, IFD, SUPPLY = range(4)
VFE, EFD = range(2)

PARAMETERS = (
    ac_alternator.MEASURING,
    Parameter("regulator_gain", "KA", "p.u."),
    Parameter("regulator_time", "TA", "s", Bound.NOT_NEGATIVE),
    Parameter("regulator_lead_time", "TK", "s", Bound.NOT_NEGATIVE),
    *ac_alternator.COMPENSATOR,
    Parameter("amplifier_maximum", "VAMAX", "p.u.", Bound.ANY),
    Parameter("amplifier_minimum", "VAMIN", "p.u.", Bound.ANY),
    Parameter("regulator_maximum", "VRMAX", "p.u.", Bound.ANY),
    Parameter("regulator_minimum", "VRMIN", "p.u.", Bound.ANY),
    ac_alternator.EXCITER_TIME,
    Parameter("field_limit", "VFELIM", "p.u.", Bound.ANY),
    Parameter("field_limiter_gain", "KH", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("field_limiter_maximum", "VHMAX", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("field_limiter_lag_time", "TH", "s", Bound.NOT_NEGATIVE),
    Parameter("field_limiter_lead_time", "TJ", "s", Bound.NOT_NEGATIVE),
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
    """Measurement, both lead-lags, limiter of the exciter's field, and alternator."""
    for i in range(x.shape[1]):
        v_c, dx[VC, i] = lag(u[VT, i], x[VC, i], p[TR, i])
        error = p[KA, i] * (p[VREF, i] + u[VS, i] - v_c)
        first, dx[FIRST, i] = lead_lag(error, x[FIRST, i], p[TK, i], p[TA, i])
        second, rate = lead_lag(first, x[SECOND, i], p[TC, i], p[TB, i])
        v_a = clip(second, p[VAMIN, i], p[VAMAX, i])
        dx[SECOND, i] = held(rate, x[SECOND, i], p[VAMIN, i], p[VAMAX, i])
        excess = p[KH, i] * (y[VFE, i] - p[VFELIM, i])
        limiting = clip(excess, 0.0 * excess, p[VHMAX, i] + 0.0 * excess)
        v_h, dx[LIMITER, i] = lead_lag(limiting, x[LIMITER, i], p[TJ, i], p[TH, i])
        v_r = clip(v_a - v_h, u[SUPPLY, i] * p[VRMIN, i], u[SUPPLY, i] * p[VRMAX, i])
        dx[VE, i] = exciter_rate(v_r, y[VFE, i], x[VE, i], p[TE, i], p[VEMIN, i])


ESAC6A = Device(
    model="esac6a",
    title="IEEE type AC6A excitation system (PSS/E ESAC6A)",
    role=Role.EXCITER,
    parameters=PARAMETERS,
    set_points=("voltage_reference",),
    states=(
        "measured_voltage",
        "regulator_state",
        "lead_lag_state",
        "field_limiter_state",
        "exciter_voltage",
    ),
    inputs=(*ac_alternator.INPUTS, "supply_voltage"),
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
        proper=[
            ("regulator_lead_time", "regulator_time"),
            ("lead_time", "lag_time"),
            ("field_limiter_lead_time", "field_limiter_lag_time"),
        ],
        more=[saturation_faults],
    ),
    limits=(
        *limits("amplifier_minimum", "amplifier_maximum", state="lead_lag_state"),
        *limits("regulator_minimum", "regulator_maximum"),
        Limit("field_limit", Side.HIGHEST),
        ac_alternator.LOWEST_LIMIT,
    ),
    psse_record=DYR_COLUMNS,
)
