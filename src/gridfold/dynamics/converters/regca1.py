"""REGCA1 of PSS/E: the converter of a wind or solar plant as the grid sees it, a current source.

PSS/E Model Library, REGCA1; WECC REMTF, WECC Solar Photovoltaic Power Plant Modeling and Validation
Guideline, 2019, REGC_A. Currents are in per unit of the converter's rating, in the direction of its
terminal voltage and across it; a positive reactive current gives reactive power. With the voltage v as
:mod:`~gridfold.dynamics.converters.tracking` knows it,

    Ip' = (Ipcmd - Ip) / Tg     rising by Rrpwr per second at most, not above L(v / (1 + s Tfltr))
    Iq' = (Iqcmd - Iq) / Tg     rising by Iqrmax at most if it was positive at the start,
                                falling by Iqrmin at most if it was negative
    I   = g(v) Ip - j max(Iq - Khv max(v - Volim, 0), Iolim)

L, for Lvplsw = 1, rises from 0 at Zerox to Lvpl1 at Brkpt; g from 0 at Lvpnt0 to 1 at Lvpnt1.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numba import njit

from gridfold.dynamics.blocks import APPROACH, higher, lag, lower
from gridfold.dynamics.checks import checks
from gridfold.dynamics.converters.tracking import follow
from gridfold.dynamics.device import Bound, Device, Limit, Parameter, Role, Scaling, Side, Values

(
    LVPLSW, TG, RRPWR, BRKPT, ZEROX, LVPL1, VOLIM, LVPNT1, LVPNT0, IOLIM, TFLTR, KHV, IQRMAX, IQRMIN,
    POWER_BASE, IQ_START, BASE_SPEED,
) = range(17)  # fmt: skip
ANGLE, FREQUENCY, VOLTAGE, FILTERED, IP, IQ = range(6)
VR, VI, IP_COMMAND, IQ_COMMAND = range(4)
SOURCE_R, SOURCE_I, ACTIVE, REACTIVE, P, Q, VT, START = range(8)

PARAMETERS = (
    Parameter("low_voltage_power_code", "Lvplsw", "-", Bound.ANY),
    Parameter("converter_time", "Tg", "s"),
    Parameter("power_recovery_rate", "Rrpwr", "p.u./s"),
    Parameter("low_voltage_power_break", "Brkpt", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("low_voltage_power_zero", "Zerox", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("low_voltage_power_limit", "Lvpl1", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("high_voltage", "Volim", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("full_current_voltage", "Lvpnt1", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("no_current_voltage", "Lvpnt0", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("lowest_reactive_current", "Iolim", "p.u.", Bound.ANY),
    Parameter("voltage_filter_time", "Tfltr", "s", Bound.NOT_NEGATIVE),
    Parameter("high_voltage_gain", "Khv", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("reactive_rise_rate", "Iqrmax", "p.u./s", Bound.NOT_NEGATIVE),
    Parameter("reactive_fall_rate", "Iqrmin", "p.u./s", Bound.ANY),
    Parameter("power_base", "MBASE/SBASE", "p.u.", scaling=Scaling.POWER, default=1.0),
)
#: Numbers of the dynamics record; the acceleration of PSS/E's network solution has nothing to act on.
DYR_COLUMNS: tuple[str | None, ...] = (*(p.name for p in PARAMETERS[:-1]), None)


@njit
def ramp(v, low, high, top):
    """0 up to `low`, rising to `top` at `high`, and `top` above."""
    if v.real >= high.real:
        return top
    if v.real <= low.real:
        return 0.0 * top
    return top * (v - low) / (high - low)


@njit
def active_limit(v, filtered, p, i):
    """The highest active current of unit `i` at a voltage; far away without the logic."""
    if p[LVPLSW, i].real == 1:
        measured, _ = lag(v, filtered, p[TFLTR, i])
        return ramp(measured, p[ZEROX, i], p[BRKPT, i], p[LVPL1, i])
    return 0.0 * v + 1e9


def source(x, u, p, y, dx):
    """The current into the network, on the system base."""
    for i in range(x.shape[1]):
        v, s, c = x[VOLTAGE, i], np.sin(x[ANGLE, i]), np.cos(x[ANGLE, i])
        highest = active_limit(v, x[FILTERED, i], p, i)
        gain = ramp(v, p[LVPNT0, i], p[LVPNT1, i], 1.0 + 0.0 * v)
        active = gain * lower(x[IP, i], highest)
        absorbed = p[KHV, i] * higher(v - p[VOLIM, i], 0.0 * v)
        reactive = higher(x[IQ, i] - absorbed, p[IOLIM, i])
        y[SOURCE_R, i] = p[POWER_BASE, i] * (active * c + reactive * s)
        y[SOURCE_I, i] = p[POWER_BASE, i] * (active * s - reactive * c)
        y[ACTIVE, i], y[REACTIVE, i] = active, reactive


def output(x, u, p, y, dx):
    """Terminal power and voltage."""
    for i in range(x.shape[1]):
        i_r, i_i = y[SOURCE_R, i], y[SOURCE_I, i]
        v_r, v_i = u[VR, i], u[VI, i]
        y[P, i] = v_r * i_r + v_i * i_i
        y[Q, i] = v_i * i_r - v_r * i_i
        y[VT, i] = np.sqrt(v_r * v_r + v_i * v_i)
        y[START, i] = x[IQ, i] - p[IQ_START, i]


def derivative(x, u, p, y, dx):
    """Followed voltage, its filter, and both currents."""
    for i in range(x.shape[1]):
        dx[ANGLE, i], dx[FREQUENCY, i], dx[VOLTAGE, i] = follow(
            u[VR, i], u[VI, i], x[ANGLE, i], x[FREQUENCY, i], x[VOLTAGE, i], p[BASE_SPEED, i]
        )
        _, dx[FILTERED, i] = lag(x[VOLTAGE, i], x[FILTERED, i], p[TFLTR, i])
        highest = active_limit(x[VOLTAGE, i], x[FILTERED, i], p, i)
        rate = lower((u[IP_COMMAND, i] - x[IP, i]) / p[TG, i], p[RRPWR, i])
        dx[IP, i] = lower(rate, (highest - x[IP, i]) / APPROACH)
        rate = (u[IQ_COMMAND, i] - x[IQ, i]) / p[TG, i]
        if p[IQ_START, i].real > 0:
            rate = lower(rate, p[IQRMAX, i])
        elif p[IQ_START, i].real < 0:
            rate = higher(rate, p[IQRMIN, i])
        dx[IQ, i] = rate


def guess(p: Values, known: Mapping[str, Any]) -> Mapping[str, Any]:
    """Currents from power and voltage; the low-voltage gain and the absorbed current are undone."""
    voltage = known["voltage_real"] + 1j * known["voltage_imag"]
    size = np.abs(voltage)
    low, high = p["no_current_voltage"], p["full_current_voltage"]
    gain = np.clip((size - low) / np.maximum(high - low, 1e-9), 1e-3, 1.0)
    active = known["active_power"] / p["power_base"] / size / gain
    absorbed = p["high_voltage_gain"] * np.maximum(size - p["high_voltage"], 0.0)
    reactive = known["reactive_power"] / p["power_base"] / size + absorbed
    return {
        "voltage_angle": np.angle(voltage),
        "measured_frequency": 1.0,
        "followed_voltage": size,
        "filtered_voltage": size,
        "active_current": active,
        "reactive_current": reactive,
        "starting_current": reactive,
        "active_current_command": active,
        "reactive_current_command": reactive,
    }


def codes(parameters: Mapping[str, float]) -> Iterable[str]:
    """A switch is 0 or 1, and a rate of falling is negative."""
    code = parameters["low_voltage_power_code"]
    if code not in (0, 1):
        yield f"low_voltage_power_code Lvplsw {code:g} is neither 0 nor 1"
    if parameters["reactive_fall_rate"] > 0:
        yield "reactive_fall_rate Iqrmin is the rate of falling, not above 0"


REGCA1 = Device(
    model="regca1",
    title="converter REGCA1",
    role=Role.MACHINE,
    parameters=PARAMETERS,
    set_points=("starting_current",),
    states=(
        "voltage_angle",
        "measured_frequency",
        "followed_voltage",
        "filtered_voltage",
        "active_current",
        "reactive_current",
    ),
    inputs=(
        "voltage_real",
        "voltage_imag",
        "active_current_command",
        "reactive_current_command",
    ),
    sources=("source_real", "source_imag", "given_active_current", "given_reactive_current"),
    outputs=("active_power", "reactive_power", "terminal_voltage", "converter_start"),
    source=source,
    output=output,
    derivative=derivative,
    targets=("active_power", "reactive_power", "converter_start"),
    solved_inputs=("active_current_command", "reactive_current_command"),
    defaults={"converter_start": 0.0},
    guess=guess,
    check=checks(
        PARAMETERS,
        ordered=[
            ("low_voltage_power_zero", "low_voltage_power_break"),
            ("no_current_voltage", "full_current_voltage"),
        ],
        more=[codes],
    ),
    limits=(
        Limit("power_recovery_rate", Side.HIGHEST),
        Limit("low_voltage_power_limit", Side.HIGHEST),
        Limit("lowest_reactive_current", Side.LOWEST),
        Limit("reactive_rise_rate", Side.HIGHEST),
        Limit("reactive_fall_rate", Side.LOWEST),
    ),
    psse_names=("REGCA1", "REGCAU1"),
    psse_record=DYR_COLUMNS,
    psse_icons=1,
)
