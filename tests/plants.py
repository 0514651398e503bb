"""A small case with devices of PSS/E, to be edited."""

from __future__ import annotations

import gridfold as gf

MACHINE = {
    "d_open_circuit_time": 8.0,
    "d_subtransient_open_circuit_time": 0.03,
    "q_open_circuit_time": 0.4,
    "q_subtransient_open_circuit_time": 0.05,
    "inertia": 6.5,
    "damping": 0.0,
    "d_reactance": 1.8,
    "q_reactance": 1.7,
    "d_transient_reactance": 0.3,
    "q_transient_reactance": 0.55,
    "subtransient_reactance": 0.25,
    "leakage_reactance": 0.2,
    "saturation_10": 0.0,
    "saturation_12": 0.0,
    "resistance": 0.0,
}
EXCITER = {
    "lead_lag_ratio": 0.1,
    "lag_time": 10.0,
    "regulator_gain": 100.0,
    "exciter_time": 0.1,
    "field_voltage_minimum": -5.0,
    "field_voltage_maximum": 5.0,
}


def two_plants() -> gf.Case:
    """Two areas with a unit and a load each, joined by a line with two circuits; a shunt at bus 103."""
    return gf.Case(
        name="plants",
        buses=(
            gf.Bus(101, "NORTH", 20.0, area=1, zone=1),
            gf.Bus(102, "SOUTH", 20.0, area=2, zone=1),
            gf.Bus(103, "TOWN", 230.0, area=1, zone=2),
            gf.Bus(104, "PORT", 230.0, area=2, zone=2),
        ),
        branches=(
            gf.Branch(101, 103, reactance=0.02),
            gf.Branch(102, 104, reactance=0.02, ratio=1.05),
            gf.Branch(103, 104, "1", 0.002, 0.05, 0.1),
            gf.Branch(103, 104, "2", 0.002, 0.05, 0.1),
        ),
        generators=(
            gf.Generator(101, "1", 100.0, base_mva=300.0, control=gf.Control.SLACK),
            gf.Generator(102, "1", 100.0, base_mva=300.0),
            gf.Generator(102, "2", 50.0, base_mva=150.0),
        ),
        loads=(
            gf.Load(103, "1", 120.0, 40.0),
            gf.Load(104, "1", 80.0, 20.0, impedance_active_mw=40.0),
            gf.Load(104, "2", 500.0, in_service=False),
        ),
        shunts=(gf.Shunt(103, "1", susceptance_mvar=30.0),),
        devices=(
            *(gf.DeviceRecord("genrou", bus, unit, dict(MACHINE)) for bus, unit in UNITS),
            gf.DeviceRecord("sexs", 101, "1", dict(EXCITER)),
        ),
        area_names={1: "NORTH", 2: "SOUTH"},
    )


UNITS = ((101, "1"), (102, "1"), (102, "2"))
