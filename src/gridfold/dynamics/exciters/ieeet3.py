"""IEEET3: IEEE type-3 excitation system of 1968, an exciter fed by voltage and current.

    VR  = KA / (1 + s TA) (VREF + VS - VT / (1 + s TR) - s KF / (1 + s TF) EFD)   VRMIN <= VR <= VRMAX
    VB  = VR + VTHEV sqrt(1 - A),  A = (0.78 IFD / VTHEV)^2,                      0 <= VB <= VBMAX
    EFD = VB / (KE + s TE),        VTHEV = | KP VT + j KI IT |

VR is non-windup; where A is above 1 the rectifier gives nothing, and VB is 0. PSS/E Model Library; IEEE
Committee Report, Computer Representation of Excitation Systems, 1968. Current and power of the source
are on the machine's base.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numba import njit

from gridfold.dynamics.blocks import clip, lag, limited_lag, rate_feedback
from gridfold.dynamics.checks import checks
from gridfold.dynamics.device import (
    Bound,
    Device,
    Limit,
    Parameter,
    Role,
    Scaling,
    Side,
    Values,
    limits,
)
from gridfold.dynamics.exciters.rectifier import compound_voltage

(
    TR, KA, TA, VRMAX, VRMIN, TE, KF, TF, KP, KI, VBMAX, KE, BASE, VREF, BASE_SPEED,
) = range(15)  # fmt: skip
VC, VR, VF, EFD = range(4)
VT, VS, IFD, P, Q, ID, IQ, SUPPLY = range(8)
SOURCE = 0
#: Voltage that a p.u. of field current takes away, in p.u.
LOADING = 0.78

PARAMETERS = (
    Parameter("measuring_time", "TR", "s", Bound.NOT_NEGATIVE),
    Parameter("regulator_gain", "KA", "p.u."),
    Parameter("regulator_time", "TA", "s", Bound.NOT_NEGATIVE),
    Parameter("regulator_maximum", "VRMAX", "p.u.", Bound.ANY),
    Parameter("regulator_minimum", "VRMIN", "p.u.", Bound.ANY),
    Parameter("exciter_time", "TE", "s"),
    Parameter("feedback_gain", "KF", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("feedback_time", "TF", "s", Bound.NOT_NEGATIVE),
    Parameter("potential_gain", "KP", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("current_gain", "KI", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("source_maximum", "VBMAX", "p.u."),
    Parameter("exciter_gain", "KE", "p.u."),
    Parameter("power_base", "MBASE/SBASE", "p.u.", scaling=Scaling.POWER, default=1.0),
)
DYR_COLUMNS: tuple[str | None, ...] = tuple(p.name for p in PARAMETERS[:-1])


@njit
def loaded(source, i_fd):
    """VTHEV sqrt(1 - A), and not positive where A is above 1."""
    left = source * source - (LOADING * i_fd) ** 2
    return np.sqrt(left) if left.real > 0 else 0.0 * left


def output(x, u, p, y, dx):
    """Rectified source voltage."""
    for i in range(x.shape[1]):
        base = p[BASE, i]
        squared = (u[ID, i] * u[ID, i] + u[IQ, i] * u[IQ, i]) / (base * base)
        none = 0.0 * base
        v_th = compound_voltage(
            u[SUPPLY, i], u[P, i] / base, u[Q, i] / base, squared, p[KP, i], none, p[KI, i], none
        )
        y[SOURCE, i] = loaded(v_th, u[IFD, i])


def derivative(x, u, p, y, dx):
    """Measurement, rate feedback, regulator and exciter."""
    for i in range(x.shape[1]):
        v_c, dx[VC, i] = lag(u[VT, i], x[VC, i], p[TR, i])
        v_f, dx[VF, i] = rate_feedback(x[EFD, i], x[VF, i], p[KF, i], p[TF, i])
        error = p[VREF, i] + u[VS, i] - v_c - v_f
        v_r, dx[VR, i] = limited_lag(p[KA, i] * error, x[VR, i], p[TA, i], p[VRMIN, i], p[VRMAX, i])
        wanted = v_r + y[SOURCE, i]
        v_b = clip(wanted, 0.0 * wanted, p[VBMAX, i] + 0.0 * wanted)
        if y[SOURCE, i].real <= 0:
            v_b = 0.0 * wanted
        dx[EFD, i] = (v_b - p[KE, i] * x[EFD, i]) / p[TE, i]


def guess(p: Values, known: Mapping[str, Any]) -> Mapping[str, Any]:
    """The field voltage is prescribed, the source is known, and near VR = 0 the rest is linear."""
    return {
        **dict.fromkeys(("field_voltage", "feedback_state"), known["field_voltage"]),
        **dict.fromkeys(("measured_voltage", "voltage_reference"), known["supply_voltage"]),
    }


IEEET3 = Device(
    model="ieeet3",
    title="IEEE type 3 excitation system (PSS/E IEEET3)",
    role=Role.EXCITER,
    parameters=PARAMETERS,
    set_points=("voltage_reference",),
    states=("measured_voltage", "regulator_voltage", "feedback_state", "field_voltage"),
    inputs=(
        "terminal_voltage",
        "stabilizer_signal",
        "field_current",
        "active_power",
        "reactive_power",
        "d_current",
        "q_current",
        "supply_voltage",
    ),
    outputs=("source_voltage",),
    output=output,
    derivative=derivative,
    targets=("field_voltage",),
    defaults={"stabilizer_signal": 0.0},
    guess=guess,
    check=checks(
        PARAMETERS,
        ordered=[("regulator_minimum", "regulator_maximum")],
        proper=[("feedback_gain", "feedback_time")],
    ),
    limits=(
        *limits("regulator_minimum", "regulator_maximum", state="regulator_voltage"),
        Limit("source_maximum", Side.HIGHEST),
    ),
    psse_record=DYR_COLUMNS,
)
