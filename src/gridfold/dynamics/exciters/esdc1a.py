"""ESDC1A: IEEE type DC1A of 1992, a DC commutator exciter.

    VR  = KA / (1 + s TA) (1 + s TC) / (1 + s TB) (VREF + VS - VT / (1 + s TR) - VF)
    VF  = s KF / (1 + s TF1) EFD
    EFD = (VR - (KE + SE(EFD)) EFD) / (s TE)

with VRMIN <= VR <= VRMAX and EFD >= 0, all non-windup: ESDC2A with limits that do not follow the
terminal voltage. PSS/E Model Library; IEEE Std 421.5-1992, type DC1A. The gate for an underexcitation
limiter has no input here. For KE = 0, VRMAX = 0 and the start see
``gridfold.dynamics.exciters.dc_commutator``.
"""

from __future__ import annotations

from dataclasses import replace

from gridfold.dynamics.blocks import held, lag, rate_feedback
from gridfold.dynamics.device import Limit, Side
from gridfold.dynamics.exciters import dc_commutator, esdc2a
from gridfold.dynamics.exciters.dc_commutator import exciter_rate, regulator
from gridfold.dynamics.exciters.esdc2a import (
    ADDED,
    E1,
    E2,
    EFD,
    EMIN,
    KA,
    KEU,
    KF,
    LEAD,
    NO_MAXIMUM,
    SE1,
    SE2,
    TA,
    TB,
    TC,
    TE,
    TF,
    TR,
    VC,
    VE,
    VF,
    VR,
    VREF,
    VRMAX,
    VRMIN,
    VS,
    VT,
)

DYR_COLUMNS = dc_commutator.COMPENSATED_COLUMNS


def derivative(x, u, p, y, dx):
    """Measurement, rate feedback, lead-lag, regulator and exciter."""
    for i in range(x.shape[1]):
        v_c, dx[VC, i] = lag(u[VT, i], x[VC, i], p[TR, i])
        v_f, dx[VF, i] = rate_feedback(y[EFD, i], x[VF, i], p[KF, i], p[TF, i])
        v_r, dx[LEAD, i], dx[VR, i] = regulator(
            p[VREF, i] + u[VS, i] - v_c - v_f,
            x[LEAD, i],
            x[VR, i],
            p[KA, i],
            p[TA, i],
            p[TC, i],
            p[TB, i],
            p[VRMIN, i],
            p[VRMAX, i] + p[ADDED, i],
        )
        rate = exciter_rate(
            v_r, y[EFD, i], p[KEU, i], p[TE, i], p[E1, i], p[SE1, i], p[E2, i], p[SE2, i]
        )
        dx[VE, i] = held(rate, x[VE, i], p[EMIN, i], p[EMIN, i] + NO_MAXIMUM)


ESDC1A = replace(
    esdc2a.ESDC2A,
    model="esdc1a",
    title="IEEE type DC1A excitation system (PSS/E ESDC1A)",
    derivative=derivative,
    limits=(
        *dc_commutator.STATE_LIMITS,
        Limit("field_voltage_minimum", Side.LOWEST, state="exciter_voltage"),
    ),
)
