"""Dc lines in a run: both ends are loads of constant power or current, of either sign."""

from dataclasses import replace

import numpy as np
import pytest

import gridfold as gf
from gridfold.dynamics.model import build_model
from gridfold.grid.dc_lines import (
    DcControl,
    LineControl,
    ThyristorEnd,
    ThyristorLine,
    TransistorEnd,
    TransistorLine,
)
from gridfold.grid.network_state import NetworkState

LINE = ThyristorLine(
    "D", LineControl.POWER, 60.0, 5.0, 200.0,
    ThyristorEnd(2, 2, 20.0, 5.0, 0.0, 6.0, 230.0, 0.45, 1.02),
    ThyristorEnd(3, 2, 22.0, 15.0, 0.0, 5.0, 115.0, 0.9, 1.01),
)  # fmt: skip
AMPERES = replace(LINE, control=LineControl.CURRENT, setting=300.0)


def grid(line, *extra):
    """Machines at 1 and 3, a rectifier at 2, an inverter at 3, a load at each of them."""
    machine = {"inertia": 4.0, "transient_reactance": 0.2, "damping": 2.0}
    return gf.Case(
        "dc",
        tuple(gf.Bus(k, base_kv=kv) for k, kv in ((1, 230.0), (2, 230.0), (3, 115.0))),
        (
            gf.Branch(1, 2, reactance=0.1, susceptance=0.1),
            gf.Branch(1, 3, resistance=0.01, reactance=0.3),
            gf.Branch(1, 3, "2", resistance=0.01, reactance=0.3),
        ),
        (
            gf.Generator(1, voltage_pu=1.03, control=gf.Control.SLACK),
            gf.Generator(3, active_mw=30.0, voltage_pu=1.01),
        ),
        loads=(gf.Load(2, active_mw=20.0, reactive_mvar=5.0), gf.Load(3, active_mw=90.0), *extra),
        devices=tuple(gf.DeviceRecord("classical", k, "1", machine) for k in (1, 3)),
        dc_lines=() if line is None else (line,),
    )


def as_loads(line):
    """The same with the ends as loads at the solved operating point, and nothing else of the line."""
    flow = gf.solve_power_flow(grid(line))
    ends = []
    for bus, power in zip(line.buses, flow.dc_flows[0].power_mva, strict=True):
        if line.holds_current:
            part = power / abs(flow.voltage[flow.case.bus_index[bus]])
            ends.append(
                gf.Load(bus, "D", current_active_mw=part.real, current_reactive_mvar=part.imag)
            )
        else:
            ends.append(gf.Load(bus, "D", active_mw=power.real, reactive_mvar=power.imag))
    plain = tuple(
        replace(
            load,
            active_mw=0.0,
            reactive_mvar=0.0,
            impedance_active_mw=z.real,
            impedance_reactive_mvar=z.imag,
        )
        for load in grid(line).loads
        for z in [
            complex(load.active_mw, load.reactive_mvar)
            / abs(flow.voltage[flow.case.bus_index[load.bus]]) ** 2
        ]
    )
    return replace(grid(None), loads=(*plain, *ends))


EVENTS = {
    "fault at the rectifier": gf.BusFault(2, 0.1, 0.1),
    "fault at the inverter": gf.BusFault(3, 0.1, 0.08, 0.0, 0.1),
    "trip": gf.BranchTrip("1-3:2", 0.1),
}


@pytest.mark.parametrize("line", [LINE, AMPERES], ids=["power", "current"])
@pytest.mark.parametrize("what", EVENTS)
def test_a_run_is_that_with_loads_of_constant_power_or_current_at_the_ends(line, what):
    """The other loads are impedances; below 0.7 p.u. ends and loads are the same by one rule."""
    run = gf.simulate(build_model(grid(line)), [EVENTS[what]], 0.6)
    loads = gf.LoadModel.parse("raw")
    same = gf.simulate(build_model(as_loads(line), loads=loads), [EVENTS[what]], 0.6)
    np.testing.assert_allclose(run.states, same.states, atol=1e-8)
    np.testing.assert_allclose(run.bus_voltage(), same.bus_voltage(), atol=1e-8)


def drawn_at_2(run, row):
    """Power into bus 2 from the line of the ac network, less its load of constant impedance."""
    voltage, start = run.bus_voltage()[row], run.bus_voltage()[0]
    through = (voltage[0] - voltage[1]) / 0.1j - 0.05j * voltage[1]
    load = complex(0.2, 0.05) * abs(voltage[1]) ** 2 / abs(start[1]) ** 2
    return 100 * (voltage[1] * np.conj(through) - load)


@pytest.mark.parametrize(("line", "rises"), [(LINE, 0), (AMPERES, 1)], ids=["power", "current"])
def test_power_follows_the_voltage_as_it_says(line, rises):
    run = gf.simulate(build_model(grid(line)), [EVENTS["trip"]], 1.0)
    start = run.model.power_flow.dc_flows[0].power_mva[0]
    size = np.abs(run.bus_voltage()[:, 1])
    row = int(np.argmax(np.abs(size - size[0])))
    assert abs(size[row] - size[0]) > 1e-3
    assert drawn_at_2(run, row) == pytest.approx(start * (size[row] / size[0]) ** rises, rel=1e-6)


def test_below_the_break_voltage_an_end_is_an_impedance():
    run = gf.simulate(build_model(grid(LINE)), [gf.BusFault(2, 0.1, 0.1, 0.0, 0.05)], 0.3)
    start = run.model.power_flow.dc_flows[0].power_mva[0]
    row = int(np.searchsorted(run.times, 0.15))
    voltage = run.bus_voltage()[row]
    assert abs(voltage[1]) < 0.6
    fault = 100 * abs(voltage[1]) ** 2 * 1j / 0.05
    assert drawn_at_2(run, row) - fault == pytest.approx(
        start * (abs(voltage[1]) / 0.7) ** 2, rel=1e-6
    )


@pytest.mark.parametrize("line", [LINE, AMPERES], ids=["power", "current"])
def test_a_line_whose_end_is_de_energized_draws_nothing_at_the_other(line):
    """Bus 2 goes out with its branch; then the run goes on as if there were no line at all."""
    run = gf.simulate(build_model(grid(line)), [gf.BranchTrip("1-2", 0.2)], 0.5)
    last = run.bus_voltage()[-1]
    assert last[1] == 0
    after = run.model.for_state(NetworkState(branches_out=frozenset({0})))
    assert after.injections.nonlinear is not None
    assert not after.injections.nonlinear.power.any()
    assert abs(after.injections.load[1]) == pytest.approx(
        abs(complex(0.2, 0.05)) / abs(run.bus_voltage()[0][1]) ** 2, rel=1e-9
    )
    texts = [notice.text for notice in run.notices]
    assert 'dc line "D" carries nothing: an end is de-energized' in texts


def test_a_line_carries_its_power_again_when_its_end_comes_back():
    events = [gf.BranchTrip("1-2", 0.2), gf.BranchReclose("1-2", 0.3)]
    run = gf.simulate(build_model(grid(LINE)), events, 0.5)
    texts = [notice.text for notice in run.notices]
    assert 'dc line "D" carries its power again' in texts
    start = run.model.power_flow.dc_flows[0].power_mva[0]
    assert drawn_at_2(run, -1) == pytest.approx(start, rel=1e-6)


def test_a_voltage_source_line_is_held_with_the_reactive_power_of_its_voltage_control():
    line = TransistorLine(
        "V", True, 0.8,
        TransistorEnd(3, DcControl.VOLTAGE, 150.0),
        TransistorEnd(2, DcControl.POWER, 40.0, holds_voltage=True),
    )  # fmt: skip
    model = build_model(grid(line))
    assert model.residual < 1e-9
    run = gf.simulate(model, [EVENTS["trip"]], 0.5)
    start = model.power_flow.dc_flows[0].power_mva[1]
    assert start.imag != 0
    assert drawn_at_2(run, -1) == pytest.approx(start, rel=1e-6)


def test_small_signals_know_the_ends():
    """A Jacobian against differences: constant power at the ends is in the linear network."""
    model = build_model(grid(LINE))
    step = 1e-6
    numeric = np.array(
        [
            (model.compiled(model.x0 + step * e) - model.compiled(model.x0 - step * e)) / (2 * step)
            for e in np.eye(model.n_states)
        ]
    ).T
    np.testing.assert_allclose(model.jacobian(model.x0), numeric, atol=1e-5)
