"""Stabilizer IEEEST: one input, a filter, two lead-lags and a washout.

Model IEEEST of the PSS/E Model Library, stabilizer models; compare PSS1A of IEEE Std 421.5. The
signal of the input code IC passes, in this order,

    (1 + A5 s + A6 s^2) / ((1 + A1 s + A2 s^2) (1 + A3 s + A4 s^2))
    (1 + s T1) / (1 + s T2),   (1 + s T3) / (1 + s T4),   KS s T5 / (1 + s T6)

and the limits LSMIN and LSMAX. The output is zero where the terminal voltage is above VCU or below
VCL; a VCU or VCL of zero is no such limit. Input codes: 1 speed deviation, 3 electric power and 4
accelerating power on the machine's base, 5 terminal voltage.

The filter is run with the second pair of poles first: then the derivatives that its zeros need are
those of states, for every choice of zero coefficients that leaves it proper.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from numba import njit

from gridfold.dynamics.blocks import clip, lead_lag, pole_pair, washout
from gridfold.dynamics.device import Bound, Device, Parameter, Role, Scaling, limits

(
    IC, IB, A1, A2, A3, A4, A5, A6, T1, T2, T3, T4, T5, T6, KS, LSMAX, LSMIN, VCU, VCL,
    POWER_BASE, BASE_SPEED,
) = range(21)  # fmt: skip
POLES_1, SLOPE_1, POLES_2, SLOPE_2, LEAD_1, LEAD_2, WASHOUT = range(7)
OMEGA, PE, PM, VT = range(4)
VS = 0
SPEED, ELECTRIC_POWER, ACCELERATING_POWER, VOLTAGE = 1, 3, 4, 5
_REFUSED = {2: "bus frequency deviation", 6: "derivative of the bus voltage"}

DYR_COLUMNS: tuple[str | None, ...] = (
    "input_code",
    "remote_bus",
    "filter_a1",
    "filter_a2",
    "filter_a3",
    "filter_a4",
    "filter_a5",
    "filter_a6",
    "lead_time_1",
    "lag_time_1",
    "lead_time_2",
    "lag_time_2",
    "washout_lead_time",
    "washout_time",
    "stabilizer_gain",
    "highest_signal",
    "lowest_signal",
    "upper_cut_off",
    "lower_cut_off",
)


@njit
def input_signal(code, speed, active_power, mechanical_power, voltage, power_base):
    """The signal of an input code, and zero for code 0; powers on the machine's base."""
    if code.real == SPEED:
        return speed - 1.0
    if code.real == ELECTRIC_POWER:
        return active_power / power_base
    if code.real == ACCELERATING_POWER:
        return (mechanical_power - active_power) / power_base
    if code.real == VOLTAGE:
        return voltage + 0.0
    return 0.0 * voltage


@njit
def cut_off(signal, voltage, lower, upper):
    """`signal`, or zero outside the band of voltages; a bound of zero is none."""
    if upper.real != 0 and voltage.real > upper.real:
        return 0.0 * signal
    if lower.real != 0 and voltage.real < lower.real:
        return 0.0 * signal
    return signal


@njit
def _filter(u, a1, a2, a3, a4, a5, a6, x_1, slope_1, x_2, slope_2):
    """Output of the filter, then the derivatives of its four states."""
    none = 0.0 * u
    v, dv, ddv, d_x_2, d_slope_2 = pole_pair(u, none, none, a3, a4, x_2, slope_2)
    w, dw, ddw, d_x_1, d_slope_1 = pole_pair(v, dv, ddv, a1, a2, x_1, slope_1)
    return w + a5 * dw + a6 * ddw, d_x_1, d_slope_1, d_x_2, d_slope_2


def output(x, u, p, y, dx):
    """Stabilizer signal.

    Mechanical power may be an output that is evaluated later; `check` sees to it that accelerating
    power does not reach the output directly, so here it may be any number.
    """
    for i in range(x.shape[1]):
        signal = input_signal(p[IC, i], u[OMEGA, i], u[PE, i], u[PE, i], u[VT, i], p[POWER_BASE, i])
        filtered, _, _, _, _ = _filter(
            signal, p[A1, i], p[A2, i], p[A3, i], p[A4, i], p[A5, i], p[A6, i],
            x[POLES_1, i], x[SLOPE_1, i], x[POLES_2, i], x[SLOPE_2, i],
        )  # fmt: skip
        lead_1, _ = lead_lag(filtered, x[LEAD_1, i], p[T1, i], p[T2, i])
        lead_2, _ = lead_lag(lead_1, x[LEAD_2, i], p[T3, i], p[T4, i])
        washed, _ = washout(lead_2, x[WASHOUT, i], p[KS, i] * p[T5, i], p[T6, i])
        limited = clip(washed, p[LSMIN, i], p[LSMAX, i])
        y[VS, i] = cut_off(limited, u[VT, i], p[VCL, i], p[VCU, i])


def derivative(x, u, p, y, dx):
    """Filter, lead-lags and washout."""
    for i in range(x.shape[1]):
        signal = input_signal(p[IC, i], u[OMEGA, i], u[PE, i], u[PM, i], u[VT, i], p[POWER_BASE, i])
        filtered, dx[POLES_1, i], dx[SLOPE_1, i], dx[POLES_2, i], dx[SLOPE_2, i] = _filter(
            signal, p[A1, i], p[A2, i], p[A3, i], p[A4, i], p[A5, i], p[A6, i],
            x[POLES_1, i], x[SLOPE_1, i], x[POLES_2, i], x[SLOPE_2, i],
        )  # fmt: skip
        lead_1, dx[LEAD_1, i] = lead_lag(filtered, x[LEAD_1, i], p[T1, i], p[T2, i])
        lead_2, dx[LEAD_2, i] = lead_lag(lead_1, x[LEAD_2, i], p[T3, i], p[T4, i])
        _, dx[WASHOUT, i] = washout(lead_2, x[WASHOUT, i], p[KS, i] * p[T5, i], p[T6, i])


def input_faults(code: float, remote_bus: float, symbol: str) -> Iterable[str]:
    """Input codes and remote buses that no stabilizer here knows."""
    if code in _REFUSED:
        yield f"input code {symbol} {code:g} ({_REFUSED[int(code)]}) is not modelled"
    elif code not in (SPEED, ELECTRIC_POWER, ACCELERATING_POWER, VOLTAGE):
        yield f"input code {symbol} {code:g} is none of 1, 3, 4 and 5"
    if remote_bus != 0:
        yield f"a signal from remote bus {remote_bus:g} is not modelled; it has to be 0"


def lead_faults(pairs: Iterable[tuple[str, float, str, float]]) -> Iterable[str]:
    """Lead times without a lag, of pairs (symbol, lead time, symbol, lag time)."""
    for lead_symbol, lead, lag_symbol, time in pairs:
        if time == 0 and lead != 0:
            yield f"{lag_symbol} is 0: {lead_symbol} has to be 0 then"


def _degree(first: float, second: float) -> int:
    """Degree of the polynomial 1 + first s + second s^2."""
    if second != 0:
        return 2
    return 1 if first != 0 else 0


def check(parameters: Mapping[str, float]) -> Iterable[str]:
    """Known inputs, proper blocks, no direct path of accelerating power, limits in order."""
    yield from input_faults(parameters["input_code"], parameters["remote_bus"], "IC")
    a = [parameters[f"filter_a{k}"] for k in range(1, 7)]
    excess = _degree(a[0], a[1]) + _degree(a[2], a[3]) - _degree(a[4], a[5])
    if excess < 0:
        yield "filter_a5 A5 and filter_a6 A6 need more poles: A1 to A4 have too many zeros"
    lead_1, lag_1, lead_2, lag_2 = (
        parameters[name] for name in ("lead_time_1", "lag_time_1", "lead_time_2", "lag_time_2")
    )
    yield from lead_faults([("T1", lead_1, "T2", lag_1), ("T3", lead_2, "T4", lag_2)])
    delayed = excess > 0 or (lag_1 > 0 and lead_1 == 0) or (lag_2 > 0 and lead_2 == 0)
    if parameters["input_code"] == ACCELERATING_POWER and not delayed:
        yield "accelerating power (IC 4) needs a lag that it cannot pass at once: A1 to A4, T2 or T4"
    if parameters["lowest_signal"] > parameters["highest_signal"]:
        yield "lowest_signal LSMIN is above highest_signal LSMAX"


IEEEST = Device(
    model="ieeest",
    title="stabilizer IEEEST",
    role=Role.STABILIZER,
    parameters=(
        Parameter("input_code", "IC", ""),
        Parameter("remote_bus", "IB", "", Bound.ANY, default=0.0),
        Parameter("filter_a1", "A1", "s", Bound.NOT_NEGATIVE),
        Parameter("filter_a2", "A2", "s^2", Bound.NOT_NEGATIVE),
        Parameter("filter_a3", "A3", "s", Bound.NOT_NEGATIVE),
        Parameter("filter_a4", "A4", "s^2", Bound.NOT_NEGATIVE),
        Parameter("filter_a5", "A5", "s", Bound.ANY),
        Parameter("filter_a6", "A6", "s^2", Bound.ANY),
        Parameter("lead_time_1", "T1", "s", Bound.NOT_NEGATIVE),
        Parameter("lag_time_1", "T2", "s", Bound.NOT_NEGATIVE),
        Parameter("lead_time_2", "T3", "s", Bound.NOT_NEGATIVE),
        Parameter("lag_time_2", "T4", "s", Bound.NOT_NEGATIVE),
        Parameter("washout_lead_time", "T5", "s"),
        Parameter("washout_time", "T6", "s"),
        Parameter("stabilizer_gain", "KS", "p.u.", Bound.ANY),
        Parameter("highest_signal", "LSMAX", "p.u.", Bound.ANY),
        Parameter("lowest_signal", "LSMIN", "p.u.", Bound.ANY),
        Parameter("upper_cut_off", "VCU", "p.u.", Bound.ANY, default=0.0),
        Parameter("lower_cut_off", "VCL", "p.u.", Bound.ANY, default=0.0),
        Parameter("power_base", "MBASE/SBASE", "p.u.", scaling=Scaling.POWER, default=1.0),
    ),
    states=(
        "stabilizer_filter_1",
        "stabilizer_filter_slope_1",
        "stabilizer_filter_2",
        "stabilizer_filter_slope_2",
        "stabilizer_lead_1",
        "stabilizer_lead_2",
        "stabilizer_washout",
    ),
    inputs=("speed", "active_power", "mechanical_power", "terminal_voltage"),
    outputs=("stabilizer_signal",),
    output=output,
    derivative=derivative,
    defaults={"mechanical_power": 0.0},
    check=check,
    limits=(
        *limits("lowest_signal", "highest_signal"),
        *limits("lower_cut_off", "upper_cut_off"),
    ),
    psse_record=DYR_COLUMNS,
)
