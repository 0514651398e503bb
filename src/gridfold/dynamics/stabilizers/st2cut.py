"""Stabilizer ST2CUT: two inputs, a washout and three lead-lags.

Model ST2CUT of the PSS/E Model Library, stabilizer models. The signals of both input codes, through
K1 / (1 + s T1) and K2 / (1 + s T2), add up and pass

    s T3 / (1 + s T4),   (1 + s T5) / (1 + s T6),   (1 + s T7) / (1 + s T8),   (1 + s T9) / (1 + s T10)

and the limits LSMIN and LSMAX. The output is zero where the terminal voltage has risen by more than VCU
from its start value, or by less than VCL (a negative number); a VCU or VCL of zero is no such limit.
Input codes are those of IEEEST; a second code of 0 is no second input.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from gridfold.dynamics.blocks import clip, lag, lead_lag, washout
from gridfold.dynamics.device import Bound, Device, Parameter, Role, Scaling, Values, limits
from gridfold.dynamics.stabilizers.ieeest import (
    ACCELERATING_POWER,
    cut_off,
    input_faults,
    input_signal,
    lead_faults,
)

(
    IC1, IB1, IC2, IB2, K1, K2, T1, T2, T3, T4, T5, T6, T7, T8, T9, T10, LSMAX, LSMIN, VCU, VCL,
    POWER_BASE, VSTART, BASE_SPEED,
) = range(23)  # fmt: skip
SENSOR_1, SENSOR_2, WASHOUT, LEAD_1, LEAD_2, LEAD_3 = range(6)
OMEGA, PE, PM, VT = range(4)
VS, DV = range(2)

DYR_COLUMNS: tuple[str | None, ...] = (
    "input_code_1",
    "remote_bus_1",
    "input_code_2",
    "remote_bus_2",
    "input_gain_1",
    "input_gain_2",
    "input_time_1",
    "input_time_2",
    "washout_lead_time",
    "washout_time",
    "lead_time_1",
    "lag_time_1",
    "lead_time_2",
    "lag_time_2",
    "lead_time_3",
    "lag_time_3",
    "highest_signal",
    "lowest_signal",
    "upper_cut_off",
    "lower_cut_off",
)


def output(x, u, p, y, dx):
    """Stabilizer signal, and the change of the terminal voltage since the start.

    Mechanical power may be an output that is evaluated later; `check` sees to it that accelerating
    power does not reach the output directly, so here it may be any number.
    """
    for i in range(x.shape[1]):
        signal_1 = input_signal(
            p[IC1, i], u[OMEGA, i], u[PE, i], u[PE, i], u[VT, i], p[POWER_BASE, i]
        )
        signal_2 = input_signal(
            p[IC2, i], u[OMEGA, i], u[PE, i], u[PE, i], u[VT, i], p[POWER_BASE, i]
        )
        sensed_1, _ = lag(p[K1, i] * signal_1, x[SENSOR_1, i], p[T1, i])
        sensed_2, _ = lag(p[K2, i] * signal_2, x[SENSOR_2, i], p[T2, i])
        washed, _ = washout(sensed_1 + sensed_2, x[WASHOUT, i], p[T3, i], p[T4, i])
        lead_1, _ = lead_lag(washed, x[LEAD_1, i], p[T5, i], p[T6, i])
        lead_2, _ = lead_lag(lead_1, x[LEAD_2, i], p[T7, i], p[T8, i])
        lead_3, _ = lead_lag(lead_2, x[LEAD_3, i], p[T9, i], p[T10, i])
        limited = clip(lead_3, p[LSMIN, i], p[LSMAX, i])
        y[DV, i] = u[VT, i] - p[VSTART, i]
        y[VS, i] = cut_off(limited, y[DV, i], p[VCL, i], p[VCU, i])


def derivative(x, u, p, y, dx):
    """Sensors, washout and lead-lags."""
    for i in range(x.shape[1]):
        signal_1 = input_signal(
            p[IC1, i], u[OMEGA, i], u[PE, i], u[PM, i], u[VT, i], p[POWER_BASE, i]
        )
        signal_2 = input_signal(
            p[IC2, i], u[OMEGA, i], u[PE, i], u[PM, i], u[VT, i], p[POWER_BASE, i]
        )
        sensed_1, dx[SENSOR_1, i] = lag(p[K1, i] * signal_1, x[SENSOR_1, i], p[T1, i])
        sensed_2, dx[SENSOR_2, i] = lag(p[K2, i] * signal_2, x[SENSOR_2, i], p[T2, i])
        washed, dx[WASHOUT, i] = washout(sensed_1 + sensed_2, x[WASHOUT, i], p[T3, i], p[T4, i])
        lead_1, dx[LEAD_1, i] = lead_lag(washed, x[LEAD_1, i], p[T5, i], p[T6, i])
        lead_2, dx[LEAD_2, i] = lead_lag(lead_1, x[LEAD_2, i], p[T7, i], p[T8, i])
        _, dx[LEAD_3, i] = lead_lag(lead_2, x[LEAD_3, i], p[T9, i], p[T10, i])


def guess(p: Values, known: Mapping[str, Any]) -> Mapping[str, Any]:
    """The start voltage is known."""
    return {"start_voltage": known["terminal_voltage"]}


def check(parameters: Mapping[str, float]) -> Iterable[str]:
    """Known inputs, proper blocks, no direct path of accelerating power, limits in order."""
    leads = [
        (
            f"T{2 * k + 3}",
            parameters[f"lead_time_{k}"],
            f"T{2 * k + 4}",
            parameters[f"lag_time_{k}"],
        )
        for k in (1, 2, 3)
    ]
    delayed = any(time > 0 and lead == 0 for _, lead, _, time in leads)
    for k in (1, 2):
        code, bus = parameters[f"input_code_{k}"], parameters[f"remote_bus_{k}"]
        if k == 1 or code != 0:
            yield from input_faults(code, bus, f"IC{k}")
        if code == ACCELERATING_POWER and not delayed and parameters[f"input_time_{k}"] == 0:
            yield f"accelerating power (IC{k} 4) needs a lag: a positive T{k}"
    yield from lead_faults(leads)
    if parameters["lowest_signal"] > parameters["highest_signal"]:
        yield "lowest_signal LSMIN is above highest_signal LSMAX"


ST2CUT = Device(
    model="st2cut",
    title="stabilizer ST2CUT",
    role=Role.STABILIZER,
    parameters=(
        Parameter("input_code_1", "IC1", ""),
        Parameter("remote_bus_1", "IB1", "", Bound.ANY, default=0.0),
        Parameter("input_code_2", "IC2", "", Bound.NOT_NEGATIVE, default=0.0),
        Parameter("remote_bus_2", "IB2", "", Bound.ANY, default=0.0),
        Parameter("input_gain_1", "K1", "p.u.", Bound.ANY),
        Parameter("input_gain_2", "K2", "p.u.", Bound.ANY),
        Parameter("input_time_1", "T1", "s", Bound.NOT_NEGATIVE),
        Parameter("input_time_2", "T2", "s", Bound.NOT_NEGATIVE),
        Parameter("washout_lead_time", "T3", "s"),
        Parameter("washout_time", "T4", "s"),
        Parameter("lead_time_1", "T5", "s", Bound.NOT_NEGATIVE),
        Parameter("lag_time_1", "T6", "s", Bound.NOT_NEGATIVE),
        Parameter("lead_time_2", "T7", "s", Bound.NOT_NEGATIVE),
        Parameter("lag_time_2", "T8", "s", Bound.NOT_NEGATIVE),
        Parameter("lead_time_3", "T9", "s", Bound.NOT_NEGATIVE),
        Parameter("lag_time_3", "T10", "s", Bound.NOT_NEGATIVE),
        Parameter("highest_signal", "LSMAX", "p.u.", Bound.ANY),
        Parameter("lowest_signal", "LSMIN", "p.u.", Bound.ANY),
        Parameter("upper_cut_off", "VCU", "p.u.", Bound.ANY, default=0.0),
        Parameter("lower_cut_off", "VCL", "p.u.", Bound.ANY, default=0.0),
        Parameter("power_base", "MBASE/SBASE", "p.u.", scaling=Scaling.POWER, default=1.0),
    ),
    set_points=("start_voltage",),
    states=(
        "stabilizer_sensor_1",
        "stabilizer_sensor_2",
        "stabilizer_washout",
        "stabilizer_lead_1",
        "stabilizer_lead_2",
        "stabilizer_lead_3",
    ),
    inputs=("speed", "active_power", "mechanical_power", "terminal_voltage"),
    outputs=("stabilizer_signal", "stabilizer_voltage_change"),
    output=output,
    derivative=derivative,
    targets=("stabilizer_voltage_change",),
    defaults={"mechanical_power": 0.0, "stabilizer_voltage_change": 0.0},
    guess=guess,
    check=check,
    limits=(
        *limits("lowest_signal", "highest_signal"),
        *limits("lower_cut_off", "upper_cut_off"),
    ),
    psse_record=DYR_COLUMNS,
)
