"""GENSAL of PSS/E: salient-pole machine with a field, one damper in each axis and saturation.

PSS/E Model Library, GENSAL; IEEE Std 1110, model 2.1. The d axis, the stator and the swing equation
are those of :mod:`~gridfold.dynamics.machines.genrou`, but the iron of the field alone saturates, by
E'q. With ed = psi1d + (X'd - Xl) Id - E'q,

    psi''d          = (X'' - Xl)/(X'd - Xl) E'q + (X'd - X'')/(X'd - Xl) psi1d
    T'd0  dE'q/dt   = Efd - Xad Ifd,     T''d0 dpsi1d/dt = -ed
    Xad Ifd         = E'q + (Xd - X'd) (Id - (X'd - X'')/(X'd - Xl)^2 ed) + B (E'q - A)^2
    T''q0 dpsi''q/dt = -psi''q - (Xq - X'') Iq

where B (E'q - A)^2 / E'q, zero below A, passes through S(1.0) and S(1.2).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numba import njit

from gridfold.dynamics.blocks import quadratic_saturation
from gridfold.dynamics.device import Bound, Device, Parameter, Role, Scaling, Values
from gridfold.dynamics.machines.genrou import (
    above_leakage,
    acceleration,
    admittance,
    between,
    d_axis_guess,
    induced,
    phasors,
    rising_saturation,
)
from gridfold.dynamics.stator import over_impedance, terminal

#: Numbers of the dynamics record.
DYR_COLUMNS: tuple[str | None, ...] = (
    "d_open_circuit_time",
    "d_subtransient_open_circuit_time",
    "q_subtransient_open_circuit_time",
    "inertia",
    "damping",
    "d_reactance",
    "q_reactance",
    "d_transient_reactance",
    "subtransient_reactance",
    "leakage_reactance",
    "saturation_10",
    "saturation_12",
)

TD1, TD2, TQ2, H, D, XD, XQ, XD1, X2, XL, S10, S12, RA, BASE_SPEED = range(14)
DELTA, OMEGA, EQ1, PSI_1D, PSI_Q = range(5)
VR, VI, EFD, PM = range(4)
SOURCE_R, SOURCE_I, SIN, COS, PSI_D, IR, II, ID, IQ, P, Q, VT, IFD = range(13)


def source(x, u, p, y, dx):
    """Norton current E'' / (Ra + j X'')."""
    for i in range(x.shape[1]):
        s, c = np.sin(x[DELTA, i]), np.cos(x[DELTA, i])
        psi_d = between(x[EQ1, i], x[PSI_1D, i], p[XD1, i], p[X2, i], p[XL, i])
        e_r, e_i = psi_d * c - x[PSI_Q, i] * s, psi_d * s + x[PSI_Q, i] * c
        y[SOURCE_R, i], y[SOURCE_I, i] = over_impedance(e_r, e_i, p[RA, i], p[X2, i])
        y[SIN, i], y[COS, i] = s, c
        y[PSI_D, i] = psi_d


@njit
def stator_outputs(x, u, p, y, i, excess):
    """Outputs of unit `i`: stator currents, terminal power and voltage, field current.

    `excess` is the field current that saturation adds.
    """
    i_r, i_i, y[P, i], y[Q, i], y[VT, i] = terminal(
        y[SOURCE_R, i], y[SOURCE_I, i], u[VR, i], u[VI, i], p[RA, i], p[X2, i]
    )
    i_d = i_r * y[SIN, i] - i_i * y[COS, i]
    y[IR, i], y[II, i] = i_r, i_i
    y[ID, i], y[IQ, i] = i_d, i_r * y[COS, i] + i_i * y[SIN, i]
    error = x[PSI_1D, i] + (p[XD1, i] - p[XL, i]) * i_d - x[EQ1, i]
    armature = induced(i_d, error, p[XD, i], p[XD1, i], p[X2, i], p[XL, i])
    y[IFD, i] = x[EQ1, i] + armature + excess


@njit
def rotor_rates(x, u, p, y, dx, i, excess):
    """Derivatives of unit `i`: swing equation, field and dampers.

    `excess` is what saturation takes from the damper of the q axis.
    """
    i_d, i_q = y[ID, i], y[IQ, i]
    torque = y[PSI_D, i] * i_q - x[PSI_Q, i] * i_d
    dx[DELTA, i] = p[BASE_SPEED, i] * (x[OMEGA, i] - 1.0)
    dx[OMEGA, i] = acceleration(u[PM, i], torque, x[OMEGA, i], p[D, i], p[H, i])
    dx[EQ1, i] = (u[EFD, i] - y[IFD, i]) / p[TD1, i]
    dx[PSI_1D, i] = (x[EQ1, i] - (p[XD1, i] - p[XL, i]) * i_d - x[PSI_1D, i]) / p[TD2, i]
    dx[PSI_Q, i] = (-x[PSI_Q, i] - (p[XQ, i] - p[X2, i]) * i_q - excess) / p[TQ2, i]


def output(x, u, p, y, dx):
    """Stator currents, terminal power and voltage, field current."""
    for i in range(x.shape[1]):
        excess = quadratic_saturation(x[EQ1, i], 1.0, p[S10, i], 1.2, p[S12, i])
        stator_outputs(x, u, p, y, i, excess)


def derivative(x, u, p, y, dx):
    """Swing equation, field and dampers."""
    for i in range(x.shape[1]):
        rotor_rates(x, u, p, y, dx, i, 0.0 * x[PSI_Q, i])


def guess(p: Values, known: Mapping[str, Any]) -> Mapping[str, Any]:
    """Rotor angle from the q-axis voltage V + (Ra + j Xq) I; the field voltage without saturation."""
    voltage, current = phasors(known)
    angle = np.angle(voltage + (p["resistance"] + 1j * p["q_reactance"]) * current)
    i_q = (current * np.exp(-1j * (angle - np.pi / 2))).imag
    flux = -(p["q_reactance"] - p["subtransient_reactance"]) * i_q
    return {**d_axis_guess(p, known, angle), "q_subtransient_flux": flux}


def check(parameters: Mapping[str, float]) -> Iterable[str]:
    """A transient reactance other than that of the leakage."""
    yield from above_leakage(parameters, ("d_transient_reactance", "X'd"))
    yield from rising_saturation(parameters)


GENSAL = Device(
    model="gensal",
    title="PSS/E salient-pole machine GENSAL",
    role=Role.MACHINE,
    parameters=(
        Parameter("d_open_circuit_time", "T'd0", "s"),
        Parameter("d_subtransient_open_circuit_time", "T''d0", "s"),
        Parameter("q_subtransient_open_circuit_time", "T''q0", "s"),
        Parameter("inertia", "H", "s", scaling=Scaling.POWER),
        Parameter("damping", "D", "p.u.", Bound.NOT_NEGATIVE, Scaling.POWER),
        Parameter("d_reactance", "Xd", "p.u.", scaling=Scaling.IMPEDANCE),
        Parameter("q_reactance", "Xq", "p.u.", scaling=Scaling.IMPEDANCE),
        Parameter("d_transient_reactance", "X'd", "p.u.", scaling=Scaling.IMPEDANCE),
        Parameter("subtransient_reactance", "X''d", "p.u.", scaling=Scaling.IMPEDANCE),
        Parameter("leakage_reactance", "Xl", "p.u.", Bound.NOT_NEGATIVE, Scaling.IMPEDANCE),
        Parameter("saturation_10", "S(1.0)", "p.u.", Bound.NOT_NEGATIVE),
        Parameter("saturation_12", "S(1.2)", "p.u.", Bound.NOT_NEGATIVE),
        Parameter("resistance", "Ra", "p.u.", Bound.NOT_NEGATIVE, Scaling.IMPEDANCE, default=0.0),
    ),
    states=("rotor_angle", "speed", "q_transient_voltage", "d_damper_flux", "q_subtransient_flux"),
    inputs=("voltage_real", "voltage_imag", "field_voltage", "mechanical_power"),
    sources=("source_real", "source_imag", "sine", "cosine", "d_flux"),
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
