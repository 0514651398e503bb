"""Hydro turbine and PID governor PIDGOV, on the base of its machine.

Model PIDGOV of the PSS/E Model Library, turbine-governor models. With the speed deviation dw,

    e    = Rperm / (1 + s Treg) (Pref - feedback) - dw
    c    = 1 / (1 + s Ta) [(Kp + Ki / s) / (1 + s Ta) + s Kd / (1 + s Ta)] e
    gate' = (c - gate) / Tb, within Velmin and Velmax; gate within Gmin and Gmax (non-windup)
    Pm   = (1 - s Atw Tw) / (1 + s Atw Tw / 2) P(gate) - Dturb dw

The feedback is the electric power (code 0) or the gate (code 1). P(gate) is a line through (G0, 0),
(G1, P1), (G2, P2) and (1, P3), which goes on beyond its ends.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import pairwise
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from gridfold.dynamics.blocks import clip, held, lag, lead_lag, rate_feedback
from gridfold.dynamics.checks import checks
from gridfold.dynamics.device import Bound, Device, Parameter, Role, Scaling, Values, limits

(
    CODE, RPERM, TREG, KP, KI, KD, TA, TB, DTURB, G0, G1, P1, G2, P2, P3, GMAX, GMIN, ATW, TW,
    VELMAX, VELMIN, POWER_BASE, PREF, BASE_SPEED,
) = range(24)  # fmt: skip
DROOP, INTEGRAL, REGULATED, DIFFERENCE, CONTROL, GATE, WATER = range(7)
OMEGA, PE = range(2)
PM = 0

PARAMETERS = (
    Parameter("feedback_code", "M", "-", Bound.ANY),
    Parameter("droop", "Rperm", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("droop_time", "Treg", "s", Bound.NOT_NEGATIVE),
    Parameter("proportional_gain", "Kp", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("integral_gain", "Ki", "1/s"),
    Parameter("derivative_gain", "Kd", "s", Bound.NOT_NEGATIVE),
    Parameter("control_time", "Ta", "s", Bound.NOT_NEGATIVE),
    Parameter("gate_time", "Tb", "s"),
    Parameter("turbine_damping", "Dturb", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("no_load_gate", "G0", "p.u.", Bound.ANY),
    Parameter("gate_1", "G1", "p.u.", Bound.ANY),
    Parameter("power_1", "P1", "p.u.", Bound.ANY),
    Parameter("gate_2", "G2", "p.u.", Bound.ANY),
    Parameter("power_2", "P2", "p.u.", Bound.ANY),
    Parameter("power_3", "P3", "p.u.", Bound.ANY),
    Parameter("highest_gate", "Gmax", "p.u.", Bound.ANY),
    Parameter("lowest_gate", "Gmin", "p.u.", Bound.ANY),
    Parameter("water_factor", "Atw", "p.u."),
    Parameter("water_time", "Tw", "s"),
    Parameter("opening_rate", "Velmax", "p.u./s"),
    Parameter("closing_rate", "Velmin", "p.u./s", Bound.ANY),
    Parameter("power_base", "MBASE/SBASE", "p.u.", scaling=Scaling.POWER, default=1.0),
)
DYR_COLUMNS: tuple[str | None, ...] = tuple(p.name for p in PARAMETERS[:-1])


@njit
def steady_power(gate, g_0, g_1, p_1, g_2, p_2, p_3):
    """Power at a gate; the first and the last piece go on beyond the ends of the line."""
    if gate.real < g_1.real:
        return p_1 * (gate - g_0) / (g_1 - g_0)
    if gate.real < g_2.real:
        return p_1 + (p_2 - p_1) * (gate - g_1) / (g_2 - g_1)
    return p_2 + (p_3 - p_2) * (gate - g_2) / (1.0 - g_2)


@njit
def water(gate, x, p, i):
    """Power behind the water column of unit `i`, then the derivative of its state."""
    flow = steady_power(gate, p[G0, i], p[G1, i], p[P1, i], p[G2, i], p[P2, i], p[P3, i])
    inertia = p[ATW, i] * p[TW, i]
    return lead_lag(flow, x[WATER, i], -inertia, inertia / 2.0)


def output(x, u, p, y, dx):
    """Mechanical power on the system base."""
    for i in range(x.shape[1]):
        power, _ = water(clip(x[GATE, i], p[GMIN, i], p[GMAX, i]), x, p, i)
        y[PM, i] = p[POWER_BASE, i] * (power - p[DTURB, i] * (u[OMEGA, i] - 1.0))


def derivative(x, u, p, y, dx):
    """Droop, PID, gate and water column."""
    for i in range(x.shape[1]):
        gate = clip(x[GATE, i], p[GMIN, i], p[GMAX, i])
        feedback = gate if p[CODE, i].real == 1 else u[PE, i] / p[POWER_BASE, i]
        wanted = p[RPERM, i] * (p[PREF, i] - feedback)
        droop, dx[DROOP, i] = lag(wanted, x[DROOP, i], p[TREG, i])
        error = droop - (u[OMEGA, i] - 1.0)
        dx[INTEGRAL, i] = p[KI, i] * error
        regulated, dx[REGULATED, i] = lag(
            p[KP, i] * error + x[INTEGRAL, i], x[REGULATED, i], p[TA, i]
        )
        rate_part, dx[DIFFERENCE, i] = rate_feedback(error, x[DIFFERENCE, i], p[KD, i], p[TA, i])
        control, dx[CONTROL, i] = lag(regulated + rate_part, x[CONTROL, i], p[TA, i])
        rate = clip((control - gate) / p[TB, i], p[VELMIN, i], p[VELMAX, i])
        dx[GATE, i] = held(rate, x[GATE, i], p[GMIN, i], p[GMAX, i])
        _, dx[WATER, i] = water(gate, x, p, i)


def steady_gate(p: Values, power: NDArray[np.float64]) -> NDArray[np.float64]:
    """The gate at which the turbine gives a power."""
    g_0, g_1, g_2 = p["no_load_gate"], p["gate_1"], p["gate_2"]
    p_1, p_2, p_3 = p["power_1"], p["power_2"], p["power_3"]
    pieces = [
        g_0 + (g_1 - g_0) * power / p_1,
        g_1 + (g_2 - g_1) * (power - p_1) / (p_2 - p_1),
        g_2 + (1.0 - g_2) * (power - p_2) / (p_3 - p_2),
    ]
    return np.asarray(np.select([power < p_1, power < p_2], pieces[:2], pieces[2]))


def guess(p: Values, known: Mapping[str, Any]) -> Mapping[str, Any]:
    """The gate that gives the power."""
    power = known["mechanical_power"] / p["power_base"]
    gate = steady_gate(p, power)
    electric = known["active_power"] / p["power_base"]
    states = ("governor_integral", "governor_output", "governor_control", "gate")
    return {
        **dict.fromkeys(states, gate),
        "water_state": power,
        "power_reference": np.where(p["feedback_code"] == 1, gate, electric),
    }


def turbine(parameters: Mapping[str, float]) -> Iterable[str]:
    """A choice of two, a power that rises with the gate, a droop."""
    if parameters["feedback_code"] not in (0, 1):
        yield f"feedback_code M {parameters['feedback_code']:g} is neither 0 nor 1"
    gates = [parameters[name] for name in ("no_load_gate", "gate_1", "gate_2")] + [1.0]
    powers = [0.0] + [parameters[f"power_{k}"] for k in (1, 2, 3)]
    for name, values in (("G0, G1, G2, 1", gates), ("0, P1, P2, P3", powers)):
        if any(low >= high for low, high in pairwise(values)):
            yield f"the power of the turbine does not rise with its gate: {name} have to rise"
    if parameters["droop"] == 0:
        yield "droop Rperm is 0: nothing decides the reference"
    if parameters["closing_rate"] > 0:
        yield "closing_rate Velmin is positive: it is the rate of closing, 0 or less"


PIDGOV = Device(
    model="pidgov",
    title="hydro turbine and PID governor PIDGOV",
    role=Role.GOVERNOR,
    parameters=PARAMETERS,
    set_points=("power_reference",),
    states=(
        "droop_signal",
        "governor_integral",
        "governor_output",
        "governor_difference",
        "governor_control",
        "gate",
        "water_state",
    ),
    inputs=("speed", "active_power"),
    outputs=("mechanical_power",),
    output=output,
    derivative=derivative,
    targets=("mechanical_power",),
    guess=guess,
    check=checks(
        PARAMETERS,
        ordered=[("lowest_gate", "highest_gate")],
        proper=[("derivative_gain", "control_time")],
        more=[turbine],
    ),
    limits=(
        *limits("closing_rate", "opening_rate"),
        *limits("lowest_gate", "highest_gate", state="gate"),
    ),
    psse_record=DYR_COLUMNS,
)
