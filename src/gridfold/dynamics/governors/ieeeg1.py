"""Steam turbine and governor IEEEG1, on the base of its machine.

Model IEEEG1 of the PSS/E Model Library, turbine-governor models (IEEE Committee Report, Dynamic
models for steam and hydro turbines in power system studies, 1973). With the speed deviation dw,

    gate' = (Pref - K (1 + s T2) / (1 + s T1) dw - gate) / T3, within Uc and Uo

and the gate itself within Pmin and Pmax (non-windup). Four lags in a row follow: steam chest T4,
reheater T5, crossover T6 and T7; the power is the sum of K1, K3, K5 and K7 times their outputs.

The second unit of a cross-compound turbine, to which K2, K4, K6 and K8 belong, is not modelled.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from numba import njit

from gridfold.dynamics.blocks import clip, held, lag, lead_lag
from gridfold.dynamics.device import Bound, Device, Parameter, Role, Scaling, Values, limits

(
    JBUS, K, T1, T2, T3, UO, UC, PMAX, PMIN,
    T4, K1, K2, T5, K3, K4, T6, K5, K6, T7, K7, K8,
    POWER_BASE, PREF, BASE_SPEED,
) = range(24)  # fmt: skip
GOVERNOR, GATE, CHEST, REHEATER, CROSSOVER, OUTLET = range(6)
OMEGA = 0
PM = 0

DYR_COLUMNS: tuple[str | None, ...] = (
    "second_bus",
    None,  # M, the id of a second unit at JBUS
    "governor_gain",
    "governor_lag_time",
    "governor_lead_time",
    "gate_time",
    "opening_rate",
    "closing_rate",
    "highest_gate",
    "lowest_gate",
    "chest_time",
    "chest_fraction",
    "second_chest_fraction",
    "reheater_time",
    "reheater_fraction",
    "second_reheater_fraction",
    "crossover_time",
    "crossover_fraction",
    "second_crossover_fraction",
    "outlet_time",
    "outlet_fraction",
    "second_outlet_fraction",
)
_FRACTIONS = ("chest_fraction", "reheater_fraction", "crossover_fraction", "outlet_fraction")
_SYMBOLS = ("K2", "K4", "K6", "K8")


@njit
def turbine(gate, chest, reheater, crossover, outlet, t4, t5, t6, t7):
    """Outputs of the four lags, then the derivatives of their states."""
    power_1, d_chest = lag(gate, chest, t4)
    power_2, d_reheater = lag(power_1, reheater, t5)
    power_3, d_crossover = lag(power_2, crossover, t6)
    power_4, d_outlet = lag(power_3, outlet, t7)
    return power_1, power_2, power_3, power_4, d_chest, d_reheater, d_crossover, d_outlet


def output(x, u, p, y, dx):
    """Mechanical power on the system base."""
    for i in range(x.shape[1]):
        power_1, power_2, power_3, power_4, _, _, _, _ = turbine(
            clip(x[GATE, i], p[PMIN, i], p[PMAX, i]),
            x[CHEST, i], x[REHEATER, i], x[CROSSOVER, i], x[OUTLET, i],
            p[T4, i], p[T5, i], p[T6, i], p[T7, i],
        )  # fmt: skip
        power = p[K1, i] * power_1 + p[K3, i] * power_2 + p[K5, i] * power_3 + p[K7, i] * power_4
        y[PM, i] = p[POWER_BASE, i] * power


def derivative(x, u, p, y, dx):
    """Governor, gate and turbine."""
    for i in range(x.shape[1]):
        signal, dx[GOVERNOR, i] = lead_lag(u[OMEGA, i] - 1, x[GOVERNOR, i], p[T2, i], p[T1, i])
        gate = clip(x[GATE, i], p[PMIN, i], p[PMAX, i])
        wanted = (p[PREF, i] - p[K, i] * signal - gate) / p[T3, i]
        rate = clip(wanted, p[UC, i], p[UO, i])
        dx[GATE, i] = held(rate, x[GATE, i], p[PMIN, i], p[PMAX, i])
        _, _, _, _, dx[CHEST, i], dx[REHEATER, i], dx[CROSSOVER, i], dx[OUTLET, i] = turbine(
            gate,
            x[CHEST, i], x[REHEATER, i], x[CROSSOVER, i], x[OUTLET, i],
            p[T4, i], p[T5, i], p[T6, i], p[T7, i],
        )  # fmt: skip


def guess(p: Values, known: Mapping[str, Any]) -> Mapping[str, Any]:
    """The gate that gives the power."""
    total = sum(p[name] for name in _FRACTIONS)
    gate = known["mechanical_power"] / (p["power_base"] * total)
    states = ("gate", "chest_power", "reheater_power", "crossover_power", "outlet_power")
    return dict.fromkeys((*states, "power_reference"), gate)


def check(parameters: Mapping[str, float]) -> Iterable[str]:
    """No second unit, a turbine that gives power, proper blocks and limits in order."""
    if parameters["second_bus"] != 0:
        yield "second_bus JBUS: a second unit of the turbine is not modelled"
    for name, symbol in zip(_FRACTIONS, _SYMBOLS, strict=True):
        if parameters[f"second_{name}"] != 0:
            yield f"second_{name} {symbol} is power of a second unit, which is not modelled"
    if not sum(parameters[name] for name in _FRACTIONS) > 0:
        yield "the fractions K1, K3, K5 and K7 add up to 0: the turbine gives no power"
    if parameters["governor_lag_time"] == 0 and parameters["governor_lead_time"] != 0:
        yield "governor_lag_time T1 is 0: governor_lead_time T2 has to be 0 then"
    if parameters["closing_rate"] > 0:
        yield "closing_rate Uc is positive: it is the rate of closing, 0 or less"
    if parameters["lowest_gate"] > parameters["highest_gate"]:
        yield "lowest_gate Pmin is above highest_gate Pmax"


IEEEG1 = Device(
    model="ieeeg1",
    title="steam turbine and governor IEEEG1",
    role=Role.GOVERNOR,
    parameters=(
        Parameter("second_bus", "JBUS", "", Bound.ANY, default=0.0),
        Parameter("governor_gain", "K", "p.u.", Bound.NOT_NEGATIVE),
        Parameter("governor_lag_time", "T1", "s", Bound.NOT_NEGATIVE),
        Parameter("governor_lead_time", "T2", "s", Bound.NOT_NEGATIVE),
        Parameter("gate_time", "T3", "s"),
        Parameter("opening_rate", "Uo", "p.u./s", Bound.NOT_NEGATIVE),
        Parameter("closing_rate", "Uc", "p.u./s", Bound.ANY),
        Parameter("highest_gate", "Pmax", "p.u.", Bound.ANY),
        Parameter("lowest_gate", "Pmin", "p.u.", Bound.ANY),
        Parameter("chest_time", "T4", "s", Bound.NOT_NEGATIVE),
        Parameter("chest_fraction", "K1", "p.u.", Bound.NOT_NEGATIVE),
        Parameter("second_chest_fraction", "K2", "p.u.", Bound.ANY, default=0.0),
        Parameter("reheater_time", "T5", "s", Bound.NOT_NEGATIVE),
        Parameter("reheater_fraction", "K3", "p.u.", Bound.NOT_NEGATIVE),
        Parameter("second_reheater_fraction", "K4", "p.u.", Bound.ANY, default=0.0),
        Parameter("crossover_time", "T6", "s", Bound.NOT_NEGATIVE),
        Parameter("crossover_fraction", "K5", "p.u.", Bound.NOT_NEGATIVE),
        Parameter("second_crossover_fraction", "K6", "p.u.", Bound.ANY, default=0.0),
        Parameter("outlet_time", "T7", "s", Bound.NOT_NEGATIVE),
        Parameter("outlet_fraction", "K7", "p.u.", Bound.NOT_NEGATIVE),
        Parameter("second_outlet_fraction", "K8", "p.u.", Bound.ANY, default=0.0),
        Parameter("power_base", "MBASE/SBASE", "p.u.", scaling=Scaling.POWER, default=1.0),
    ),
    set_points=("power_reference",),
    states=(
        "governor_signal",
        "gate",
        "chest_power",
        "reheater_power",
        "crossover_power",
        "outlet_power",
    ),
    inputs=("speed",),
    outputs=("mechanical_power",),
    output=output,
    derivative=derivative,
    targets=("mechanical_power",),
    guess=guess,
    check=check,
    limits=(
        *limits("closing_rate", "opening_rate"),
        *limits("lowest_gate", "highest_gate", state="gate"),
    ),
    psse_record=DYR_COLUMNS,
)
