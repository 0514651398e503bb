"""ESAC8B: a Basler DECS, an exciter without losses whose regulator is a PID.

    VPID = (KP + KI / s + s KD / (1 + s TD)) (VREF + VS - VT / (1 + s TR))
    VR   = KA / (1 + s TA) VPID,                              VRMIN <= VR <= VRMAX
    EFD  = (VR - (KE + SE(EFD)) EFD) / (s TE),                EFD >= EFDMIN

non-windup; the integral stands while VR is at a limit and it would lead on. EFDMIN is not in the record
and 0. VRMAX = 0 is as in ``gridfold.dynamics.exciters.dc_commutator``. PSS/E Model Library; the
machine is that of the type AC8B of IEEE Std 421.5-2005 without KC and KD.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from gridfold.dynamics.blocks import clip, held, higher, lag, limited_lag, rate_feedback
from gridfold.dynamics.checks import checks
from gridfold.dynamics.device import Bound, Device, Limit, Parameter, Role, Side, Values, limits
from gridfold.dynamics.exciters import ac_alternator, dc_commutator
from gridfold.dynamics.exciters.dc_commutator import exciter_rate, saturation_faults
from gridfold.dynamics.exciters.pid import gains, some_gain

(
    TR, KP, KI, KD, TD, KA, TA, VRMAX, VRMIN, TE, KE, E1, SE1, E2, SE2, EMIN, VREF, BASE_SPEED,
) = range(18)  # fmt: skip
VC, INTEGRAL, DIFFERENCE, VR, VE = range(5)
VT, VS = range(2)
EFD = 0
NO_MAXIMUM = 1e12

PARAMETERS = (
    ac_alternator.MEASURING,
    *gains(""),
    *ac_alternator.AMPLIFIER,
    Parameter("regulator_maximum", "VRMAX", "p.u.", Bound.ANY),
    Parameter("regulator_minimum", "VRMIN", "p.u.", Bound.ANY),
    ac_alternator.EXCITER_TIME,
    Parameter("exciter_gain", "KE", "p.u.", Bound.ANY),
    *ac_alternator.SATURATION,
    Parameter("field_voltage_minimum", "EFDMIN", "p.u.", Bound.ANY, default=0.0),
)
DYR_COLUMNS: tuple[str | None, ...] = tuple(p.name for p in PARAMETERS[:-1])


def output(x, u, p, y, dx):
    """Field voltage, not below its limit."""
    for i in range(x.shape[1]):
        y[EFD, i] = higher(x[VE, i], p[EMIN, i])


def derivative(x, u, p, y, dx):
    """Measurement, PID, amplifier and exciter."""
    for i in range(x.shape[1]):
        v_c, dx[VC, i] = lag(u[VT, i], x[VC, i], p[TR, i])
        error = p[VREF, i] + u[VS, i] - v_c
        rate_part, dx[DIFFERENCE, i] = rate_feedback(error, x[DIFFERENCE, i], p[KD, i], p[TD, i])
        wanted = p[KA, i] * (p[KP, i] * error + rate_part + x[INTEGRAL, i])
        v_r, dx[VR, i] = limited_lag(wanted, x[VR, i], p[TA, i], p[VRMIN, i], p[VRMAX, i])
        if p[KI, i].real > 0:
            outside = wanted - clip(wanted, p[VRMIN, i], p[VRMAX, i])
            rate = p[KI, i] * error
            dx[INTEGRAL, i] = rate if (outside * rate).real <= 0 else 0.0 * rate
        else:
            dx[INTEGRAL, i] = -x[INTEGRAL, i]
        rate = exciter_rate(
            v_r, y[EFD, i], p[KE, i], p[TE, i], p[E1, i], p[SE1, i], p[E2, i], p[SE2, i]
        )
        dx[VE, i] = held(rate, x[VE, i], p[EMIN, i], p[EMIN, i] + NO_MAXIMUM)


def guess(p: Values, known: Mapping[str, Any]) -> Mapping[str, Any]:
    """The field voltage is prescribed; the rest follows linearly."""
    return {"exciter_voltage": known["field_voltage"]}


ESAC8B = Device(
    model="esac8b",
    title="Basler DECS excitation system (PSS/E ESAC8B)",
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
    inputs=("terminal_voltage", "stabilizer_signal"),
    outputs=("field_voltage",),
    output=output,
    derivative=derivative,
    targets=("field_voltage",),
    defaults=ac_alternator.DEFAULTS,
    guess=guess,
    resolve=dc_commutator.resolve,
    check=checks(
        PARAMETERS,
        ordered=[("regulator_minimum", "regulator_maximum")],
        proper=[("derivative_gain", "derivative_time")],
        more=[some_gain, saturation_faults],
    ),
    limits=(
        *limits("regulator_minimum", "regulator_maximum", state="regulator_voltage"),
        Limit("field_voltage_minimum", Side.LOWEST, state="exciter_voltage"),
    ),
    psse_record=DYR_COLUMNS,
)
