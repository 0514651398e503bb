"""Estimated errors against true ones, and runs that keep a tolerance."""

from __future__ import annotations

from dataclasses import replace
from math import inf

import numpy as np
import pytest

import gridfold as gf
from gridfold.equivalents.adaptive import AdaptiveSimulation
from gridfold.equivalents.error_estimate import ErrorEstimator, ErrorTrail
from gridfold.equivalents.families import Mode
from gridfold.equivalents.tolerant import PROBE, TRUSTED, TolerantModel
from gridfold.grid.criteria import AngleSeparation, VoltageDip
from gridfold.runs.synchronism import angle_frame
from gridfold.systems.status import Status

#: A bus fault that clears itself, one near the critical clearing time, and a line fault with its trip.
DISTURBANCES = {
    "short": [gf.BusFault(21, duration=0.1)],
    "near the limit": [gf.BusFault(3, duration=0.38)],
    "with a trip": [gf.BranchFault("3-2", duration=0.1)],
}


def true_error(detailed: gf.Trajectory, run: gf.Trajectory, parts: gf.Partition) -> float:
    return max(e.relative_rms_deg for e in gf.compare(detailed, run, parts.study_units).units)


@pytest.fixture(scope="module")
def estimator(npcc_parts, npcc_swings) -> ErrorEstimator:
    return ErrorEstimator(npcc_parts, npcc_swings)


@pytest.fixture(scope="module")
def ladder(npcc_retained, npcc_linear) -> gf.Ladder:
    costs = {Mode.DETAILED: 4.0, Mode.RETAINED: 3.0, Mode.LINEAR: 2.0, Mode.WHOLE: 1.0}
    return gf.Ladder((npcc_retained, npcc_linear), whole=True, step_seconds=costs)


@pytest.mark.parametrize("events", DISTURBANCES.values(), ids=DISTURBANCES)
@pytest.mark.parametrize("rule", [gf.SwitchingRule(float("inf")), gf.SwitchingRule(0.0)],
                         ids=["linear", "retained"])  # fmt: skip
def test_the_estimate_is_the_difference_to_the_detailed_run(
    npcc, npcc_parts, estimator, ladder, events, rule
) -> None:
    detailed = gf.simulate(npcc, events, 5.0)
    run = gf.simulate_adaptive(npcc, ladder, rule, events, 5.0)
    found = estimator.estimate(run)
    assert found is not None
    assert found.worst_deg == pytest.approx(
        true_error(detailed, run.trajectory, npcc_parts), rel=0.2
    )


@pytest.mark.parametrize("tolerance", [0.05, 0.5])
@pytest.mark.parametrize("events", DISTURBANCES.values(), ids=DISTURBANCES)
def test_a_run_keeps_the_tolerance_by_the_cheapest_rung_that_does(
    npcc, npcc_parts, ladder, events, tolerance
) -> None:
    found = TolerantModel(ladder, tolerance).run(npcc, events, 5.0)
    detailed = gf.simulate(npcc, events, 5.0)
    assert true_error(detailed, found.trajectory, npcc_parts) <= tolerance
    assert found.error_estimate_deg <= tolerance
    *failed, taken = found.attempts
    assert taken.refused is None
    assert all(attempt.refused for attempt in failed)


def test_without_a_tolerance_the_run_is_the_detailed_one(npcc, ladder) -> None:
    events = DISTURBANCES["short"]
    found = TolerantModel(ladder, 0.0).run(npcc, events, 2.0)
    assert found.error_estimate_deg == 0
    assert (found.trajectory.states == gf.simulate(npcc, events, 2.0).states).all()


def test_a_ladder_that_does_not_pay_is_not_climbed(npcc, ladder) -> None:
    dear = {**dict.fromkeys(Mode, 9.0), Mode.DETAILED: 1.0}
    model = TolerantModel(replace(ladder, step_seconds=dear), 1.0)
    assert not model.rules


def test_an_unstable_outcome_is_the_detailed_model_s(npcc, ladder) -> None:
    found = TolerantModel(ladder, 2.0).run(npcc, [gf.BusFault(3, duration=0.6)], 5.0)
    assert found.trajectory.status is Status.LOST_SYNCHRONISM
    assert [attempt.mode for attempt in found.attempts][-1] is Mode.DETAILED
    assert "lost synchronism" in (found.attempts[0].refused or "")


@pytest.mark.parametrize("wrong", [-0.1, float("nan"), float("inf")])
def test_a_tolerance_that_is_none_is_refused(ladder, wrong) -> None:
    with pytest.raises(gf.OptionError, match="a tolerance is 0 degrees or more"):
        TolerantModel(ladder, wrong)


def test_rungs_that_miss_the_tolerance_after_all_sample_faults_are_not_tried(npcc, ladder) -> None:
    tight = TolerantModel(ladder, 1e-4)
    assert not tight.rules
    found = tight.run(npcc, DISTURBANCES["short"], 1.0)
    assert [attempt.mode for attempt in found.attempts] == [Mode.DETAILED]


def test_a_run_that_leads_to_another_topology_is_detailed(npcc, ladder) -> None:
    found = TolerantModel(ladder, 2.0).run(npcc, DISTURBANCES["with a trip"], 2.0)
    assert [attempt.mode for attempt in found.attempts] == [Mode.DETAILED]


def test_the_modes_that_carry_sample_errors_are_enough_for_another_run(
    npcc, npcc_parts, npcc_swings, ladder
) -> None:
    """A run that lost synchronism among the samples says nothing, and does no harm."""
    rule = gf.SwitchingRule(float("inf"))
    lost, sample, other = (
        gf.simulate_adaptive(npcc, ladder, rule, [gf.BusFault(bus, duration=seconds)], 5.0)
        for bus, seconds in ((3, 0.6), (3, 0.1), (21, 0.1))
    )
    focused = ErrorEstimator(npcc_parts, npcc_swings)
    every = focused.estimate(other)
    focused.focus([lost])
    np.testing.assert_array_equal(focused.estimate(other).angles_deg, every.angles_deg)
    assert sample.trajectory.status is Status.COMPLETED
    focused.focus([sample])
    assert focused.estimate(other).worst_deg == pytest.approx(every.worst_deg, rel=0.05)


@pytest.mark.parametrize("order", [12, 20])
def test_what_a_coarse_area_loses_when_it_takes_over_is_part_of_the_error(
    npcc, npcc_parts, npcc_swings, estimator, order
) -> None:
    """The jump of the states carries a sixth to a third of the error here."""
    area = gf.fold(npcc_parts, (), gf.BalancedTruncation(None, order), swings=npcc_swings)
    events = DISTURBANCES["short"]
    run = gf.simulate_adaptive(npcc, area, gf.SwitchingRule(float("inf")), events, 5.0)
    true = true_error(gf.simulate(npcc, events, 5.0), run.trajectory, npcc_parts)
    assert estimator.estimate(run).worst_deg == pytest.approx(true, rel=0.05)


def test_a_run_that_paused_is_the_run(npcc, ladder) -> None:
    """With one model all the way, to rounding: its state is lifted and restricted on the way."""
    events = DISTURBANCES["short"]
    rest = (npcc, ladder, gf.SwitchingRule(0.0), events, 2.0)
    paused = AdaptiveSimulation(*rest)
    for until in (0.05, 0.4, inf):
        assert paused.advance(until) is Status.COMPLETED
    whole = gf.simulate_adaptive(*rest).trajectory
    found = paused.result()
    np.testing.assert_allclose(found.trajectory.times, whole.times, atol=1e-12)
    np.testing.assert_allclose(found.trajectory.states, whole.states, rtol=1e-8, atol=1e-8)
    assert [mode.value for mode in found.modes] == ["detailed"] * 2 + ["retained"] * 2
    assert len(found.switches) == 2


@pytest.mark.parametrize("tolerance", [0.02, 0.1, 0.5])
@pytest.mark.parametrize("bus", [3, 21])
def test_what_is_given_up_early_is_above_the_tolerance_at_the_end(
    npcc, ladder, estimator, bus, tolerance
) -> None:
    """The estimate over the whole span is never less than that of its beginning."""
    rest = (npcc, ladder, gf.SwitchingRule(inf), [gf.BusFault(bus, duration=0.1)], 5.0)
    simulation = AdaptiveSimulation(*rest)
    trail = ErrorTrail(estimator)
    simulation.advance(simulation.after_events(PROBE))
    trail.follow(simulation)
    early = trail.estimate().worst_over(5.0)
    simulation.advance()
    trail.follow(simulation)
    late = trail.estimate()
    assert early <= late.worst_deg == late.worst_over(5.0)
    model = TolerantModel(ladder, 0.0)
    model.rules, model.estimator = (gf.SwitchingRule(inf),), estimator
    model.tolerance_deg = tolerance
    attempt, *_ = model.run(npcc, rest[3], 5.0).attempts
    refused = "above the tolerance" in (attempt.refused or "")
    assert refused is (late.worst_deg > TRUSTED * tolerance)
    assert attempt.estimate_deg == (
        early if early > TRUSTED * tolerance else pytest.approx(late.worst_deg, rel=1e-9)
    )


def test_an_error_carried_on_after_a_pause_is_that_of_the_whole_run(
    npcc, ladder, estimator
) -> None:
    rule, events = gf.SwitchingRule(inf), DISTURBANCES["near the limit"]
    simulation = AdaptiveSimulation(npcc, ladder, rule, events, 5.0)
    trail = ErrorTrail(estimator)
    for until in (1.0, inf):
        simulation.advance(until)
        trail.follow(simulation)
    whole = estimator.estimate(gf.simulate_adaptive(npcc, ladder, rule, events, 5.0))
    assert trail.estimate().worst_deg == pytest.approx(whole.worst_deg, rel=0.03)


def test_the_run_and_its_error_come_close_to_the_detailed_run(npcc, ladder, estimator) -> None:
    """Voltages of the study area at all rows, not only where the error was found."""
    events = DISTURBANCES["near the limit"]
    run = gf.simulate_adaptive(npcc, ladder, gf.SwitchingRule(inf), events, 5.0)
    detailed = gf.simulate(npcc, events, 5.0)
    corrected = estimator.trail(run).corrected(run.trajectory)
    buses = sorted(ladder.parts.study_buses)
    voltages = [
        np.abs(item.bus_voltage(buses))[detailed.times > 0.4]
        for item in (detailed, run.trajectory, corrected)
    ]
    missed, left = (np.abs(item - voltages[0]).max() for item in voltages[1:])
    assert left < missed / 4


@pytest.mark.parametrize(
    ("limits", "told"),
    [
        ({"limit_deg": 1.0002}, "synchronism is lost within its error"),
        ({"speed_limit": 1.0002}, "a machine is off speed within its error"),
    ],
    ids=["angle", "speed"],
)
def test_a_limit_within_the_error_is_left_to_the_detailed_model(npcc, ladder, limits, told) -> None:
    """The limit lies just above what the run with the reduced model reaches itself."""
    events = DISTURBANCES["near the limit"]
    run = TolerantModel(ladder, 5.0).run(npcc, events, 5.0).trajectory
    frame = angle_frame(npcc)
    rotors = run.states[:, frame.slots]
    angles = np.rad2deg(np.abs(rotors - frame.references_of(rotors))).max()
    speeds = np.abs(run.signal("speed", run.model.machines) - 1).max()
    just = {"limit_deg": angles, "speed_limit": speeds}
    criterion = gf.SynchronismCriterion(**{name: by * just[name] for name, by in limits.items()})
    found = TolerantModel(ladder, 5.0).run(npcc, events, 5.0, criterion=criterion)
    *failed, last = found.attempts
    assert last.mode is Mode.DETAILED
    assert failed[-1].within_error
    assert failed[-1].refused == told
    assert any(told in notice.text for notice in found.trajectory.notices)


def test_a_criterion_within_the_error_is_judged_on_the_detailed_run(npcc, ladder) -> None:
    """A limit between the reduced run's value and the detailed one's; far from it nothing happens."""
    events, model = DISTURBANCES["near the limit"], TolerantModel(ladder, 5.0)
    run = model.run(npcc, events, 5.0)
    assert run.attempts[-1].mode is not Mode.DETAILED
    assert not any("repeated" in notice.text for notice in run.trajectory.notices)
    detailed = gf.simulate(npcc, events, 5.0)
    found, right = (
        gf.judge(item, [AngleSeparation(500.0)], ladder.parts.study_buses)[0].value
        for item in (run.trajectory, detailed)
    )
    between = AngleSeparation((found + right) / 2)
    doubted = model.run(npcc, events, 5.0, criteria=[between])
    assert doubted.attempts[-1].mode is Mode.DETAILED
    assert (doubted.trajectory.states == detailed.states).all()
    told = [notice.text for notice in doubted.trajectory.notices if "repeated" in notice.text]
    assert len(told) == 1
    assert str(between) in told[0]
    far = model.run(npcc, events, 5.0, criteria=[AngleSeparation(500.0), VoltageDip(0.01)])
    assert far.attempts == run.attempts
