"""Runs with buses that branches without impedance join: those of one bus, until the coupler opens."""

from dataclasses import replace

import numpy as np
import pytest

import gridfold as gf
from gridfold.dynamics.model import build_model

COUPLER = "2-20"


def station(coupler=0.0):
    """Machines at 1, 2 and 20; 2 and 20 are halves of a station; lines 1-2 and 1-20, a load at 3."""
    classical = ("classical", {"inertia": 4.0, "transient_reactance": 0.25, "damping": 2.0})
    units = ((1, 40.0), (2, 60.0), (20, 45.0))
    return gf.Case(
        "station",
        tuple(gf.Bus(k, voltage_pu=v) for k, v in ((1, 1.03), (2, 1.02), (20, 1.02), (3, 1.0))),
        (
            gf.Branch(1, 2, reactance=0.2, susceptance=0.02),
            gf.Branch(1, 20, reactance=0.3),
            gf.Branch(20, 3, reactance=0.1),
            gf.Branch(1, 3, reactance=0.4),
            gf.Branch(2, 20, reactance=coupler),
        ),
        tuple(
            gf.Generator(k, active_mw=p, voltage_pu={1: 1.03}.get(k, 1.02), control=control)
            for (k, p), control in zip(
                units, (gf.Control.SLACK, gf.Control.VOLTAGE, gf.Control.VOLTAGE), strict=True
            )
        ),
        loads=(
            gf.Load(3, active_mw=130.0, reactive_mvar=30.0),
            gf.Load(2, active_mw=20.0, reactive_mvar=45.0),
        ),
        devices=tuple(gf.DeviceRecord(classical[0], k, "1", classical[1]) for k, _ in units),
    )


def as_one_bus():
    """The same with the station as bus 2, and the second unit there as its second."""
    case = station()
    units = (*case.generators[:2], replace(case.generators[2], bus=2, id="2"))
    devices = (*case.devices[:2], replace(case.devices[2], bus=2, id="2"))
    branches = (
        case.branches[0],
        gf.Branch(1, 2, "2", reactance=0.3),
        gf.Branch(2, 3, reactance=0.1),
        case.branches[3],
    )
    buses = tuple(bus for bus in case.buses if bus.number != 20)
    return replace(case, buses=buses, branches=branches, generators=units, devices=devices)


FAULTS = {
    "at the other half": ([gf.BusFault(20, 0.1, 0.1)], [gf.BusFault(2, 0.1, 0.1)]),
    "with an impedance": (
        [gf.BusFault(20, 0.1, 0.1, 0.0, 0.05)], [gf.BusFault(2, 0.1, 0.1, 0.0, 0.05)]
    ),
    "trip of a line at a half": ([gf.BranchTrip("1-20", 0.1)], [gf.BranchTrip("1-2:2", 0.1)]),
    "line fault": ([gf.BranchFault("20-3", 0.1, 0.1, 0.4)], [gf.BranchFault("2-3", 0.1, 0.1, 0.4)]),
    "on the coupler": (
        [gf.BranchFault(COUPLER, 0.1, 0.1, 0.3, trip=False)], [gf.BusFault(2, 0.1, 0.1)]
    ),
    "load step": ([gf.LoadStep(20, 0.1, 30.0, 10.0)], [gf.LoadStep(2, 0.1, 30.0, 10.0)]),
    "machine trip": ([gf.MachineTrip(20, "1", 0.1)], [gf.MachineTrip(2, "2", 0.1)]),
}  # fmt: skip


@pytest.mark.parametrize("backend", [gf.NetworkBackend.DENSE, gf.NetworkBackend.SPARSE])
@pytest.mark.parametrize("loads", ["z", "0.4,0.3,0.3"])
@pytest.mark.parametrize("what", FAULTS)
def test_a_run_is_that_of_one_bus(what, loads, backend):
    joined_events, events = FAULTS[what]
    model = gf.LoadModel.parse(loads)
    several = gf.simulate(build_model(station(), backend=backend, loads=model), joined_events, 0.6)
    one = gf.simulate(build_model(as_one_bus(), backend=backend, loads=model), events, 0.6)
    np.testing.assert_allclose(several.states, one.states, atol=2e-9)
    voltage, expected = several.bus_voltage(), one.bus_voltage()
    np.testing.assert_allclose(voltage[:, [0, 1, 3]], expected, atol=2e-9)
    np.testing.assert_allclose(voltage[:, 2], expected[:, 1], atol=2e-9)


def test_the_jacobian_is_that_of_one_bus():
    several, one = build_model(station()), build_model(as_one_bus())
    np.testing.assert_allclose(several.jacobian(several.x0), one.jacobian(one.x0), atol=1e-9)


@pytest.mark.parametrize("events", [
    [gf.BranchTrip(COUPLER, 0.1)],
    [gf.BranchTrip(COUPLER, 0.1), gf.BranchReclose(COUPLER, 0.3)],
    [gf.BranchFault(COUPLER, 0.1, 0.1)],
    [gf.BusFault(20, 0.1, 0.1, trip_bus=True)],
])  # fmt: skip
def test_an_opened_coupler_splits_the_node_again(events):
    """As a coupler of a millionth does, which is an ordinary branch.

    There each half makes its own reactive power, here they share it: in the same parts.
    """
    beside = build_model(station(1e-6))
    parts = beside.power_flow.unit_power.imag.tolist()
    case = station()
    units = [replace(u, share=q) for u, q in zip(case.generators, parts, strict=True)]
    sound = gf.simulate(build_model(replace(case, generators=tuple(units))), events, 0.8)
    near = gf.simulate(beside, events, 0.8)
    np.testing.assert_allclose(sound.states, near.states, atol=1e-4)
    np.testing.assert_allclose(sound.bus_voltage(), near.bus_voltage(), atol=1e-4)
    assert np.ptp(np.abs(sound.bus_voltage()[:, 1] - sound.bus_voltage()[:, 2])) > 0.005


def test_a_coupler_closes_two_halves_into_one_node():
    case = station()
    opened = replace(case.branches[4], in_service=False)
    case = replace(case, branches=(*case.branches[:4], opened))
    run = gf.simulate(build_model(case), [gf.BranchReclose(COUPLER, 0.2)], 0.6)
    apart = np.abs(run.bus_voltage()[:, 1] - run.bus_voltage()[:, 2])
    assert apart[run.times < 0.2].min() > 0.01
    assert apart[run.times > 0.2].max() < 1e-12
