"""IEEE type-1 exciter with exponential saturation and rate feedback, without limits.

Equations (1) of Osipov & Sun; Sauer & Pai, Power System Dynamics and Stability, 1998, sections
4.3 and 4.4.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from gridfold.dynamics.device import Bound, Device, Parameter, Role, Values

KA, TA, KE, TE, KF, TF, AE, BE, VREF, BASE_SPEED = range(10)
VR, RF, EFD = range(3)
VT, VS = range(2)


def derivative(x, u, p, y, dx):
    """Regulator, rate feedback and exciter."""
    for i in range(x.shape[1]):
        v_r, r_f, e_fd = x[VR, i], x[RF, i], x[EFD, i]
        feedback = p[KF, i] / p[TF, i] * e_fd
        error = p[VREF, i] - u[VT, i] + u[VS, i]
        dx[VR, i] = (-v_r + p[KA, i] * (r_f - feedback + error)) / p[TA, i]
        dx[RF, i] = (-r_f + feedback) / p[TF, i]
        saturation = p[AE, i] * np.exp(p[BE, i] * e_fd)
        dx[EFD, i] = (-(p[KE, i] + saturation) * e_fd + v_r) / p[TE, i]


def guess(p: Values, known: Mapping[str, Any]) -> Mapping[str, Any]:
    """The field voltage is prescribed; the rest follows linearly."""
    return {"field_voltage": known["field_voltage"]}


IEEE_TYPE1 = Device(
    model="ieee_type1",
    title="IEEE type-1 exciter",
    role=Role.EXCITER,
    parameters=(
        Parameter("regulator_gain", "KA", "p.u."),
        Parameter("regulator_time", "TA", "s"),
        Parameter("exciter_gain", "KE", "p.u.", Bound.ANY),
        Parameter("exciter_time", "TE", "s"),
        Parameter("feedback_gain", "KF", "p.u.", Bound.NOT_NEGATIVE),
        Parameter("feedback_time", "TF", "s"),
        Parameter("saturation_a", "AE", "p.u.", Bound.NOT_NEGATIVE, default=0.0),
        Parameter("saturation_b", "BE", "1/p.u.", Bound.NOT_NEGATIVE, default=0.0),
    ),
    set_points=("voltage_reference",),
    states=("regulator_voltage", "rate_feedback", "field_voltage"),
    inputs=("terminal_voltage", "stabilizer_signal"),
    derivative=derivative,
    targets=("field_voltage",),
    defaults={"stabilizer_signal": 0.0},
    guess=guess,
)
