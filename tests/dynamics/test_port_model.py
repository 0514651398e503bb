from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from row_of_areas import row_of_areas

import gridfold as gf
from gridfold.equivalents.families import Mode
from gridfold.equivalents.folded import fold
from gridfold.grid.timeline import build_timeline
from gridfold.partition import partition
from gridfold.reduction import BalancedTruncation, Unreduced
from gridfold.simulation import Segment, run_segments

MIXED = gf.LoadModel((0.3, 0.3, 0.4))
NEAR_BOUNDARY = (42, 50, 51, 78, 134)
MODELS = ("npcc", "npcc_sparse", "mixed", "row", "bus", "mixed_bus")
TURNING = MODELS[:4]


@pytest.fixture(scope="module")
def mixed():
    return gf.build_model(gf.load_case("npcc"), loads=MIXED)


@pytest.fixture(scope="module")
def row():
    return gf.build_model(row_of_areas(), loads=MIXED)


def row_with_infinite_bus(loads):
    case = row_of_areas()
    devices = tuple(device for device in case.devices if device.bus != 32)
    source = gf.DeviceRecord("infinite_bus", 32, "1", {"reactance": 0.05})
    return gf.build_model(replace(case, devices=(*devices, source)), loads=loads)


@pytest.fixture(scope="module")
def bus():
    """A grid with an infinite bus among the linear units, which has no states."""
    return row_with_infinite_bus(None)


@pytest.fixture(scope="module")
def mixed_bus():
    return row_with_infinite_bus(MIXED)


def study_of(model):
    return range(11, 16) if model.case.name == "row" else range(1, 37)


def folded(model, linear=None, reducer=None):
    """The area with the machines at the buses `linear` linear, all external ones by default."""
    parts = partition(model, study_of(model))
    retained = [u for u in parts.external_units if linear is not None and u.bus not in linear]
    return fold(parts, retained, Unreduced() if reducer is None else reducer)


def some_linear(model):
    """Machines of which one stands at a port, and some are hidden."""
    return (31, 32) if model.case.name == "row" else (78, 115, 123)


def state_off(model, spread=0.05, seed=5):
    return model.x0 + spread * np.random.default_rng(seed).standard_normal(model.n_states)


def difference_jacobian(rhs, point, h=1e-4):
    columns = []
    for k in range(len(point)):
        step = np.zeros(len(point))
        step[k] = h
        near = rhs(point + step) - rhs(point - step)
        far = rhs(point + 2 * step) - rhs(point - 2 * step)
        columns.append((8 * near - far) / (12 * h))
    return np.array(columns).T


@pytest.mark.parametrize("name", MODELS)
def test_the_equilibrium_is_at_rest(request, name):
    model = request.getfixturevalue(name)
    for linear in (some_linear(model), None):
        built = folded(model, linear).build(Mode.LINEAR, model).system
        v = built.restrict(model.x0)
        assert np.abs(built.lift(v) - model.x0).max() < 1e-12
        assert np.abs(built.compiled(v)).max() < 1e-8


@pytest.mark.parametrize("name", MODELS)
def test_the_jacobian_is_the_whole_one_in_other_coordinates(request, name):
    model = request.getfixturevalue(name)
    built = folded(model, some_linear(model)).build(Mode.RETAINED, model).system
    v = built.restrict(model.x0)
    lift = (built.lift(np.eye(len(v))) - built.lift(np.zeros(len(v)))).T
    moved = model.jacobian(model.x0) @ lift
    expected = np.array([built.restrict(model.x0 + column) - v for column in moved.T]).T
    found = difference_jacobian(built.compiled, v)
    assert np.abs(found - expected).max() < 1e-6 * np.abs(expected).max()


@pytest.mark.parametrize("name", MODELS)
def test_derivatives_are_those_of_the_detailed_model_to_second_order(request, name):
    model = request.getfixturevalue(name)
    built = folded(model, some_linear(model)).build(Mode.RETAINED, model).system
    off = state_off(model, 1.0) - model.x0

    def error(size):
        x = model.x0 + size * off
        dv = built.compiled(built.restrict(x))
        dx = built.lift(dv) - built.lift(np.zeros(len(dv)))
        return np.abs(dx - model.compiled(x)).max()

    assert error(1e-3) / error(5e-4) == pytest.approx(4.0, rel=0.1)
    assert error(1e-3) < 1e-2 * np.abs(model.compiled(model.x0 + 1e-3 * off)).max()


@pytest.mark.parametrize("name", TURNING)
@pytest.mark.parametrize(
    "reducer", [Unreduced(), BalancedTruncation(2e-3)], ids=["full", "reduced"]
)
def test_a_common_turn_of_all_angles_changes_no_derivative(request, name, reducer):
    model = request.getfixturevalue(name)
    built = folded(model, reducer=reducer).build(Mode.LINEAR, model).system
    angles = model.slots("rotor_angle", model.machines)
    x = state_off(model, 0.02)
    expected = built.compiled(built.restrict(x))
    for turn in (0.5, 3.0, -4.0, 40.0):
        turned = x.copy()
        turned[angles] += turn
        found = built.compiled(built.restrict(turned))
        np.testing.assert_allclose(found, expected, atol=1e-7 * np.abs(expected).max())


@pytest.mark.parametrize("name", ["npcc", "npcc_sparse"])
def test_exact_units_see_the_network_of_the_detailed_model(request, name):
    """Where the linear machines rest and only exact ones are off, exact derivatives are exact."""
    model = request.getfixturevalue(name)
    built = folded(model, some_linear(model)).build(Mode.RETAINED, model).system
    x = state_off(model, 0.1)
    x[built.area_index] = model.x0[built.area_index]
    found = built.compiled(built.restrict(x))[: len(built.exact_index)]
    expected = model.compiled(x)[built.exact_index]
    np.testing.assert_allclose(found, expected, atol=1e-9 * np.abs(expected).max())


def angle_error_deg(model, small, start, t_end=5.0):
    """Largest difference of a rotor angle between the detailed and a small model."""
    stepper = gf.RungeKutta4()
    exact = run_segments([Segment(model, t_end)], start, stepper).pieces[0].full_states
    built = Segment(small.system, t_end, coordinates=small.coordinates)
    found = run_segments([built], start, stepper).pieces[0].full_states
    slots = model.slots("rotor_angle", model.machines)
    return float(np.rad2deg(np.abs(found - exact)[:, slots]).max())


@pytest.mark.parametrize("name", ["npcc", "mixed"])
@pytest.mark.parametrize("linear", [None, (78, 115, 123)], ids=["all", "some"])
def test_small_swings_are_those_of_the_detailed_model_to_second_order(request, name, linear):
    model = request.getfixturevalue(name)
    small = folded(model, linear).build(Mode.LINEAR, model)
    off = np.zeros(model.n_states)
    off[model.slots("rotor_angle", model.machines)] = np.random.default_rng(3).standard_normal(48)
    large, half = (angle_error_deg(model, small, model.x0 + s * off) for s in (2e-3, 1e-3))
    assert 3.0 < large / half < 5.0
    assert angle_error_deg(model, small, model.x0 + 1e-5 * off) < 1e-6


@pytest.mark.parametrize("name", ["npcc", "mixed"])
def test_a_large_turn_and_a_tiny_swing_are_followed_too(request, name):
    model = request.getfixturevalue(name)
    small = folded(model).build(Mode.LINEAR, model)
    start = model.x0.copy()
    start[model.slots("rotor_angle", model.machines)] += 7.0
    start[model.slots("rotor_angle", model.machines[:3])] += 1e-5
    assert angle_error_deg(model, small, start) < 1e-6


def test_rows_are_lifted_without_the_others(npcc):
    built = folded(npcc, reducer=BalancedTruncation(2e-3)).build(Mode.LINEAR, npcc).system
    states = np.random.default_rng(1).standard_normal((4, len(built.state_names)))
    index = np.random.default_rng(2).permutation(npcc.n_states)[:50]
    np.testing.assert_allclose(built.lift_rows(states, index), built.lift(states)[:, index])


@pytest.mark.parametrize("name", ["npcc", "mixed"])
def test_a_machine_that_is_out_stands_still_while_the_others_turn(request, name):
    intact = request.getfixturevalue(name)
    trip = build_timeline(intact.case, [gf.MachineTrip(23, "1")], 1.0)[-1].state
    model = intact.for_state(trip)
    built = folded(intact).build(Mode.LINEAR, model).system
    still = np.array([name.endswith(":23:1") for name in built.state_names])
    x = state_off(model, 0.02)
    derivative = built.compiled(built.restrict(x))
    assert still.sum() == 9
    assert not derivative[still].any()
    assert derivative[~still].all()
    live = tuple(unit for unit in model.machines if unit not in model.state.units_out)
    x[model.slots("rotor_angle", live)] += 2.0
    turned = built.compiled(built.restrict(x))
    np.testing.assert_allclose(turned, derivative, atol=1e-7 * np.abs(derivative).max())
