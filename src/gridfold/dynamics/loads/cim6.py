"""CIM6 of PSS/E: an induction motor whose load torque is a polynomial of its speed.

PSS/E Model Library, CIM6BL, CIM6OW, CIM6ZN, CIM6AR and CIM6AL. The motor is that of
:mod:`~gridfold.dynamics.loads.induction`; with the speed w = 1 - s its load takes the torque

    T0 (A w^2 + B w + C0 + D w^E),

where T0 follows from the start.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from gridfold.dynamics.device import Bound, Device, Parameter, Role, Values
from gridfold.dynamics.loads import induction
from gridfold.dynamics.loads.cim5 import power_of_speed
from gridfold.dynamics.loads.induction import (
    SLIP,
    motor_output,
    motor_rates,
    motor_source,
)

A, B, D, E, C0, T0, SHUNT, BASE_SPEED = range(18, 26)


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
        w = 1 - x[SLIP, i]
        form = (p[A, i] * w + p[B, i]) * w + p[C0, i] + p[D, i] * power_of_speed(w, p[E, i])
        motor_rates(x, u, p, y, dx, i, p[BASE_SPEED, i], p[T0, i] * form)


def guess(p: Values, known: Mapping[str, Any]) -> dict[str, Any]:
    """The motor's start; T0 is the torque over the polynomial at nominal speed."""
    names = ("torque_square", "torque_slope", "torque_constant", "torque_power")
    found = induction.guess(p, known)
    return found | {"load_torque": found["load_torque"] / sum(p[name] for name in names)}


def check(parameters: Mapping[str, float]) -> Iterable[str]:
    """Those of all motors, and a load that takes a torque at nominal speed."""
    yield from induction.check(parameters)
    names = ("torque_square", "torque_slope", "torque_constant", "torque_power")
    total = sum(parameters[name] for name in names)
    if total <= 0:
        yield f"A + B + C0 + D is {total:g}, so that the load takes no torque at nominal speed"


CIM6 = Device(
    model="cim6",
    title="induction motor with a polynomial load torque (PSS/E CIM6)",
    role=Role.LOAD,
    parameters=(
        *induction.PARAMETERS,
        Parameter("torque_square", "A", "p.u.", Bound.ANY),
        Parameter("torque_slope", "B", "p.u.", Bound.ANY),
        Parameter("torque_power", "D", "p.u.", Bound.ANY),
        Parameter("torque_exponent", "E", "-", Bound.NOT_NEGATIVE),
        Parameter("torque_constant", "C0", "p.u.", Bound.ANY),
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
    guess=guess,
    check=check,
    rating=induction.rating,
    psse_record=(
        *induction.DYR_COLUMNS,
        "torque_square",
        "torque_slope",
        "torque_power",
        "torque_exponent",
        "torque_constant",
        None,
    ),
)
