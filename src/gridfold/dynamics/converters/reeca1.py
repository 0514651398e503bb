"""REECA1 of PSS/E: electrical control of wind turbines, photovoltaics and storage.

PSS/E Model Library, REECA1; WECC REMTF, REEC_A. Beside what it shares with REECB1
(:mod:`~gridfold.dynamics.converters.electrical`),

- the voltage support Iqinj acts in a dip only; after it, it is Iqfrz for Thld seconds if Thld > 0, and
  goes on for -Thld seconds if Thld < 0;
- the limit of the active current stands for Thld2 seconds after a dip;
- tables limit each current by the voltage;
- the power reference may be multiplied by the speed of the generator (PFLAG = 1).

A clock that rises to Thld in a dip and runs down after it stands for the states of PSS/E's logic.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import pairwise
from typing import Any

import numpy as np
from numba import njit

from gridfold.dynamics.blocks import APPROACH
from gridfold.dynamics.checks import checks
from gridfold.dynamics.converters import electrical
from gridfold.dynamics.converters.electrical import (
    FILTERED,
    IP_COMMAND,
    IQ_COMMAND,
    MEASURED,
    ORDER,
    PREF,
    Q_CURRENT,
    Q_INTEGRAL,
    V_INTEGRAL,
    both_commands,
    highest_active,
    measured_voltage,
    off_voltage,
    other_outputs,
    power_order_rate,
    reactive_reference,
    voltage_support,
)
from gridfold.dynamics.device import Bound, Device, Limit, Parameter, Role, Side, Values

IQFRZ, THLD, THLD2, VREF1, PFLAG, Q_TABLE = range(30, 36)
P_TABLE = Q_TABLE + 8
REFERENCE, TANGENT = P_TABLE + 8, P_TABLE + 9
SUPPORT_CLOCK, LIMIT_CLOCK, HELD_LIMIT = range(6, 9)
SPEED = 5
#: A current that limits nothing, and the time in s below which a clock has run down.
FREE, RUN_DOWN = 1e9, 1e-3

_TABLES = tuple(
    Parameter(f"{of}_{what}_{k}", f"{symbol}{k}", "p.u.", Bound.ANY)
    for of, symbols in (("reactive_table", ("Vq", "Iq")), ("active_table", ("Vp", "Ip")))
    for k in range(1, 5)
    for what, symbol in zip(("voltage", "current"), symbols, strict=True)
)
PARAMETERS = (
    *electrical.PARAMETERS,
    Parameter("frozen_injection", "Iqfrz", "p.u.", Bound.ANY),
    Parameter("support_hold_time", "Thld", "s", Bound.ANY),
    Parameter("limit_hold_time", "Thld2", "s", Bound.NOT_NEGATIVE),
    Parameter("voltage_bias", "Vref1", "p.u.", Bound.ANY),
    Parameter("speed_code", "PFLAG", "-", Bound.ANY),
    *_TABLES,
)
_FIRST = [parameter.name for parameter in electrical.PARAMETERS]
#: Numbers of the dynamics record; the remote bus comes first.
DYR_COLUMNS: tuple[str | None, ...] = (
    None, "power_factor_code", "voltage_code", "reactive_code", "speed_code", "priority_code",
    *_FIRST[:9], "frozen_injection", "support_hold_time", "limit_hold_time",
    *_FIRST[9:18], "voltage_bias", *_FIRST[18:25], *(parameter.name for parameter in _TABLES),
)  # fmt: skip


@njit
def by_voltage(v, p, i, first):
    """Limit of a current from the table that begins at row `first`; none if it does not rise."""
    if p[first + 2, i].real <= p[first, i].real:
        return FREE + 0.0 * v
    for k in range(first, first + 8, 2):
        if v.real <= p[k, i].real:
            if k == first:
                return p[k + 1, i] + 0.0 * v
            share = (v - p[k - 2, i]) / (p[k, i] - p[k - 2, i])
            return p[k - 1, i] + share * (p[k + 1, i] - p[k - 1, i])
    return p[first + 7, i] + 0.0 * v


@njit
def injection(x, u, p, i):
    """Iqinj of unit `i`: in a dip, and as long as it is held after it."""
    support = voltage_support(x, u, p, i, p[REFERENCE, i])
    if off_voltage(u, p, i):
        return support
    if x[SUPPORT_CLOCK, i].real > RUN_DOWN:
        return p[IQFRZ, i] + 0.0 * support if p[THLD, i].real > 0 else support
    return 0.0 * support


@njit
def run_down(clock, time, off):
    """Derivative of a clock: it rises to its time while `off`, and then runs down."""
    if off:
        return (time - clock) / APPROACH
    rate = -clock / APPROACH
    return rate if rate.real > -1.0 else -1.0 + 0.0 * rate


@njit
def speed_factor(u, p, i):
    """What multiplies the power reference of unit `i`."""
    return u[SPEED, i] if p[PFLAG, i].real == 1 else 1.0 + 0.0 * u[SPEED, i]


@njit
def commands(x, u, p, i):
    """Both commands, derivatives of integrals and lag, and the limit of the active current."""
    v, _, _ = measured_voltage(x, u, p, i)
    wanted, _ = reactive_reference(x, u, p, i, p[TANGENT, i])
    own_reactive, own_active = by_voltage(v, p, i, Q_TABLE), by_voltage(v, p, i, P_TABLE)
    if x[LIMIT_CLOCK, i].real > RUN_DOWN and not off_voltage(u, p, i):
        own_active = x[HELD_LIMIT, i]
    active, reactive, d_q, d_v, d_lag = both_commands(
        x, u, p, i, wanted, p[VREF1, i], injection(x, u, p, i), own_active, own_reactive
    )
    highest = highest_active(p, i, reactive, own_active)
    return active, reactive, d_q, d_v, d_lag, highest


def output(x, u, p, y, dx):
    """Both current commands."""
    for i in range(x.shape[1]):
        y[IP_COMMAND, i], y[IQ_COMMAND, i], _, _, _, _ = commands(x, u, p, i)
        other_outputs(x, u, p, y, i, p[REFERENCE, i], p[TANGENT, i], speed_factor(u, p, i))


def derivative(x, u, p, y, dx):
    """Measurements and clocks always, all else but in a dip."""
    for i in range(x.shape[1]):
        off = off_voltage(u, p, i)
        _, dx[FILTERED, i], _ = measured_voltage(x, u, p, i)
        _, dx[MEASURED, i] = reactive_reference(x, u, p, i, p[TANGENT, i])
        _, _, d_q, d_v, d_lag, highest = commands(x, u, p, i)
        moves = 0.0 if off else 1.0
        dx[Q_INTEGRAL, i] = moves * d_q
        dx[V_INTEGRAL, i] = moves * d_v
        dx[Q_CURRENT, i] = moves * d_lag
        dx[ORDER, i] = moves * power_order_rate(x, u, p, i, u[PREF, i] * speed_factor(u, p, i))
        hold = p[THLD, i] if p[THLD, i].real > 0 else -p[THLD, i]
        dx[SUPPORT_CLOCK, i] = run_down(x[SUPPORT_CLOCK, i], hold, off)
        dx[LIMIT_CLOCK, i] = run_down(x[LIMIT_CLOCK, i], p[THLD2, i], off)
        if off:
            dx[HELD_LIMIT, i] = (highest - x[HELD_LIMIT, i]) / APPROACH
        elif x[LIMIT_CLOCK, i].real > RUN_DOWN:
            dx[HELD_LIMIT, i] = 0.0 * highest
        else:
            dx[HELD_LIMIT, i] = -x[HELD_LIMIT, i] / APPROACH


def guess(p: Values, known: Mapping[str, Any]) -> Mapping[str, Any]:
    """As without tables; no support acts at the start unless the voltage is off."""
    voltage = known["terminal_voltage"]
    off = (voltage < p["dip_voltage"]) | (voltage > p["high_voltage"])
    own = {**p, "injection_gain": np.where(off, p["injection_gain"], 0.0)}
    factor = np.where(p["speed_code"] == 1, known["generator_speed"], 1.0)
    found = electrical.guess(own, known, p["voltage_bias"], factor)
    clocks = {
        "support_clock": np.where(off, np.abs(p["support_hold_time"]), 0.0),
        "limit_clock": np.where(off, p["limit_hold_time"], 0.0),
    }
    return {**found, **clocks}


def tables(parameters: Mapping[str, float]) -> Iterable[str]:
    """Voltages of a table rise, or there is none."""
    for table, symbol in (("reactive_table", "Vq"), ("active_table", "Vp")):
        places = [parameters[f"{table}_voltage_{k}"] for k in range(1, 5)]
        rising = all(a < b for a, b in pairwise(places))
        absent = places[1] <= places[0] and len(set(places)) == 1
        if not rising and not absent:
            yield f"{symbol}1 to {symbol}4 of {table} do not rise: {places}"


REECA1 = Device(
    model="reeca1",
    title="electrical control of renewable plants REECA1",
    role=Role.ELECTRICAL_CONTROL,
    parameters=PARAMETERS,
    set_points=electrical.SET_POINTS,
    states=(*electrical.STATES, "support_clock", "limit_clock", "held_active_limit"),
    inputs=(*electrical.INPUTS, "generator_speed"),
    outputs=electrical.OUTPUTS,
    output=output,
    derivative=derivative,
    targets=electrical.TARGETS,
    solved_inputs=electrical.SOLVED_INPUTS,
    defaults={**electrical.DEFAULTS, "generator_speed": 1.0},
    guess=guess,
    check=checks(PARAMETERS, ordered=electrical.ORDERED, more=[electrical.codes, tables]),
    limits=(
        *electrical.LIMITS,
        *(
            Limit(f"{table}_current_{k}", Side.HIGHEST)
            for table in ("reactive_table", "active_table")
            for k in range(1, 5)
        ),
    ),
    psse_names=("REECA1", "REECAU1"),
    psse_record=DYR_COLUMNS,
    psse_icons=6,
    psse_measured=(0,),
)
