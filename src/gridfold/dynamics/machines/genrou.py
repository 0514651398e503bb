"""GENROU of PSS/E: round-rotor machine with a field, three dampers and quadratic saturation.

PSS/E Model Library, GENROU; without saturation it is the machine of Sauer & Pai, Power System
Dynamics and Stability, 1998, section 3.5 (IEEE Std 1110, model 2.2). All voltages are seen from the
rotor: Id + j Iq = I exp(-j(delta - pi/2)). The rotor keeps the flux

    psi''d =  (X'' - Xl)/(X'd - Xl) E'q + (X'd - X'')/(X'd - Xl) psi1d
    psi''q = -(X'' - Xl)/(X'q - Xl) E'd + (X'q - X'')/(X'q - Xl) psi2q

and the stator is E'' = -psi''q + j psi''d = V + (Ra + j X'') I, without transformer voltages and
without the speed; X'' = X''d = X''q. With ed = psi1d + (X'd - Xl) Id - E'q and
eq = psi2q + (X'q - Xl) Iq + E'd,

    T'd0  dE'q/dt   = Efd - Xad Ifd,     T''d0 dpsi1d/dt = -ed,     T''q0 dpsi2q/dt = -eq
    Xad Ifd         = E'q + (Xd - X'd) (Id - (X'd - X'')/(X'd - Xl)^2 ed) + S psi''d
    T'q0  dE'd/dt   = -E'd + (Xq - X'q) (Iq - (X'q - X'')/(X'q - Xl)^2 eq)
                      + S psi''q (Xq - Xl)/(Xd - Xl)
    2 H   dw/dt     = (Pm - D (w - 1)) / w - (psi''d Iq - psi''q Id)

where S = B (psi'' - A)^2 / psi'' at psi'' = |psi''d + j psi''q| > A passes through S(1.0) and
S(1.2). Power over speed is the torque here; the two-axis machine takes power for torque.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from gridfold.dynamics.blocks import quadratic_saturation
from gridfold.dynamics.device import Bound, Device, Parameter, Role, Scaling, Values
from gridfold.dynamics.stator import over_impedance, terminal

#: Numbers of the dynamics record.
DYR_COLUMNS: tuple[str | None, ...] = (
    "d_open_circuit_time",
    "d_subtransient_open_circuit_time",
    "q_open_circuit_time",
    "q_subtransient_open_circuit_time",
    "inertia",
    "damping",
    "d_reactance",
    "q_reactance",
    "d_transient_reactance",
    "q_transient_reactance",
    "subtransient_reactance",
    "leakage_reactance",
    "saturation_10",
    "saturation_12",
)

TD1, TD2, TQ1, TQ2, H, D, XD, XQ, XD1, XQ1, X2, XL, S10, S12, RA, BASE_SPEED = range(16)
DELTA, OMEGA, EQ1, ED1, PSI_1D, PSI_2Q = range(6)
VR, VI, EFD, PM = range(4)
SOURCE_R, SOURCE_I, SIN, COS, PSI_D, PSI_Q, IR, II, ID, IQ, P, Q, VT, IFD = range(14)


@njit
def between(at_transient, at_leakage, x_1, x_2, x_l):
    """Flux behind X'': the value behind X' and the one behind Xl, weighted by reactances."""
    return ((x_2 - x_l) * at_transient + (x_1 - x_2) * at_leakage) / (x_1 - x_l)


@njit
def induced(current, error, x, x_1, x_2, x_l):
    """What a stator current and a damper that is out of balance add to the current of a winding."""
    return (x - x_1) * (current - (x_1 - x_2) / (x_1 - x_l) ** 2 * error)


@njit
def acceleration(power, torque, speed, damping, inertia):
    """Derivative of the speed of a PSS/E machine."""
    return ((power - damping * (speed - 1.0)) / speed - torque) / (2.0 * inertia)


@njit
def saturation(flux_d, flux_q, s_10, s_12):
    """S of the magnitude of a flux; 0 without flux."""
    flux = np.sqrt(flux_d * flux_d + flux_q * flux_q)
    if flux.real > 0:
        return quadratic_saturation(flux, 1.0, s_10, 1.2, s_12) / flux
    return 0.0 * flux


@njit
def stator_outputs(x, u, p, y, i, s):
    """Outputs of unit `i`: stator currents, terminal power and voltage, field current with S = `s`."""
    i_r, i_i, y[P, i], y[Q, i], y[VT, i] = terminal(
        y[SOURCE_R, i], y[SOURCE_I, i], u[VR, i], u[VI, i], p[RA, i], p[X2, i]
    )
    i_d = i_r * y[SIN, i] - i_i * y[COS, i]
    y[IR, i], y[II, i] = i_r, i_i
    y[ID, i], y[IQ, i] = i_d, i_r * y[COS, i] + i_i * y[SIN, i]
    error = x[PSI_1D, i] + (p[XD1, i] - p[XL, i]) * i_d - x[EQ1, i]
    armature = induced(i_d, error, p[XD, i], p[XD1, i], p[X2, i], p[XL, i])
    y[IFD, i] = x[EQ1, i] + armature + s * y[PSI_D, i]


@njit
def rotor_rates(x, u, p, y, dx, i, s):
    """Derivatives of unit `i`: swing equation, field and dampers, with S = `s`."""
    i_d, i_q, psi_d, psi_q = y[ID, i], y[IQ, i], y[PSI_D, i], y[PSI_Q, i]
    torque = psi_d * i_q - psi_q * i_d
    dx[DELTA, i] = p[BASE_SPEED, i] * (x[OMEGA, i] - 1.0)
    dx[OMEGA, i] = acceleration(u[PM, i], torque, x[OMEGA, i], p[D, i], p[H, i])
    dx[EQ1, i] = (u[EFD, i] - y[IFD, i]) / p[TD1, i]
    dx[PSI_1D, i] = (x[EQ1, i] - (p[XD1, i] - p[XL, i]) * i_d - x[PSI_1D, i]) / p[TD2, i]
    error = x[PSI_2Q, i] + (p[XQ1, i] - p[XL, i]) * i_q + x[ED1, i]
    dx[PSI_2Q, i] = -error / p[TQ2, i]
    armature = induced(i_q, error, p[XQ, i], p[XQ1, i], p[X2, i], p[XL, i])
    s_q = s * (p[XQ, i] - p[XL, i]) / (p[XD, i] - p[XL, i])
    dx[ED1, i] = (-x[ED1, i] + armature + s_q * psi_q) / p[TQ1, i]


def source(x, u, p, y, dx):
    """Norton current E'' / (Ra + j X'')."""
    for i in range(x.shape[1]):
        s, c = np.sin(x[DELTA, i]), np.cos(x[DELTA, i])
        psi_d = between(x[EQ1, i], x[PSI_1D, i], p[XD1, i], p[X2, i], p[XL, i])
        psi_q = between(-x[ED1, i], x[PSI_2Q, i], p[XQ1, i], p[X2, i], p[XL, i])
        e_r, e_i = psi_d * c - psi_q * s, psi_d * s + psi_q * c
        y[SOURCE_R, i], y[SOURCE_I, i] = over_impedance(e_r, e_i, p[RA, i], p[X2, i])
        y[SIN, i], y[COS, i] = s, c
        y[PSI_D, i], y[PSI_Q, i] = psi_d, psi_q


def output(x, u, p, y, dx):
    """Stator currents, terminal power and voltage, field current."""
    for i in range(x.shape[1]):
        s = saturation(y[PSI_D, i], y[PSI_Q, i], p[S10, i], p[S12, i])
        stator_outputs(x, u, p, y, i, s)


def derivative(x, u, p, y, dx):
    """Swing equation, field and dampers."""
    for i in range(x.shape[1]):
        s = saturation(y[PSI_D, i], y[PSI_Q, i], p[S10, i], p[S12, i])
        rotor_rates(x, u, p, y, dx, i, s)


def admittance(p: Values) -> NDArray[np.complex128]:
    """1 / (Ra + j X'')."""
    return np.asarray(1 / (p["resistance"] + 1j * p["subtransient_reactance"]))


def guess(p: Values, known: Mapping[str, Any]) -> Mapping[str, Any]:
    """Start from the saturated q axis.

    The magnitude of psi'' does not depend on the rotor angle, so S is known, and the q axis lies at
    V + (Ra + j Xs) I with Xs = X'' + (Xq - X'') / (1 + S (Xq - Xl)/(Xd - Xl)).
    """
    excess = np.vectorize(quadratic_saturation.py_func, otypes=[float])

    def of_flux(flux: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(excess(flux, 1.0, p["saturation_10"], 1.2, p["saturation_12"]) / flux)

    return saturated_guess(p, known, of_flux)


def saturated_guess(
    p: Values,
    known: Mapping[str, Any],
    of_flux: Callable[[NDArray[np.float64]], NDArray[np.float64]],
) -> dict[str, NDArray[np.float64] | float]:
    """The start from the saturated q axis, S being `of_flux`."""
    x_2, x_l = p["subtransient_reactance"], p["leakage_reactance"]
    voltage, current = phasors(known)
    internal = voltage + current / admittance(p)
    saturated = 1 + of_flux(np.abs(internal)) * (p["q_reactance"] - x_l) / (p["d_reactance"] - x_l)
    angle = np.angle(internal + 1j * (p["q_reactance"] - x_2) / saturated * current)
    turn = np.exp(-1j * (angle - np.pi / 2))
    rotor = internal * turn + 1j * (p["q_transient_reactance"] - x_2) * current * turn
    return {
        **d_axis_guess(p, known, angle),
        "d_transient_voltage": rotor.real,
        "q_damper_flux": -rotor.real - (p["q_transient_reactance"] - x_l) * (current * turn).imag,
    }


def phasors(known: Mapping[str, Any]) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """Terminal voltage and current of the power flow."""
    voltage = known["voltage_real"] + 1j * known["voltage_imag"]
    power = known["active_power"] + 1j * known["reactive_power"]
    return voltage, np.conj(power / voltage)


def d_axis_guess(
    p: Values, known: Mapping[str, Any], angle: NDArray[np.float64]
) -> dict[str, NDArray[np.float64] | float]:
    """Speed, d-axis fluxes, unsaturated field voltage and power at a rotor angle."""
    voltage, current = phasors(known)
    turn = np.exp(-1j * (angle - np.pi / 2))
    flux = ((voltage + p["resistance"] * current) * turn).imag
    i_d = (current * turn).real
    return {
        "rotor_angle": angle,
        "speed": 1.0,
        "q_transient_voltage": flux + p["d_transient_reactance"] * i_d,
        "d_damper_flux": flux + p["leakage_reactance"] * i_d,
        "field_voltage": flux + p["d_reactance"] * i_d,
        "mechanical_power": known["active_power"] + p["resistance"] * np.abs(current) ** 2,
    }


Named = tuple[str, str]


def check(parameters: Mapping[str, float]) -> Iterable[str]:
    """Both axes have a transient circuit, with a reactance other than that of the leakage."""
    yield from above_leakage(parameters, ("d_transient_reactance", "X'd"))
    yield from rising_saturation(parameters)
    pairs = (("q_open_circuit_time", "T'q0"), ("q_transient_reactance", "X'q"))
    missing = [pair for pair in pairs if parameters[pair[0]] == 0]
    for name, symbol in missing:
        yield (
            f"{name} ({symbol}) is 0, but GENROU has a transient circuit in the q axis; "
            "a machine without one is a GENSAL"
        )
    if not missing:
        yield from above_leakage(parameters, pairs[1])


def above_leakage(parameters: Mapping[str, float], named: Named) -> Iterator[str]:
    """A fault where a transient reactance equals the leakage reactance."""
    name, symbol = named
    if parameters[name] == parameters["leakage_reactance"]:
        yield f"{name} ({symbol}) {parameters[name]!r} must differ from leakage_reactance (Xl)"


def rising_saturation(parameters: Mapping[str, float]) -> Iterator[str]:
    """A fault where the iron saturates less at 1.2 than at 1.0."""
    low, high = parameters["saturation_10"], parameters["saturation_12"]
    if high < low:
        yield f"saturation_12 (S(1.2)) {high!r} is less than saturation_10 (S(1.0)) {low!r}"


GENROU = Device(
    model="genrou",
    title="PSS/E round-rotor machine GENROU",
    role=Role.MACHINE,
    parameters=(
        Parameter("d_open_circuit_time", "T'd0", "s"),
        Parameter("d_subtransient_open_circuit_time", "T''d0", "s"),
        Parameter("q_open_circuit_time", "T'q0", "s", Bound.NOT_NEGATIVE),
        Parameter("q_subtransient_open_circuit_time", "T''q0", "s"),
        Parameter("inertia", "H", "s", scaling=Scaling.POWER),
        Parameter("damping", "D", "p.u.", Bound.NOT_NEGATIVE, Scaling.POWER),
        Parameter("d_reactance", "Xd", "p.u.", scaling=Scaling.IMPEDANCE),
        Parameter("q_reactance", "Xq", "p.u.", scaling=Scaling.IMPEDANCE),
        Parameter("d_transient_reactance", "X'd", "p.u.", scaling=Scaling.IMPEDANCE),
        Parameter("q_transient_reactance", "X'q", "p.u.", Bound.NOT_NEGATIVE, Scaling.IMPEDANCE),
        Parameter("subtransient_reactance", "X''d", "p.u.", scaling=Scaling.IMPEDANCE),
        Parameter("leakage_reactance", "Xl", "p.u.", Bound.NOT_NEGATIVE, Scaling.IMPEDANCE),
        Parameter("saturation_10", "S(1.0)", "p.u.", Bound.NOT_NEGATIVE),
        Parameter("saturation_12", "S(1.2)", "p.u.", Bound.NOT_NEGATIVE),
        Parameter("resistance", "Ra", "p.u.", Bound.NOT_NEGATIVE, Scaling.IMPEDANCE, default=0.0),
    ),
    states=(
        "rotor_angle",
        "speed",
        "q_transient_voltage",
        "d_transient_voltage",
        "d_damper_flux",
        "q_damper_flux",
    ),
    inputs=("voltage_real", "voltage_imag", "field_voltage", "mechanical_power"),
    sources=("source_real", "source_imag", "sine", "cosine", "d_flux", "q_flux"),
    outputs=(
        "current_real",
        "current_imag",
        "d_current",
        "q_current",
        "active_power",
        "reactive_power",
        "terminal_voltage",
        "field_current",
    ),
    source=source,
    output=output,
    derivative=derivative,
    admittance=admittance,
    targets=("active_power", "reactive_power"),
    solved_inputs=("field_voltage", "mechanical_power"),
    guess=guess,
    check=check,
    psse_record=DYR_COLUMNS,
)
