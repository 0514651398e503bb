"""Steam turbine and governor WSIEG1: IEEEG1 of WECC, with a dead band, a gate curve and blocking.

PSS/E Model Library, WSIEG1. The governor of :mod:`~gridfold.dynamics.governors.ieeeg1` sees the speed
deviation beyond a dead band: nothing up to db1, and the whole deviation beyond. The turbine sees the
gate through a curve of five points, straight lines between (GV1, PGV1) ... (GV5, PGV5), which is left
out where all of them are 0. IBLOCK says which limit of the gate is the gate of the start where that
limit is 0: 1 the lowest, 2 the highest, 3 both.

The hysteresis err of the dead band and the backlash db2 of the gate are not modelled.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import pairwise
from typing import Any

import numpy as np
from numba import njit

from gridfold.dynamics.blocks import clip, held, lead_lag
from gridfold.dynamics.device import Bound, Device, Parameter, Role, Values, limits
from gridfold.dynamics.governors import ieeeg1
from gridfold.dynamics.governors.ieeeg1 import (
    CHEST,
    CROSSOVER,
    GATE,
    GOVERNOR,
    IEEEG1,
    OMEGA,
    OUTLET,
    PM,
    REHEATER,
    turbine,
)

(
    JBUS, K, T1, T2, T3, UO, UC, PMAX, PMIN,
    T4, K1, K2, T5, K3, K4, T6, K5, K6, T7, K7, K8,
    DB1, ERR, DB2, GV1, PGV1, GV2, PGV2, GV3, PGV3, GV4, PGV4, GV5, PGV5, IBLOCK,
    POWER_BASE, PREF, START, BASE_SPEED,
) = range(39)  # fmt: skip
_CHANGE = 1
_POINTS = tuple(f"{kind}_{k}" for k in range(1, 6) for kind in ("curve_gate", "curve_power"))

DYR_COLUMNS: tuple[str | None, ...] = (
    *ieeeg1.DYR_COLUMNS,
    "dead_band",
    "dead_band_hysteresis",
    "gate_backlash",
    *_POINTS,
    "blocking_code",
)


@njit
def power_at(gate, p, i):
    """Power of unit `i` at a gate: straight lines between points, and on beyond the last ones."""
    if p[GV5, i].real == 0 and p[PGV5, i].real == 0:
        return gate
    first = GV1
    while first < GV4 and gate.real > p[first + 2, i].real:
        first += 2
    slope = (p[first + 3, i] - p[first + 1, i]) / (p[first + 2, i] - p[first, i])
    return p[first + 1, i] + slope * (gate - p[first, i])


@njit
def bounds(p, i):
    """Lowest and highest gate of unit `i`."""
    low, high, code = p[PMIN, i], p[PMAX, i], p[IBLOCK, i].real
    if code in (1, 3) and low.real == 0:
        low = p[START, i]
    if code in (2, 3) and high.real == 0:
        high = p[START, i]
    return low, high


def output(x, u, p, y, dx):
    """Mechanical power on the system base, and the change of the gate since the start."""
    for i in range(x.shape[1]):
        low, high = bounds(p, i)
        power_1, power_2, power_3, power_4, _, _, _, _ = turbine(
            power_at(clip(x[GATE, i], low, high), p, i),
            x[CHEST, i], x[REHEATER, i], x[CROSSOVER, i], x[OUTLET, i],
            p[T4, i], p[T5, i], p[T6, i], p[T7, i],
        )  # fmt: skip
        power = p[K1, i] * power_1 + p[K3, i] * power_2 + p[K5, i] * power_3 + p[K7, i] * power_4
        y[PM, i] = p[POWER_BASE, i] * power
        y[_CHANGE, i] = x[GATE, i] - p[START, i]


def derivative(x, u, p, y, dx):
    """Governor, gate and turbine."""
    for i in range(x.shape[1]):
        slip = u[OMEGA, i] - 1
        seen = slip if abs(slip.real) >= p[DB1, i].real else 0.0 * slip
        signal, dx[GOVERNOR, i] = lead_lag(seen, x[GOVERNOR, i], p[T2, i], p[T1, i])
        low, high = bounds(p, i)
        gate = clip(x[GATE, i], low, high)
        rate = clip((p[PREF, i] - p[K, i] * signal - gate) / p[T3, i], p[UC, i], p[UO, i])
        dx[GATE, i] = held(rate, x[GATE, i], low, high)
        _, _, _, _, dx[CHEST, i], dx[REHEATER, i], dx[CROSSOVER, i], dx[OUTLET, i] = turbine(
            power_at(gate, p, i),
            x[CHEST, i], x[REHEATER, i], x[CROSSOVER, i], x[OUTLET, i],
            p[T4, i], p[T5, i], p[T6, i], p[T7, i],
        )  # fmt: skip


def guess(p: Values, known: Mapping[str, Any]) -> Mapping[str, Any]:
    """The power of the stages, and the gate that gives it by the curve."""
    found = dict(ieeeg1.guess(p, known))
    power = found["chest_power"]
    gate = np.array([_gate_at(p, k, float(each)) for k, each in enumerate(np.atleast_1d(power))])
    return found | {"gate": gate, "power_reference": gate, "start_gate": gate}


def _gate_at(p: Values, k: int, power: float) -> float:
    """The gate that gives a power, on the line on which it is."""
    gates = [float(np.atleast_1d(p[f"curve_gate_{j}"])[k]) for j in range(1, 6)]
    powers = [float(np.atleast_1d(p[f"curve_power_{j}"])[k]) for j in range(1, 6)]
    if gates[-1] == 0 and powers[-1] == 0:
        return power
    first = next((j for j in range(3) if power <= powers[j + 1]), 3)
    part = (power - powers[first]) / (powers[first + 1] - powers[first])
    return gates[first] + part * (gates[first + 1] - gates[first])


def check(parameters: Mapping[str, float]) -> Iterable[str]:
    """What IEEEG1 asks for, a curve that rises, a known code, and no hysteresis."""
    yield from ieeeg1.check(parameters)
    values = [parameters[name] for name in _POINTS]
    for kind, column in (("GV", values[::2]), ("PGV", values[1::2])):
        rises = all(low < high for low, high in pairwise(column))
        if any(values) and not rises:
            yield f"{kind}1 to {kind}5 have to rise, or all points of the curve have to be 0"
    if parameters["blocking_code"] not in (0, 1, 2, 3):
        yield f"blocking_code IBLOCK is 0, 1, 2 or 3, not {parameters['blocking_code']:g}"
    for name, symbol in (("dead_band_hysteresis", "err"), ("gate_backlash", "db2")):
        if parameters[name] != 0:
            yield f"{name} {symbol} is {parameters[name]:g}, but a hysteresis is not modelled"


WSIEG1 = Device(
    model="wsieg1",
    title="steam turbine and governor WSIEG1",
    role=Role.GOVERNOR,
    parameters=(
        *IEEEG1.parameters[:-1],
        Parameter("dead_band", "db1", "p.u.", Bound.NOT_NEGATIVE),
        Parameter("dead_band_hysteresis", "err", "p.u.", Bound.ANY),
        Parameter("gate_backlash", "db2", "p.u.", Bound.ANY),
        *(
            Parameter(name, f"{'GV' if 'gate' in name else 'PGV'}{name[-1]}", "p.u.", Bound.ANY)
            for name in _POINTS
        ),
        Parameter("blocking_code", "IBLOCK", "-", Bound.ANY, default=0.0),
        IEEEG1.parameters[-1],
    ),
    set_points=("power_reference", "start_gate"),
    states=IEEEG1.states,
    inputs=IEEEG1.inputs,
    outputs=("mechanical_power", "gate_change"),
    output=output,
    derivative=derivative,
    targets=("mechanical_power", "gate_change"),
    defaults={"gate_change": 0.0},
    guess=guess,
    check=check,
    limits=(*limits("closing_rate", "opening_rate"), *limits("lowest_gate", "highest_gate")),
    psse_record=DYR_COLUMNS,
)
