"""GENROE of PSS/E: GENROU whose iron saturates exponentially.

PSS/E Model Library, GENROE. All equations are those of :mod:`~gridfold.dynamics.machines.genrou` but

    S = S(1.0) psi''^n,  n = ln(S(1.2) / S(1.0)) / ln 1.2,

which has no threshold: the iron saturates a little at every flux.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from gridfold.dynamics.blocks import exponential_saturation
from gridfold.dynamics.device import Values
from gridfold.dynamics.machines import genrou
from gridfold.dynamics.machines.genrou import (
    PSI_D,
    PSI_Q,
    S10,
    S12,
    rotor_rates,
    saturated_guess,
    stator_outputs,
)

DYR_COLUMNS = genrou.DYR_COLUMNS


@njit
def saturation(flux_d, flux_q, s_10, s_12):
    """S of the magnitude of a flux; 0 without flux."""
    return exponential_saturation(np.sqrt(flux_d * flux_d + flux_q * flux_q), s_10, s_12)


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


def exponential(p: Values, flux: NDArray[np.float64]) -> NDArray[np.float64]:
    """S of fluxes, for guesses."""
    each = np.vectorize(exponential_saturation.py_func, otypes=[float])
    return np.asarray(each(flux, p["saturation_10"], p["saturation_12"]))


def guess(p: Values, known: Mapping[str, Any]) -> Mapping[str, Any]:
    """Start from the saturated q axis, as GENROU."""
    return saturated_guess(p, known, lambda flux: exponential(p, flux))


GENROE = replace(
    genrou.GENROU,
    model="genroe",
    title="PSS/E round-rotor machine with exponential saturation GENROE",
    output=output,
    derivative=derivative,
    guess=guess,
)
