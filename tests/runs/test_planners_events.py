"""Runs with the events of planners, against results that are known without a run."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from cases import X_LINE, X_MACHINE, H, one_machine_infinite_bus

import gridfold as gf
from gridfold.dynamics.network import LoadModel

F0 = 60.0


def one_machine_with_load(load_mw: float = 80.0, governor: bool = False) -> gf.Case:
    """A classical machine at bus 1 feeds a load at bus 2 through a lossless line, alone."""
    devices = [
        gf.DeviceRecord(
            "classical", 1, "1", {"inertia": H, "damping": 0.0, "transient_reactance": X_MACHINE}
        )
    ]
    if governor:
        values = {
            "droop": 0.05, "valve_time": 0.2, "highest_valve": 2.0, "lowest_valve": 0.0,
            "reheater_lead_time": 1.0, "reheater_time": 2.0, "turbine_damping": 0.0,
        }  # fmt: skip
        devices.append(gf.DeviceRecord("tgov1", 1, "1", values))
    return gf.Case(
        name="alone",
        buses=(gf.Bus(1), gf.Bus(2)),
        branches=(gf.Branch(1, 2, reactance=X_LINE),),
        generators=(gf.Generator(1, active_mw=load_mw, control=gf.Control.SLACK),),
        loads=(gf.Load(2, active_mw=load_mw),),
        devices=tuple(devices),
    )


@pytest.fixture(scope="module")
def alone() -> gf.DetailedModel:
    return gf.build_model(one_machine_with_load())


def texts(run: gf.Trajectory) -> list[str]:
    return [notice.text for notice in run.notices]


def test_shedding_a_share_of_an_impedance_leaves_the_rest_of_its_admittance(alone):
    run = gf.simulate(alone, [gf.LoadShed(0.25, buses="2", time=0.5)], 0.6, criterion=None)
    voltage = run.bus_voltage([2])[:, 0]
    drawn = np.abs(voltage) ** 2 * 0.8 / abs(voltage[0]) ** 2
    given = run.signal("active_power", ["1:1"])[:, 0]
    after = run.times >= 0.5
    np.testing.assert_allclose(given[~after], drawn[~after], rtol=1e-9)
    np.testing.assert_allclose(given[after], 0.75 * drawn[after], rtol=1e-9)
    assert texts(run) == ["25 % of the load at buses 2 shed, 20.0 MW"]


@pytest.mark.parametrize("loads", ["1,0,0", "0,1,0", "0.3,0.3,0.4"])
def test_what_is_left_of_a_load_depends_on_voltage_as_before(loads):
    model = gf.build_model(one_machine_with_load(), loads=LoadModel.parse(loads))
    run = gf.simulate(model, [gf.LoadShed(0.25, buses="2", time=0.5)], 0.6, criterion=None)
    size = np.abs(run.bus_voltage([2])[:, 0])
    size /= size[0]
    power, current, impedance = LoadModel.parse(loads).shares or ()
    drawn = 0.8 * (power + current * size + impedance * size**2)
    left = np.where(run.times >= 0.5, 0.75, 1.0)
    given = run.signal("active_power", ["1:1"])[:, 0]
    np.testing.assert_allclose(given, left * drawn, rtol=1e-9)


def test_a_shunt_adds_its_susceptance_and_a_fixed_one_goes_out_and_comes_back():
    fixed = gf.Shunt(2, susceptance_mvar=30.0)
    model = gf.build_model(replace(one_machine_with_load(), shunts=(fixed,)))
    events = [
        gf.ShuntTrip(2, time=0.1), gf.ShuntStep(2, 30.0, time=0.2), gf.ShuntClose(2, time=0.3),
        gf.ShuntStep(2, -30.0, time=0.4),
    ]  # fmt: skip
    run = gf.simulate(model, events, 0.5, criterion=None)
    rows = [np.searchsorted(run.times, time - 1e-9) for time in (0.0, 0.1, 0.2, 0.3, 0.4)]
    size = np.abs(run.bus_voltage([2])[rows, 0])
    load = 0.8 / size[0] ** 2
    # Behind X'd and the line: V = E / (1 + jX (G + jB)).
    seen = [
        1 / abs(1 + 1j * (X_MACHINE + X_LINE) * (load + 1j * b)) for b in (0.3, 0.0, 0.3, 0.6, 0.3)
    ]
    np.testing.assert_allclose(size / size[0], np.array(seen) / seen[0], rtol=1e-9)


def test_a_line_with_an_open_end_is_fed_from_the_other_one_with_its_charging():
    """The machine then feeds nothing but the charging of the line: V = E / (1 + j X'd Y)."""
    case = one_machine_infinite_bus()
    charged = gf.Branch(1, 2, "2", reactance=X_LINE, susceptance=0.2)
    model = gf.build_model(replace(case, branches=(*case.branches, charged)))
    trip = gf.BranchTrip("1-2:1", time=0.1)
    run = gf.simulate(model, [trip, gf.BranchOpenEnd("1-2:2", 2, time=0.1)], 0.2, criterion=None)
    far = run.times >= 0.1
    admittance = 0.1j + 1 / (1j * X_LINE + 1 / 0.1j)
    current = run.signal("active_power", ["1:1"])[far, 0]
    np.testing.assert_allclose(current, 0.0, atol=1e-12)
    block = next(b for b in model.layout.blocks if b.device.model == "classical")
    internal = block.parameters[block.device.parameter_rows.index("internal_voltage"), 0]
    size = np.abs(run.bus_voltage([1])[far, 0])
    np.testing.assert_allclose(size, internal / abs(1 + 1j * X_MACHINE * admittance), rtol=1e-9)
    assert "runs on as an island of its own" in texts(run)[-1]


def test_clearing_one_end_after_the_other_feeds_the_fault_through_the_rest_of_the_line():
    """After the near end opens, the machine feeds the fault through the other part of the line."""
    case = one_machine_infinite_bus()
    model = gf.build_model(
        replace(case, branches=(*case.branches, replace(case.branches[0], circuit="2")))
    )
    fault = gf.BranchFault("2-1:2", 0.1, 0.1, fraction=0.25, far_duration=0.3)
    run = gf.simulate(model, [fault], 0.6, criterion=None)
    half = (run.times >= 0.2) & (run.times < 0.4)
    assert texts(run) == [
        "fault on branch 2-1:2", "branch 2-1:2 opened at bus 2", "branch 2-1:2 tripped",
    ]  # fmt: skip
    stage = run.models[2]
    admittance = stage.equations.matrix.toarray()
    series, fed = 1 / (1j * X_LINE), 1 / (0.75j * X_LINE)
    assert admittance[0, 0] == pytest.approx(series + fed + 1 / (1j * X_MACHINE))
    assert admittance[0, 1] == pytest.approx(-series)
    assert (np.abs(run.bus_voltage([1])[half, 0]) < 0.9).all()


def test_a_step_of_the_power_reference_settles_where_the_droop_has_it(alone):
    """Alone with an impedance load: P = Pref - dw / R, and P does not change with the speed."""
    model = gf.build_model(one_machine_with_load(governor=True))
    step = gf.SetParameter(1, "power_reference", change=0.02, time=1.0)
    run = gf.simulate(model, [step], 60.0, criterion=None)
    assert run.signal("speed", ["1:1"])[-1, 0] - 1 == pytest.approx(0.05 * 0.02, abs=1e-7)


@pytest.mark.parametrize("given", [{"value": 1.002}, {"change": 0.002}])
def test_a_step_of_the_speed_reference_is_where_the_speed_settles(given):
    """With a load that takes the same power at any speed it is the speed itself."""
    model = gf.build_model(one_machine_with_load(governor=True))
    step = gf.SetParameter(1, "speed_reference", time=1.0, **given)
    run = gf.simulate(model, [step], 60.0, criterion=None)
    assert run.signal("speed", ["1:1"])[-1, 0] - 1 == pytest.approx(0.002, abs=1e-7)


def test_a_parameter_on_another_base_is_given_as_in_files():
    """Half the inertia halves the swing's period squared: the machine's base is 50 MVA here."""
    model = gf.build_model(one_machine_infinite_bus(base_mva=50.0))
    halved = gf.SetParameter(1, "inertia", value=H, time=0.0)  # on 50 MVA it was 2 H
    expected = gf.build_model(one_machine_infinite_bus(base_mva=100.0))
    kick = gf.BusFault(2, 0.1, 0.05)
    run = gf.simulate(model, [halved, kick], 1.0)
    same = replace(
        expected.case,
        devices=(
            replace(
                expected.case.devices[0],
                parameters={**expected.case.devices[0].parameters, "inertia": H / 2},
            ),
            expected.case.devices[1],
        ),
    )
    reference = gf.simulate(gf.build_model(same), [kick], 1.0)
    np.testing.assert_allclose(run.rotor_angle_deg(), reference.rotor_angle_deg(), rtol=1e-12)


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        (
            gf.SetParameter(1, "intertia", 3.0),
            "no device of the unit has it; known: classical: inertia",
        ),
        (gf.SetParameter(1, "inertia", -1.0), "it must be positive, not -1"),
        (gf.SetParameter(1, "inertia", change=-H), "it must be positive, not 0"),
        (gf.SetParameter(1, "speed_reference", 1.0), "no device of the unit has it"),
        (gf.SetParameter(1, "h", 4.0), "h of unit 1:1: it is called inertia here"),
        (
            gf.SetParameter(1, "highest_valve", -1.0),
            "lowest_valve VMIN is above highest_valve VMAX",
        ),
    ],
)
def test_a_parameter_that_cannot_be_set_is_an_error_before_anything_runs(setting, message):
    governed = setting.parameter == "highest_valve"
    case = one_machine_with_load(governor=True) if governed else one_machine_with_load()
    with pytest.raises(gf.EventError, match=message):
        gf.simulate(gf.build_model(case), [replace(setting, time=0.5)], 1.0)


def test_a_redispatched_run_is_that_of_the_case_with_other_powers(npcc):
    """Flat before the fault, and the same as the case with the powers changed by hand."""
    events = [gf.Redispatch(60.0, areas="1"), gf.Redispatch(-60.0, areas="2")]
    fault = gf.BusFault(3, 1.0, 0.05)
    run = gf.simulate(npcc, [*events, fault], 2.0)
    dispatch = dict(run.models[0].state.dispatch)
    areas = {bus.number: bus.area for bus in npcc.case.buses}
    moved = {a: sum(p for u, p in dispatch.items() if areas[u.bus] == a) for a in (1, 2)}
    assert moved == pytest.approx({1: 60.0, 2: -60.0})
    generators = tuple(
        replace(g, active_mw=g.active_mw + dispatch.get(g.key, 0.0)) for g in npcc.case.generators
    )
    by_hand = gf.simulate(gf.build_model(replace(npcc.case, generators=generators)), [fault], 2.0)
    np.testing.assert_allclose(run.states, by_hand.states, atol=1e-9)
    before = run.times < 1.0
    assert np.ptp(run.rotor_angle_deg()[before], axis=0).max() < 1e-6


def test_a_fault_at_the_start_of_a_redispatched_run_acts_on_the_new_equilibrium(npcc):
    events = [gf.BusFault(3, 0.0, 0.05), gf.Redispatch(60.0, areas="1")]
    run = gf.simulate(npcc, events, 0.1)
    assert run.models[0].state.faulted
    assert not np.allclose(run.states[0], npcc.x0, atol=1e-3)
    np.testing.assert_allclose(run.states[0], run.models[0].x0, atol=0)
