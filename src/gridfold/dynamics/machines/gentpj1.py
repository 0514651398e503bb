"""GENTPJ1 of PSS/E: round or salient rotor whose iron saturates all reactances, WECC type J.

PSS/E Model Library, GENTPJ1; J. Weber, Description of Machine Models GENROU, GENSAL, GENTPF and
GENTPJ, PowerWorld, 2015. Voltages are seen from the rotor as in
:mod:`~gridfold.dynamics.machines.genrou`. With the air-gap flux psi = |V + (Ra + j Xl) I| and
m = psi + Kis |I|,

    Sd = 1 + S(m),               Sq = 1 + Xq / Xd S(m)
    X''ds = (X'' - Xl) / Sd + Xl,   X''qs = (X'' - Xl) / Sq + Xl
    T'd0  dE'q/dt     = Efd - Xad Ifd,   T''d0 dpsi''d/dt = Sd (E'q - psi''d) - (X'd - X'') Id
    Xad Ifd           = Sd ((Xd - X'') E'q - (Xd - X'd) psi''d) / (X'd - X'')
    T'q0  dE'd/dt     = -Sq ((Xq - X'') E'd + (Xq - X'q) psi''q) / (X'q - X'')
    T''q0 dpsi''q/dt  = -Sq (E'd + psi''q) - (X'q - X'') Iq
    V + (Ra Id - X''qs Iq) + j (Ra Iq + X''ds Id) = -psi''q + j psi''d

and the swing equation of GENROU. S goes through S(1.0) and S(1.2). GENTPF is the same with Kis = 0.

The stator is a constant impedance Ra + j X'' to the network. m, and the current in the difference
between X'' and X''ds, X''qs, are states that follow within 10 ms; PSS/E takes those of the same
instant.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numba import njit

from gridfold.dynamics.blocks import quadratic_saturation
from gridfold.dynamics.device import Bound, Device, Parameter, Role, Scaling, Values
from gridfold.dynamics.machines.genrou import (
    GENROU,
    acceleration,
    admittance,
    phasors,
    rising_saturation,
)
from gridfold.dynamics.stator import over_impedance, terminal

TD1, TD2, TQ1, TQ2, H, D, XD, XQ, XD1, XQ1, X2, XL, S10, S12, KIS, RA, BASE_SPEED = range(17)
DELTA, OMEGA, EQ1, ED1, PSI_D, PSI_Q, FLUX, ID_F, IQ_F = range(9)
VR, VI, EFD, PM = range(4)
SOURCE_R, SOURCE_I, SIN, COS, SD, SQ, IR, II, ID, IQ, P, Q, VT, IFD = range(14)

#: Time in s within which saturation and the current in saturated reactances follow.
FOLLOW = 0.01

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
    "current_multiplier",
)


@njit
def iron(m, p, i):
    """Sd and Sq of unit `i`."""
    s = 0.0 * m
    if m.real > 0:
        s = quadratic_saturation(m, 1.0, p[S10, i], 1.2, p[S12, i]) / m
    return 1.0 + s, 1.0 + p[XQ, i] / p[XD, i] * s


@njit
def lost(saturation, p, i):
    """X'' less the saturated one."""
    return (p[X2, i] - p[XL, i]) * (1.0 - 1.0 / saturation)


@njit
def transient(p, i):
    """X'q; without a transient circuit it is Xq."""
    return p[XQ1, i] if p[TQ1, i].real > 0 else p[XQ, i]


def source(x, u, p, y, dx):
    """Norton current of the flux behind X'', with what saturated reactances leave."""
    for i in range(x.shape[1]):
        s, c = np.sin(x[DELTA, i]), np.cos(x[DELTA, i])
        y[SD, i], y[SQ, i] = iron(x[FLUX, i], p, i)
        flux_d = x[PSI_D, i] + lost(y[SD, i], p, i) * x[ID_F, i]
        flux_q = x[PSI_Q, i] + lost(y[SQ, i], p, i) * x[IQ_F, i]
        e_r, e_i = flux_d * c - flux_q * s, flux_d * s + flux_q * c
        y[SOURCE_R, i], y[SOURCE_I, i] = over_impedance(e_r, e_i, p[RA, i], p[X2, i])
        y[SIN, i], y[COS, i] = s, c


def output(x, u, p, y, dx):
    """Stator currents, terminal power and voltage, field current."""
    for i in range(x.shape[1]):
        i_r, i_i, y[P, i], y[Q, i], y[VT, i] = terminal(
            y[SOURCE_R, i], y[SOURCE_I, i], u[VR, i], u[VI, i], p[RA, i], p[X2, i]
        )
        y[IR, i], y[II, i] = i_r, i_i
        y[ID, i] = i_r * y[SIN, i] - i_i * y[COS, i]
        y[IQ, i] = i_r * y[COS, i] + i_i * y[SIN, i]
        behind = (p[XD, i] - p[X2, i]) * x[EQ1, i] - (p[XD, i] - p[XD1, i]) * x[PSI_D, i]
        y[IFD, i] = y[SD, i] * behind / (p[XD1, i] - p[X2, i])


def derivative(x, u, p, y, dx):
    """Swing equation, field and dampers, and what follows."""
    for i in range(x.shape[1]):
        i_r, i_i = y[IR, i], y[II, i]
        squared = i_r * i_r + i_i * i_i
        dx[DELTA, i] = p[BASE_SPEED, i] * (x[OMEGA, i] - 1.0)
        torque = y[P, i] + p[RA, i] * squared
        dx[OMEGA, i] = acceleration(u[PM, i], torque, x[OMEGA, i], p[D, i], p[H, i])
        x_q1 = transient(p, i)
        dx[EQ1, i] = (u[EFD, i] - y[IFD, i]) / p[TD1, i]
        driven = y[SD, i] * (x[EQ1, i] - x[PSI_D, i])
        dx[PSI_D, i] = (driven - (p[XD1, i] - p[X2, i]) * y[ID, i]) / p[TD2, i]
        driven = y[SQ, i] * (x[ED1, i] + x[PSI_Q, i])
        dx[PSI_Q, i] = (-driven - (x_q1 - p[X2, i]) * y[IQ, i]) / p[TQ2, i]
        if p[TQ1, i].real > 0:
            behind = (p[XQ, i] - p[X2, i]) * x[ED1, i] + (p[XQ, i] - x_q1) * x[PSI_Q, i]
            dx[ED1, i] = -y[SQ, i] * behind / ((x_q1 - p[X2, i]) * p[TQ1, i])
        else:
            dx[ED1, i] = -x[ED1, i]
        gap_r = u[VR, i] + p[RA, i] * i_r - p[XL, i] * i_i
        gap_i = u[VI, i] + p[RA, i] * i_i + p[XL, i] * i_r
        m = np.sqrt(gap_r * gap_r + gap_i * gap_i) + p[KIS, i] * np.sqrt(squared)
        dx[FLUX, i] = (m - x[FLUX, i]) / FOLLOW
        dx[ID_F, i] = (y[ID, i] - x[ID_F, i]) / FOLLOW
        dx[IQ_F, i] = (y[IQ, i] - x[IQ_F, i]) / FOLLOW


def guess(p: Values, known: Mapping[str, Any]) -> Mapping[str, Any]:
    """The whole start: saturation follows from voltage and current, and with it the q axis."""
    voltage, current = phasors(known)
    x_2, x_l, x_d, x_q = (p[f"{name}_reactance"] for name in ("subtransient", "leakage", "d", "q"))
    gap = voltage + (p["resistance"] + 1j * x_l) * current
    m = np.abs(gap) + p["current_multiplier"] * np.abs(current)
    excess = np.vectorize(quadratic_saturation.py_func, otypes=[float])
    s = excess(m, 1.0, p["saturation_10"], 1.2, p["saturation_12"]) / m
    s_d, s_q = 1 + s, 1 + x_q / x_d * s
    along = voltage + (p["resistance"] + 1j * ((x_q - x_l) / s_q + x_l)) * current
    angle = np.angle(along)
    turn = np.exp(-1j * (angle - np.pi / 2))
    i_d, i_q = (current * turn).real, (current * turn).imag
    behind = (voltage + p["resistance"] * current) * turn
    flux_d = behind.imag + ((x_2 - x_l) / s_d + x_l) * i_d
    flux_q = -behind.real + ((x_2 - x_l) / s_q + x_l) * i_q
    transient_q = flux_d + (p["d_transient_reactance"] - x_2) / s_d * i_d
    no_circuit = p["q_open_circuit_time"] == 0
    x_q1 = np.where(no_circuit, x_q, p["q_transient_reactance"])
    field = (x_d - x_2) * transient_q - (x_d - p["d_transient_reactance"]) * flux_d
    return {
        "rotor_angle": angle,
        "speed": 1.0,
        "q_transient_voltage": transient_q,
        "d_transient_voltage": np.where(no_circuit, 0.0, -flux_q - (x_q1 - x_2) / s_q * i_q),
        "d_subtransient_flux": flux_d,
        "q_subtransient_flux": flux_q,
        "saturating_flux": m,
        "followed_d_current": i_d,
        "followed_q_current": i_q,
        "field_voltage": s_d * field / (p["d_transient_reactance"] - x_2),
        "mechanical_power": known["active_power"] + p["resistance"] * np.abs(current) ** 2,
    }


def check(parameters: Mapping[str, float]) -> Iterable[str]:
    """Reactances that differ where the equations divide by their difference; iron that rises."""
    x_2 = parameters["subtransient_reactance"]
    names = [("d_transient_reactance", "X'd")]
    if parameters["q_open_circuit_time"] > 0:
        names.append(("q_transient_reactance", "X'q"))
    for name, symbol in names:
        if parameters[name] <= x_2:
            yield f"{name} ({symbol}) {parameters[name]!r} must be above subtransient_reactance (X'')"
    yield from rising_saturation(parameters)


_PARAMETERS = {parameter.name: parameter for parameter in GENROU.parameters}

GENTPJ1 = Device(
    model="gentpj1",
    title="PSS/E machine with saturated reactances GENTPJ1",
    role=Role.MACHINE,
    parameters=(
        *(_PARAMETERS[name] for name in DYR_COLUMNS if name in _PARAMETERS),
        Parameter("current_multiplier", "Kis", "p.u.", Bound.NOT_NEGATIVE, Scaling.IMPEDANCE),
        _PARAMETERS["resistance"],
    ),
    states=(
        "rotor_angle",
        "speed",
        "q_transient_voltage",
        "d_transient_voltage",
        "d_subtransient_flux",
        "q_subtransient_flux",
        "saturating_flux",
        "followed_d_current",
        "followed_q_current",
    ),
    inputs=GENROU.inputs,
    sources=("source_real", "source_imag", "sine", "cosine", "d_saturation", "q_saturation"),
    outputs=GENROU.outputs,
    source=source,
    output=output,
    derivative=derivative,
    admittance=admittance,
    targets=GENROU.targets,
    solved_inputs=GENROU.solved_inputs,
    guess=guess,
    check=check,
    psse_record=DYR_COLUMNS,
)
