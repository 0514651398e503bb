from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from area_cases import Unreduced

import gridfold as gf
from gridfold.equivalents.adaptive import simulate_adaptive
from gridfold.equivalents.compare import compare
from gridfold.equivalents.families import Mode, reduce_external, whole_system
from gridfold.equivalents.small_models import SmallModels
from gridfold.equivalents.switching import SwitchingRule
from gridfold.errors import InitializationError, OptionError
from gridfold.partition import Partition, partition
from gridfold.systems.status import Status

#: Thresholds of the angle deviation in the paper, in degrees: partitioned and whole.
PARTITIONED, WHOLE = 67.0, 6.0
HYBRID_ONLY, LINEAR_ONLY = SwitchingRule(0.0), SwitchingRule(float("inf"))


@pytest.fixture(scope="module")
def parts(npcc) -> Partition:
    return partition(npcc, range(1, 37))


@pytest.fixture(scope="module")
def partitioned(parts) -> SmallModels:
    return SmallModels(reduce_external(parts))


@pytest.fixture(scope="module")
def whole(parts) -> SmallModels:
    return SmallModels(whole_system(parts))


@pytest.fixture(scope="module")
def all_kept(parts) -> SmallModels:
    return SmallModels(reduce_external(parts, Unreduced(), column_norm=0.0))


def worst_rms_deg(detailed, run, parts) -> float:
    return compare(detailed, run.trajectory, parts.study_units).worst.rms_deg


def modes(run) -> list[Mode]:
    return [switch.after for switch in run.switches]


def test_the_log_tells_when_from_what_to_what_and_why(npcc, partitioned):
    fault = gf.BusFault(3, start=1.0, duration=0.39)
    run = simulate_adaptive(npcc, partitioned, SwitchingRule(PARTITIONED), [fault])
    assert run.trajectory.status is Status.COMPLETED
    first, second, third, fourth = run.switches[:4]
    assert (first.time, first.before, first.after) == (0.0, None, Mode.LINEAR)
    assert (second.time, second.before, second.after) == (1.0, Mode.LINEAR, Mode.DETAILED)
    assert second.reason == "fault on"
    assert (third.time, third.before, third.after) == (1.39, Mode.DETAILED, Mode.LINEAR)
    assert "within the threshold" in third.reason
    assert (fourth.before, fourth.after) == (Mode.LINEAR, Mode.HYBRID)
    assert "exceeds the threshold" in fourth.reason
    assert modes(run)[-1] is Mode.LINEAR
    assert all(b.before is a.after for a, b in zip(run.switches, run.switches[1:], strict=False))
    times = [switch.time for switch in run.switches]
    assert times == sorted(set(times))


def test_the_model_is_hybrid_exactly_while_a_study_machine_is_beyond_the_threshold(
    npcc, partitioned, parts
):
    run = simulate_adaptive(
        npcc, partitioned, SwitchingRule(PARTITIONED), [gf.BusFault(3, start=1.0, duration=0.39)]
    )
    angles = run.trajectory.rotor_angle_deg(parts.study_units, partitioned.family.reference_unit)
    above = np.abs(angles - angles[0]).max(axis=1) > PARTITIONED
    hybrid = np.zeros(len(above), dtype=bool)
    ends = [*(switch.time for switch in run.switches[1:]), 16.0 + 1e-9]
    for switch, end in zip(run.switches, ends, strict=True):
        rows = (run.trajectory.times > switch.time - 1e-9) & (run.trajectory.times < end - 1e-9)
        hybrid[rows] = switch.after is Mode.HYBRID
        if switch.after is Mode.DETAILED:
            above[rows] = False
    # The last instant has no model after it.
    np.testing.assert_array_equal(hybrid[:-1], above[:-1])
    assert 0 < hybrid.sum() < len(hybrid)


def test_threshold_0_is_hybrid_and_infinity_linear_all_the_time(npcc, partitioned):
    fault = [gf.BusFault(3, start=0.5, duration=0.2)]
    linear = simulate_adaptive(npcc, partitioned, LINEAR_ONLY, fault, 8.0)
    assert modes(linear) == [Mode.LINEAR, Mode.DETAILED, Mode.LINEAR]
    hybrid = simulate_adaptive(npcc, partitioned, HYBRID_ONLY, fault, 4.0)
    assert modes(hybrid) == [Mode.HYBRID, Mode.DETAILED, Mode.HYBRID]
    assert [switch.time for switch in hybrid.switches] == [0.0, 0.5, 0.7]
    assert len(hybrid.trajectory.run.pieces) == 3


def test_without_reduction_no_switch_makes_rotor_angles_jump(npcc, all_kept, partitioned):
    fault, rule = [gf.BusFault(3, start=1.0, duration=0.39)], SwitchingRule(PARTITIONED)
    full = simulate_adaptive(npcc, all_kept, rule, fault, 4.0)
    reduced = simulate_adaptive(npcc, partitioned, rule, fault, 4.0)
    assert len(full.switches) > 3
    assert max(switch.jump_deg for switch in full.switches) < 1e-9
    # Leaving the detailed model costs what truncation discards; later switches cost nothing.
    assert 1e-6 < reduced.switches[2].jump_deg < 0.5
    assert max(switch.jump_deg for switch in reduced.switches[3:]) < 1e-9


def test_hybrid_with_all_kept_equals_the_detailed_run_fault_and_all(npcc, all_kept, parts):
    fault = [gf.BusFault(3, duration=0.39)]
    run = simulate_adaptive(npcc, all_kept, HYBRID_ONLY, fault)
    detailed = gf.simulate(npcc, fault)
    errors = compare(detailed, run.trajectory)
    assert max(unit.largest_deg for unit in errors.units) < 1e-7


@pytest.mark.parametrize(
    ("bus", "clearing", "linear_from", "linear_to"),
    [(3, 0.39, 10.9, 11.2), (23, 0.20, 16.0, 16.3), (17, 0.03, 0.0, 1.0)],
)
def test_errors_at_the_critical_clearing_time_are_within_those_of_the_design(
    npcc, partitioned, whole, parts, bus, clearing, linear_from, linear_to
):
    fault = [gf.BusFault(bus, duration=clearing)]
    detailed = gf.simulate(npcc, fault)

    def error(small, rule):
        return worst_rms_deg(detailed, simulate_adaptive(npcc, small, rule, fault), parts)

    linear = error(partitioned, LINEAR_ONLY)
    assert linear_from < linear < linear_to
    assert error(partitioned, HYBRID_ONLY) <= 1.2
    assert error(partitioned, SwitchingRule(PARTITIONED)) <= min(3.0, linear + 1e-9)
    assert error(whole, SwitchingRule(WHOLE)) <= 7.0


def test_the_mean_error_of_the_linear_model_is_several_times_that_of_the_adaptive_one(
    npcc, partitioned, parts
):
    linear, adaptive = [], []
    for bus, clearing in ((3, 0.39), (23, 0.20), (17, 0.03)):
        fault = [gf.BusFault(bus, duration=clearing)]
        detailed = gf.simulate(npcc, fault)
        for errors, rule in ((linear, LINEAR_ONLY), (adaptive, SwitchingRule(PARTITIONED))):
            run = simulate_adaptive(npcc, partitioned, rule, fault)
            errors.append(worst_rms_deg(detailed, run, parts))
    assert np.mean(linear) > 3 * np.mean(adaptive)


@pytest.mark.parametrize("kind", ["partitioned", "whole"])
def test_a_trip_moves_the_operating_point_at_once_and_a_long_run_ends_there_in_linear_mode(
    npcc, request, parts, kind
):
    small = request.getfixturevalue(kind)
    rule = SwitchingRule(PARTITIONED if kind == "partitioned" else WHOLE)
    events = [gf.BranchFault("3-2", duration=0.39, trip=True)]
    run = simulate_adaptive(npcc, small, rule, events, t_end=40.0)
    detailed = gf.simulate(npcc, events, t_end=40.0)
    model = run.trajectory.models[-1]
    assert model.state.branches_out
    moved, before = small.family_for(model), small.family
    assert moved is not before
    assert np.abs(model.compiled(moved.origin)[npcc.slots("speed", npcc.machines)]).max() < 1e-8
    assert np.abs(model.compiled(before.origin)).max() > 1e-3
    assert modes(run)[-1] is Mode.LINEAR
    assert run.switches[-1].time < 25.0
    angles = npcc.slots("rotor_angle", npcc.machines)
    last = [r.states[-1, angles] for r in (detailed, run.trajectory)]
    relative = [np.rad2deg(a - a[0]) for a in last]
    assert np.abs(relative[0] - relative[1]).max() < 0.1


def test_a_trip_alone_is_logged_and_settles_without_switching_to_and_fro(npcc, whole):
    run = simulate_adaptive(
        npcc, whole, SwitchingRule(WHOLE), [gf.BranchTrip("29-37", time=0.5)], t_end=40.0
    )
    assert len(run.switches) < 10
    assert modes(run)[-1] is Mode.LINEAR


def test_too_long_above_the_threshold_is_logged_once(npcc, whole):
    fault = [gf.BusFault(3, duration=0.39)]
    run = simulate_adaptive(npcc, whole, SwitchingRule(WHOLE, longest_above=2.0), fault)
    looks = [switch for switch in run.switches if "nothing is rebuilt" in switch.reason]
    assert [switch.time for switch in looks] == [pytest.approx(2.39)]
    assert (looks[0].before, looks[0].after) == (Mode.HYBRID, Mode.HYBRID)
    patient = simulate_adaptive(npcc, whole, SwitchingRule(WHOLE, longest_above=20.0), fault)
    assert not any("nothing is rebuilt" in switch.reason for switch in patient.switches)
    np.testing.assert_allclose(run.trajectory.states, patient.trajectory.states, atol=1e-9)


def test_loss_of_synchronism_is_found_at_the_same_step_as_by_the_detailed_model(npcc, all_kept):
    fault = [gf.BusFault(3, duration=0.41)]
    detailed = gf.simulate(npcc, fault)
    run = simulate_adaptive(npcc, all_kept, HYBRID_ONLY, fault).trajectory
    assert detailed.status is Status.LOST_SYNCHRONISM
    assert run.status is Status.LOST_SYNCHRONISM
    assert run.times[-1] == detailed.times[-1]
    assert run.times[-1] > 0.41
    assert run.culprit == detailed.culprit


def test_the_same_step_holds_for_the_whole_hybrid_model(npcc, parts):
    fault = [gf.BusFault(3, duration=0.41)]
    run = simulate_adaptive(npcc, whole_system(parts, column_norm=0.0), HYBRID_ONLY, fault)
    assert run.trajectory.status is Status.LOST_SYNCHRONISM
    assert run.trajectory.times[-1] == gf.simulate(npcc, fault).times[-1]


def test_where_there_is_no_equilibrium_the_model_stays_detailed_and_says_so(npcc, partitioned):
    events = [gf.BranchTrip("29-37", time=0.5), gf.BranchTrip("35-73", time=1.0)]
    run = simulate_adaptive(npcc, partitioned, SwitchingRule(PARTITIONED), events, 3.0)
    last = run.switches[-1]
    assert (last.time, last.after) == (1.0, Mode.DETAILED)
    assert "no equilibrium" in last.reason
    detailed = gf.simulate(npcc, events, 3.0)
    late = detailed.times >= 1.0
    assert run.trajectory.status is detailed.status
    difference = run.trajectory.states[late] - detailed.states[late]
    assert np.abs(difference).max() < 0.05


def test_small_models_are_built_once_for_all_runs(npcc, parts):
    small = SmallModels(whole_system(parts))
    fault = [gf.BusFault(3, duration=0.2)]
    first = simulate_adaptive(npcc, small, SwitchingRule(WHOLE), fault, 1.0)
    second = simulate_adaptive(npcc, small, SwitchingRule(WHOLE), fault, 1.0)
    assert first.reduction_seconds > 0
    assert second.reduction_seconds == 0
    np.testing.assert_array_equal(first.trajectory.states, second.trajectory.states)


def test_an_event_inside_a_reduced_phase_starts_a_segment_on_the_new_network(npcc, all_kept):
    events = [gf.LoadStep(3, time=1.0, active_mw=200.0)]
    run = simulate_adaptive(npcc, all_kept, HYBRID_ONLY, events, 4.0)
    detailed = gf.simulate(npcc, events, 4.0)
    assert len(run.trajectory.models) == len(run.trajectory.run.pieces)
    errors = compare(detailed, run.trajectory)
    assert max(unit.largest_deg for unit in errors.units) < 1e-7


@pytest.mark.parametrize(
    "bad", [{"angle_deg": -1.0}, {"angle_deg": float("nan")}, {"longest_above": 0.0}]
)
def test_a_rule_without_sense_is_refused(bad):
    with pytest.raises(OptionError):
        replace(SwitchingRule(67.0), **bad)


def test_the_family_of_an_islanded_state_is_none_and_tried_once(npcc, partitioned, monkeypatch):
    case = npcc.case
    ties = frozenset(
        k for k, b in enumerate(case.branches) if {b.from_bus, b.to_bus} in ({29, 37}, {35, 73})
    )
    islands = npcc.for_state(replace(npcc.state, branches_out=npcc.state.branches_out | ties))
    small, calls = SmallModels(partitioned.family), []

    def refuse(model, guess):
        calls.append(model.state)
        raise InitializationError("no equilibrium")

    monkeypatch.setattr("gridfold.equivalents.small_models.find_equilibrium", refuse)
    assert small.family_for(islands) is None
    assert small.get(islands, Mode.HYBRID) is None
    assert calls == [islands.state]
