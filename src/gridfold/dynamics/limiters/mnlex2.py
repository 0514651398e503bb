"""MNLEX2 of PSS/E: a limiter of underexcitation by a circle of active and reactive power.

PSS/E Model Library, MNLEX2. On the machine's base,

    E    = (Qo V^2 - Q)^2 + P^2 - (Radius V^2)^2
    VUEL = KM / (1 + s TM) (E - s KF2 / (1 + s TF2) VUEL)      0 <= VUEL <= MELMAX, non-windup

which is 0 within the circle about Qo, and raises the reference of the voltage regulator outside of it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from gridfold.dynamics.blocks import limited_lag, washout
from gridfold.dynamics.device import Bound, Device, Parameter, Role, Scaling, Values

KF2, TF2, KM, TM, MELMAX, Q0, RADIUS, POWER_BASE, BASE_SPEED = range(9)
SIGNAL, FEEDBACK = range(2)
VT, P, Q = range(3)
VUEL = 0

PARAMETERS = (
    Parameter("feedback_gain", "KF2", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("feedback_time", "TF2", "s"),
    Parameter("limiter_gain", "KM", "p.u."),
    Parameter("limiter_time", "TM", "s"),
    Parameter("highest_signal", "MELMAX", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("circle_centre", "Qo", "p.u.", Bound.ANY),
    Parameter("circle_radius", "Radius", "p.u."),
    Parameter("power_base", "MBASE/SBASE", "p.u.", scaling=Scaling.POWER, default=1.0),
)
DYR_COLUMNS: tuple[str | None, ...] = tuple(p.name for p in PARAMETERS[:-1])


def output(x, u, p, y, dx):
    """The signal."""
    for i in range(x.shape[1]):
        low = 0.0 * p[KM, i]
        y[VUEL, i], _ = limited_lag(x[SIGNAL, i], x[SIGNAL, i], p[TM, i], low, p[MELMAX, i])


def derivative(x, u, p, y, dx):
    """Limiter and its rate feedback."""
    for i in range(x.shape[1]):
        squared = u[VT, i] * u[VT, i]
        active, reactive = u[P, i] / p[POWER_BASE, i], u[Q, i] / p[POWER_BASE, i]
        off, reach = p[Q0, i] * squared - reactive, p[RADIUS, i] * squared
        error = off * off + active * active - reach * reach
        fed_back, dx[FEEDBACK, i] = washout(y[VUEL, i], x[FEEDBACK, i], p[KF2, i], p[TF2, i])
        _, rate = limited_lag(
            p[KM, i] * (error - fed_back), x[SIGNAL, i], p[TM, i], 0.0 * error, p[MELMAX, i]
        )
        idle = x[SIGNAL, i].real <= 0 and rate.real <= 0
        dx[SIGNAL, i] = -x[SIGNAL, i] / p[TM, i] if idle else rate


def guess(p: Values, known: Mapping[str, Any]) -> Mapping[str, Any]:
    """The whole start: within the circle nothing, outside of it what the gain says."""
    squared, base = known["terminal_voltage"] ** 2, p["power_base"]
    off = p["circle_centre"] * squared - known["reactive_power"] / base
    reach = p["circle_radius"] * squared
    error = off**2 + (known["active_power"] / base) ** 2 - reach**2
    signal = np.clip(p["limiter_gain"] * error, 0.0, p["highest_signal"])
    return {"underexcitation_state": signal, "underexcitation_feedback": signal}


MNLEX2 = Device(
    model="mnlex2",
    title="limiter of underexcitation MNLEX2",
    role=Role.UNDEREXCITATION_LIMITER,
    parameters=PARAMETERS,
    states=("underexcitation_state", "underexcitation_feedback"),
    inputs=("terminal_voltage", "active_power", "reactive_power"),
    outputs=("underexcitation_signal",),
    output=output,
    derivative=derivative,
    guess=guess,
    psse_record=DYR_COLUMNS,
)
