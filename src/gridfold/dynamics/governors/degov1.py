"""Diesel engine and Woodward governor DEGOV1 with droop, on the base of its machine.

Box, actuator and engine are those of :mod:`~gridfold.dynamics.governors.diesel`, with the error

    e = Pref - dw - DROOP feedback,   feedback = throttle (M = 0) or Pe / (1 + s TE) (M = 1)

Model DEGOV1 of the PSS/E Model Library, turbine-governor models.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from gridfold.dynamics.blocks import clip, lag
from gridfold.dynamics.checks import checks
from gridfold.dynamics.device import Bound, Device, Parameter, Role, Scaling, Values
from gridfold.dynamics.governors import diesel
from gridfold.dynamics.governors.diesel import actuator, control_box, engine

(
    M, T1, T2, T3, K, T4, T5, T6, TD, TMAX, TMIN, DROOP, TE, POWER_BASE, PREF, BASE_SPEED,
) = range(16)  # fmt: skip
BOX, SLOPE, LEAD, LAG, THROTTLE, LATE_1, LATE_2, MEASURED = range(8)
OMEGA, PE = range(2)
PM = 0
ELECTRIC_POWER = 1

PARAMETERS = (
    Parameter("feedback_code", "M", "-", Bound.ANY),
    *diesel.BOX,
    *diesel.ENGINE,
    Parameter("droop", "DROOP", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("power_time", "TE", "s", Bound.NOT_NEGATIVE),
    Parameter("power_base", "MBASE/SBASE", "p.u.", scaling=Scaling.POWER, default=1.0),
)
DYR_COLUMNS: tuple[str | None, ...] = tuple(p.name for p in PARAMETERS[:-1])


def output(x, u, p, y, dx):
    """Mechanical power on the system base."""
    for i in range(x.shape[1]):
        throttle = clip(x[THROTTLE, i], p[TMIN, i], p[TMAX, i])
        power, _, _ = engine(throttle, x[LATE_1, i], x[LATE_2, i], p[TD, i], u[OMEGA, i])
        y[PM, i] = p[POWER_BASE, i] * power


def derivative(x, u, p, y, dx):
    """Measurement of power, control box, actuator and delay of the engine."""
    for i in range(x.shape[1]):
        power, dx[MEASURED, i] = lag(u[PE, i] / p[POWER_BASE, i], x[MEASURED, i], p[TE, i])
        feedback = clip(x[THROTTLE, i], p[TMIN, i], p[TMAX, i])
        if p[M, i].real == ELECTRIC_POWER:
            feedback = power
        error = p[PREF, i] - (u[OMEGA, i] - 1.0) - p[DROOP, i] * feedback
        box, dx[BOX, i], dx[SLOPE, i] = control_box(
            error, x[BOX, i], x[SLOPE, i], p[T1, i], p[T2, i], p[T3, i]
        )
        throttle, dx[LEAD, i], dx[LAG, i], dx[THROTTLE, i] = actuator(
            box, x[LEAD, i], x[LAG, i], x[THROTTLE, i],
            p[K, i], p[T4, i], p[T5, i], p[T6, i], p[TMIN, i], p[TMAX, i],
        )  # fmt: skip
        _, dx[LATE_1, i], dx[LATE_2, i] = engine(
            throttle, x[LATE_1, i], x[LATE_2, i], p[TD, i], u[OMEGA, i]
        )


def guess(p: Values, known: Mapping[str, Any]) -> Mapping[str, Any]:
    """The throttle that gives the power; Pref follows linearly."""
    return {**diesel.guess(p, known), "measured_power": known["active_power"] / p["power_base"]}


def feedback_codes(parameters: Mapping[str, float]) -> Iterable[str]:
    """M is a choice of two."""
    if parameters["feedback_code"] not in (0, 1):
        yield f"feedback_code M {parameters['feedback_code']:g} is neither 0 nor 1"


DEGOV1 = Device(
    model="degov1",
    title="diesel engine and governor with droop DEGOV1",
    role=Role.GOVERNOR,
    parameters=PARAMETERS,
    set_points=("power_reference",),
    states=(*diesel.STATES, "measured_power"),
    inputs=("speed", "active_power"),
    outputs=("mechanical_power",),
    output=output,
    derivative=derivative,
    targets=("mechanical_power",),
    guess=guess,
    check=checks(PARAMETERS, ordered=[diesel.ORDERED], more=[feedback_codes, diesel.proper_blocks]),
    limits=diesel.LIMITS,
    psse_record=DYR_COLUMNS,
)
