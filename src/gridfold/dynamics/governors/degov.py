"""Diesel engine and Woodward governor DEGOV, isochronous, on the base of its machine.

Box, actuator and engine are those of :mod:`~gridfold.dynamics.governors.diesel`, with the error
e = Pref - dw. There is no droop: Pref, a speed in per unit, is zero at the start. Model DEGOV of the
PSS/E Model Library, turbine-governor models.
"""

from __future__ import annotations

from gridfold.dynamics.blocks import clip
from gridfold.dynamics.checks import checks
from gridfold.dynamics.device import Device, Parameter, Role, Scaling
from gridfold.dynamics.governors import diesel
from gridfold.dynamics.governors.diesel import actuator, control_box, engine

T1, T2, T3, K, T4, T5, T6, TD, TMAX, TMIN, POWER_BASE, PREF, BASE_SPEED = range(13)
BOX, SLOPE, LEAD, LAG, THROTTLE, LATE_1, LATE_2 = range(7)
OMEGA = 0
PM = 0

PARAMETERS = (
    *diesel.BOX,
    *diesel.ENGINE,
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
    """Control box, actuator and delay of the engine."""
    for i in range(x.shape[1]):
        error = p[PREF, i] - (u[OMEGA, i] - 1.0)
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


DEGOV = Device(
    model="degov",
    title="diesel engine and isochronous governor DEGOV",
    role=Role.GOVERNOR,
    parameters=PARAMETERS,
    set_points=("power_reference",),
    states=diesel.STATES,
    inputs=("speed",),
    outputs=("mechanical_power",),
    output=output,
    derivative=derivative,
    targets=("mechanical_power",),
    guess=diesel.guess,
    check=checks(PARAMETERS, ordered=[diesel.ORDERED], more=[diesel.proper_blocks]),
    limits=diesel.LIMITS,
    psse_record=DYR_COLUMNS,
)
