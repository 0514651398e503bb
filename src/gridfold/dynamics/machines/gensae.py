"""GENSAE of PSS/E: salient-pole machine whose iron saturates exponentially in both axes.

PSS/E Model Library, GENSAE; IEEE Std 1110, model 2.1. The windings, the stator and the swing equation
are those of :mod:`~gridfold.dynamics.machines.gensal`. The air-gap flux saturates the iron, as in
GENROE: with S = S(1.0) psi''^n at psi'' = |psi''d + j psi''q|, n = ln(S(1.2) / S(1.0)) / ln 1.2,

    Xad Ifd          = E'q + (Xd - X'd) (Id - (X'd - X'')/(X'd - Xl)^2 ed) + S psi''d
    T''q0 dpsi''q/dt = -psi''q - (Xq - X'') Iq - S psi''q (Xq - Xl)/(Xd - Xl)
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from gridfold.dynamics.device import Values
from gridfold.dynamics.machines import gensal
from gridfold.dynamics.machines.genroe import exponential, saturation
from gridfold.dynamics.machines.genrou import d_axis_guess, phasors
from gridfold.dynamics.machines.gensal import (
    PSI_D,
    PSI_Q,
    S10,
    S12,
    XD,
    XL,
    XQ,
    rotor_rates,
    stator_outputs,
)

DYR_COLUMNS = gensal.DYR_COLUMNS


def output(x, u, p, y, dx):
    """Stator currents, terminal power and voltage, field current."""
    for i in range(x.shape[1]):
        s = saturation(y[PSI_D, i], x[PSI_Q, i], p[S10, i], p[S12, i])
        stator_outputs(x, u, p, y, i, s * y[PSI_D, i])


def derivative(x, u, p, y, dx):
    """Swing equation, field and dampers."""
    for i in range(x.shape[1]):
        s = saturation(y[PSI_D, i], x[PSI_Q, i], p[S10, i], p[S12, i])
        s_q = s * (p[XQ, i] - p[XL, i]) / (p[XD, i] - p[XL, i])
        rotor_rates(x, u, p, y, dx, i, s_q * x[PSI_Q, i])


def guess(p: Values, known: Mapping[str, Any]) -> Mapping[str, Any]:
    """Start from the saturated q axis, as GENROU."""
    x_2, x_l = p["subtransient_reactance"], p["leakage_reactance"]
    voltage, current = phasors(known)
    internal = voltage + (p["resistance"] + 1j * x_2) * current
    s = exponential(p, np.abs(internal))
    saturated = 1 + s * (p["q_reactance"] - x_l) / (p["d_reactance"] - x_l)
    angle = np.angle(internal + 1j * (p["q_reactance"] - x_2) / saturated * current)
    flux = -(internal * np.exp(-1j * (angle - np.pi / 2))).real
    return {**d_axis_guess(p, known, angle), "q_subtransient_flux": flux}


GENSAE = replace(
    gensal.GENSAL,
    model="gensae",
    title="PSS/E salient-pole machine with exponential saturation GENSAE",
    output=output,
    derivative=derivative,
    guess=guess,
)
