"""Classical machine: a voltage of constant magnitude behind the transient reactance.

Kundur, Power System Stability and Control, 1994, section 13.1.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gridfold.dynamics.device import Bound, Device, Parameter, Role, Scaling, Values
from gridfold.dynamics.stator import over_impedance, terminal

H, D, RA, XD1, E, BASE_SPEED = range(6)
DELTA, OMEGA = range(2)
VR, VI, PM = range(3)
SOURCE_R, SOURCE_I, E_R, E_I, P, Q, VT, PE = range(8)


def source(x, u, p, y, dx):
    """Norton current E / (Ra + j X'd)."""
    for i in range(x.shape[1]):
        e_r, e_i = p[E, i] * np.cos(x[DELTA, i]), p[E, i] * np.sin(x[DELTA, i])
        y[SOURCE_R, i], y[SOURCE_I, i] = over_impedance(e_r, e_i, p[RA, i], p[XD1, i])
        y[E_R, i] = e_r
        y[E_I, i] = e_i


def output(x, u, p, y, dx):
    """Terminal power and voltage, and the power that the rotor gives to the air gap."""
    for i in range(x.shape[1]):
        i_r, i_i, y[P, i], y[Q, i], y[VT, i] = terminal(
            y[SOURCE_R, i], y[SOURCE_I, i], u[VR, i], u[VI, i], p[RA, i], p[XD1, i]
        )
        y[PE, i] = y[E_R, i] * i_r + y[E_I, i] * i_i


def derivative(x, u, p, y, dx):
    """Swing equation."""
    for i in range(x.shape[1]):
        slip = x[OMEGA, i] - 1.0
        dx[DELTA, i] = p[BASE_SPEED, i] * slip
        dx[OMEGA, i] = (u[PM, i] - y[PE, i] - p[D, i] * slip) / (2.0 * p[H, i])


def admittance(p: Values) -> NDArray[np.complex128]:
    """1 / (Ra + j X'd)."""
    return np.asarray(1 / (p["resistance"] + 1j * p["transient_reactance"]))


def guess(p: Values, known: Mapping[str, Any]) -> Mapping[str, Any]:
    """Internal voltage V + (Ra + j X'd) I."""
    voltage = known["voltage_real"] + 1j * known["voltage_imag"]
    power = known["active_power"] + 1j * known["reactive_power"]
    internal = voltage + np.conj(power / voltage) / admittance(p)
    return {
        "rotor_angle": np.angle(internal),
        "speed": 1.0,
        "internal_voltage": np.abs(internal),
        "mechanical_power": known["active_power"],
    }


CLASSICAL = Device(
    model="classical",
    title="classical machine",
    role=Role.MACHINE,
    parameters=(
        Parameter("inertia", "H", "s", scaling=Scaling.POWER),
        Parameter("damping", "D", "p.u.", Bound.NOT_NEGATIVE, Scaling.POWER, default=0.0),
        Parameter("resistance", "Ra", "p.u.", Bound.NOT_NEGATIVE, Scaling.IMPEDANCE, default=0.0),
        Parameter("transient_reactance", "X'd", "p.u.", scaling=Scaling.IMPEDANCE),
    ),
    set_points=("internal_voltage",),
    states=("rotor_angle", "speed"),
    inputs=("voltage_real", "voltage_imag", "mechanical_power"),
    sources=("source_real", "source_imag", "internal_real", "internal_imag"),
    outputs=("active_power", "reactive_power", "terminal_voltage", "air_gap_power"),
    source=source,
    output=output,
    derivative=derivative,
    admittance=admittance,
    targets=("active_power", "reactive_power"),
    solved_inputs=("mechanical_power",),
    guess=guess,
)
