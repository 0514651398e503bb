"""DERA1 of PSS/E: many small converters of a distribution grid as one, with partial trips.

PSS/E Model Library, DERA1; EPRI, The New Aggregated Distributed Energy Resources (der_a) Model for
Transmission Planning Studies, 2019. All is in per unit of the unit's rating. The voltage v is
followed as by :mod:`~gridfold.dynamics.converters.tracking`; with V = v / (1 + s Trv),

    Iq   = Qr / V / (1 + s Tiq) + clip(Kqv db(Vref - V), Iqll, Iqhl)
    Qr   = Pf tan(phi) if Pfflag = 1, else Qref                    Pf = P / (1 + s Tp)
    e    = Pref - Pf + min(Ddn db(1 - f), 0) + max(Dup db(1 - f), 0)    within femin and femax
    Pord = (Kpg + Kig / s) e if Freqflag = 1, else Pref            both within Pmin and Pmax
    Ip   = Pord / (1 + s Tpord) / V

Both currents share Imax, are multiplied by the share k of what is still there, and follow within Tg,
the active one rising by rrpwr per second at most. k = 1 / (1 + s Tv) of what voltage and frequency
leave (:func:`remaining`). A trip of a part is for good: the lowest and the highest voltage are kept.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numba import njit

from gridfold.dynamics.blocks import (
    APPROACH,
    clip,
    dead_band_between,
    held,
    higher,
    lag,
    limited_pi,
    lower,
)
from gridfold.dynamics.checks import checks
from gridfold.dynamics.converters.electrical import LEAST_VOLTAGE, left_over
from gridfold.dynamics.converters.tracking import follow
from gridfold.dynamics.device import (
    Bound,
    Device,
    Limit,
    Parameter,
    Role,
    Scaling,
    Side,
    Values,
    limits,
    positions,
)

PARAMETERS = (
    Parameter("power_factor_code", "Pfflag", "-", Bound.ANY),
    Parameter("frequency_code", "Freqflag", "-", Bound.ANY),
    Parameter("priority_code", "PQflag", "-", Bound.ANY),
    Parameter("type_code", "Typeflag", "-", Bound.ANY),
    Parameter("voltage_trip_code", "Vtripflag", "-", Bound.ANY),
    Parameter("frequency_trip_code", "Ftripflag", "-", Bound.ANY),
    Parameter("voltage_filter_time", "Trv", "s", Bound.NOT_NEGATIVE),
    Parameter("frequency_filter_time", "Trf", "s", Bound.NOT_NEGATIVE),
    Parameter("lower_dead_band", "dbd1", "p.u.", Bound.ANY),
    Parameter("upper_dead_band", "dbd2", "p.u.", Bound.ANY),
    Parameter("voltage_gain", "Kqv", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("given_voltage_reference", "Vref0", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("power_filter_time", "Tp", "s", Bound.NOT_NEGATIVE),
    Parameter("reactive_current_time", "Tiq", "s", Bound.NOT_NEGATIVE),
    Parameter("droop_down", "Ddn", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("droop_up", "Dup", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("lower_frequency_band", "fdbd1", "p.u.", Bound.ANY),
    Parameter("upper_frequency_band", "fdbd2", "p.u.", Bound.ANY),
    Parameter("highest_error", "femax", "p.u.", Bound.ANY),
    Parameter("lowest_error", "femin", "p.u.", Bound.ANY),
    Parameter("highest_power", "Pmax", "p.u.", Bound.ANY),
    Parameter("lowest_power", "Pmin", "p.u.", Bound.ANY),
    Parameter("highest_power_rate", "dPmax", "p.u./s", Bound.NOT_NEGATIVE),
    Parameter("lowest_power_rate", "dPmin", "p.u./s", Bound.ANY),
    Parameter("power_order_time", "Tpord", "s"),
    Parameter("power_proportional_gain", "Kpg", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("power_integral_gain", "Kig", "1/s", Bound.NOT_NEGATIVE),
    Parameter("highest_current", "Imax", "p.u."),
    Parameter("low_voltage_none", "vl0", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("low_voltage_all", "vl1", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("high_voltage_none", "vh0", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("high_voltage_all", "vh1", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("low_voltage_none_time", "tvl0", "s", Bound.NOT_NEGATIVE),
    Parameter("low_voltage_all_time", "tvl1", "s", Bound.NOT_NEGATIVE),
    Parameter("high_voltage_none_time", "tvh0", "s", Bound.NOT_NEGATIVE),
    Parameter("high_voltage_all_time", "tvh1", "s", Bound.NOT_NEGATIVE),
    Parameter("recovering_share", "Vrfrac", "-", Bound.NOT_NEGATIVE),
    Parameter("lowest_frequency", "fltrp", "Hz", Bound.NOT_NEGATIVE),
    Parameter("highest_frequency", "fhtrp", "Hz", Bound.NOT_NEGATIVE),
    Parameter("low_frequency_time", "tfl", "s", Bound.NOT_NEGATIVE),
    Parameter("high_frequency_time", "tfh", "s", Bound.NOT_NEGATIVE),
    Parameter("converter_time", "Tg", "s"),
    Parameter("power_recovery_rate", "rrpwr", "p.u./s"),
    Parameter("share_time", "Tv", "s", Bound.NOT_NEGATIVE),
    Parameter("frequency_trip_voltage", "Vpr", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("highest_injection", "Iqhl", "p.u.", Bound.ANY),
    Parameter("lowest_injection", "Iqll", "p.u.", Bound.ANY),
    Parameter("power_base", "MBASE/SBASE", "p.u.", scaling=Scaling.POWER, default=1.0),
)
DYR_COLUMNS: tuple[str | None, ...] = tuple(p.name for p in PARAMETERS[:-1])
SET_POINTS = ("power_reference", "reactive_reference", "voltage_reference")
STATES = (
    "voltage_angle",
    "measured_frequency",
    "followed_voltage",
    "measured_voltage",
    "measured_power",
    "filtered_frequency",
    "reactive_lag",
    "power_integral",
    "power_order",
    "connected_share",
    "active_current",
    "reactive_current",
    "lowest_voltage",
    "highest_voltage",
    "very_low_clock",
    "low_clock",
    "very_high_clock",
    "high_clock",
    "low_frequency_clock",
    "high_frequency_clock",
)
INPUTS = ("voltage_real", "voltage_imag")
SOURCES = ("source_real", "source_imag")
OUTPUTS = ("active_power", "reactive_power", "terminal_voltage", "voltage_reference_start")

P = positions(*PARAMETERS, *SET_POINTS, "base_speed")
X = positions(*STATES)
U = positions(*INPUTS)
Y = positions(*SOURCES, *OUTPUTS)

CODES = {
    "power_factor_code": "Pfflag",
    "frequency_code": "Freqflag",
    "priority_code": "PQflag",
    "type_code": "Typeflag",
    "voltage_trip_code": "Vtripflag",
    "frequency_trip_code": "Ftripflag",
}


@njit
def measured(x, p, i):
    """V of unit `i`, and the derivative of its state."""
    return lag(x[X.followed_voltage, i], x[X.measured_voltage, i], p[P.voltage_filter_time, i])


@njit
def part(v, extreme, late, none, whole, recovers):
    """What is left of all units whose trip voltages lie evenly between `none` and `whole`.

    Once it is `late`, of those that were gone at the `extreme` voltage only a share `recovers`.
    """
    now = clip((v - none) / (whole - none), 0.0 * v, 1.0 + 0.0 * v)
    least = clip((extreme - none) / (whole - none), 0.0 * v, 1.0 + 0.0 * v)
    if not late or now.real <= least.real:
        return now
    return least + recovers * (now - least)


@njit
def remaining(x, p, i):
    """What voltage and frequency leave of unit `i`, from 0 to 1."""
    v, _ = measured(x, p, i)
    left = 1.0 + 0.0 * v
    if p[P.voltage_trip_code, i].real == 1:
        recovers = p[P.recovering_share, i]
        late = x[X.low_clock, i].real > p[P.low_voltage_all_time, i].real
        left = part(
            v, x[X.lowest_voltage, i], late,
            p[P.low_voltage_none, i], p[P.low_voltage_all, i], recovers,
        )  # fmt: skip
        late = x[X.high_clock, i].real > p[P.high_voltage_all_time, i].real
        left = left * part(
            -v, -x[X.highest_voltage, i], late,
            -p[P.high_voltage_none, i], -p[P.high_voltage_all, i], recovers,
        )  # fmt: skip
        if (
            x[X.very_low_clock, i].real > p[P.low_voltage_none_time, i].real
            or x[X.very_high_clock, i].real > p[P.high_voltage_none_time, i].real
        ):
            left = 0.0 * v
    if p[P.frequency_trip_code, i].real == 1 and (
        x[X.low_frequency_clock, i].real > p[P.low_frequency_time, i].real
        or x[X.high_frequency_clock, i].real > p[P.high_frequency_time, i].real
    ):
        left = 0.0 * v
    return left


@njit
def clock(elapsed, time, runs):
    """Derivative of a clock, which runs while a condition holds and stands once over its time."""
    if elapsed.real > time.real:
        return 0.0 * elapsed
    return 1.0 + 0.0 * elapsed if runs else -elapsed / APPROACH


@njit
def kept(extreme, v, off, late, sign):
    """Derivative of the lowest (`sign` 1) or highest (-1) voltage; outside of a trip it follows."""
    if (off or late) and sign * (v - extreme).real > 0:
        return 0.0 * v
    return (v - extreme) / APPROACH


@njit
def active_power(x, u, p, i):
    """Power at the terminals of unit `i` over its rating."""
    s, c = np.sin(x[X.voltage_angle, i]), np.cos(x[X.voltage_angle, i])
    active, reactive = x[X.active_current, i], x[X.reactive_current, i]
    along = u[U.voltage_real, i] * c + u[U.voltage_imag, i] * s
    across = u[U.voltage_real, i] * s - u[U.voltage_imag, i] * c
    return active * along + reactive * across


@njit
def power_wanted(x, p, i, power):
    """What the order of unit `i` follows, and the derivative of the integral."""
    frequency, _ = lag(
        x[X.measured_frequency, i], x[X.filtered_frequency, i], p[P.frequency_filter_time, i]
    )
    off = dead_band_between(
        1.0 - frequency, p[P.lower_frequency_band, i], p[P.upper_frequency_band, i]
    )
    droop = lower(p[P.droop_down, i] * off, 0.0 * off) + higher(p[P.droop_up, i] * off, 0.0 * off)
    if p[P.frequency_code, i].real == 0:
        return p[P.power_reference, i] + 0.0 * off, -x[X.power_integral, i]
    error = p[P.power_reference, i] - power + droop
    return limited_pi(
        clip(error, p[P.lowest_error, i], p[P.highest_error, i]),
        x[X.power_integral, i],
        p[P.power_proportional_gain, i],
        p[P.power_integral_gain, i],
        p[P.lowest_power, i],
        p[P.highest_power, i],
    )


@njit
def commands(x, p, i, power):
    """Both current commands of unit `i`, and the derivative of the lag of the reactive one."""
    v, _ = measured(x, p, i)
    divisor = higher(v, LEAST_VOLTAGE + 0.0 * v)
    wanted = p[P.reactive_reference, i]
    if p[P.power_factor_code, i].real == 1:
        wanted = wanted * power
    own, d_lag = lag(wanted / divisor, x[X.reactive_lag, i], p[P.reactive_current_time, i])
    error = dead_band_between(
        p[P.voltage_reference, i] - v, p[P.lower_dead_band, i], p[P.upper_dead_band, i]
    )
    reactive = own + clip(
        p[P.voltage_gain, i] * error, p[P.lowest_injection, i], p[P.highest_injection, i]
    )
    order = clip(x[X.power_order, i], p[P.lowest_power, i], p[P.highest_power, i])
    active, whole = order / divisor, p[P.highest_current, i]
    if p[P.priority_code, i].real == 0:
        reactive = clip(reactive, -whole, whole)
        most = left_over(whole, reactive)
    else:
        most = whole
    active = clip(active, -most if p[P.type_code, i].real == 0 else 0.0 * most, most)
    if p[P.priority_code, i].real == 1:
        rest = left_over(whole, active)
        reactive = clip(reactive, -rest, rest)
    return active, reactive, d_lag


def source(x, u, p, y, dx):
    """The current into the network, on the system base."""
    for i in range(x.shape[1]):
        s, c = np.sin(x[X.voltage_angle, i]), np.cos(x[X.voltage_angle, i])
        active, reactive = x[X.active_current, i], x[X.reactive_current, i]
        y[Y.source_real, i] = p[P.power_base, i] * (active * c + reactive * s)
        y[Y.source_imag, i] = p[P.power_base, i] * (active * s - reactive * c)


def output(x, u, p, y, dx):
    """Terminal power and voltage."""
    for i in range(x.shape[1]):
        i_r, i_i = y[Y.source_real, i], y[Y.source_imag, i]
        v_r, v_i = u[U.voltage_real, i], u[U.voltage_imag, i]
        y[Y.active_power, i] = v_r * i_r + v_i * i_i
        y[Y.reactive_power, i] = v_i * i_r - v_r * i_i
        size = np.sqrt(v_r * v_r + v_i * v_i)
        y[Y.terminal_voltage, i] = size
        given = p[P.given_voltage_reference, i]
        aim = given + 0.0 * size if given.real > 0 else size
        y[Y.voltage_reference_start, i] = p[P.voltage_reference, i] - aim


def derivative(x, u, p, y, dx):
    """Followed voltage, measurements, order, currents, and the clocks of the trips."""
    for i in range(x.shape[1]):
        (
            dx[X.voltage_angle, i], dx[X.measured_frequency, i], dx[X.followed_voltage, i],
        ) = follow(
            u[U.voltage_real, i], u[U.voltage_imag, i], x[X.voltage_angle, i],
            x[X.measured_frequency, i], x[X.followed_voltage, i], p[P.base_speed, i],
        )  # fmt: skip
        v, dx[X.measured_voltage, i] = measured(x, p, i)
        power, dx[X.measured_power, i] = lag(
            active_power(x, u, p, i), x[X.measured_power, i], p[P.power_filter_time, i]
        )
        frequency, dx[X.filtered_frequency, i] = lag(
            x[X.measured_frequency, i], x[X.filtered_frequency, i], p[P.frequency_filter_time, i]
        )
        wanted, dx[X.power_integral, i] = power_wanted(x, p, i, power)
        rate = clip(
            (wanted - x[X.power_order, i]) / p[P.power_order_time, i],
            p[P.lowest_power_rate, i],
            p[P.highest_power_rate, i],
        )
        dx[X.power_order, i] = held(
            rate, x[X.power_order, i], p[P.lowest_power, i], p[P.highest_power, i]
        )
        active, reactive, dx[X.reactive_lag, i] = commands(x, p, i, power)
        share, dx[X.connected_share, i] = lag(
            remaining(x, p, i), x[X.connected_share, i], p[P.share_time, i]
        )
        rate = (share * active - x[X.active_current, i]) / p[P.converter_time, i]
        dx[X.active_current, i] = lower(rate, p[P.power_recovery_rate, i])
        dx[X.reactive_current, i] = (share * reactive - x[X.reactive_current, i]) / p[
            P.converter_time, i
        ]
        low = v.real < p[P.low_voltage_all, i].real
        high = v.real > p[P.high_voltage_all, i].real
        late = x[X.low_clock, i].real > p[P.low_voltage_all_time, i].real
        dx[X.lowest_voltage, i] = kept(x[X.lowest_voltage, i], v, low, late, 1.0)
        late = x[X.high_clock, i].real > p[P.high_voltage_all_time, i].real
        dx[X.highest_voltage, i] = kept(x[X.highest_voltage, i], v, high, late, -1.0)
        dx[X.low_clock, i] = clock(x[X.low_clock, i], p[P.low_voltage_all_time, i], low)
        dx[X.high_clock, i] = clock(x[X.high_clock, i], p[P.high_voltage_all_time, i], high)
        low = v.real < p[P.low_voltage_none, i].real
        high = v.real > p[P.high_voltage_none, i].real
        dx[X.very_low_clock, i] = clock(x[X.very_low_clock, i], p[P.low_voltage_none_time, i], low)
        dx[X.very_high_clock, i] = clock(
            x[X.very_high_clock, i], p[P.high_voltage_none_time, i], high
        )
        hertz = frequency.real * p[P.base_speed, i].real / (2.0 * np.pi)
        sees = v.real > p[P.frequency_trip_voltage, i].real
        low = sees and hertz < p[P.lowest_frequency, i].real
        high = sees and hertz > p[P.highest_frequency, i].real
        dx[X.low_frequency_clock, i] = clock(
            x[X.low_frequency_clock, i], p[P.low_frequency_time, i], low
        )
        dx[X.high_frequency_clock, i] = clock(
            x[X.high_frequency_clock, i], p[P.high_frequency_time, i], high
        )


def guess(p: Values, known: Mapping[str, Any]) -> Mapping[str, Any]:
    """Everything follows from power and voltage, with all units there."""
    phasor = known["voltage_real"] + 1j * known["voltage_imag"]
    voltage = np.abs(phasor)
    active = known["active_power"] / p["power_base"]
    reactive = known["reactive_power"] / p["power_base"]
    given = p["given_voltage_reference"]
    reference = np.where(given > 0, given, voltage)
    error = reference - voltage
    beyond = np.where(
        error > p["upper_dead_band"],
        error - p["upper_dead_band"],
        np.minimum(error - p["lower_dead_band"], 0.0),
    )
    injected = np.clip(p["voltage_gain"] * beyond, p["lowest_injection"], p["highest_injection"])
    own = reactive / voltage - injected
    by_factor = p["power_factor_code"] == 1
    by_integral = (p["frequency_code"] == 1) & (p["power_integral_gain"] > 0)
    gain = np.maximum(p["power_proportional_gain"], 1e-9)
    droop = np.where((p["frequency_code"] == 1) & ~by_integral, active / gain, 0.0)
    follows = p["frequency_code"] == 1
    return {
        "voltage_angle": np.angle(phasor),
        "measured_frequency": 1.0,
        "followed_voltage": voltage,
        "measured_voltage": voltage,
        "measured_power": active,
        "filtered_frequency": 1.0,
        "reactive_lag": own,
        "power_integral": np.where(by_integral, active, 0.0),
        "power_order": active,
        "connected_share": 1.0,
        "active_current": active / voltage,
        "reactive_current": reactive / voltage,
        "lowest_voltage": voltage,
        "highest_voltage": voltage,
        "power_reference": active + np.where(follows, droop, 0.0),
        "reactive_reference": np.where(
            by_factor, own * voltage / np.where(active == 0, 1.0, active), own * voltage
        ),
        "voltage_reference": reference,
    }


def codes(parameters: Mapping[str, float]) -> Iterable[str]:
    """Codes are 0 or 1, dead bands hold zero, rates have their signs, trip voltages their order."""
    for name, symbol in CODES.items():
        if parameters[name] not in (0, 1):
            yield f"{name} {symbol} {parameters[name]:g} is neither 0 nor 1"
    for low, high, symbol in (
        ("lower_dead_band", "upper_dead_band", "dbd1 to dbd2"),
        ("lower_frequency_band", "upper_frequency_band", "fdbd1 to fdbd2"),
        ("lowest_error", "highest_error", "femin to femax"),
        ("lowest_power_rate", "highest_power_rate", "dPmin to dPmax"),
    ):
        if parameters[low] > 0 or parameters[high] < 0:
            yield f"{low} to {high} ({symbol}) has to hold zero"
    gain = parameters["power_proportional_gain"] + parameters["power_integral_gain"]
    if parameters["frequency_code"] == 1 and gain == 0:
        yield "Kpg and Kig are both 0: with Freqflag 1 nothing gives the power"
    if parameters["recovering_share"] > 1:
        yield f"recovering_share Vrfrac {parameters['recovering_share']:g} is above 1"
    if parameters["voltage_trip_code"] == 1:
        if parameters["low_voltage_none"] >= parameters["low_voltage_all"]:
            yield "low_voltage_none vl0 is not below low_voltage_all vl1"
        if parameters["high_voltage_all"] >= parameters["high_voltage_none"]:
            yield "high_voltage_all vh1 is not below high_voltage_none vh0"


DERA1 = Device(
    model="dera1",
    title="aggregate of distributed energy resources DERA1",
    role=Role.MACHINE,
    parameters=PARAMETERS,
    set_points=SET_POINTS,
    states=STATES,
    inputs=INPUTS,
    sources=SOURCES,
    outputs=OUTPUTS,
    source=source,
    output=output,
    derivative=derivative,
    targets=("active_power", "reactive_power", "voltage_reference_start"),
    defaults={"voltage_reference_start": 0.0},
    guess=guess,
    check=checks(
        PARAMETERS,
        ordered=[("lowest_power", "highest_power"), ("lowest_injection", "highest_injection")],
        more=[codes],
    ),
    limits=(
        *limits("lowest_error", "highest_error"),
        *limits("lowest_power", "highest_power", state="power_order"),
        *limits("lowest_power_rate", "highest_power_rate"),
        *limits("lowest_injection", "highest_injection"),
        Limit("highest_current", Side.HIGHEST),
        Limit("power_recovery_rate", Side.HIGHEST),
    ),
    psse_record=DYR_COLUMNS,
)
