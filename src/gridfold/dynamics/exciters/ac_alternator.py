"""What the exciters with an alternator share: a rotating AC exciter behind a loaded rectifier.

    VFE = (KE + SE(VE)) VE + KD IFD
    VE  = (VR - VFE) / (s TE),  VE >= VEMIN                                          non-windup
    EFD = VE FEX(KC IFD / VE)

IEEE Std 421.5-1992, types AC1A to AC6A and annex D; PSS/E Model Library. VE SE(VE) is the quadratic fit
through (E1, SE1) and (E2, SE2). The field current IFD is on the base in which it equals the field
voltage in steady state. VEMIN is not in the record of most models; it is 0 there, as the diodes of the
exciter let current flow in one direction only.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from numba import njit

from gridfold.dynamics.blocks import held, higher, quadratic_saturation
from gridfold.dynamics.device import Bound, Limit, Parameter, Side, Values
from gridfold.dynamics.exciters.rectifier import rectified, unloaded

NO_MAXIMUM = 1e12

MEASURING = Parameter("measuring_time", "TR", "s", Bound.NOT_NEGATIVE)
COMPENSATOR = (
    Parameter("lag_time", "TB", "s", Bound.NOT_NEGATIVE),
    Parameter("lead_time", "TC", "s", Bound.NOT_NEGATIVE),
)
AMPLIFIER = (
    Parameter("regulator_gain", "KA", "p.u."),
    Parameter("regulator_time", "TA", "s", Bound.NOT_NEGATIVE),
)
EXCITER_TIME = Parameter("exciter_time", "TE", "s")
FEEDBACK = (
    Parameter("feedback_gain", "KF", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("feedback_time", "TF", "s", Bound.NOT_NEGATIVE),
)
LOADING = (
    Parameter("rectifier_loading", "KC", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("demagnetization", "KD", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("exciter_gain", "KE", "p.u.", Bound.ANY),
)
SATURATION = (
    Parameter("saturation_voltage_1", "E1", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("saturation_1", "SE1", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("saturation_voltage_2", "E2", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("saturation_2", "SE2", "p.u.", Bound.NOT_NEGATIVE),
)
LOWEST = Parameter("exciter_voltage_minimum", "VEMIN", "p.u.", Bound.ANY, default=0.0)
LOWEST_LIMIT = Limit("exciter_voltage_minimum", Side.LOWEST, state="exciter_voltage")

INPUTS = ("terminal_voltage", "stabilizer_signal", "field_current")
DEFAULTS = {"stabilizer_signal": 0.0}


@njit
def exciter_demand(v_e, i_fd, k_d, k_e, e_1, s_1, e_2, s_2):
    """VFE, what the alternator takes of its own field."""
    return k_e * v_e + quadratic_saturation(v_e, e_1, s_1, e_2, s_2) + k_d * i_fd


@njit
def demand_and_field(v_e, lowest, i_fd, k_c, k_d, k_e, e_1, s_1, e_2, s_2):
    """VFE and the field voltage EFD; VE counts from VEMIN on."""
    above = higher(v_e, lowest)
    demand = exciter_demand(above, i_fd, k_d, k_e, e_1, s_1, e_2, s_2)
    return demand, rectified(above, k_c * i_fd)


@njit
def exciter_rate(v_r, v_fe, v_e, t_e, lowest):
    """Derivative of VE."""
    return held((v_r - v_fe) / t_e, v_e, lowest, lowest + NO_MAXIMUM)


def guess(p: Values, known: Mapping[str, Any]) -> Mapping[str, Any]:
    """VE from the rectifier; with it all equations are linear."""
    drop = p["rectifier_loading"] * known["field_current"]
    return {"exciter_voltage": unloaded(known["field_voltage"], drop)}
