"""Two-axis machine: rotor angle, speed and the transient voltages of both axes.

Equations (1) of Osipov & Sun; Sauer & Pai, Power System Dynamics and Stability, 1998, section 5.4.
The current equations of the paper imply X'q = X'd. With E = (E'd + j E'q) exp(j(delta - pi/2)) the
stator is E = V + (Ra + j X'd) I, and Id + j Iq = I exp(-j(delta - pi/2)).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gridfold.dynamics.device import Bound, Device, Parameter, Role, Scaling, Values
from gridfold.dynamics.stator import over_impedance, terminal

H, D, RA, XD, XQ, XD1, XQ1, TD0, TQ0, BASE_SPEED = range(10)
DELTA, OMEGA, ED1, EQ1 = range(4)
VR, VI, EFD, PM = range(4)
SOURCE_R, SOURCE_I, SIN, COS, ID, IQ, P, Q, VT = range(9)


def source(x, u, p, y, dx):
    """Norton current E / (Ra + j X'd)."""
    for i in range(x.shape[1]):
        s, c = np.sin(x[DELTA, i]), np.cos(x[DELTA, i])
        e_r = x[ED1, i] * s + x[EQ1, i] * c
        e_i = -x[ED1, i] * c + x[EQ1, i] * s
        y[SOURCE_R, i], y[SOURCE_I, i] = over_impedance(e_r, e_i, p[RA, i], p[XD1, i])
        y[SIN, i] = s
        y[COS, i] = c


def output(x, u, p, y, dx):
    """Stator currents in both axes, terminal power and voltage."""
    for i in range(x.shape[1]):
        i_r, i_i, y[P, i], y[Q, i], y[VT, i] = terminal(
            y[SOURCE_R, i], y[SOURCE_I, i], u[VR, i], u[VI, i], p[RA, i], p[XD1, i]
        )
        y[ID, i] = i_r * y[SIN, i] - i_i * y[COS, i]
        y[IQ, i] = i_r * y[COS, i] + i_i * y[SIN, i]


def derivative(x, u, p, y, dx):
    """Swing equation and transient voltages."""
    for i in range(x.shape[1]):
        i_d, i_q = y[ID, i], y[IQ, i]
        slip = x[OMEGA, i] - 1.0
        power = x[ED1, i] * i_d + x[EQ1, i] * i_q
        dx[DELTA, i] = p[BASE_SPEED, i] * slip
        dx[OMEGA, i] = (u[PM, i] - power - p[D, i] * slip) / (2.0 * p[H, i])
        dx[ED1, i] = (-x[ED1, i] + (p[XQ, i] - p[XQ1, i]) * i_q) / p[TQ0, i]
        dx[EQ1, i] = (-x[EQ1, i] - (p[XD, i] - p[XD1, i]) * i_d + u[EFD, i]) / p[TD0, i]


def admittance(p: Values) -> NDArray[np.complex128]:
    """1 / (Ra + j X'd)."""
    return np.asarray(1 / (p["resistance"] + 1j * p["d_transient_reactance"]))


def guess(p: Values, known: Mapping[str, Any]) -> Mapping[str, Any]:
    """Rotor angle from the q-axis voltage V + (Ra + j Xq) I; the rest near its size."""
    voltage = known["voltage_real"] + 1j * known["voltage_imag"]
    power = known["active_power"] + 1j * known["reactive_power"]
    current = np.conj(power / voltage)
    q_axis = voltage + (p["resistance"] + 1j * p["q_reactance"]) * current
    return {
        "rotor_angle": np.angle(q_axis),
        "speed": 1.0,
        "q_transient_voltage": np.abs(voltage),
        "field_voltage": np.abs(q_axis),
        "mechanical_power": known["active_power"],
    }


def check(parameters: Mapping[str, float]) -> Iterable[str]:
    """The model needs X'q = X'd (a transient saliency would turn the stator with the rotor)."""
    d, q = parameters["d_transient_reactance"], parameters["q_transient_reactance"]
    if abs(d - q) > 1e-12 * max(d, q):
        yield f"q_transient_reactance {q!r} differs from d_transient_reactance {d!r}"


TWO_AXIS = Device(
    model="two_axis",
    title="two-axis machine",
    role=Role.MACHINE,
    parameters=(
        Parameter("inertia", "H", "s", scaling=Scaling.POWER),
        Parameter("damping", "D", "p.u.", Bound.NOT_NEGATIVE, Scaling.POWER, default=0.0),
        Parameter("resistance", "Ra", "p.u.", Bound.NOT_NEGATIVE, Scaling.IMPEDANCE, default=0.0),
        Parameter("d_reactance", "Xd", "p.u.", scaling=Scaling.IMPEDANCE),
        Parameter("q_reactance", "Xq", "p.u.", scaling=Scaling.IMPEDANCE),
        Parameter("d_transient_reactance", "X'd", "p.u.", scaling=Scaling.IMPEDANCE),
        Parameter("q_transient_reactance", "X'q", "p.u.", scaling=Scaling.IMPEDANCE),
        Parameter("d_open_circuit_time", "T'd0", "s"),
        Parameter("q_open_circuit_time", "T'q0", "s"),
    ),
    states=("rotor_angle", "speed", "d_transient_voltage", "q_transient_voltage"),
    inputs=("voltage_real", "voltage_imag", "field_voltage", "mechanical_power"),
    sources=("source_real", "source_imag", "sine", "cosine"),
    outputs=(
        "d_current",
        "q_current",
        "active_power",
        "reactive_power",
        "terminal_voltage",
    ),
    source=source,
    output=output,
    derivative=derivative,
    admittance=admittance,
    targets=("active_power", "reactive_power"),
    solved_inputs=("field_voltage", "mechanical_power"),
    guess=guess,
    check=check,
)
