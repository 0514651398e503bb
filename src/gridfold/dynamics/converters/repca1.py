"""REPCA1 of PSS/E: control of a plant of wind turbines, photovoltaics or storage.

PSS/E Model Library, REPCA1; WECC REMTF, REPC_A. It gives the electrical control its references, from
voltage and power where the plant is measured; all is in per unit of the plant's rating.

    e_q  = Vref - (|V - (Rc + j Xc) I| or V + Kc Q) / (1 + s Tfltr)               RefFlag = 1
    e_q  = Qref - Q / (1 + s Tfltr)                                               RefFlag = 0
    Qext = (1 + s Tft) / (1 + s Tfv) (Kp + Ki / s) clip(db(e_q), emin, emax)      within Qmin and Qmax
    e_p  = Pref - P / (1 + s Tp) + min(Ddn df, 0) + max(Dup df, 0)                df = db(1 - f)
    Pext = 1 / (1 + s Tg) (Kpg + Kig / s) clip(e_p, femin, femax)                 within Pmin and Pmax

The integral of Qext stands while the voltage is below Vfrz. Fflag = 0 leaves the power alone.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numba import njit

from gridfold.dynamics.blocks import (
    clip,
    dead_band_between,
    higher,
    lag,
    lead_lag,
    limited_pi,
    lower,
)
from gridfold.dynamics.checks import checks
from gridfold.dynamics.device import Bound, Device, Parameter, Role, Scaling, Values, limits

(
    VCFLAG, REFFLAG, FFLAG, TFLTR, KP, KI, TFT, TFV, VFRZ, RC, XC, KC, EMAX, EMIN, DBD1, DBD2, QMAX,
    QMIN, KPG, KIG, TP, FDBD1, FDBD2, FEMAX, FEMIN, PMAX, PMIN, TG, DDN, DUP, POWER_BASE, REFERENCE,
    POWER_REFERENCE, BASE_SPEED,
) = range(34)  # fmt: skip
VOLTAGE, REACTIVE, Q_INTEGRAL, LEAD, POWER, P_INTEGRAL, P_ORDER = range(7)
VT, PE, QE, FREQUENCY = range(4)
P_EXTERNAL, Q_EXTERNAL, P_START = range(3)

PARAMETERS = (
    Parameter("compensation_code", "VCFlag", "-", Bound.ANY),
    Parameter("reference_code", "RefFlag", "-", Bound.ANY),
    Parameter("frequency_code", "Fflag", "-", Bound.ANY),
    Parameter("filter_time", "Tfltr", "s", Bound.NOT_NEGATIVE),
    Parameter("reactive_proportional_gain", "Kp", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("reactive_integral_gain", "Ki", "1/s", Bound.NOT_NEGATIVE),
    Parameter("lead_time", "Tft", "s", Bound.NOT_NEGATIVE),
    Parameter("lag_time", "Tfv", "s", Bound.NOT_NEGATIVE),
    Parameter("freeze_voltage", "Vfrz", "p.u.", Bound.ANY),
    Parameter("compensation_resistance", "Rc", "p.u.", Bound.ANY),
    Parameter("compensation_reactance", "Xc", "p.u.", Bound.ANY),
    Parameter("reactive_droop", "Kc", "p.u.", Bound.ANY),
    Parameter("highest_error", "emax", "p.u.", Bound.ANY),
    Parameter("lowest_error", "emin", "p.u.", Bound.ANY),
    Parameter("lower_dead_band", "dbd1", "p.u.", Bound.ANY),
    Parameter("upper_dead_band", "dbd2", "p.u.", Bound.ANY),
    Parameter("highest_reactive_power", "Qmax", "p.u.", Bound.ANY),
    Parameter("lowest_reactive_power", "Qmin", "p.u.", Bound.ANY),
    Parameter("power_proportional_gain", "Kpg", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("power_integral_gain", "Kig", "1/s", Bound.NOT_NEGATIVE),
    Parameter("power_time", "Tp", "s", Bound.NOT_NEGATIVE),
    Parameter("lower_frequency_band", "fdbd1", "p.u.", Bound.ANY),
    Parameter("upper_frequency_band", "fdbd2", "p.u.", Bound.ANY),
    Parameter("highest_power_error", "femax", "p.u.", Bound.ANY),
    Parameter("lowest_power_error", "femin", "p.u.", Bound.ANY),
    Parameter("highest_power", "Pmax", "p.u.", Bound.ANY),
    Parameter("lowest_power", "Pmin", "p.u.", Bound.ANY),
    Parameter("order_time", "Tg", "s", Bound.NOT_NEGATIVE),
    Parameter("over_frequency_gain", "Ddn", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("under_frequency_gain", "Dup", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("power_base", "MBASE/SBASE", "p.u.", scaling=Scaling.POWER, default=1.0),
)
#: Numbers of the dynamics record, behind the remote bus and the branch that is measured.
DYR_COLUMNS: tuple[str | None, ...] = (
    None, None, None, None, *(parameter.name for parameter in PARAMETERS[:-1]),
)  # fmt: skip


@njit
def regulated(u, p, i):
    """Voltage that unit `i` regulates: with the drop of its current, or with a droop of Q."""
    v, active, reactive = u[VT, i], u[PE, i] / p[POWER_BASE, i], u[QE, i] / p[POWER_BASE, i]
    if p[VCFLAG, i].real == 0:
        return v + p[KC, i] * reactive
    size = higher(v, 0.01 + 0.0 * v)
    along = v - (p[RC, i] * active + p[XC, i] * reactive) / size
    across = (p[XC, i] * active - p[RC, i] * reactive) / size
    return np.sqrt(along * along + across * across)


@njit
def reactive_path(x, u, p, i):
    """Qext of unit `i`, then derivatives of both measurements, of the integral and the lead-lag."""
    voltage, d_voltage = lag(regulated(u, p, i), x[VOLTAGE, i], p[TFLTR, i])
    reactive, d_reactive = lag(u[QE, i] / p[POWER_BASE, i], x[REACTIVE, i], p[TFLTR, i])
    measured = voltage if p[REFFLAG, i].real == 1 else reactive
    error = dead_band_between(p[REFERENCE, i] - measured, p[DBD1, i], p[DBD2, i])
    error = clip(error, p[EMIN, i], p[EMAX, i])
    wanted, d_integral = limited_pi(
        error, x[Q_INTEGRAL, i], p[KP, i], p[KI, i], p[QMIN, i], p[QMAX, i]
    )
    if u[VT, i].real < p[VFRZ, i].real:
        d_integral = 0.0 * d_integral
    external, d_lead = lead_lag(wanted, x[LEAD, i], p[TFT, i], p[TFV, i])
    return external, d_voltage, d_reactive, d_integral, d_lead


@njit
def power_path(x, u, p, i):
    """Pext of unit `i`, then derivatives of the measurement, the integral and the order."""
    power, d_power = lag(u[PE, i] / p[POWER_BASE, i], x[POWER, i], p[TP, i])
    if p[FFLAG, i].real == 0:
        return p[POWER_REFERENCE, i], d_power, -x[P_INTEGRAL, i], -x[P_ORDER, i]
    off = dead_band_between(1.0 - u[FREQUENCY, i], p[FDBD1, i], p[FDBD2, i])
    help_up, help_down = higher(p[DUP, i] * off, 0.0 * off), lower(p[DDN, i] * off, 0.0 * off)
    error = p[POWER_REFERENCE, i] - power + help_up + help_down
    wanted, d_integral = limited_pi(
        clip(error, p[FEMIN, i], p[FEMAX, i]),
        x[P_INTEGRAL, i], p[KPG, i], p[KIG, i], p[PMIN, i], p[PMAX, i],
    )  # fmt: skip
    external, d_order = lag(wanted, x[P_ORDER, i], p[TG, i])
    return external, d_power, d_integral, d_order


def output(x, u, p, y, dx):
    """Both references of the electrical control."""
    for i in range(x.shape[1]):
        y[P_EXTERNAL, i], _, _, _ = power_path(x, u, p, i)
        y[Q_EXTERNAL, i], _, _, _, _ = reactive_path(x, u, p, i)


def derivative(x, u, p, y, dx):
    """Measurements, integrals, lead-lag and order."""
    for i in range(x.shape[1]):
        _, dx[VOLTAGE, i], dx[REACTIVE, i], dx[Q_INTEGRAL, i], dx[LEAD, i] = reactive_path(
            x, u, p, i
        )
        _, dx[POWER, i], dx[P_INTEGRAL, i], dx[P_ORDER, i] = power_path(x, u, p, i)


def guess(p: Values, known: Mapping[str, Any]) -> Mapping[str, Any]:
    """Without error where there is an integral; else the error that the gain needs."""
    base, voltage = p["power_base"], known["terminal_voltage"]
    active, reactive = known["active_power"] / base, known["reactive_power"] / base
    drop = (p["compensation_resistance"] + 1j * p["compensation_reactance"]) * (
        active - 1j * reactive
    )
    compensated = np.abs(voltage - drop / np.maximum(voltage, 0.01))
    seen = np.where(
        p["compensation_code"] == 1, compensated, voltage + p["reactive_droop"] * reactive
    )
    measured = np.where(p["reference_code"] == 1, seen, reactive)
    external, power = known["reactive_reference"], known["active_reference"]
    with_integral, driven = p["reactive_integral_gain"] > 0, p["power_integral_gain"] > 0
    error = _error(external, with_integral, p["reactive_proportional_gain"])
    beyond = np.where(error > 0, p["upper_dead_band"], np.where(error < 0, p["lower_dead_band"], 0))
    held = p["frequency_code"] == 1
    return {
        "regulated_voltage": seen,
        "measured_reactive_power": reactive,
        "plant_reactive_integral": np.where(with_integral, external, 0.0),
        "plant_lead_state": external,
        "measured_plant_power": active,
        "plant_power_integral": np.where(held & driven, power, 0.0),
        "plant_power_order": np.where(held, power, 0.0),
        "plant_reference": measured + error + beyond,
        "plant_power_reference": np.where(
            held, active + _error(power, driven, p["power_proportional_gain"]), power
        ),
    }


def _error(wanted: Any, with_integral: Any, gain: Any) -> Any:
    return np.where(with_integral, 0.0, wanted / np.maximum(gain, 1e-9))


def codes(parameters: Mapping[str, float]) -> Iterable[str]:
    """Codes are 0 or 1; something gives the references; dead bands hold zero."""
    names = {"compensation_code": "VCFlag", "reference_code": "RefFlag", "frequency_code": "Fflag"}
    for name, symbol in names.items():
        if parameters[name] not in (0, 1):
            yield f"{name} {symbol} {parameters[name]:g} is neither 0 nor 1"
    for low, high, symbols in (
        ("lower_dead_band", "upper_dead_band", "dbd1 to dbd2"),
        ("lower_frequency_band", "upper_frequency_band", "fdbd1 to fdbd2"),
    ):
        if parameters[low] > 0 or parameters[high] < 0:
            yield f"the dead band {symbols} has to hold zero"
    if not parameters["reactive_proportional_gain"] + parameters["reactive_integral_gain"]:
        yield "Kp and Ki are both 0: nothing gives the reactive power"
    gain = parameters["power_proportional_gain"] + parameters["power_integral_gain"]
    if parameters["frequency_code"] == 1 and gain == 0:
        yield "Kpg and Kig are both 0: with Fflag 1 nothing gives the power"


REPCA1 = Device(
    model="repca1",
    title="plant control REPCA1",
    role=Role.PLANT_CONTROL,
    parameters=PARAMETERS,
    set_points=("plant_reference", "plant_power_reference"),
    states=(
        "regulated_voltage",
        "measured_reactive_power",
        "plant_reactive_integral",
        "plant_lead_state",
        "measured_plant_power",
        "plant_power_integral",
        "plant_power_order",
    ),
    inputs=("terminal_voltage", "active_power", "reactive_power", "measured_frequency"),
    outputs=("active_reference", "reactive_reference"),
    output=output,
    derivative=derivative,
    targets=("active_reference", "reactive_reference"),
    guess=guess,
    check=checks(
        PARAMETERS,
        ordered=[
            ("lowest_error", "highest_error"),
            ("lowest_reactive_power", "highest_reactive_power"),
            ("lowest_power_error", "highest_power_error"),
            ("lowest_power", "highest_power"),
        ],
        proper=[("lead_time", "lag_time")],
        more=[codes],
    ),
    limits=(
        *limits("lowest_error", "highest_error"),
        *limits("lowest_reactive_power", "highest_reactive_power"),
        *limits("lowest_power_error", "highest_power_error"),
        *limits("lowest_power", "highest_power"),
    ),
    psse_names=("REPCA1", "REPCTA1", "REPCAU1", "REPCTAU1"),
    psse_record=DYR_COLUMNS,
    psse_icons=7,
    psse_measured=(0, 1),
)
