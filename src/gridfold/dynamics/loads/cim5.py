"""CIM5 of PSS/E: an induction motor whose load torque is a power of its speed.

PSS/E Model Library, CIM5BL, CIM5OW, CIM5ZN, CIM5AR and CIM5AL. The motor is that of
:mod:`~gridfold.dynamics.loads.induction`; its load takes the torque T0 (1 - s)^D, where T0 follows
from the start.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from gridfold.dynamics.device import Bound, Device, Parameter, Role
from gridfold.dynamics.loads import induction
from gridfold.dynamics.loads.induction import (
    SLIP,
    motor_output,
    motor_rates,
    motor_source,
)

D, T0, SHUNT, BASE_SPEED = range(18, 22)


@njit
def power_of_speed(speed, exponent):
    """A power of a speed, which at rest is 0, or 1 where the exponent is 0."""
    if exponent.real == 0:
        return 1.0 + 0.0 * speed
    if speed.real <= 0:
        return 0.0 * speed
    return np.exp(exponent * np.log(speed))


def source(x, u, p, y, dx):
    """Norton current."""
    for i in range(x.shape[1]):
        motor_source(x, p, y, i, p[BASE_SPEED, i])


def output(x, u, p, y, dx):
    """Power, voltage and torque."""
    for i in range(x.shape[1]):
        motor_output(x, u, p, y, i, p[BASE_SPEED, i], p[SHUNT, i])


def derivative(x, u, p, y, dx):
    """The motor with its load torque."""
    for i in range(x.shape[1]):
        torque = p[T0, i] * power_of_speed(1 - x[SLIP, i], p[D, i])
        motor_rates(x, u, p, y, dx, i, p[BASE_SPEED, i], torque)


CIM5 = Device(
    model="cim5",
    title="induction motor (PSS/E CIM5)",
    role=Role.LOAD,
    parameters=(
        *induction.PARAMETERS,
        Parameter("torque_exponent", "D", "-", Bound.NOT_NEGATIVE),
    ),
    set_points=("load_torque", "shunt_susceptance"),
    states=induction.STATES,
    inputs=("voltage_real", "voltage_imag"),
    sources=induction.SOURCES,
    outputs=induction.OUTPUTS,
    source=source,
    output=output,
    derivative=derivative,
    admittance=induction.admittance,
    targets=("active_power", "reactive_power"),
    guess=induction.guess,
    check=induction.check,
    rating=induction.rating,
    psse_record=(*induction.DYR_COLUMNS, "torque_exponent", None),
)
