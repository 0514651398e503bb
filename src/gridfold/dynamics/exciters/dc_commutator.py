"""What the DC commutator exciters of PSS/E share: IEEET1, IEEEX1, EXDC2, ESDC2A.

    VC  = VT / (1 + s TR)
    VF  = s KF / (1 + s TF) EFD
    VR  = KA / (1 + s TA) (1 + s TC) / (1 + s TB) (VREF + VS - VC - VF)      non-windup limits
    EFD = (VR - (KE + SE(EFD)) EFD) / (s TE)

PSS/E Model Library; IEEE Std 421.5-1992, types DC1A and DC2A; Sauer & Pai, Power System Dynamics and
Stability, 1998, chapter 4. EFD SE(EFD) is the quadratic fit through (E1, SE1) and (E2, SE2).

KE = 0 is PSS/E's sign that the shunt field is trimmed by hand: at the start the regulator gives a tenth
of VRMAX, and KE follows from that, KE = VRMAX / (10 EFD) - SE(EFD). It is therefore a set point,
``effective_exciter_gain``, and equal to the given KE where that is not zero.

VRMAX = 0 is PSS/E's sign that the regulator can just hold the field voltage E2: then VRMAX is
(KE + SE2) E2, or SE2 E2 where KE is not positive, and VRMIN = -VRMAX.

As the start needs VRMAX itself, not VRMAX but an addition to it, 0 unless somebody moves it, is what
is taken away at the start and moved where a limit is in the way.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any

from numba import njit

from gridfold.dynamics.blocks import lead_lag, limited_lag, quadratic_saturation
from gridfold.dynamics.checks import checks
from gridfold.dynamics.device import Bound, Limit, Parameter, Side, Values

#: Part of VRMAX that the regulator gives at the start where KE is chosen by the start.
TRIMMED_SHARE = 0.1

MEASURING = (Parameter("measuring_time", "TR", "s", Bound.NOT_NEGATIVE),)
REGULATOR = (
    Parameter("regulator_gain", "KA", "p.u."),
    Parameter("regulator_time", "TA", "s", Bound.NOT_NEGATIVE),
)
COMPENSATOR = (
    Parameter("lag_time", "TB", "s", Bound.NOT_NEGATIVE),
    Parameter("lead_time", "TC", "s", Bound.NOT_NEGATIVE),
)
EXCITER = (
    Parameter("regulator_maximum", "VRMAX", "p.u.", Bound.ANY),
    Parameter("regulator_minimum", "VRMIN", "p.u.", Bound.ANY),
    Parameter("exciter_gain", "KE", "p.u.", Bound.ANY),
    Parameter("exciter_time", "TE", "s"),
    Parameter("feedback_gain", "KF", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("feedback_time", "TF", "s", Bound.NOT_NEGATIVE),
    Parameter("saturation_voltage_1", "E1", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("saturation_1", "SE1", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("saturation_voltage_2", "E2", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("saturation_2", "SE2", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("regulator_maximum_added", "dVRMAX", "p.u.", Bound.NOT_NEGATIVE, default=0.0),
)

SET_POINTS = ("voltage_reference", "effective_exciter_gain")
#: Zero at the start, where it decides the effective exciter gain; without meaning afterwards.
START_CONDITION = "exciter_start"
DEFAULTS = {"stabilizer_signal": 0.0, START_CONDITION: 0.0}
LIMITS = (
    Limit("regulator_minimum", Side.LOWEST),
    Limit("regulator_maximum_added", Side.HIGHEST, added_to="regulator_maximum"),
)
#: The same where they do not depend on the voltage, and so bound the regulator's state as they are.
STATE_LIMITS = tuple(replace(limit, state="regulator_voltage") for limit in LIMITS)

_EXCITER_COLUMNS = (
    "regulator_maximum",
    "regulator_minimum",
    "exciter_gain",
    "exciter_time",
    "feedback_gain",
    "feedback_time",
    None,
    "saturation_voltage_1",
    "saturation_1",
    "saturation_voltage_2",
    "saturation_2",
)
#: The record of IEEET1 (the number after TF, a switch, is not used), and that of the other models.
PLAIN_COLUMNS: tuple[str | None, ...] = (
    "measuring_time",
    "regulator_gain",
    "regulator_time",
    *_EXCITER_COLUMNS,
)
COMPENSATED_COLUMNS: tuple[str | None, ...] = (
    "measuring_time",
    "regulator_gain",
    "regulator_time",
    "lag_time",
    "lead_time",
    *_EXCITER_COLUMNS,
)


@njit
def regulator(error, x_lead, x_regulator, gain, time, lead, lag_time, lowest, highest):
    """VR and the derivatives of the lead-lag and the regulator state."""
    lead_out, lead_rate = lead_lag(error, x_lead, lead, lag_time)
    v_r, rate = limited_lag(gain * lead_out, x_regulator, time, lowest, highest)
    return v_r, lead_rate, rate


@njit
def exciter_rate(v_r, e_fd, k_e, t_e, e_1, s_1, e_2, s_2):
    """Derivative of EFD."""
    return (v_r - k_e * e_fd - quadratic_saturation(e_fd, e_1, s_1, e_2, s_2)) / t_e


@njit
def start_condition(e_fd, k_e, k_e_used, v_rmax, e_1, s_1, e_2, s_2):
    """What has to vanish at the start: KE is the given one, or that of the trimmed shunt field."""
    if k_e.real == 0.0:
        drop = k_e_used * e_fd + quadratic_saturation(e_fd, e_1, s_1, e_2, s_2)
        return drop - TRIMMED_SHARE * v_rmax
    return k_e_used - k_e


def guess(p: Values, known: Mapping[str, Any]) -> Mapping[str, Any]:
    """The field voltage is prescribed; the rest follows linearly."""
    field = known["field_voltage"]
    return {
        "field_voltage": field,
        "exciter_voltage": field,
        "effective_exciter_gain": p["exciter_gain"],
    }


def resolve(parameters: Mapping[str, float], base_mva: float) -> Mapping[str, float]:
    """VRMAX = 0 as the regulator output that holds the field voltage E2."""
    if parameters["regulator_maximum"] != 0:
        return parameters
    slope = max(parameters["exciter_gain"], 0.0) + parameters["saturation_2"]
    highest = slope * parameters["saturation_voltage_2"]
    return {**parameters, "regulator_maximum": highest, "regulator_minimum": -highest}


def no_regulator(parameters: Mapping[str, float]) -> Iterable[str]:
    """A fault where VRMAX is 0 and cannot be found."""
    if parameters["regulator_maximum"] == 0:
        yield "regulator_maximum VRMAX is 0, and so is (KE + SE2) E2, from which it would follow"


def saturation_faults(parameters: Mapping[str, float]) -> Iterable[str]:
    """The products E SE(E) at the two points must rise, or there is no quadratic through them."""
    first, second = sorted(
        (parameters[f"saturation_voltage_{k}"], parameters[f"saturation_{k}"]) for k in (1, 2)
    )
    (e_1, s_1), (e_2, s_2) = first, second
    if s_1 > 0 and s_2 > 0 and (e_1 == e_2 or e_1 * s_1 >= e_2 * s_2):
        yield (
            f"no quadratic saturation goes through SE({e_1:g}) = {s_1:g} and "
            f"SE({e_2:g}) = {s_2:g}: E SE(E) has to rise"
        )


#: Checks of the models without a lead-lag block, and of those with one.
_ORDERED = (("regulator_minimum", "regulator_maximum"),)
_FEEDBACK = ("feedback_gain", "feedback_time")
_MORE = (no_regulator, saturation_faults)
PLAIN_CHECK = checks(EXCITER, ordered=_ORDERED, proper=[_FEEDBACK], more=_MORE)
CHECK = checks(
    COMPENSATOR + EXCITER,
    ordered=_ORDERED,
    proper=[("lead_time", "lag_time"), _FEEDBACK],
    more=_MORE,
)
