"""The causes of an estimated error, against runs from which one of them is absent."""

from __future__ import annotations

from math import inf

import numpy as np
import pytest

import gridfold as gf
from gridfold.equivalents.error_estimate import ErrorEstimator
from gridfold.equivalents.folded import FoldedArea
from gridfold.equivalents.ladder import Ladder
from gridfold.equivalents.small_models import SmallModels
from gridfold.equivalents.split_error import ErrorSplitter

FAULT, T_END = gf.BusFault(21, duration=0.1), 5.0
#: Rules by which the rung of an area is in use all the time, and linear throughout below an angle.
ALWAYS, WHOLE = gf.SwitchingRule(inf), gf.SwitchingRule(30.0, whole_deg=30.0)


@pytest.fixture(scope="module")
def fine(npcc_parts, npcc_swings) -> FoldedArea:
    return gf.fold(npcc_parts, (), gf.BalancedTruncation(1e-5), swings=npcc_swings)


@pytest.fixture(scope="module")
def estimator(npcc_parts, fine) -> ErrorEstimator:
    return ErrorEstimator(npcc_parts, area=fine)


@pytest.fixture(scope="module")
def retained(npcc_retained) -> FoldedArea:
    finest = gf.BalancedTruncation(1e-5)
    return gf.fold(npcc_retained.parts, npcc_retained.retained, finest)


def runs(model, area, bound, rule):
    """The run with the area truncated to the bound, its models, and the run without that."""
    coarse = next(area.truncated([bound]))
    one, other = (Ladder((a,), whole=rule is WHOLE) for a in (coarse, area))
    small = SmallModels(one)
    found = gf.simulate_adaptive(model, small, rule, [FAULT], T_END)
    return found, small, gf.simulate_adaptive(model, other, rule, [FAULT], T_END)


def rms(model, these, those, parts) -> float:
    """Largest RMS difference of a study machine's angle against the centre of inertia, in degrees."""
    apart = np.radians(these.rotor_angle_deg() - those.rotor_angle_deg())
    inertia = model.inertia(model.machines)
    apart -= (apart @ inertia / inertia.sum())[:, None]
    study = [model.machines.index(unit) for unit in parts.study_units]
    squares = np.trapezoid(apart[:, study] ** 2, these.times, axis=0)
    return float(np.degrees(np.sqrt(squares / these.times[-1])).max())


@pytest.mark.parametrize("rule", [ALWAYS, WHOLE], ids=["linear", "linear whole"])
@pytest.mark.parametrize("bound", [1e-2, 1e-1])
def test_truncation_and_jumps_are_the_difference_to_a_run_without_truncation(
    npcc, npcc_parts, fine, estimator, rule, bound
) -> None:
    run, small, untruncated = runs(npcc, fine, bound, rule)
    estimate = estimator.estimate(run)
    curves = ErrorSplitter(small).curves(estimate)
    lost = curves[0] + curves[2]
    size = np.sqrt(np.trapezoid(lost**2, estimate.times) / T_END)
    difference = rms(npcc, untruncated.trajectory, run.trajectory, npcc_parts)
    assert size == pytest.approx(difference, rel=0.1)


def test_the_same_with_machines_retained(npcc, npcc_parts, retained, estimator) -> None:
    run, small, untruncated = runs(npcc, retained, 1e-1, ALWAYS)
    causes = ErrorSplitter(small).split(estimator.estimate(run))
    difference = rms(npcc, untruncated.trajectory, run.trajectory, npcc_parts)
    assert causes.truncation_deg == pytest.approx(difference, rel=0.1)


def test_the_contributions_add_up_to_the_estimate_at_each_instant(npcc, fine, estimator) -> None:
    run, small, _ = runs(npcc, fine, 1e-2, WHOLE)
    estimate = estimator.estimate(run)
    curves = ErrorSplitter(small).curves(estimate)
    worst = estimate.units.index(estimate.worst_unit)
    np.testing.assert_allclose(curves.sum(axis=0), estimate.angles_deg[:, worst], atol=1e-12)
    causes = ErrorSplitter(small).split(estimate)
    total = sum(causes.record().values())
    assert max(causes.record().values()) < estimate.worst_deg * 1.2 < 1.2 * total


def test_without_truncation_the_error_is_that_of_linearization(npcc, fine, estimator) -> None:
    """The area is the one in which errors travel; its own truncation is a thousand times smaller."""
    small = SmallModels(fine)
    run = gf.simulate_adaptive(npcc, small, ALWAYS, [FAULT], T_END)
    estimate = estimator.estimate(run)
    causes = ErrorSplitter(small).split(estimate)
    assert causes.linearization_deg == pytest.approx(estimate.worst_deg, rel=0.02)
    assert causes.truncation_deg < 0.05 * estimate.worst_deg


def test_what_a_swing_that_is_small_lacks_is_not_linearization(npcc, fine, estimator) -> None:
    """Linearization goes with the square of the swing, truncation with the swing itself."""
    area = next(fine.truncated([1e-1]))
    small, found = SmallModels(area), {}
    for duration in (0.1, 0.01):
        run = gf.simulate_adaptive(npcc, small, ALWAYS, [gf.BusFault(21, duration=duration)], T_END)
        found[duration] = ErrorSplitter(small).split(estimator.estimate(run))
    large, little = found[0.1], found[0.01]
    swing = little.truncation_deg / large.truncation_deg
    assert swing < 0.2
    assert little.linearization_deg / large.linearization_deg < 0.3 * swing
    assert little.linearization_deg < 0.05 * little.truncation_deg
