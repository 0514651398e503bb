from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from area_cases import Unreduced, boundary_voltages
from row_of_areas import row_of_areas
from scipy.linalg import expm

import gridfold as gf
from gridfold.dynamics.equilibrium import find_equilibrium
from gridfold.dynamics.registry import DEVICES
from gridfold.equivalents.families import ReducedExternal, reduce_external, whole_system
from gridfold.grid.timeline import build_timeline
from gridfold.partition import Partition, partition
from gridfold.reduction import BalancedTruncation
from gridfold.simulation import Segment, run_segments

KEPT = 1.0


@pytest.fixture(scope="module")
def parts(npcc) -> Partition:
    return partition(npcc, range(1, 37))


@pytest.fixture(scope="module")
def unreduced(parts) -> ReducedExternal:
    return reduce_external(parts, Unreduced())


@pytest.fixture(scope="module")
def reduced(parts) -> ReducedExternal:
    return reduce_external(parts, BalancedTruncation(order=60))


@pytest.fixture(scope="module")
def everything_kept(parts) -> ReducedExternal:
    return reduce_external(parts, Unreduced(), column_norm=0.0)


def states_off(model, spread=0.05, count=3):
    generator = np.random.default_rng(5)
    return [model.x0 + spread * generator.standard_normal(model.n_states) for _ in range(count)]


def detailed_angles(model, events, t_end=16.0):
    return gf.simulate(model, events, t_end, criterion=None)


def largest_angle_error_deg(model, run, detailed):
    states = np.concatenate(
        [p.full_states[: None if p is run.pieces[-1] else -1] for p in run.pieces]
    )
    slots = model.slots("rotor_angle", model.machines)
    return np.rad2deg(np.abs(states[:, slots] - detailed.states[:, slots]).max())


def run_small(model, build, events, t_end=16.0):
    """A run of which every stage, the fault too, is simulated with the model that `build` gives."""
    stages = build_timeline(model.case, events, t_end)
    ends = [*(stage.start for stage in stages[1:]), t_end]
    segments = []
    for stage, end in zip(stages, ends, strict=True):
        small = build(model.for_state(stage.state))
        segments.append(Segment(small.system, end, coordinates=small.coordinates))
    return run_segments(segments, model.x0, gf.RungeKutta4(0.01))


@pytest.mark.parametrize("mode", ["linear", "hybrid"])
@pytest.mark.parametrize("family", ["unreduced", "reduced", "whole"])
def test_the_equilibrium_is_at_rest(npcc, parts, unreduced, reduced, family, mode):
    models = {"unreduced": unreduced, "reduced": reduced, "whole": whole_system(parts)}
    small = getattr(models[family], mode)(npcc)
    v = small.coordinates.restrict(npcc.x0)
    assert np.abs(small.coordinates.lift(v) - npcc.x0).max() < 1e-10
    lifted = small.coordinates.lift(v + small.system.compiled(v)) - small.coordinates.lift(v)
    assert np.abs(lifted).max() < 1e-8


@pytest.mark.parametrize("kept", ["none", "some", "all"])
@pytest.mark.parametrize("family", ["unreduced", "reduced"])
def test_derivatives_are_those_of_equation_14_written_out(npcc, parts, request, family, kept):
    models = request.getfixturevalue(family)
    units = {"none": (), "some": models.kept, "all": parts.external_units}[kept]
    small = replace(models, kept=units).hybrid(npcc)
    external = np.array(parts.states_of(parts.external_units))
    inside = np.array(parts.states_of(parts.study_units))
    full, reduction = models.area.full, models.reduction
    rows = np.isin(external, parts.states_of(units))
    for x in states_off(npcc):
        v = small.coordinates.restrict(x)
        x = small.coordinates.lift(v)
        boundary = boundary_voltages(parts, npcc, x)
        du = np.concatenate([np.angle(boundary), np.abs(boundary)]) - models.area.input_reference
        detailed = npcc.compiled(x)
        z = reduction.state_map.restrict(x[external])
        linear_rows = full.a @ (x[external] - npcc.x0[external]) + full.b @ du
        dz = reduction.system.a @ z + reduction.system.b @ du
        correction = (detailed[external] - linear_rows)[rows]
        dz = dz + reduction.state_map.restrict_matrix[:, rows] @ correction
        expected = reduction.state_map.lift_matrix @ dz
        dv = small.system.compiled(v)
        dx = small.coordinates.lift(v + dv) - small.coordinates.lift(v)
        scale = np.abs(npcc.compiled(x)).max()
        np.testing.assert_allclose(dx[inside], detailed[inside], atol=1e-9 * scale)
        np.testing.assert_allclose(dx[external], expected, atol=1e-8 * scale)


def test_a_turn_of_the_whole_system_by_any_angle_turns_the_reduced_one_alike(npcc, unreduced):
    angles = npcc.slots("rotor_angle", npcc.machines)
    small = unreduced.hybrid(npcc)
    for turn in (0.7, 3.0, -4.0, 40.0, 1000.0):
        for x in states_off(npcc, 0.02):
            turned = x.copy()
            turned[angles] += turn
            before, after = (small.coordinates.restrict(state) for state in (x, turned))
            dx = small.coordinates.lift(small.system.compiled(before)) - unreduced_origin(small)
            dy = small.coordinates.lift(small.system.compiled(after)) - unreduced_origin(small)
            assert np.abs(dx - dy).max() < 1e-8 * max(1.0, abs(turn)) * np.abs(dx).max()


def unreduced_origin(small):
    return small.coordinates.lift(np.zeros(small.system.n_states))


@pytest.mark.parametrize(("bus", "duration"), [(3, 0.39), (23, 0.2)])
def test_with_all_machines_kept_and_nothing_reduced_a_run_equals_the_detailed_one(
    npcc, everything_kept, bus, duration
):
    events = [gf.BusFault(bus, duration=duration)]
    run = run_small(npcc, everything_kept.hybrid, events)
    assert largest_angle_error_deg(npcc, run, detailed_angles(npcc, events)) < 1e-7


def test_with_all_machines_kept_it_equals_the_detailed_one_for_another_study_area(npcc):
    events = [gf.BusFault(100, duration=0.05)]
    other = partition(npcc, [*range(1, 37), 78, 133, 134])
    everything = reduce_external(other, Unreduced(), column_norm=0.0)
    run = run_small(npcc, everything.hybrid, events, 4.0)
    assert largest_angle_error_deg(npcc, run, detailed_angles(npcc, events, 4.0)) < 1e-7


def test_the_sparse_network_gives_the_same_derivatives(npcc, npcc_sparse, reduced):
    small, sparse = reduced.hybrid(npcc), reduced.hybrid(npcc_sparse)
    for x in states_off(npcc):
        v = small.coordinates.restrict(x)
        expected = small.system.compiled(v)
        np.testing.assert_allclose(
            sparse.system.compiled(v), expected, atol=1e-9 * np.abs(expected).max()
        )


def test_hybrid_with_none_kept_is_the_linear_model(npcc, reduced):
    linear, hybrid = reduced.linear(npcc), replace(reduced, kept=()).hybrid(npcc)
    for x in states_off(npcc):
        v = linear.coordinates.restrict(x)
        np.testing.assert_allclose(hybrid.system.compiled(v), linear.system.compiled(v), rtol=1e-12)


def test_functions_that_are_linear_anyway_are_not_counted_as_kept(npcc, reduced):
    """Always nonlinear: speed, regulator, exciter; a transient voltage if its reactances differ."""
    machines = {r.key: r.parameters for r in npcc.case.devices if r.model == "two_axis"}
    differ = [
        machines[unit][f"{axis}_reactance"] != machines[unit][f"{axis}_transient_reactance"]
        for unit in reduced.kept
        for axis in ("d", "q")
    ]
    assert 0 < sum(differ) < len(differ)
    assert reduced.linear(npcc).nonlinear_functions == 0
    assert reduced.hybrid(npcc).nonlinear_functions == 3 * len(reduced.kept) + sum(differ)


def test_functions_that_are_nonlinear_far_from_the_start_only_are_kept():
    """Regulators whose device declares no limits, which a fault takes from 2 to 4 p.u."""
    models = {**DEVICES} | {
        name: replace(DEVICES[name], limits=(), replaces_built_in=True)
        for name in ("exdc2", "tgov1")
    }
    case = row_of_areas(regulator_maximum=4.0)
    model = gf.build_model(case, devices=models)
    parts = partition(model, [bus.number for bus in case.buses if bus.area == 1])
    events = [gf.BusFault(25, duration=0.1)]
    everything = reduce_external(parts, Unreduced(), column_norm=0.0)
    run = run_small(model, everything.hybrid, events, 3.0)
    detailed = detailed_angles(model, events, 3.0)
    reached = detailed.states[:, model.slots("regulator_voltage", parts.external_units)].max()
    assert 3.0 < reached < 4.5
    assert largest_angle_error_deg(model, run, detailed) < 1e-7


def test_whole_hybrid_with_all_machines_kept_equals_the_detailed_run(npcc, parts):
    events = [gf.BusFault(3, duration=0.39)]
    run = run_small(npcc, whole_system(parts, column_norm=0.0).hybrid, events)
    assert largest_angle_error_deg(npcc, run, detailed_angles(npcc, events)) < 1e-7


def test_whole_hybrid_is_exact_for_near_and_linear_for_far_machines(npcc, parts):
    family = whole_system(parts, KEPT)
    small = family.hybrid(npcc)
    far = [unit for unit in parts.external_units if unit not in family.kept]
    index = parts.states_of(far)
    near = np.setdiff1d(np.arange(npcc.n_states), index)
    jacobian = npcc.jacobian(npcc.x0)
    for x in states_off(npcc):
        v = small.coordinates.restrict(x)
        dx = small.coordinates.lift(v + small.system.compiled(v)) - small.coordinates.lift(v)
        np.testing.assert_allclose(dx[near], npcc.compiled(x)[near], atol=1e-9)
        np.testing.assert_allclose(dx[index], (jacobian @ (x - npcc.x0))[index], atol=1e-8)


def test_whole_linear_run_equals_the_matrix_exponential(npcc, parts):
    small = whole_system(parts).linear(npcc)
    shift = 0.02 * np.random.default_rng(2).standard_normal(npcc.n_states)
    segment = Segment(small.system, 1.0, coordinates=small.coordinates)
    run = run_segments([segment], npcc.x0 + shift, gf.RungeKutta4(0.005))
    expected = npcc.x0 + expm(npcc.jacobian(npcc.x0)) @ shift
    assert np.abs(run.pieces[-1].full_states[-1] - expected).max() < 1e-6


@pytest.mark.parametrize("kind", ["partitioned", "whole"])
@pytest.mark.parametrize("mode", ["linear", "hybrid"])
def test_models_about_an_equilibrium_with_a_new_frequency_turn_with_it(npcc, parts, kind, mode):
    step = build_timeline(npcc.case, [gf.LoadStep(3, active_mw=300.0)], 1.0)[0].state
    loaded = npcc.for_state(step)
    point = find_equilibrium(loaded, npcc.x0)
    assert point.rate < -0.01
    family = reduce_external(parts, Unreduced()) if kind == "partitioned" else whole_system(parts)
    small = getattr(family.moved(loaded, point), mode)(loaded)
    segment = Segment(small.system, 5.0, coordinates=small.coordinates)
    run = run_segments([segment], point.x, gf.RungeKutta4(0.01))
    expected = point.x.copy()
    expected[npcc.slots("rotor_angle", npcc.machines)] += 5.0 * point.rate
    assert np.abs(run.pieces[-1].full_states[-1] - expected).max() < 1e-6
