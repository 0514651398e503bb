"""A ring of three machines with loads, controls, limits that act and an exciter of a user's own."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from own_exciters import own_file

import gridfold as gf

_MACHINE = {
    "damping": 2.0,
    "d_reactance": 1.2,
    "q_reactance": 1.1,
    "d_transient_reactance": 0.25,
    "q_transient_reactance": 0.25,
    "d_open_circuit_time": 6.0,
    "q_open_circuit_time": 0.6,
}
_TYPE_1 = {
    "regulator_gain": 20.0,
    "regulator_time": 0.2,
    "exciter_gain": 1.0,
    "exciter_time": 0.314,
    "feedback_gain": 0.063,
    "feedback_time": 0.35,
    "saturation_a": 0.0013,
    "saturation_b": 1.4083,
}
_SEXS = {
    "lead_lag_ratio": 0.1,
    "lag_time": 10.0,
    "regulator_gain": 100.0,
    "exciter_time": 0.05,
    "field_voltage_minimum": 0.5,
    "field_voltage_maximum": 2.2,
}
_OWN = {
    "mode": 2.0,
    "measuring_time": 0.02,
    "gain": 50.0,
    "time": 0.05,
    "lowest": -4.0,
    "highest": 4.0,
}


def three_machines(folder: Path) -> gf.DetailedModel:
    """The grid at its equilibrium; the file of the own exciter is written into `folder`."""
    own = gf.load_devices(own_file(folder))
    records = [
        gf.DeviceRecord("two_axis", bus, "1", _MACHINE | {"inertia": inertia})
        for bus, inertia in ((1, 5.0), (2, 3.0), (3, 4.0))
    ]
    exciters = (("ieee_type1", _TYPE_1), ("sexs", _SEXS), ("mine", _OWN))
    records += [
        gf.DeviceRecord(model, bus, "1", values)
        for bus, (model, values) in enumerate(exciters, start=1)
    ]
    for bus in (1, 3):
        governor = {"droop": 0.05, "governor_time": 0.3}
        records.append(gf.DeviceRecord("first_order_governor", bus, "1", governor))
        records.append(gf.DeviceRecord("non_reheat_turbine", bus, "1", {"charging_time": 0.4}))
    slack, held = gf.Control.SLACK, gf.Control.VOLTAGE
    case = gf.Case(
        name="three machines",
        buses=tuple(gf.Bus(bus) for bus in (1, 2, 3, 4)),
        branches=(
            gf.Branch(1, 2, reactance=0.1, resistance=0.01),
            gf.Branch(2, 3, reactance=0.12, resistance=0.01),
            gf.Branch(3, 4, reactance=0.08, resistance=0.01),
            gf.Branch(4, 1, reactance=0.09, resistance=0.01),
        ),
        generators=(
            gf.Generator(1, active_mw=60.0, voltage_pu=1.02, control=slack),
            gf.Generator(2, active_mw=70.0, voltage_pu=1.01, control=held),
            gf.Generator(3, active_mw=50.0, voltage_pu=1.0, control=held),
        ),
        loads=(gf.Load(2, active_mw=40.0, reactive_mvar=10.0), gf.Load(4, "1", 130.0, 30.0)),
        devices=tuple(records),
    )
    return gf.build_model(case, devices=own)


def disturbances() -> list[Sequence[gf.Event]]:
    """Events of most kinds, on and off the grid of steps."""
    return [
        [],
        [gf.BusFault(2, 0.02, 0.05)],
        [gf.BusFault(4, 0.0233, 0.0471, 0.001, 0.02), gf.BranchTrip("2-3", 0.1)],
        [gf.BranchFault("1-2", 0.02, 0.0377, fraction=0.37)],
        [gf.MachineTrip(3, "1", 0.05)],
        [gf.LoadStep(4, 0.03, 30.0, -5.0)],
        [gf.BusFault(3, 0.0, 0.05, trip_bus=True)],
        [gf.Redispatch(2.0, buses="2"), gf.BusFault(2, 0.02, 0.05)],
    ]
