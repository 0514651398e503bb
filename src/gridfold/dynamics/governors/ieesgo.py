"""Turbine and governor IEESGO of the IEEE standard form, on the base of its machine.

Model IEESGO of the PSS/E Model Library, turbine-governor models (IEEE Committee Report, Dynamic models
for steam and hydro turbines in power system studies, 1973). With the speed deviation dw,

    signal = K1 (1 + s T2) / ((1 + s T1) (1 + s T3)) dw
    valve  = Pref - signal within PMIN and PMAX
    p1 = valve / (1 + s T4),   p2 = K2 p1 / (1 + s T5),   p3 = K3 p2 / (1 + s T6)
    Pm = (1 - K2) p1 + (1 - K3) p2 + p3

so that the gain of the turbine is 1. The limits are windup limits.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from numba import njit

from gridfold.dynamics.blocks import clip, lag, lead_lag
from gridfold.dynamics.checks import checks
from gridfold.dynamics.device import Bound, Device, Parameter, Role, Scaling, Values, limits

(
    T1, T2, T3, T4, T5, T6, K1, K2, K3, PMAX, PMIN, POWER_BASE, PREF, BASE_SPEED,
) = range(14)  # fmt: skip
SIGNAL, LEAD, CHEST, REHEATER, CROSSOVER = range(5)
OMEGA = 0
PM = 0

PARAMETERS = (
    Parameter("governor_lag_time", "T1", "s", Bound.NOT_NEGATIVE),
    Parameter("governor_lead_time", "T2", "s", Bound.NOT_NEGATIVE),
    Parameter("valve_time", "T3", "s", Bound.NOT_NEGATIVE),
    Parameter("chest_time", "T4", "s", Bound.NOT_NEGATIVE),
    Parameter("reheater_time", "T5", "s", Bound.NOT_NEGATIVE),
    Parameter("crossover_time", "T6", "s", Bound.NOT_NEGATIVE),
    Parameter("governor_gain", "K1", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("reheater_fraction", "K2", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("crossover_fraction", "K3", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("highest_valve", "PMAX", "p.u.", Bound.ANY),
    Parameter("lowest_valve", "PMIN", "p.u.", Bound.ANY),
    Parameter("power_base", "MBASE/SBASE", "p.u.", scaling=Scaling.POWER, default=1.0),
)
DYR_COLUMNS: tuple[str | None, ...] = tuple(p.name for p in PARAMETERS[:-1])


@njit
def valve(x, u, p, i):
    """Valve of unit `i`, then the derivatives of both states of the governor.

    The lead T2 stands over T3 or, where that is zero, over T1.
    """
    slip = p[K1, i] * (u[OMEGA, i] - 1.0)
    if p[T3, i].real > 0:
        late, d_signal = lag(slip, x[SIGNAL, i], p[T1, i])
        signal, d_lead = lead_lag(late, x[LEAD, i], p[T2, i], p[T3, i])
    else:
        signal, d_signal = lead_lag(slip, x[SIGNAL, i], p[T2, i], p[T1, i])
        d_lead = signal - x[LEAD, i]
    return clip(p[PREF, i] - signal, p[PMIN, i], p[PMAX, i]), d_signal, d_lead


@njit
def turbine(opening, x, p, i):
    """Power of unit `i`, then the derivatives of its three lags."""
    chest, d_chest = lag(opening, x[CHEST, i], p[T4, i])
    reheater, d_reheater = lag(p[K2, i] * chest, x[REHEATER, i], p[T5, i])
    crossover, d_crossover = lag(p[K3, i] * reheater, x[CROSSOVER, i], p[T6, i])
    power = (1.0 - p[K2, i]) * chest + (1.0 - p[K3, i]) * reheater + crossover
    return power, d_chest, d_reheater, d_crossover


def output(x, u, p, y, dx):
    """Mechanical power on the system base."""
    for i in range(x.shape[1]):
        opening, _, _ = valve(x, u, p, i)
        power, _, _, _ = turbine(opening, x, p, i)
        y[PM, i] = p[POWER_BASE, i] * power


def derivative(x, u, p, y, dx):
    """Governor and turbine."""
    for i in range(x.shape[1]):
        opening, dx[SIGNAL, i], dx[LEAD, i] = valve(x, u, p, i)
        _, dx[CHEST, i], dx[REHEATER, i], dx[CROSSOVER, i] = turbine(opening, x, p, i)


def guess(p: Values, known: Mapping[str, Any]) -> Mapping[str, Any]:
    """All equations are linear."""
    power = known["mechanical_power"] / p["power_base"]
    return {"chest_power": power, "power_reference": power}


def leads(parameters: Mapping[str, float]) -> Iterable[str]:
    """A lead needs a lag."""
    if (
        parameters["governor_lag_time"] + parameters["valve_time"] == 0
        and parameters["governor_lead_time"] != 0
    ):
        yield "T1 and T3 are 0: governor_lead_time T2 has to be 0 then"


IEESGO = Device(
    model="ieesgo",
    title="turbine and governor of the IEEE standard form IEESGO",
    role=Role.GOVERNOR,
    parameters=PARAMETERS,
    set_points=("power_reference",),
    states=("governor_signal", "governor_lead", "chest_power", "reheater_power", "crossover_power"),
    inputs=("speed",),
    outputs=("mechanical_power",),
    output=output,
    derivative=derivative,
    targets=("mechanical_power",),
    guess=guess,
    check=checks(PARAMETERS, ordered=[("lowest_valve", "highest_valve")], more=[leads]),
    limits=limits("lowest_valve", "highest_valve"),
    psse_names=("IEESGO", "IEEESGO"),
    psse_record=DYR_COLUMNS,
)
