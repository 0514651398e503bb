"""What the stabilizers with two inputs share: PSS2A and PSS2B, the integral of accelerating power.

    v1  = w1 w2 / (1 + s T6) of the first input,    v2 = KS2 w3 w4 / (1 + s T7) of the second
    f   = [ (1 + s T8) / (1 + s T9)^M ]^N (v1 + KS3 v2)
    VS  = KS1 (1 + s T1) / (1 + s T2) (1 + s T3) / (1 + s T4) ... (f - v2),  within VSTMIN and VSTMAX

where wk = s TWk / (1 + s TWk), and a washout with TWk = 0 is left out. PSS/E Model Library; IEEE Std
421.5, types PSS2A and PSS2B. Input codes are those of IEEEST. M and N of 0, or T9 = 0, leave the ramp
filter out; it has at most eight lags, N times M.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from numba import njit

from gridfold.dynamics.blocks import lag, lead_lag, washout
from gridfold.dynamics.checks import Check, checks
from gridfold.dynamics.device import Bound, Parameter, Role, Scaling, limits
from gridfold.dynamics.stabilizers.ieeest import ACCELERATING_POWER, input_signal

#: Lags of the ramp filter that there are states for.
RAMP_LAGS = 8

CODES = (
    Parameter("input_code_1", "IC1", "-", Bound.ANY),
    Parameter("remote_bus_1", "IB1", "-", Bound.ANY),
    Parameter("input_code_2", "IC2", "-", Bound.ANY),
    Parameter("remote_bus_2", "IB2", "-", Bound.ANY),
    Parameter("ramp_poles", "M", "-", Bound.NOT_NEGATIVE),
    Parameter("ramp_stages", "N", "-", Bound.NOT_NEGATIVE),
)
FILTERS = (
    Parameter("washout_time_1", "TW1", "s", Bound.NOT_NEGATIVE),
    Parameter("washout_time_2", "TW2", "s", Bound.NOT_NEGATIVE),
    Parameter("input_time_1", "T6", "s", Bound.NOT_NEGATIVE),
    Parameter("washout_time_3", "TW3", "s", Bound.NOT_NEGATIVE),
    Parameter("washout_time_4", "TW4", "s", Bound.NOT_NEGATIVE),
    Parameter("input_time_2", "T7", "s", Bound.NOT_NEGATIVE),
    Parameter("input_gain_2", "KS2", "p.u.", Bound.ANY),
    Parameter("ramp_gain", "KS3", "p.u.", Bound.ANY),
    Parameter("ramp_lead_time", "T8", "s", Bound.NOT_NEGATIVE),
    Parameter("ramp_lag_time", "T9", "s", Bound.NOT_NEGATIVE),
    Parameter("stabilizer_gain", "KS1", "p.u.", Bound.ANY),
    Parameter("lead_time_1", "T1", "s", Bound.NOT_NEGATIVE),
    Parameter("lag_time_1", "T2", "s", Bound.NOT_NEGATIVE),
    Parameter("lead_time_2", "T3", "s", Bound.NOT_NEGATIVE),
    Parameter("lag_time_2", "T4", "s", Bound.NOT_NEGATIVE),
)
OUTPUT = (
    Parameter("highest_signal", "VSTMAX", "p.u.", Bound.ANY),
    Parameter("lowest_signal", "VSTMIN", "p.u.", Bound.ANY),
)
POWER_BASE = Parameter("power_base", "MBASE/SBASE", "p.u.", scaling=Scaling.POWER, default=1.0)
STATES = (
    "stabilizer_washout_1",
    "stabilizer_washout_2",
    "stabilizer_input_1",
    "stabilizer_washout_3",
    "stabilizer_washout_4",
    "stabilizer_input_2",
    *(f"stabilizer_ramp_{k}" for k in range(1, RAMP_LAGS + 1)),
    "stabilizer_lead_1",
    "stabilizer_lead_2",
)
INPUTS = ("speed", "active_power", "mechanical_power", "terminal_voltage")
#: A unit without a governor has a constant mechanical power, which is washed out.
DEFAULTS = {"mechanical_power": 0.0}
LIMITS = limits("lowest_signal", "highest_signal")
ROLE = Role.STABILIZER

(
    IC1, IB1, IC2, IB2, M, N, TW1, TW2, T6, TW3, TW4, T7, KS2, KS3, T8, T9, KS1, T1, T2, T3, T4,
) = range(21)  # fmt: skip
W1, W2, IN_1, W3, W4, IN_2, RAMP = range(7)
LEAD_1 = RAMP + RAMP_LAGS
LEAD_2 = LEAD_1 + 1
OMEGA, PE, PM, VT = range(4)


@njit
def optional_washout(u, x, time):
    """S T / (1 + s T), and the input itself where T is zero."""
    if time.real > 0:
        return washout(u, x, time, time)
    return u, u - x


@njit
def ramp_lag(u, x, k, poles, stages, lead, time):
    """Lag number `k` of the ramp filter, from 0: the first one of each stage has the lead."""
    if time.real <= 0 or k >= poles.real * stages.real:
        return u, u - x
    if k % max(int(poles.real), 1) == 0:
        return lead_lag(u, x, lead, time)
    return lag(u, x, time)


@njit
def keep(dx, row, i, rate, writes):
    """Write the derivative of a state, where that is wanted."""
    if writes:
        dx[row, i] = rate


@njit
def before_leads(first, second, x, p, dx, i, writes):
    """KS1 (f - v2) of unit `i`; `writes` the derivatives of all states but those of the leads."""
    value, rate = optional_washout(first, x[W1, i], p[TW1, i])
    keep(dx, W1, i, rate, writes)
    value, rate = optional_washout(value, x[W2, i], p[TW2, i])
    keep(dx, W2, i, rate, writes)
    v_1, rate = lag(value, x[IN_1, i], p[T6, i])
    keep(dx, IN_1, i, rate, writes)
    value, rate = optional_washout(second, x[W3, i], p[TW3, i])
    keep(dx, W3, i, rate, writes)
    value, rate = optional_washout(value, x[W4, i], p[TW4, i])
    keep(dx, W4, i, rate, writes)
    v_2, rate = lag(p[KS2, i] * value, x[IN_2, i], p[T7, i])
    keep(dx, IN_2, i, rate, writes)
    value = v_1 + p[KS3, i] * v_2
    for k in range(RAMP_LAGS):
        row = RAMP + k
        value, rate = ramp_lag(value, x[row, i], k, p[M, i], p[N, i], p[T8, i], p[T9, i])
        keep(dx, row, i, rate, writes)
    return p[KS1, i] * (value - v_2)


@njit
def lead(value, x, dx, row, i, lead_time, lag_time, writes):
    """A lead-lag of unit `i` with its state in `row`."""
    out, rate = lead_lag(value, x[row, i], lead_time, lag_time)
    keep(dx, row, i, rate, writes)
    return out


@njit
def signals(u, p, i, mechanical_power, power_base):
    """Both inputs of unit `i`."""
    first = input_signal(p[IC1, i], u[OMEGA, i], u[PE, i], mechanical_power, u[VT, i], power_base)
    second = input_signal(p[IC2, i], u[OMEGA, i], u[PE, i], mechanical_power, u[VT, i], power_base)
    return first, second


def inputs_and_ramp(parameters: Mapping[str, float]) -> Iterable[str]:
    """Inputs that exist, and a ramp filter that there are states for."""
    for k in (1, 2):
        code, bus = parameters[f"input_code_{k}"], parameters[f"remote_bus_{k}"]
        if code not in (0, 1, 3, 4, 5):
            yield f"input_code_{k} IC{k} {code:g} is none of 0, 1, 3, 4 and 5"
        if bus != 0:
            yield f"remote_bus_{k} IB{k}: a signal of the remote bus {bus:g} is not modelled"
        direct = parameters[f"input_time_{k}"] == 0
        if code == ACCELERATING_POWER and direct:
            yield f"input_code_{k} IC{k} 4: accelerating power needs a lag input_time_{k}"
    poles, stages = parameters["ramp_poles"], parameters["ramp_stages"]
    if poles != int(poles) or stages != int(stages) or poles * stages > RAMP_LAGS:
        yield f"ramp_poles M {poles:g} times ramp_stages N {stages:g} is no number up to {RAMP_LAGS}"
    if poles * stages > 0 and parameters["ramp_lag_time"] == 0 and parameters["ramp_lead_time"] > 0:
        yield "ramp_lag_time T9 is 0: ramp_lead_time T8 has to be 0 then"


def check_of(parameters: tuple[Parameter, ...], *more_ordered: tuple[str, str]) -> Check:
    """The check of a model with these parameters."""
    names = {parameter.name for parameter in parameters}
    leads = [(f"lead_time_{k}", f"lag_time_{k}") for k in (1, 2, 3) if f"lag_time_{k}" in names]
    return checks(
        parameters,
        ordered=[("lowest_signal", "highest_signal"), *more_ordered],
        proper=leads,
        more=[inputs_and_ramp],
    )
