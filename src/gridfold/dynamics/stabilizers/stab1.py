"""Stabilizer STAB1: speed through a washout and two lead-lags.

    VS = s K / (1 + s T) (1 + s T1) / (1 + s T3) (1 + s T2) / (1 + s T4) dw,  within -HLIM and HLIM

Model STAB1 of the PSS/E Model Library, stabilizer models. The record gives the ratios K/T, T1/T3 and
T2/T4.
"""

from __future__ import annotations

from gridfold.dynamics.blocks import clip, lead_lag, washout
from gridfold.dynamics.device import Bound, Device, Limit, Parameter, Role, Side

RATIO, T, LEAD_1, T3, LEAD_2, T4, HLIM, BASE_SPEED = range(8)
WASHED, FIRST, SECOND = range(3)
OMEGA = 0
VS = 0

PARAMETERS = (
    Parameter("washout_ratio", "K/T", "1/s", Bound.ANY),
    Parameter("washout_time", "T", "s"),
    Parameter("lead_ratio_1", "T1/T3", "-", Bound.NOT_NEGATIVE),
    Parameter("lag_time_1", "T3", "s", Bound.NOT_NEGATIVE),
    Parameter("lead_ratio_2", "T2/T4", "-", Bound.NOT_NEGATIVE),
    Parameter("lag_time_2", "T4", "s", Bound.NOT_NEGATIVE),
    Parameter("signal_limit", "HLIM", "p.u.", Bound.NOT_NEGATIVE),
)
DYR_COLUMNS: tuple[str | None, ...] = tuple(p.name for p in PARAMETERS)


def output(x, u, p, y, dx):
    """Stabilizer signal."""
    for i in range(x.shape[1]):
        washed, _ = washout(u[OMEGA, i] - 1.0, x[WASHED, i], p[RATIO, i] * p[T, i], p[T, i])
        first, _ = lead_lag(washed, x[FIRST, i], p[LEAD_1, i] * p[T3, i], p[T3, i])
        second, _ = lead_lag(first, x[SECOND, i], p[LEAD_2, i] * p[T4, i], p[T4, i])
        y[VS, i] = clip(second, -p[HLIM, i], p[HLIM, i])


def derivative(x, u, p, y, dx):
    """Washout and lead-lags."""
    for i in range(x.shape[1]):
        slip = u[OMEGA, i] - 1.0
        washed, dx[WASHED, i] = washout(slip, x[WASHED, i], p[RATIO, i] * p[T, i], p[T, i])
        first, dx[FIRST, i] = lead_lag(washed, x[FIRST, i], p[LEAD_1, i] * p[T3, i], p[T3, i])
        _, dx[SECOND, i] = lead_lag(first, x[SECOND, i], p[LEAD_2, i] * p[T4, i], p[T4, i])


STAB1 = Device(
    model="stab1",
    title="speed-sensitive stabilizer STAB1",
    role=Role.STABILIZER,
    parameters=PARAMETERS,
    states=("stabilizer_washout", "stabilizer_lead_1", "stabilizer_lead_2"),
    inputs=("speed",),
    outputs=("stabilizer_signal",),
    output=output,
    derivative=derivative,
    limits=(Limit("signal_limit", Side.HIGHEST),),
    psse_record=DYR_COLUMNS,
)
