"""Infinite bus: a constant voltage phasor behind an impedance.

The impedance is that of the equivalent network behind the bus and must not be zero; it is on the
generator's own base.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gridfold.dynamics.device import Bound, Device, Parameter, Role, Scaling, Values
from gridfold.dynamics.stator import over_impedance, terminal

R, X, E_R, E_I, BASE_SPEED = range(5)
VR, VI = range(2)
SOURCE_R, SOURCE_I, P, Q, VT = range(5)


def source(x, u, p, y, dx):
    """Norton current E / (R + j X)."""
    for i in range(p.shape[1]):
        y[SOURCE_R, i], y[SOURCE_I, i] = over_impedance(p[E_R, i], p[E_I, i], p[R, i], p[X, i])


def output(x, u, p, y, dx):
    """Terminal power and voltage."""
    for i in range(p.shape[1]):
        _, _, y[P, i], y[Q, i], y[VT, i] = terminal(
            y[SOURCE_R, i], y[SOURCE_I, i], u[VR, i], u[VI, i], p[R, i], p[X, i]
        )


def admittance(p: Values) -> NDArray[np.complex128]:
    """1 / (R + j X)."""
    return np.asarray(1 / (p["resistance"] + 1j * p["reactance"]))


def guess(p: Values, known: Mapping[str, Any]) -> Mapping[str, Any]:
    """Internal voltage near the terminal voltage."""
    return {"internal_real": known["voltage_real"], "internal_imag": known["voltage_imag"]}


INFINITE_BUS = Device(
    model="infinite_bus",
    title="infinite bus",
    role=Role.MACHINE,
    parameters=(
        Parameter("resistance", "R", "p.u.", Bound.NOT_NEGATIVE, Scaling.IMPEDANCE, default=0.0),
        Parameter("reactance", "X", "p.u.", scaling=Scaling.IMPEDANCE),
    ),
    set_points=("internal_real", "internal_imag"),
    states=(),
    inputs=("voltage_real", "voltage_imag"),
    sources=("source_real", "source_imag"),
    outputs=("active_power", "reactive_power", "terminal_voltage"),
    source=source,
    output=output,
    admittance=admittance,
    targets=("active_power", "reactive_power"),
    guess=guess,
)
