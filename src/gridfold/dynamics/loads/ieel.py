"""IEEL of PSS/E: a load that goes with powers of the voltage and with the frequency.

PSS/E Model Library, IEELBL, IEELOW, IEELZN, IEELAR and IEELAL, for a load, an owner, a zone, an
area and all. With the voltage v of the bus in p.u. and the deviation f of its frequency,

    P = Pb (a1 v^n1 + a2 v^n2 + a3 v^n3) (1 + a7 f),
    Q = Qb (a4 v^n4 + a5 v^n5 + a6 v^n6) (1 + a8 f),

where Pb and Qb are such that the load draws at the start what the power flow says. Below 0.7 p.u.
it is a constant impedance, as all loads are. The part without frequency belongs to the network
(:mod:`gridfold.dynamics.network.loads`). The rest is a current that sees the voltage through a
filter: the frequency is the derivative of the voltage's angle through two lags of 20 ms each, in
place of PSS/E's one of 40 ms, and the voltage passes a lag of 20 ms. Only loads with a7 or a8 have
these states.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from gridfold.dynamics.blocks import higher, lag
from gridfold.dynamics.device import Bound, Device, Parameter, Role, Terms, Values
from gridfold.dynamics.loads.break_voltage import BREAK_VOLTAGE
from gridfold.dynamics.loads.frame import frame_rate, turned

A1, A2, A3, A4, A5, A6, A7, A8, N1, N2, N3, N4, N5, N6, PB, QB, BASE_SPEED = range(17)
THETA, F, V = range(3)
VR, VI = range(2)
SOURCE_R, SOURCE_I, P, Q, VT = range(5)

#: Time constant of each filter in s.
FILTER = 0.02

DYR_COLUMNS: tuple[str | None, ...] = (
    *(f"active_weight_{k}" for k in (1, 2, 3)),
    *(f"reactive_weight_{k}" for k in (1, 2, 3)),
    "active_frequency_factor",
    "reactive_frequency_factor",
    *(f"active_exponent_{k}" for k in (1, 2, 3)),
    *(f"reactive_exponent_{k}" for k in (1, 2, 3)),
)


@njit
def dependence(v, a_1, n_1, a_2, n_2, a_3, n_3):
    """A sum of powers of a positive voltage; 1 where there is no term."""
    if a_1.real == 0 and a_2.real == 0 and a_3.real == 0:
        return 1.0 + 0.0 * v
    log = np.log(v)
    return a_1 * np.exp(n_1 * log) + a_2 * np.exp(n_2 * log) + a_3 * np.exp(n_3 * log)


@njit
def at_voltage(v, p, i):
    """Active and reactive power of unit `i` at a voltage and nominal frequency, over its square."""
    m = higher(v, BREAK_VOLTAGE)
    active = dependence(m, p[A1, i], p[N1, i], p[A2, i], p[N2, i], p[A3, i], p[N3, i])
    reactive = dependence(m, p[A4, i], p[N4, i], p[A5, i], p[N5, i], p[A6, i], p[N6, i])
    return p[PB, i] * active / (m * m), p[QB, i] * reactive / (m * m)


def source(x, u, p, y, dx):
    """Current that the deviation of the frequency adds."""
    for i in range(x.shape[1]):
        active, reactive = at_voltage(x[V, i], p, i)
        g, b = p[A7, i] * x[F, i] * active, -p[A8, i] * x[F, i] * reactive
        y[SOURCE_R, i], y[SOURCE_I, i] = turned(
            -g * x[V, i], -b * x[V, i], np.cos(x[THETA, i]), np.sin(x[THETA, i])
        )


def output(x, u, p, y, dx):
    """Power into the network, with its part that the frequency changes, and voltage."""
    for i in range(x.shape[1]):
        squared = u[VR, i] * u[VR, i] + u[VI, i] * u[VI, i]
        y[VT, i] = np.sqrt(squared)
        active, reactive = at_voltage(y[VT, i], p, i)
        y[P, i] = u[VR, i] * y[SOURCE_R, i] + u[VI, i] * y[SOURCE_I, i] - active * squared
        y[Q, i] = u[VI, i] * y[SOURCE_R, i] - u[VR, i] * y[SOURCE_I, i] - reactive * squared


def derivative(x, u, p, y, dx):
    """Angle, frequency and voltage of the bus."""
    for i in range(x.shape[1]):
        dx[THETA, i] = frame_rate(u[VR, i], u[VI, i], x[THETA, i], FILTER)
        dx[F, i] = (dx[THETA, i] / p[BASE_SPEED, i] - x[F, i]) / FILTER
        _, dx[V, i] = lag(y[VT, i], x[V, i], FILTER + 0.0 * p[A1, i])


def admittance(p: Values) -> NDArray[np.complex128]:
    """None: the load at nominal frequency belongs to the network."""
    return np.zeros(len(p["active_weight_1"]), dtype=np.complex128)


def guess(p: Values, known: Mapping[str, Any]) -> Mapping[str, Any]:
    """The voltage is known; the powers are linear in what they are made of."""
    voltage = known["voltage_real"] + 1j * known["voltage_imag"]
    return {"voltage_angle": np.angle(voltage), "measured_voltage": np.abs(voltage)}


def characteristic(parameters: Mapping[str, float]) -> Terms:
    """Exponents and weights of active and reactive power."""
    kinds = (("active", 1.0 + 0j), ("reactive", 1j))
    return tuple(
        (parameters[f"{kind}_exponent_{k}"], parameters[f"{kind}_weight_{k}"] * unit)
        for kind, unit in kinds
        for k in (1, 2, 3)
    )


def has_dynamics(parameters: Mapping[str, float]) -> bool:
    """Whether the frequency matters."""
    return any(parameters[f"{kind}_frequency_factor"] for kind in ("active", "reactive"))


IEEL = Device(
    model="ieel",
    title="load by voltage and frequency (PSS/E IEEL)",
    role=Role.LOAD,
    parameters=(
        *(Parameter(f"active_weight_{k}", f"a{k}", "p.u.", Bound.ANY) for k in (1, 2, 3)),
        *(Parameter(f"reactive_weight_{k}", f"a{k + 3}", "p.u.", Bound.ANY) for k in (1, 2, 3)),
        Parameter("active_frequency_factor", "a7", "p.u.", Bound.ANY),
        Parameter("reactive_frequency_factor", "a8", "p.u.", Bound.ANY),
        *(Parameter(f"active_exponent_{k}", f"n{k}", "-", Bound.ANY) for k in (1, 2, 3)),
        *(Parameter(f"reactive_exponent_{k}", f"n{k + 3}", "-", Bound.ANY) for k in (1, 2, 3)),
    ),
    set_points=("active_power_base", "reactive_power_base"),
    states=("voltage_angle", "bus_frequency_deviation", "measured_voltage"),
    inputs=("voltage_real", "voltage_imag"),
    sources=("source_real", "source_imag"),
    outputs=("active_power", "reactive_power", "terminal_voltage"),
    source=source,
    output=output,
    derivative=derivative,
    admittance=admittance,
    targets=("active_power", "reactive_power"),
    guess=guess,
    characteristic=characteristic,
    has_dynamics=has_dynamics,
    psse_record=DYR_COLUMNS,
)
