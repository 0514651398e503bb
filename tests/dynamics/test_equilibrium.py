from __future__ import annotations

import numpy as np
import pytest
from cases import one_machine_infinite_bus
from device_alone import machine_with

import gridfold as gf
from gridfold.dynamics import equilibrium
from gridfold.dynamics.equilibrium import Equilibrium, find_equilibrium
from gridfold.dynamics.exciters.esst4b import DYR_COLUMNS as ESST4B_COLUMNS
from gridfold.dynamics.governors.ieeeg1 import DYR_COLUMNS as IEEEG1_COLUMNS
from gridfold.errors import InitializationError
from gridfold.grid.timeline import build_timeline

#: A regulator of integral and proportional part; its inner loop passes the output on up to a ceiling.
ESST4B = (0.0, 3.0, 3.0, 1.0, -1.0, 0.0, 1.0, 0.0, 1.0, -1.0, 0.0, 6.0, 0.0, 9.0, 0.1, 0.0, 0.0)

#: A governor with a gate of 20 ms that opens and closes by 0.1 p.u. in a second at most.
IEEEG1 = (0, 0, 20, 0, 0, 0.02, 0.1, -0.1, 1, 0, 0, 0.3, 0, 8.3, 0.7, 0, 0, 0, 0, 0, 0, 0)


def after(model, *events):
    """The model in the network state to which events at t = 0 lead."""
    return model.for_state(build_timeline(model.case, list(events), 1.0)[-1].state)


def residual(model, point: Equilibrium) -> float:
    turning = np.zeros(model.n_states)
    units = tuple(unit for unit in model.machines if unit not in model.state.units_out)
    turning[model.slots("rotor_angle", units)] = point.rate
    return float(np.abs(model.compiled(point.x) - turning).max())


def droop_rate(model, lost_pu: float) -> float:
    """Rate in rad/s at which droop and damping of all machines make up for `lost_pu` of power."""
    block = model.layout.blocks
    rows = {}
    for b in block:
        rows |= dict(zip(b.device.parameter_rows, b.parameters, strict=True))
    stiffness = (1 / rows["droop"]).sum() + rows["damping"].sum()
    return -120 * np.pi * lost_pu / stiffness


def test_the_intact_network_has_the_equilibrium_of_its_power_flow(npcc):
    point = find_equilibrium(npcc, npcc.x0)
    np.testing.assert_array_equal(point.x, npcc.x0)
    assert point.rate == 0.0


@pytest.mark.parametrize(
    "events",
    [
        [gf.BranchTrip("3-2")],
        [gf.BranchTrip("29-37")],
        [gf.LoadStep(3, active_mw=300.0)],
        [gf.MachineTrip(23, "2")],
        [gf.MachineTrip(78)],
    ],
    ids=str,
)
def test_all_derivatives_vanish_but_for_the_common_rate(npcc, events):
    model = after(npcc, *events)
    assert np.abs(model.compiled(npcc.x0)).max() > 1e-4
    point = find_equilibrium(model, npcc.x0)
    assert residual(model, point) < 1e-8
    speeds = point.x[model.slots("speed", model.machines)]
    live = [unit not in model.state.units_out for unit in model.machines]
    np.testing.assert_allclose(speeds[live], 1 + point.rate / (120 * np.pi), atol=1e-10)


def test_the_weighted_mean_of_the_angles_stays_that_of_the_guess(npcc):
    model = after(npcc, gf.BranchTrip("29-37"))
    point = find_equilibrium(model, npcc.x0 + 0.01)
    slots, inertia = model.slots("rotor_angle", model.machines), model.inertia(model.machines)
    moved = point.x[slots] - npcc.x0[slots] - 0.01
    assert np.abs(moved).max() > 1e-3
    assert abs(inertia @ moved) / inertia.sum() < 1e-12


@pytest.mark.parametrize("load_mw", [-200.0, 100.0, 300.0])
def test_after_a_load_step_the_rate_is_that_of_droop_and_damping(npcc, load_mw):
    model = after(npcc, gf.LoadStep(3, active_mw=load_mw))
    expected = droop_rate(npcc, load_mw / 100)
    assert find_equilibrium(model, npcc.x0).rate == pytest.approx(expected, rel=0.25)


def test_a_simulated_load_step_settles_at_the_equilibrium(npcc):
    events = [gf.LoadStep(3, active_mw=300.0)]
    model = after(npcc, *events)
    point = find_equilibrium(model, npcc.x0)
    run = gf.simulate(npcc, events, t_end=120.0)
    last = run.states[-1].copy()
    slots = model.slots("rotor_angle", model.machines)
    last[slots] -= last[slots][0] - point.x[slots][0]
    assert np.abs(last - point.x).max() < 1e-6


def test_states_of_a_tripped_machine_stay_as_they_are(npcc):
    model = after(npcc, gf.MachineTrip(23, "2"))
    point = find_equilibrium(model, npcc.x0)
    frozen = [k for k, name in enumerate(model.state_names) if name.endswith(":23:2")]
    np.testing.assert_array_equal(point.x[frozen], npcc.x0[frozen])


def test_islands_have_no_common_equilibrium(npcc):
    model = after(npcc, gf.BranchTrip("29-37"), gf.BranchTrip("35-73"))
    with pytest.raises(InitializationError, match="no equilibrium"):
        find_equilibrium(model, npcc.x0)


def test_an_infinite_bus_holds_the_frequency_and_the_angles_move_instead():
    model = gf.build_model(one_machine_infinite_bus(1.0))
    loaded = after(model, gf.LoadStep(1, active_mw=30.0))
    guess = model.x0.copy()
    guess[model.slots("rotor_angle", model.machines)] += 0.1
    point = find_equilibrium(loaded, guess)
    assert point.rate == 0.0
    assert np.abs(loaded.compiled(point.x)).max() < 1e-8
    assert np.abs(point.x - model.x0).max() > 0.01


def test_a_machine_cut_off_from_the_infinite_bus_has_no_equilibrium():
    model = gf.build_model(one_machine_infinite_bus(1.0))
    with pytest.raises(InitializationError, match="no equilibrium"):
        find_equilibrium(after(model, gf.BranchTrip("1-2")), model.x0)


def test_an_integrator_whose_output_is_cut_off_drifts_to_its_limit():
    exciter = dict(zip(ESST4B_COLUMNS, ESST4B, strict=True))
    start = gf.build_model(machine_with({"esst4b": exciter}))
    inner = start.x0[start.state_names.index("regulator_integral:1:1")]
    ceiling = exciter | {"inner_maximum": float(inner) + 0.01}
    model = gf.build_model(machine_with({"esst4b": ceiling}))
    step = gf.LoadStep(1, active_mw=0.0, reactive_mvar=8.0)
    point = find_equilibrium(after(model, step), model.x0)
    assert residual(after(model, step), point) < 1e-8
    settled = gf.simulate(model, [step], 300.0).states[-1]
    free = [k for k, name in enumerate(model.state_names) if name != "regulator_integral:1:1"]
    np.testing.assert_allclose(point.x[free], settled[free], atol=1e-4)
    regulator = model.state_names.index("regulator_voltage:1:1")
    assert point.x[regulator] == pytest.approx(exciter["regulator_maximum"])


def test_a_state_whose_rate_is_limited_moves_the_way_its_rate_points():
    """A gate that has to open by 0.2 p.u., at 0.1 p.u. in a second at most."""
    named = zip(IEEEG1_COLUMNS, IEEEG1, strict=True)
    governor = {name: float(value) for name, value in named if name is not None}
    model = gf.build_model(machine_with({"ieeeg1": governor}))
    guess = model.x0.copy()
    guess[model.state_names.index("gate:1:1")] -= 0.2
    np.testing.assert_allclose(find_equilibrium(model, guess).x, model.x0, atol=1e-6)


def test_the_implicit_euler_rule_leads_to_the_equilibrium_of_newtons_method(npcc, monkeypatch):
    tripped = after(npcc, gf.BranchTrip("3-2"))
    expected = find_equilibrium(tripped, npcc.x0)
    monkeypatch.setattr(equilibrium, "_NEWTON_STEPS", 0)
    point = find_equilibrium(tripped, npcc.x0)
    np.testing.assert_allclose(point.x, expected.x, atol=1e-6)
    assert point.rate == pytest.approx(expected.rate, abs=1e-8)


def test_a_short_step_that_moves_hardly_anything_is_no_equilibrium(npcc, monkeypatch):
    monkeypatch.setattr(equilibrium, "_NEWTON_STEPS", 0)
    off = np.zeros(npcc.n_states)
    off[npcc.slots("field_voltage", npcc.machines[:1])] = 1.0
    off *= 3e-8 / np.abs(npcc.compiled(npcc.x0 + 1e-6 * off)).max() * 1e-6
    assert 1e-8 < np.abs(npcc.compiled(npcc.x0 + off)).max() < 5e-8
    assert residual(npcc, find_equilibrium(npcc, npcc.x0 + off)) < 1e-8
