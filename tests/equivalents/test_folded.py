from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from limited_cases import npcc_with_sexs
from scipy.linalg import expm

import gridfold as gf
from gridfold.dynamics.equilibrium import Equilibrium, find_equilibrium
from gridfold.dynamics.unit_limits import touched_let_go
from gridfold.equivalents import folded, serving
from gridfold.equivalents.area_bases import find_bases
from gridfold.equivalents.families import Mode
from gridfold.equivalents.folded import fold, on_bases
from gridfold.equivalents.model_kind import Weights
from gridfold.equivalents.swings import port_swings
from gridfold.errors import OptionError
from gridfold.grid.timeline import build_timeline
from gridfold.partition import couple
from gridfold.reduction import BalancedTruncation, ModalTruncation, Unreduced
from gridfold.simulation import Segment, run_segments
from gridfold.systems import LinearSystem

NEAR_BOUNDARY = (42, 50, 51, 78, 134)
FREQUENCIES = np.concatenate([[0.0], np.logspace(-3, 3, 60)])
ALWAYS = gf.SwitchingRule(0.0, limits=False)


@pytest.fixture(scope="module")
def parts(npcc_parts):
    return npcc_parts


@pytest.fixture(scope="module")
def swings(npcc_swings):
    return npcc_swings


@pytest.fixture(scope="module")
def linear(npcc_linear):
    return npcc_linear


@pytest.fixture(scope="module")
def retained(npcc_retained):
    return npcc_retained


def near_boundary(parts):
    return [unit for unit in parts.external_units if unit.bus in NEAR_BOUNDARY]


def after(model, *events):
    return model.for_state(build_timeline(model.case, list(events), 1.0)[-1].state)


def gain(response):
    """Largest singular value over all frequencies of a response (n_frequencies, p, m)."""
    return float(np.linalg.norm(response, 2, axis=(1, 2)).max())


def assert_same_ports(found, expected):
    """Equal to the last bit."""
    assert found.movers is expected.movers is None
    for name in ("diagonal", "coupling", "b", "offset", "c", "current", "voltage", "turned"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))


def projected(system, lift, restrict):
    return LinearSystem(restrict @ system.apply(lift), restrict @ system.b, system.c @ lift)


@pytest.mark.parametrize("kept", [0, 5])
@pytest.mark.parametrize("tolerance", [1e-1, 2e-3])
def test_the_interface_balanced_truncation_obeys_its_bound(parts, swings, kept, tolerance):
    area = fold(parts, near_boundary(parts)[:kept], Unreduced(), swings=swings).area
    reduction = BalancedTruncation(tolerance).reduce(area.system.dense(), area.x0)
    full = area.system.dense().transfer(1j * FREQUENCIES)
    error = gain(full - reduction.system.transfer(1j * FREQUENCIES))
    assert 0.01 * reduction.bound < error <= reduction.bound <= tolerance


def driven_by_swings(area, parts, swings):
    """What is balanced: the port voltages vary as in the sample swings."""
    return area.driven.with_input_weights(port_swings(area, parts, swings))


@pytest.mark.parametrize("tolerance", [1e-2, 1e-3])
def test_with_the_common_turn_kept_the_error_is_still_below_the_bound_for_npcc(
    parts, swings, tolerance
):
    family = fold(parts, near_boundary(parts), BalancedTruncation(tolerance), swings=swings)
    bases, system = family.bases, driven_by_swings(family.area, parts, swings)
    plain = BalancedTruncation(tolerance).reduce(system.dense(), family.area.x0)
    full = system.dense().transfer(1j * FREQUENCIES)
    small = projected(system, bases.lift, bases.restrict)
    assert bases.order == plain.order + 1
    assert bases.bound == pytest.approx(plain.bound, rel=1e-6)
    assert small.poles.real.max() < 0
    assert gain(full - small.transfer(1j * FREQUENCIES)) <= bases.bound <= tolerance


def test_with_weights_on_states_unit_changes_drive_all_states_alike(parts, linear):
    reducer = BalancedTruncation(order=40)
    family = fold(parts, (), reducer, Weights.STATES)
    area = family.area
    every = area.driven.with_outputs(np.eye(area.system.n)).dense()
    expected = reducer.reduce(every, area.x0, area.turn)
    np.testing.assert_allclose(family.bases.hankel_values, expected.hankel_values, rtol=1e-6)
    assert not np.allclose(family.bases.hankel_values[:9], linear.bases.hankel_values[:9], rtol=0.1)


def test_the_common_turn_is_in_the_reduced_area_exactly(retained):
    turn = retained.area.turn[:, 0]
    again = retained.states.lift_matrix @ (retained.states.restrict_matrix @ turn)
    np.testing.assert_allclose(again, turn, atol=1e-10)


def test_lift_and_restrict_are_inverse_on_the_reduced_area(retained):
    bases, states = retained.bases, retained.states
    identity = np.eye(bases.order)
    np.testing.assert_allclose(bases.restrict @ bases.lift, identity, atol=1e-9)
    np.testing.assert_allclose(states.restrict_matrix @ states.lift_matrix, identity, atol=1e-9)


def test_the_modes_of_the_ports_have_the_transfer_function_of_the_projection(retained):
    found, n_pairs = retained.linear_ports, len(retained.linear_ports.coupling)
    a = np.diag(found.diagonal)
    first = found.order - 2 * n_pairs + np.arange(n_pairs)
    a[first, first + n_pairs], a[first + n_pairs, first] = found.coupling, -found.coupling
    modal = LinearSystem(a, found.b, found.c).transfer(1j * FREQUENCIES)
    small = projected(retained.area.system, retained.bases.lift, retained.bases.restrict)
    logs = retained.area.log_slopes @ retained.bases.lift
    expected = LinearSystem(small.a, small.b, logs).transfer(1j * FREQUENCIES)
    assert gain(modal - expected) < 1e-8 * gain(expected)


def errors_deg(parts, family, faults, measure="rms_deg"):
    small, found = gf.SmallModels(family), {}
    for fault in faults:
        detailed = gf.simulate(parts.model, [fault], 8.0)
        run = gf.simulate_adaptive(parts.model, small, ALWAYS, [fault], 8.0)
        assert run.modes[-1] is Mode.RETAINED
        units = gf.compare(detailed, run.trajectory, parts.study_units).units
        found[fault] = max(getattr(error, measure) for error in units)
    return found


#: Faults at study-area lines that are then tripped, all stable.
LINES = ("3-2", "4-1", "5-31", "9-30", "14-13", "28-29", "33-32", "35-34")


@pytest.mark.parametrize(
    "event",
    [
        gf.BranchTrip("3-2"),
        gf.BranchTrip("53-52"),
        gf.LoadStep(46, active_mw=200.0),
        gf.MachineTrip(78),
        gf.MachineTrip(133),
    ],
    ids=["study branch", "hidden branch", "hidden load", "retained machine", "linear machine"],
)
def test_about_another_point_an_area_rests_there(npcc, retained, event):
    model = after(npcc, event)
    point = find_equilibrium(model, npcc.x0)
    moved = retained.moved(model, point)
    built = moved.build(Mode.RETAINED, model).system
    derivative = built.compiled(built.restrict(point.x))
    turn = np.zeros(npcc.n_states)
    live = tuple(unit for unit in model.machines if unit not in model.state.units_out)
    turn[model.slots("rotor_angle", live)] = point.rate
    rest = built.lift(derivative) - built.lift(np.zeros(len(derivative)))
    np.testing.assert_allclose(rest, turn, atol=1e-8)
    np.testing.assert_array_equal(moved.origin, point.x)
    assert np.abs(point.x - npcc.x0).max() > 1e-4
    assert (moved.bases is retained.bases) is not (event == gf.MachineTrip(133))


@pytest.mark.parametrize("reducer", [Unreduced(), BalancedTruncation(order=120)])
def test_trips_of_linear_machines_are_followed_as_far_as_the_order_goes(parts, swings, reducer):
    family = fold(parts, near_boundary(parts), reducer, swings=swings)
    trips = [gf.MachineTrip(bus) for bus in (101, 133, 139)]
    assert max(errors_deg(parts, family, trips).values()) < 0.3


def test_to_the_default_bound_angles_against_each_other_follow_such_trips(parts, retained):
    """Sample swings do not drift together: what does is reduced less exactly."""
    trips = [gf.MachineTrip(bus) for bus in (101, 133, 139)]
    assert max(errors_deg(parts, retained, trips, "relative_rms_deg").values()) < 1.0


def test_where_an_area_cannot_be_joined_the_detailed_model_takes_over(npcc, parts):
    all_but_one = [unit for unit in parts.external_units if unit.bus != 78]
    family = fold(parts, all_but_one, Unreduced())
    run = gf.simulate_adaptive(npcc, family, ALWAYS, [gf.MachineTrip(78, time=0.1)], 0.5)
    assert run.modes == (Mode.RETAINED, Mode.DETAILED)


def test_moved_to_where_it_was_it_is_the_same(npcc, retained):
    again = retained.moved(npcc, Equilibrium(npcc.x0, 0.0)).linear_ports
    assert_same_ports(again, retained.linear_ports)


def test_known_bases_give_the_same_area_again(parts, retained):
    again = on_bases(parts, retained.retained, retained.ports, retained.reducer, retained.bases)
    assert_same_ports(again.linear_ports, retained.linear_ports)
    np.testing.assert_array_equal(again.states.lift_matrix, retained.states.lift_matrix)


class NewBases:
    """A family that is reduced anew about every operating point."""

    def __init__(self, family, swings):
        self.family, self.swings = family, swings

    def __getattr__(self, name):
        return getattr(self.family, name)

    def moved(self, model, point):
        weights = self.bases.weights
        area = folded._linearized(self.ports, model, point.x, weights, self.governed)
        by_ports = port_swings(area, self.parts, self.swings)
        bases = find_bases(self.reducer, area, model, point.x, weights, by_ports)
        moved = folded._projected(replace(self.family, bases=bases), area, model, point)
        return NewBases(moved, self.swings)


def test_on_old_bases_line_faults_are_as_exact_as_on_new_ones(parts, retained, swings):
    faults = [gf.BranchFault(line, duration=0.05) for line in LINES]
    old = errors_deg(parts, retained, faults)
    new = errors_deg(parts, NewBases(retained, swings), faults)
    for fault in faults:
        assert 1e-3 < old[fault] < 1.0
        assert old[fault] == pytest.approx(new[fault], rel=0.1)


def test_what_cannot_be_retained_or_reduced_is_told(parts):
    with pytest.raises(OptionError, match=r"machine 23:1 cannot be retained"):
        fold(parts, [gf.UnitKey(23, "1")])
    with pytest.raises(OptionError, match="none is left to be linear"):
        fold(parts, parts.external_units)


def test_a_modal_truncation_can_fold_an_area_too(parts):
    family = fold(parts, (), ModalTruncation(order=120))
    assert family.bases.order == 120
    assert family.bases.hankel_values is None
    built = family.build(Mode.LINEAR, parts.model).system
    assert np.abs(built.compiled(built.restrict(parts.model.x0))).max() < 1e-8


def test_a_family_tells_its_mode_units_and_reference(parts, linear, retained):
    assert linear.modes == (Mode.LINEAR,)
    assert retained.modes == (Mode.RETAINED,)
    assert retained.study_units == parts.study_units
    assert retained.reference_unit == couple(parts).reference
    small = retained.build(Mode.RETAINED, parts.model)
    assert small.unlimited == retained.ports.units
    assert len(small.unlimited) == 34
    assert linear.held_at_limits(Mode.LINEAR) == ()


@pytest.mark.parametrize("family", ["linear", "retained"])
@pytest.mark.parametrize("events", [[], [gf.BranchTrip("3-2")]], ids=["intact", "tripped"])
def test_linear_throughout_is_the_linearization_of_the_port_model(npcc, request, family, events):
    model, area = after(npcc, *events), request.getfixturevalue(family)
    if events:
        area = area.moved(model, find_equilibrium(model, npcc.x0))
    ported = area.build(area.modes[0], model).system
    whole = area.build(Mode.WHOLE, model)
    point = ported.restrict(area.origin)
    v = np.random.default_rng(4).standard_normal(len(point))
    h = 1e-4
    near, far = (
        ported.compiled(point + s * h * v) - ported.compiled(point - s * h * v) for s in (1, 2)
    )
    expected = (8 * near - far) / (12 * h)
    states = whole.coordinates.states
    w0 = states.restrict(point)
    found = states.lift_matrix @ (
        whole.system.compiled(w0 + states.restrict_matrix @ v) - whole.system.compiled(w0)
    )
    np.testing.assert_allclose(found, expected, atol=1e-6 * np.abs(expected).max())
    drift = states.lift_matrix @ whole.system.compiled(w0)
    np.testing.assert_allclose(drift, ported.compiled(point), atol=1e-7)


def test_the_closed_form_equals_stepping_and_the_exponential(npcc, retained):
    whole = retained.build(Mode.WHOLE, npcc)
    start = npcc.x0.copy()
    start[npcc.slots("rotor_angle", npcc.machines[:5])] += 0.2
    closed = Segment(whole.system, 2.0, coordinates=whole.coordinates)
    found = run_segments([closed], start, gf.RungeKutta4(0.01)).pieces[0].states[-1]
    w = whole.coordinates.restrict(start)
    step, rhs = 1e-3, whole.system.compiled
    for _ in range(2000):
        k1 = rhs(w)
        k2 = rhs(w + step / 2 * k1)
        k3 = rhs(w + step / 2 * k2)
        w = w + step / 6 * (k1 + 2 * k2 + 2 * k3 + rhs(w + step * k3))
    lifted = [whole.coordinates.lift(state) for state in (found, w)]
    np.testing.assert_allclose(lifted[0], lifted[1], atol=1e-6)
    a = np.array([rhs(column) - rhs(0 * column) for column in np.eye(len(w))]).T
    exact = expm(2.0 * a) @ whole.coordinates.restrict(start)
    assert np.abs(rhs(0 * w)).max() < 1e-8
    np.testing.assert_allclose(lifted[0], whole.coordinates.lift(exact), atol=1e-8)


def test_rows_are_lifted_without_the_others(npcc, retained):
    coordinates = retained.build(Mode.WHOLE, npcc).coordinates
    w = np.random.default_rng(1).standard_normal((3, coordinates.states.order))
    index = np.random.default_rng(2).permutation(npcc.n_states)[:40]
    np.testing.assert_allclose(
        coordinates.lift_rows(w, index), coordinates.lift(w)[:, index], atol=1e-12
    )


@pytest.fixture
def tilted(npcc, retained):
    """The area on bases on which a mode grows after a trip.

    A tilted projection keeps T T~ = I; tilted far enough it makes a stable area unstable.
    """
    lift, restrict = retained.bases.lift, retained.bases.restrict
    tilt = np.random.default_rng(0).normal(size=restrict.shape)
    tilt -= tilt @ lift @ restrict
    moved = retained.area.system.apply(lift)
    sizes = (2.0**k * 1e-6 for k in range(40))
    size = next(s for s in sizes if np.linalg.eigvals((restrict + s * tilt) @ moved).real.max() > 1)
    return replace(retained, bases=replace(retained.bases, restrict=restrict + size * tilt))


def test_a_mode_that_grows_on_the_bases_alone_is_left_out(npcc, retained, tilted, monkeypatch):
    model = after(npcc, gf.BranchTrip("3-2"))
    point = find_equilibrium(model, npcc.x0)
    monkeypatch.setattr(folded, "missed", lambda *given: 0.0)
    again = tilted.moved(model, point)
    assert "linearized anew" in again.made
    assert "1/s on them is left out" in again.made
    assert 0 < tilted.bases.order - again.bases.order < 10
    assert again.growth <= max(retained.growth, 0.0) + serving.MOST_GROWTH
    t, lift = again.states.restrict_matrix, again.states.lift_matrix
    np.testing.assert_allclose(t @ lift, np.eye(again.bases.order), atol=1e-8)
    assert "left out" not in retained.moved(model, point).made


def test_an_area_is_reduced_anew_where_too_much_of_it_is_left_out(npcc, tilted):
    model = after(npcc, gf.BranchTrip("3-2"))
    again = tilted.moved(model, find_equilibrium(model, npcc.x0))
    assert "reduced anew" in again.made
    assert again.growth < 0
    assert again.bases.miss < 1e-3


@pytest.fixture(scope="module")
def at_limits(npcc, parts):
    """The external area of a grid in which two exciters start at both of their limits."""
    model = gf.build_model(npcc_with_sexs(npcc, 0.0, ["48:1", "68:1"]))
    return fold(gf.partition(model, parts.study_buses), (), BalancedTruncation(1e-3))


def test_bases_of_a_start_at_limits_obey_the_bound_inside_of_them_too(at_limits):
    bases, model = at_limits.bases, at_limits.parts.model
    free = touched_let_go(model, model.x0, at_limits.ports.units)
    inside = folded._linearized(at_limits.ports, free, model.x0, bases.weights, ())
    held = find_bases(
        at_limits.reducer, at_limits.area, model, model.x0, bases.weights, bases.input_weights
    )

    def error(used):
        full = inside.driven.with_input_weights(used.input_weights)
        small = projected(full, used.lift, used.restrict)
        points = 2j * np.pi * FREQUENCIES[1:]
        return gain(full.dense().transfer(points) - small.transfer(points))

    assert error(bases) < bases.bound < 1e-3
    assert error(held) > 2e-3


def test_some_states_that_are_restricted_follow_linearly(npcc, retained):
    coordinates = retained.build(Mode.WHOLE, npcc).coordinates
    moved = np.random.default_rng(3).standard_normal(npcc.n_states)
    expected = coordinates.restrict(npcc.x0 + moved) - coordinates.restrict(npcc.x0)
    rows = np.array([3, 0, 40])
    found = coordinates.restriction(rows) @ moved
    np.testing.assert_allclose(found, expected[rows], rtol=1e-9, atol=1e-9)
