"""Stabilizer STAB2A: electric power through three washouts and two lags.

    w  = -(s K2 T2 / (1 + s T2))^3 P
    VS = (K5 / (1 + s T5))^2 (K3 / (1 + s T3) + K4) w,  within -HLIM and HLIM

with the electric power P on the machine's base. Model STAB2A of the PSS/E Model Library, stabilizer
models.
"""

from __future__ import annotations

from numba import njit

from gridfold.dynamics.blocks import clip, lag, washout
from gridfold.dynamics.device import Bound, Device, Limit, Parameter, Role, Scaling, Side

K2, T2, K3, T3, K4, K5, T5, HLIM, POWER_BASE, BASE_SPEED = range(10)
WASHED_1, WASHED_2, WASHED_3, SLOW, LATE_1, LATE_2 = range(6)
PE = 0
VS = 0

PARAMETERS = (
    Parameter("washout_gain", "K2", "p.u.", Bound.ANY),
    Parameter("washout_time", "T2", "s"),
    Parameter("slow_gain", "K3", "p.u.", Bound.ANY),
    Parameter("slow_time", "T3", "s", Bound.NOT_NEGATIVE),
    Parameter("direct_gain", "K4", "p.u.", Bound.ANY),
    Parameter("output_gain", "K5", "p.u.", Bound.ANY),
    Parameter("output_time", "T5", "s", Bound.NOT_NEGATIVE),
    Parameter("signal_limit", "HLIM", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("power_base", "MBASE/SBASE", "p.u.", scaling=Scaling.POWER, default=1.0),
)
DYR_COLUMNS: tuple[str | None, ...] = tuple(p.name for p in PARAMETERS[:-1])


@njit
def signal(x, u, p, i):
    """Signal of unit `i` before its limits, then the derivatives of its six states."""
    gain = p[K2, i] * p[T2, i]
    power = u[PE, i] / p[POWER_BASE, i]
    first, rate_1 = washout(-power, x[WASHED_1, i], gain, p[T2, i])
    second, rate_2 = washout(first, x[WASHED_2, i], gain, p[T2, i])
    third, rate_3 = washout(second, x[WASHED_3, i], gain, p[T2, i])
    slow, rate_4 = lag(p[K3, i] * third, x[SLOW, i], p[T3, i])
    late, rate_5 = lag(p[K5, i] * (slow + p[K4, i] * third), x[LATE_1, i], p[T5, i])
    last, rate_6 = lag(p[K5, i] * late, x[LATE_2, i], p[T5, i])
    return last, rate_1, rate_2, rate_3, rate_4, rate_5, rate_6


def output(x, u, p, y, dx):
    """Stabilizer signal."""
    for i in range(x.shape[1]):
        wanted, _, _, _, _, _, _ = signal(x, u, p, i)
        y[VS, i] = clip(wanted, -p[HLIM, i], p[HLIM, i])


def derivative(x, u, p, y, dx):
    """Washouts and lags."""
    for i in range(x.shape[1]):
        (
            _, dx[WASHED_1, i], dx[WASHED_2, i], dx[WASHED_3, i],
            dx[SLOW, i], dx[LATE_1, i], dx[LATE_2, i],
        ) = signal(x, u, p, i)  # fmt: skip


STAB2A = Device(
    model="stab2a",
    title="power-sensitive stabilizer STAB2A",
    role=Role.STABILIZER,
    parameters=PARAMETERS,
    states=(
        "stabilizer_washout_1",
        "stabilizer_washout_2",
        "stabilizer_washout_3",
        "stabilizer_slow",
        "stabilizer_lag_1",
        "stabilizer_lag_2",
    ),
    inputs=("active_power",),
    outputs=("stabilizer_signal",),
    output=output,
    derivative=derivative,
    limits=(Limit("signal_limit", Side.HIGHEST),),
    psse_record=DYR_COLUMNS,
)
