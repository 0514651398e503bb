"""What the electrical controls REECA1 and REECB1 share: from powers and voltage to current commands.

All is in per unit of the converter's rating. With the terminal voltage vf = V / (1 + s Trv):

    Qr   = Pe / (1 + s Tp) tan(phi) if PFFLAG = 1, else Qext
    Iq   = Qr / vf / (1 + s Tiq)                                                  QFLAG = 0
    Iq   = (Kvp + Kvi / s) (Vr - vf), within Iqmin and Iqmax                      QFLAG = 1
    Vr   = (Kqp + Kqi / s) (Qr - Qe), within Vmin and Vmax                        VFLAG = 1
    Vr   = Qr + Vref1                                                             VFLAG = 0
    Pord = Pref / (1 + s Tpord), within Pmin and Pmax, at a rate within dPmin and dPmax

    Iqcmd = Iq + Iqinj within Iqmin and Iqmax,    Ipcmd = Pord / vf within 0 and Ipmax

Qr is within Qmin and Qmax but where it stands for a voltage, Vr within Vmin and Vmax. Both currents
share Imax: the reactive one comes first for PQFLAG = 0, the active one for PQFLAG = 1, and the other
has what is left. While the voltage is below Vdip or above Vup, all integrals and lags behind Qr stand.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numba import njit

from gridfold.dynamics.blocks import clip, dead_band_between, held, higher, lag, limited_pi, lower
from gridfold.dynamics.device import Bound, Limit, Parameter, Scaling, Side, Values, limits

(
    VDIP, VUP, TRV, DBD1, DBD2, KQV, IQH, IQL, VREF0, TP, QMAX, QMIN, VMAX, VMIN, KQP, KQI, KVP, KVI,
    TIQ, DPMAX, DPMIN, PMAX, PMIN, IMAX, TPORD, PFFLAG, VFLAG, QFLAG, PQFLAG, POWER_BASE,
) = range(30)  # fmt: skip
FILTERED, MEASURED, Q_INTEGRAL, V_INTEGRAL, Q_CURRENT, ORDER = range(6)
VT, PE, QE, PREF, QREF = range(5)
IP_COMMAND, IQ_COMMAND, VOLTAGE_START, FACTOR_START, DIP, WANTED = range(6)
#: Voltage in p.u. by which no current is divided if it is lower.
LEAST_VOLTAGE = 0.01

PARAMETERS = (
    Parameter("dip_voltage", "Vdip", "p.u.", Bound.ANY),
    Parameter("high_voltage", "Vup", "p.u.", Bound.ANY),
    Parameter("voltage_filter_time", "Trv", "s", Bound.NOT_NEGATIVE),
    Parameter("lower_dead_band", "dbd1", "p.u.", Bound.ANY),
    Parameter("upper_dead_band", "dbd2", "p.u.", Bound.ANY),
    Parameter("injection_gain", "Kqv", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("highest_injection", "Iqhl", "p.u.", Bound.ANY),
    Parameter("lowest_injection", "Iqll", "p.u.", Bound.ANY),
    Parameter("given_voltage_reference", "Vref0", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("power_filter_time", "Tp", "s", Bound.NOT_NEGATIVE),
    Parameter("highest_reactive_power", "Qmax", "p.u.", Bound.ANY),
    Parameter("lowest_reactive_power", "Qmin", "p.u.", Bound.ANY),
    Parameter("highest_voltage", "Vmax", "p.u.", Bound.ANY),
    Parameter("lowest_voltage", "Vmin", "p.u.", Bound.ANY),
    Parameter("reactive_proportional_gain", "Kqp", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("reactive_integral_gain", "Kqi", "1/s", Bound.NOT_NEGATIVE),
    Parameter("voltage_proportional_gain", "Kvp", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("voltage_integral_gain", "Kvi", "1/s", Bound.NOT_NEGATIVE),
    Parameter("reactive_current_time", "Tiq", "s", Bound.NOT_NEGATIVE),
    Parameter("highest_power_rate", "dPmax", "p.u./s", Bound.NOT_NEGATIVE),
    Parameter("lowest_power_rate", "dPmin", "p.u./s", Bound.ANY),
    Parameter("highest_power", "Pmax", "p.u.", Bound.ANY),
    Parameter("lowest_power", "Pmin", "p.u.", Bound.ANY),
    Parameter("highest_current", "Imax", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("power_order_time", "Tpord", "s"),
    Parameter("power_factor_code", "PFFLAG", "-", Bound.ANY),
    Parameter("voltage_code", "VFLAG", "-", Bound.ANY),
    Parameter("reactive_code", "QFLAG", "-", Bound.ANY),
    Parameter("priority_code", "PQFLAG", "-", Bound.ANY),
    Parameter("power_base", "MBASE/SBASE", "p.u.", scaling=Scaling.POWER, default=1.0),
)
SET_POINTS = ("voltage_reference", "power_factor_tangent")
STATES = (
    "measured_voltage",
    "measured_power",
    "reactive_integral",
    "voltage_integral",
    "reactive_lag",
    "power_order",
)
INPUTS = (
    "terminal_voltage",
    "active_power",
    "reactive_power",
    "active_reference",
    "reactive_reference",
)
OUTPUTS = (
    "active_current_command",
    "reactive_current_command",
    "voltage_reference_start",
    "power_factor_start",
    "voltage_dip",
    "wanted_power",
)
TARGETS = OUTPUTS[:4]
SOLVED_INPUTS = ("active_reference", "reactive_reference")
DEFAULTS = {"voltage_reference_start": 0.0, "power_factor_start": 0.0}
ORDERED = (
    ("dip_voltage", "high_voltage"),
    ("lower_dead_band", "upper_dead_band"),
    ("lowest_injection", "highest_injection"),
    ("lowest_reactive_power", "highest_reactive_power"),
    ("lowest_voltage", "highest_voltage"),
    ("lowest_power_rate", "highest_power_rate"),
    ("lowest_power", "highest_power"),
)
LIMITS = (
    *limits("lowest_injection", "highest_injection"),
    *limits("lowest_reactive_power", "highest_reactive_power"),
    *limits("lowest_voltage", "highest_voltage"),
    *limits("lowest_power_rate", "highest_power_rate"),
    *limits("lowest_power", "highest_power", state="power_order"),
    Limit("highest_current", Side.HIGHEST),
)


@njit
def off_voltage(u, p, i):
    """Whether the terminal voltage of unit `i` is below Vdip or above Vup."""
    return u[VT, i].real < p[VDIP, i].real or u[VT, i].real > p[VUP, i].real


@njit
def measured_voltage(x, u, p, i):
    """Vf of unit `i`, the derivative of its state, and what currents are divided by."""
    v, rate = lag(u[VT, i], x[FILTERED, i], p[TRV, i])
    return v, rate, higher(v, LEAST_VOLTAGE + 0.0 * v)


@njit
def voltage_support(x, u, p, i, reference):
    """Iqinj of unit `i`: a gain on the voltage error beyond the dead band."""
    v, _, _ = measured_voltage(x, u, p, i)
    error = dead_band_between(reference - v, p[DBD1, i], p[DBD2, i])
    return clip(p[KQV, i] * error, p[IQL, i], p[IQH, i])


@njit
def left_over(whole, taken):
    """What a current leaves of a limit across it."""
    rest = (whole - taken) * (whole + taken)
    return np.sqrt(rest) if rest.real > 0 else 0.0 * rest


@njit
def power_order(x, p, i):
    """Pord of unit `i`."""
    return clip(x[ORDER, i], p[PMIN, i], p[PMAX, i])


@njit
def power_order_rate(x, u, p, i, reference):
    """Derivative of Pord of unit `i`."""
    rate = clip((reference - x[ORDER, i]) / p[TPORD, i], p[DPMIN, i], p[DPMAX, i])
    return held(rate, x[ORDER, i], p[PMIN, i], p[PMAX, i])


@njit
def reactive_reference(x, u, p, i, tangent):
    """Qr of unit `i`, and the derivative of the measured power."""
    power, rate = lag(u[PE, i] / p[POWER_BASE, i], x[MEASURED, i], p[TP, i])
    return (power * tangent if p[PFFLAG, i].real == 1 else u[QREF, i]), rate


@njit
def reactive_control(x, u, p, i, wanted, bias, highest):
    """Iq of unit `i` without injection, then derivatives of both integrals and of the lag.

    `highest` is Iqmax, `bias` the voltage Vref1.
    """
    v, _, divisor = measured_voltage(x, u, p, i)
    within = clip(wanted, p[QMIN, i], p[QMAX, i])
    if p[QFLAG, i].real == 0:
        current, d_lag = lag(within / divisor, x[Q_CURRENT, i], p[TIQ, i])
        return current, -x[Q_INTEGRAL, i], -x[V_INTEGRAL, i], d_lag
    reference, d_q = wanted + bias, -x[Q_INTEGRAL, i]
    if p[VFLAG, i].real == 1:
        reference, d_q = limited_pi(
            within - u[QE, i] / p[POWER_BASE, i],
            x[Q_INTEGRAL, i], p[KQP, i], p[KQI, i], p[VMIN, i], p[VMAX, i],
        )  # fmt: skip
    error = clip(reference, p[VMIN, i], p[VMAX, i]) - v
    current, d_v = limited_pi(
        error, x[V_INTEGRAL, i], p[KVP, i], p[KVI, i], -highest, highest
    )  # fmt: skip
    return current, d_q, d_v, -x[Q_CURRENT, i]


@njit
def highest_reactive(p, i, active, own):
    """Iqmax of unit `i` beside the active command; `own` is a limit of the reactive current alone."""
    whole = p[IMAX, i] if p[PQFLAG, i].real == 0 else left_over(p[IMAX, i], active)
    return lower(own, whole)


@njit
def highest_active(p, i, reactive, own):
    """Ipmax of unit `i` beside the reactive command; `own` is a limit of the active current alone."""
    whole = p[IMAX, i] if p[PQFLAG, i].real == 1 else left_over(p[IMAX, i], reactive)
    return lower(own, whole)


@njit
def active_command(p, i, wanted, highest):
    """Ipcmd of unit `i`, not negative unless its power may be."""
    lowest = 0.0 * highest if p[PMIN, i].real >= 0 else -highest
    return clip(wanted, lowest, highest)


@njit
def both_commands(x, u, p, i, wanted, bias, injected, own_active, own_reactive):
    """Ipcmd and Iqcmd of unit `i`, then derivatives of both integrals, of the lag and of Pord's place.

    `own_active` and `own_reactive` are limits of one current alone.
    """
    _, _, divisor = measured_voltage(x, u, p, i)
    asked = power_order(x, p, i) / divisor
    # With the active current first its limit does not depend on the other one.
    active = active_command(p, i, asked, highest_active(p, i, 0.0 * asked, own_active))
    most = highest_reactive(p, i, active, own_reactive)
    current, d_q, d_v, d_lag = reactive_control(x, u, p, i, wanted, bias, most)
    reactive = clip(current + injected, -most, most)
    active = active_command(p, i, asked, highest_active(p, i, reactive, own_active))
    return active, reactive, d_q, d_v, d_lag


@njit
def other_outputs(x, u, p, y, i, reference, tangent, speed):
    """Whether the voltage is off, the power that is wanted, and what is zero at the start.

    A reference that is not given is the voltage then, a factor that nothing uses is 0.
    """
    y[DIP, i] = (1.0 if off_voltage(u, p, i) else 0.0) + 0.0 * reference
    y[WANTED, i] = u[PREF, i] * speed
    if p[VREF0, i].real > 0:
        y[VOLTAGE_START, i] = reference - p[VREF0, i]
    else:
        y[VOLTAGE_START, i] = reference - u[VT, i]
    if p[PFFLAG, i].real == 1:
        y[FACTOR_START, i] = u[QREF, i] - u[QE, i] / p[POWER_BASE, i]
    else:
        y[FACTOR_START, i] = tangent


def guess(
    p: Values, known: Mapping[str, Any], bias: Any = 0.0, factor: Any = 1.0
) -> Mapping[str, Any]:
    """Everything follows from powers, voltage and commands; `factor` is what multiplies Pref."""
    voltage, base = known["terminal_voltage"], p["power_base"]
    active, reactive = known["active_power"] / base, known["reactive_power"] / base
    order = known["active_current_command"] * voltage
    reference = np.where(p["given_voltage_reference"] > 0, p["given_voltage_reference"], voltage)
    error = reference - voltage
    beyond = np.where(
        error > p["upper_dead_band"],
        error - p["upper_dead_band"],
        np.minimum(error - p["lower_dead_band"], 0.0),
    )
    own = known["reactive_current_command"] - p["injection_gain"] * beyond
    loop, outer = p["reactive_code"] == 1, p["voltage_code"] == 1
    by_voltage, by_reactive = p["voltage_integral_gain"] > 0, p["reactive_integral_gain"] > 0
    droop = np.where(by_voltage, 0.0, own / np.maximum(p["voltage_proportional_gain"], 1e-9))
    aim = voltage + droop
    q_droop = np.where(by_reactive, 0.0, aim / np.maximum(p["reactive_proportional_gain"], 1e-9))
    wanted = np.where(loop, np.where(outer, reactive + q_droop, aim - bias), own * voltage)
    factored = p["power_factor_code"] == 1
    return {
        "measured_voltage": voltage,
        "measured_power": active,
        "reactive_integral": np.where(loop & outer & by_reactive, aim, 0.0),
        "voltage_integral": np.where(loop & by_voltage, own, 0.0),
        "reactive_lag": np.where(loop, 0.0, own),
        "power_order": order,
        "voltage_reference": reference,
        "power_factor_tangent": np.where(
            factored, wanted / np.where(active == 0, 1.0, active), 0.0
        ),
        "active_reference": order / factor,
        "reactive_reference": np.where(factored, reactive, wanted),
    }


def codes(parameters: Mapping[str, float]) -> Iterable[str]:
    """Codes are 0 or 1; something must give the reactive current; rates have their signs."""
    names = {
        "power_factor_code": "PFFLAG",
        "voltage_code": "VFLAG",
        "reactive_code": "QFLAG",
        "priority_code": "PQFLAG",
        "speed_code": "PFLAG",
    }
    for name, symbol in names.items():
        if name in parameters and parameters[name] not in (0, 1):
            yield f"{name} {symbol} {parameters[name]:g} is neither 0 nor 1"
    if parameters["lower_dead_band"] > 0 or parameters["upper_dead_band"] < 0:
        yield "the dead band dbd1 to dbd2 has to hold zero"
    if parameters["lowest_power_rate"] > 0:
        yield "lowest_power_rate dPmin is the rate of falling, not above 0"
    if parameters["reactive_code"] == 1:
        if not parameters["voltage_proportional_gain"] + parameters["voltage_integral_gain"]:
            yield "Kvp and Kvi are both 0: with QFLAG 1 nothing gives the reactive current"
        gain = parameters["reactive_proportional_gain"] + parameters["reactive_integral_gain"]
        if parameters["voltage_code"] == 1 and gain == 0:
            yield "Kqp and Kqi are both 0: with QFLAG 1 and VFLAG 1 nothing gives the voltage"
