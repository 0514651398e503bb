"""CSVGN1 of PSS/E: a static var compensator, a capacitor beside a reactor that thyristors control.

PSS/E Model Library, CSVGN1. In p.u. of the unit's base MBASE, with the reactor's susceptance B,

    U = K (1 + s T1) (1 + s T2) / ((1 + s T3) (1 + s T4)) (V - VREF)      VMIN <= U <= VMAX
    B = 1 / (1 + s T5) U                                                   RMIN / MBASE <= B <= 1
    I = j (CBASE / MBASE - B) V                                            reactive current given

the limits of B being non-windup. The unit stands in the place of a machine. To the network it is the
susceptance that it has at the start; the difference from that is a current that follows the voltage
within 5 ms. Active power that the power flow gives it, its losses, is a constant conductance.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gridfold.dynamics.blocks import clip, lag, lead_lag, limited_lag
from gridfold.dynamics.checks import checks
from gridfold.dynamics.device import Bound, Device, Parameter, Role, Scaling, Values, limits
from gridfold.dynamics.loads.frame import frame_rate, turned

(
    K, T1, T2, T3, T4, T5, RMIN, VMAX, VMIN, CBASE, MBASE, POWER_BASE,
    CONDUCTANCE, SUSCEPTANCE, VREF, BASE_SPEED,
) = range(16)  # fmt: skip
THETA, V, LEAD_1, LEAD_2, REACTOR = range(5)
VR, VI = range(2)
SOURCE_R, SOURCE_I, P, Q, VT, CHANGE = range(6)

#: Time in s within which the voltage is followed.
FOLLOW = 0.005

PARAMETERS = (
    Parameter("regulator_gain", "K", "p.u."),
    Parameter("lead_time_1", "T1", "s", Bound.NOT_NEGATIVE),
    Parameter("lead_time_2", "T2", "s", Bound.NOT_NEGATIVE),
    Parameter("lag_time_1", "T3", "s", Bound.NOT_NEGATIVE),
    Parameter("lag_time_2", "T4", "s", Bound.NOT_NEGATIVE),
    Parameter("thyristor_time", "T5", "s", Bound.NOT_NEGATIVE),
    Parameter("lowest_reactor", "RMIN", "Mvar", Bound.ANY),
    Parameter("highest_regulator", "VMAX", "p.u.", Bound.ANY),
    Parameter("lowest_regulator", "VMIN", "p.u.", Bound.ANY),
    Parameter("capacitor", "CBASE", "Mvar", Bound.ANY),
    Parameter("unit_base", "MBASE", "MVA", Bound.NOT_NEGATIVE, default=0.0),
    Parameter("power_base", "MBASE/SBASE", "p.u.", scaling=Scaling.POWER, default=1.0),
)
DYR_COLUMNS: tuple[str | None, ...] = tuple(p.name for p in PARAMETERS[:-2])


def source(x, u, p, y, dx):
    """Current of the susceptance beyond that of the start."""
    for i in range(x.shape[1]):
        reactor = clip(x[REACTOR, i], p[RMIN, i] / p[MBASE, i], 1.0 + 0.0 * x[REACTOR, i])
        given = p[POWER_BASE, i] * (p[CBASE, i] / p[MBASE, i] - reactor) - p[SUSCEPTANCE, i]
        y[SOURCE_R, i], y[SOURCE_I, i] = turned(
            0.0 * x[V, i], -given * x[V, i], np.cos(x[THETA, i]), np.sin(x[THETA, i])
        )


def output(x, u, p, y, dx):
    """Power and voltage, and the change of the susceptance since the start."""
    for i in range(x.shape[1]):
        squared = u[VR, i] * u[VR, i] + u[VI, i] * u[VI, i]
        i_r, i_i = y[SOURCE_R, i], y[SOURCE_I, i]
        y[P, i] = u[VR, i] * i_r + u[VI, i] * i_i - p[CONDUCTANCE, i] * squared
        y[Q, i] = u[VI, i] * i_r - u[VR, i] * i_i + p[SUSCEPTANCE, i] * squared
        y[VT, i] = np.sqrt(squared)
        y[CHANGE, i] = (
            p[POWER_BASE, i] * (p[CBASE, i] / p[MBASE, i] - x[REACTOR, i]) - p[SUSCEPTANCE, i]
        )


def derivative(x, u, p, y, dx):
    """Followed voltage, regulator and reactor."""
    for i in range(x.shape[1]):
        dx[THETA, i] = frame_rate(u[VR, i], u[VI, i], x[THETA, i], FOLLOW)
        _, dx[V, i] = lag(y[VT, i], x[V, i], FOLLOW + 0.0 * p[K, i])
        error = y[VT, i] - p[VREF, i]
        first, dx[LEAD_1, i] = lead_lag(error, x[LEAD_1, i], p[T1, i], p[T3, i])
        second, dx[LEAD_2, i] = lead_lag(first, x[LEAD_2, i], p[T2, i], p[T4, i])
        wanted = clip(p[K, i] * second, p[VMIN, i], p[VMAX, i])
        _, dx[REACTOR, i] = limited_lag(
            wanted, x[REACTOR, i], p[T5, i], p[RMIN, i] / p[MBASE, i], 1.0 + 0.0 * wanted
        )


def admittance(p: Values) -> NDArray[np.complex128]:
    """What it is at the start."""
    return np.asarray(p["conductance"] + 1j * p["susceptance"])


def guess(p: Values, known: Mapping[str, Any]) -> Mapping[str, Any]:
    """Susceptance from reactive power and voltage, and back through the regulator."""
    voltage = known["voltage_real"] + 1j * known["voltage_imag"]
    size = np.abs(voltage)
    given = known["reactive_power"] / size**2
    reactor = p["capacitor"] / p["unit_base"] - given / p["power_base"]
    error = reactor / p["regulator_gain"]
    return {
        "voltage_angle": np.angle(voltage),
        "followed_voltage": size,
        "regulator_lead_1": error,
        "regulator_lead_2": error,
        "reactor": reactor,
        "conductance": -known["active_power"] / size**2,
        "susceptance": given,
        "voltage_reference": size - error,
    }


def resolve(parameters: Mapping[str, float], base_mva: float) -> Mapping[str, float]:
    """The base is that of the unit."""
    return {**parameters, "unit_base": base_mva}


def reactor(parameters: Mapping[str, float]) -> Iterable[str]:
    """A reactor smaller than the unit's base, and a thyristor lag."""
    if parameters["lowest_reactor"] >= parameters["unit_base"]:
        yield (
            f"lowest_reactor RMIN {parameters['lowest_reactor']:g} Mvar is not below MBASE "
            f"{parameters['unit_base']:g} MVA"
        )
    if parameters["thyristor_time"] == 0:
        yield "thyristor_time T5 is 0: the susceptance needs a lag"


CSVGN1 = Device(
    model="csvgn1",
    title="static var compensator CSVGN1",
    role=Role.MACHINE,
    parameters=PARAMETERS,
    set_points=("conductance", "susceptance", "voltage_reference"),
    states=(
        "voltage_angle",
        "followed_voltage",
        "regulator_lead_1",
        "regulator_lead_2",
        "reactor",
    ),
    inputs=("voltage_real", "voltage_imag"),
    sources=("source_real", "source_imag"),
    outputs=("active_power", "reactive_power", "terminal_voltage", "susceptance_change"),
    source=source,
    output=output,
    derivative=derivative,
    admittance=admittance,
    targets=("active_power", "reactive_power", "susceptance_change"),
    defaults={"susceptance_change": 0.0},
    guess=guess,
    resolve=resolve,
    check=checks(
        PARAMETERS,
        ordered=[("lowest_regulator", "highest_regulator")],
        proper=[("lead_time_1", "lag_time_1"), ("lead_time_2", "lag_time_2")],
        more=[reactor],
    ),
    limits=limits("lowest_regulator", "highest_regulator"),
    psse_record=DYR_COLUMNS,
)
