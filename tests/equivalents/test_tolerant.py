"""Estimated errors against true ones, and runs that keep a tolerance."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import gridfold as gf
from gridfold.equivalents.error_estimate import ErrorEstimator
from gridfold.equivalents.families import Mode
from gridfold.equivalents.tolerant import TolerantModel
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
        for bus, seconds in ((3, 0.6), (29, 0.1), (21, 0.1))
    )
    focused = ErrorEstimator(npcc_parts, npcc_swings)
    every = focused.estimate(other)
    focused.focus([lost])
    np.testing.assert_array_equal(focused.estimate(other).angles_deg, every.angles_deg)
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
