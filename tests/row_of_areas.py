"""Areas in a row, each with two round-rotor machines with PSS/E exciters and governors.

Every area is like one of the two of Kundur, Power System Stability and Control, 1994, example 12.6:
machines of 900 MVA behind transformers, 25 km and 10 km of line to the load; two circuits of 110 km
join neighbours. Machines, exciters and governors differ a little from one another.
"""

from __future__ import annotations

from collections.abc import Iterator

import gridfold as gf

BASE_MVA = 900.0
MACHINE = {
    "d_open_circuit_time": 8.0,
    "d_subtransient_open_circuit_time": 0.03,
    "q_open_circuit_time": 0.4,
    "q_subtransient_open_circuit_time": 0.05,
    "inertia": 6.5,
    "damping": 2.0,
    "d_reactance": 1.8,
    "q_reactance": 1.7,
    "d_transient_reactance": 0.3,
    "q_transient_reactance": 0.55,
    "subtransient_reactance": 0.25,
    "leakage_reactance": 0.2,
    "saturation_10": 0.05,
    "saturation_12": 0.3,
    "resistance": 0.0025,
}
EXCITER = {
    "measuring_time": 0.02,
    "regulator_gain": 20.0,
    "regulator_time": 0.055,
    "lag_time": 0.0,
    "lead_time": 0.0,
    "regulator_maximum": 6.0,
    "regulator_minimum": -6.0,
    "exciter_gain": 1.0,
    "exciter_time": 0.36,
    "feedback_gain": 0.125,
    "feedback_time": 1.8,
    "saturation_voltage_1": 2.6,
    "saturation_1": 0.05,
    "saturation_voltage_2": 3.5,
    "saturation_2": 0.3,
}
GOVERNOR = {
    "droop": 0.05,
    "valve_time": 0.5,
    "highest_valve": 1.2,
    "lowest_valve": 0.0,
    "reheater_lead_time": 2.1,
    "reheater_time": 7.0,
    "turbine_damping": 0.0,
}


def row_of_areas(count: int = 3, **exciter: float) -> gf.Case:
    """Areas 1 to `count`; buses 10 k + 1 to 10 k + 5 of area k, machines at the first two.

    `exciter` changes parameters of all exciters.
    """
    areas = range(1, count + 1)
    return gf.Case(
        name="row",
        buses=tuple(gf.Bus(10 * k + b, area=k) for k in areas for b in range(1, 6)),
        branches=tuple(branch for k in areas for branch in _branches(k, k < count)),
        generators=tuple(_generator(k, b) for k in areas for b in (1, 2)),
        loads=tuple(gf.Load(10 * k + 5, active_mw=_load_mw(k, count)) for k in areas),
        shunts=tuple(gf.Shunt(10 * k + 5, susceptance_mvar=250.0) for k in areas),
        devices=tuple(d for k in areas for b in (1, 2) for d in _devices(k, b, exciter)),
    )


def _load_mw(area: int, count: int) -> float:
    """The first area exports to the last one."""
    return 1390.0 + {1: -100.0, count: 100.0}.get(area, 0.0)


def _branches(k: int, joined: bool) -> Iterator[gf.Branch]:
    first, second, middle, far, load = (10 * k + b for b in range(1, 6))
    yield gf.Branch(first, middle, reactance=0.15 / 9)
    yield gf.Branch(second, far, reactance=0.15 / 9)
    yield gf.Branch(middle, far, resistance=0.0025, reactance=0.025, susceptance=0.0437)
    yield gf.Branch(far, load, resistance=0.001, reactance=0.01, susceptance=0.0175)
    for circuit in ("1", "2") if joined else ():
        yield gf.Branch(
            load, load + 10, circuit, resistance=0.011, reactance=0.11, susceptance=0.1925
        )


def _generator(k: int, b: int) -> gf.Generator:
    control = gf.Control.SLACK if (k, b) == (1, 1) else gf.Control.VOLTAGE
    return gf.Generator(
        10 * k + b, active_mw=700.0, voltage_pu=1.03, base_mva=BASE_MVA, control=control
    )


def _devices(k: int, b: int, exciter: dict[str, float]) -> Iterator[gf.DeviceRecord]:
    off = 1 + 0.06 * (2 * k + b - 4)
    changed = {"genrou": MACHINE | {"inertia": 6.5 * off, "q_open_circuit_time": 0.4 / off}}
    changed["exdc2"] = EXCITER | {"regulator_gain": 20.0 * off} | exciter
    changed["tgov1"] = GOVERNOR | {"valve_time": 0.5 / off, "reheater_time": 7.0 * off}
    for model, parameters in changed.items():
        yield gf.DeviceRecord(model, 10 * k + b, "1", parameters)
