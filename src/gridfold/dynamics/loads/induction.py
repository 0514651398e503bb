"""What the induction motors of PSS/E share: CIM5 and CIM6, with one or two cages.

PSS/E Model Library, CIM5BL and CIM6BL; Kundur, Power System Stability and Control, 1994, section
7.2.4, for the equations of the rotor. The circuit is Ra + j Xa, then j Xm in parallel with the
rotor: of type 1 R1/s + j X1 beside R2/s + j X2, of type 2 j X1 and then R1/s beside R2/s + j X2.
Both, and a rotor with one cage, R1/s + j X1, are

    V = E'' + (Ra + j X'') I,     E'' = ((X'' - Xl) E' + (X' - X'') Ek) / (X' - Xl),
    o = E' - Ek + j (X' - Xl) I,
    T''0 dEk/dt = o - j T''0 w Ek,
    T'0  dE'/dt = -E' + (X - X') (j I - (X' - X'')/(X' - Xl)^2 o) - S E'' - j T'0 w E',
    2 H ds/dt   = Tl - Re(E'' I*),      w = w0 s + dtheta/dt,

with phasors in the frame of :mod:`~gridfold.dynamics.loads.frame`, the slip s, and the reactances and
time constants of :func:`circuit`. S |E''| = B (|E''| - A)^2 goes through SE1 and SE2. The load
torque Tl does not turn the motor backwards: the slip stays below 1.

At the start the motor draws the active power of its load. A capacitor, or reactor, beside it makes
up for the difference in reactive power.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from gridfold.dynamics.blocks import held, quadratic_saturation
from gridfold.dynamics.device import Bound, Parameter, Scaling, Values
from gridfold.dynamics.loads.frame import frame_rate, turned
from gridfold.dynamics.stator import over_impedance, terminal

TYPE, RA, XA, XM, R1, X1, R2, X2, E1, S1, E2, S2, MBASE, PMULT, H = range(15)
THETA, SLIP, ED1, EQ1, EDK, EQK = range(6)
VR, VI = range(2)
SOURCE_R, SOURCE_I, ED2, EQ2, P, Q, VT, TORQUE = range(8)

#: Time constant in s with which the frame follows the voltage.
FRAME = 0.02

DYR_COLUMNS: tuple[str | None, ...] = (
    "cage_type",
    "stator_resistance",
    "stator_reactance",
    "magnetizing_reactance",
    "rotor_resistance_1",
    "rotor_reactance_1",
    "rotor_resistance_2",
    "rotor_reactance_2",
    "saturation_voltage_1",
    "saturation_1",
    "saturation_voltage_2",
    "saturation_2",
    "motor_base",
    "load_multiple",
    "inertia",
    "trip_voltage",
    "trip_cycles",
    "breaker_cycles",
)

PARAMETERS = (
    Parameter("cage_type", "IT", "-"),
    Parameter("stator_resistance", "Ra", "p.u.", Bound.NOT_NEGATIVE, Scaling.IMPEDANCE),
    Parameter("stator_reactance", "Xa", "p.u.", Bound.NOT_NEGATIVE, Scaling.IMPEDANCE),
    Parameter("magnetizing_reactance", "Xm", "p.u.", scaling=Scaling.IMPEDANCE),
    Parameter("rotor_resistance_1", "R1", "p.u.", scaling=Scaling.IMPEDANCE),
    Parameter("rotor_reactance_1", "X1", "p.u.", scaling=Scaling.IMPEDANCE),
    Parameter("rotor_resistance_2", "R2", "p.u.", Bound.NOT_NEGATIVE, Scaling.IMPEDANCE),
    Parameter("rotor_reactance_2", "X2", "p.u.", Bound.NOT_NEGATIVE, Scaling.IMPEDANCE),
    Parameter("saturation_voltage_1", "E1", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("saturation_1", "SE1", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("saturation_voltage_2", "E2", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("saturation_2", "SE2", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("motor_base", "MBASE", "MVA", Bound.NOT_NEGATIVE),
    Parameter("load_multiple", "PMULT", "MVA/MW", Bound.NOT_NEGATIVE),
    Parameter("inertia", "H", "s", scaling=Scaling.POWER),
    Parameter("trip_voltage", "VI", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("trip_cycles", "TI", "cycles", Bound.NOT_NEGATIVE),
    Parameter("breaker_cycles", "TB", "cycles", Bound.NOT_NEGATIVE),
)
STATES = (
    "voltage_angle",
    "slip",
    "d_transient_voltage",
    "q_transient_voltage",
    "d_cage_voltage",
    "q_cage_voltage",
)
SOURCES = ("source_real", "source_imag", "d_subtransient_voltage", "q_subtransient_voltage")
OUTPUTS = ("active_power", "reactive_power", "terminal_voltage", "electric_torque")


@njit
def circuit(p, i, base_speed):
    """X, X', X'', Xl in p.u., T'0 and T''0 in s of unit `i`; that of a single cage is an idle 1 s."""
    x_a, x_m, x_1, x_2 = p[XA, i], p[XM, i], p[X1, i], p[X2, i]
    x = x_a + x_m
    one = x_m * x_1 / (x_m + x_1)
    if p[R2, i].real == 0 or p[X2, i].real == 0:
        x_t = x_a + one
        return x, x_t, x_t, x_a, (x_1 + x_m) / (base_speed * p[R1, i]), 1.0 + 0.0 * x
    if p[TYPE, i].real < 1.5:
        t_1, t_2 = (x_1 + x_m) / p[R1, i], (x_2 + one) / p[R2, i]
        return x, x_a + one, x_a + one * x_2 / (one + x_2), x_a, t_1 / base_speed, t_2 / base_speed
    total = x_m + x_1 + x_2
    x_s = x_a + one
    t_1, t_2 = total / p[R2, i], (x_m + x_1) * x_2 / (total * p[R1, i])
    return x, x_a + x_m * (x_1 + x_2) / total, x_s, x_s, t_1 / base_speed, t_2 / base_speed


@njit
def motor_source(x, p, y, i, base_speed):
    """Norton current E'' / (Ra + j X''), and E'' in the unit's own frame."""
    _, x_1, x_2, x_l, _, _ = circuit(p, i, base_speed)
    share = (x_2 - x_l) / (x_1 - x_l)
    y[ED2, i] = share * x[ED1, i] + (1 - share) * x[EDK, i]
    y[EQ2, i] = share * x[EQ1, i] + (1 - share) * x[EQK, i]
    e_r, e_i = turned(y[ED2, i], y[EQ2, i], np.cos(x[THETA, i]), np.sin(x[THETA, i]))
    y[SOURCE_R, i], y[SOURCE_I, i] = over_impedance(e_r, e_i, p[RA, i], x_2)


@njit
def motor_current(x, u, p, y, i, x_2):
    """Current into the motor in the unit's own frame."""
    out_r, out_i, _, _, _ = terminal(
        y[SOURCE_R, i], y[SOURCE_I, i], u[VR, i], u[VI, i], p[RA, i], x_2
    )
    return turned(-out_r, -out_i, np.cos(x[THETA, i]), -np.sin(x[THETA, i]))


@njit
def motor_output(x, u, p, y, i, base_speed, shunt):
    """Power into the network with that of the shunt, voltage, torque on the system's base."""
    _, _, x_2, _, _, _ = circuit(p, i, base_speed)
    _, _, y[P, i], reactive, y[VT, i] = terminal(
        y[SOURCE_R, i], y[SOURCE_I, i], u[VR, i], u[VI, i], p[RA, i], x_2
    )
    y[Q, i] = reactive + shunt * y[VT, i] * y[VT, i]
    i_d, i_q = motor_current(x, u, p, y, i, x_2)
    y[TORQUE, i] = y[ED2, i] * i_d + y[EQ2, i] * i_q


@njit
def motor_rates(x, u, p, y, dx, i, base_speed, load_torque):
    """Derivatives of unit `i`: frame, slip and both cages."""
    x_0, x_1, x_2, x_l, t_1, t_2 = circuit(p, i, base_speed)
    i_d, i_q = motor_current(x, u, p, y, i, x_2)
    dx[THETA, i] = frame_rate(u[VR, i], u[VI, i], x[THETA, i], FRAME)
    turn = base_speed * x[SLIP, i] + dx[THETA, i]
    acceleration = (load_torque - y[TORQUE, i]) / (2 * p[H, i])
    dx[SLIP, i] = held(acceleration, x[SLIP, i], -1e9, 1.0)
    o_d = x[ED1, i] - x[EDK, i] - (x_1 - x_l) * i_q
    o_q = x[EQ1, i] - x[EQK, i] + (x_1 - x_l) * i_d
    part = (x_1 - x_2) / (x_1 - x_l) ** 2
    flux = np.sqrt(y[ED2, i] * y[ED2, i] + y[EQ2, i] * y[EQ2, i])
    s = 0.0 * flux
    if flux.real > 0:
        s = quadratic_saturation(flux, p[E1, i], p[S1, i], p[E2, i], p[S2, i]) / flux
    drive_d = (x_0 - x_1) * (-i_q - part * o_d) - s * y[ED2, i]
    drive_q = (x_0 - x_1) * (i_d - part * o_q) - s * y[EQ2, i]
    dx[ED1, i] = (drive_d - x[ED1, i]) / t_1 + turn * x[EQ1, i]
    dx[EQ1, i] = (drive_q - x[EQ1, i]) / t_1 - turn * x[ED1, i]
    if p[R2, i].real == 0 or p[X2, i].real == 0:
        dx[EDK, i], dx[EQK, i] = x[ED1, i] - x[EDK, i], x[EQ1, i] - x[EQK, i]
    else:
        dx[EDK, i] = o_d / t_2 + turn * x[EQK, i]
        dx[EQK, i] = o_q / t_2 - turn * x[EDK, i]


def admittance(p: Values) -> NDArray[np.complex128]:
    """1 / (Ra + j X'') of the motor, and its shunt."""
    rows = np.array([p[parameter.name] for parameter in PARAMETERS])
    x_2 = [circuit.py_func(rows, k, speed)[2] for k, speed in enumerate(p["base_speed"])]
    motor = 1 / (p["stator_resistance"] + 1j * np.array(x_2))
    return np.asarray(motor + 1j * p["shunt_susceptance"])


def guess(p: Values, known: Mapping[str, Any]) -> dict[str, Any]:
    """Slip on the stable side of the power's curve, and the fluxes that belong to it."""
    rows = np.array([p[parameter.name] for parameter in PARAMETERS])
    voltage = known["voltage_real"] + 1j * known["voltage_imag"]
    found = [
        _start(rows, k, float(speed), abs(complex(v)), -float(power))
        for k, (speed, v, power) in enumerate(
            zip(p["base_speed"], voltage, known["active_power"], strict=True)
        )
    ]
    slip, transient, cage, current = (np.array(values) for values in zip(*found, strict=True))
    torque = (-known["active_power"]) - p["stator_resistance"] * np.abs(current) ** 2
    drawn = np.abs(voltage) * np.conj(current)
    return {
        "voltage_angle": np.angle(voltage),
        "slip": slip,
        "d_transient_voltage": transient.real,
        "q_transient_voltage": transient.imag,
        "d_cage_voltage": cage.real,
        "q_cage_voltage": cage.imag,
        "load_torque": torque,
        "shunt_susceptance": (known["reactive_power"] + drawn.imag) / np.abs(voltage) ** 2,
    }


def _start(
    rows: NDArray[np.float64], k: int, base_speed: float, v: float, power: float
) -> tuple[float, complex, complex, complex]:
    """Slip, E', Ek and current of unit `k` without saturation, at a real voltage."""
    slips = np.geomspace(1e-6, 1.0, 400)
    drawn = v * v * (1 / _impedance(rows, k, slips)).real
    first = int(np.argmax(drawn >= power)) if (drawn >= power).any() else int(np.argmax(drawn))
    slip = float(np.interp(power, drawn[: first + 1], slips[: first + 1]))
    current = complex(v / _impedance(rows, k, np.array([slip]))[0])
    _, x_1, x_2, x_l, _, t_2 = circuit.py_func(rows, k, base_speed)
    behind = v - (rows[RA, k] + 1j * x_2) * current
    if rows[R2, k] == 0 or rows[X2, k] == 0:
        return slip, behind, behind, current
    share, turn = (x_2 - x_l) / (x_1 - x_l), 1 + 1j * base_speed * slip * t_2
    ahead = 1j * (x_1 - x_l) * current
    cage = (behind + share * ahead) / (share * turn + 1 - share)
    return slip, cage * turn - ahead, cage, current


def _impedance(
    rows: NDArray[np.float64], k: int, slip: NDArray[np.float64]
) -> NDArray[np.complex128]:
    """Impedance of the motor of unit `k` at slips."""
    first, second = rows[R1, k] / slip, rows[R2, k] / slip + 1j * rows[X2, k]
    rotor = first + 1j * rows[X1, k]
    if rows[R2, k] and rows[X2, k]:
        if rows[TYPE, k] < 1.5:
            rotor = 1 / (1 / rotor + 1 / second)
        else:
            rotor = 1j * rows[X1, k] + 1 / (1 / first + 1 / second)
    x_m = 1j * rows[XM, k]
    return np.asarray(rows[RA, k] + 1j * rows[XA, k] + x_m * rotor / (x_m + rotor))


def rating(parameters: Mapping[str, float], load_mw: float) -> float:
    """MBASE, or where it is 0 PMULT times the load in MW."""
    return parameters["motor_base"] or parameters["load_multiple"] * load_mw


def check(parameters: Mapping[str, float]) -> Iterable[str]:
    """Known types, both values of a second cage or none, saturation that rises."""
    if parameters["cage_type"] not in (1, 2):
        yield f"cage_type (IT) is 1 or 2, not {parameters['cage_type']:g}"
    second = [parameters[f"rotor_{name}_2"] for name in ("resistance", "reactance")]
    if (second[0] == 0) != (second[1] == 0):
        yield (
            f"rotor_resistance_2 (R2) is {second[0]:g} and rotor_reactance_2 (X2) {second[1]:g}: a "
            "second cage has both, a single one neither"
        )
    low, high = parameters["saturation_1"], parameters["saturation_2"]
    rises = parameters["saturation_voltage_2"] > parameters["saturation_voltage_1"]
    if low and high and not (rises and high > low):
        yield (
            "saturation_1 SE1 and saturation_2 SE2 have to rise with E1 and E2, or one of them has "
            "to be 0, which means that nothing saturates"
        )
