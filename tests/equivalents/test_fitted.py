"""Ladders that are made for a tolerance, on NPCC and its sample swings."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import gridfold as gf
from gridfold.equivalents.choice import ModelSettings, ReductionSettings, RetainSettings
from gridfold.equivalents.families import Mode
from gridfold.equivalents.fit import Fit
from gridfold.equivalents.fitted import BOUNDS, TRUNCATION_SHARE, fit_ladder
from gridfold.equivalents.model_kind import ModelKind
from gridfold.equivalents.ranking import rank_retained
from gridfold.equivalents.saved import load_reduced, save_reduced
from gridfold.equivalents.tolerant import TolerantModel
from tests.conftest import FALLING

TOLERANCES = (10.0, 2.0, 0.5, 0.1)


@pytest.fixture(scope="module")
def ladders(npcc_parts, npcc_swings) -> dict[float, gf.Ladder]:
    """For each tolerance, with costs that no clock decides."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(gf.Ladder, "measured", lambda ladder, stepper=None: replace(
            ladder, step_seconds={m: FALLING[m] for m in (Mode.DETAILED, *ladder.rungs)}
        ))  # fmt: skip
        return {t: fit_ladder(npcc_parts, t, swings=npcc_swings) for t in TOLERANCES}


def true_error(npcc_parts, area, swings) -> float:
    """RMS of the worst angle against the centre of inertia along the swings, by runs of RK4."""
    model, worst = npcc_parts.model, 0.0
    small = area.build(area.mode, model)
    inertia = model.inertia(model.machines)
    study = [model.machines.index(unit) for unit in npcc_parts.study_units]
    slots = model.slots("rotor_angle", model.machines)
    for states in swings:
        v, found = small.coordinates.restrict(states[0]), []
        for _ in states[:-1]:
            found.append(small.coordinates.lift(v))
            k1 = small.system.compiled(v)
            k2 = small.system.compiled(v + 0.005 * k1)
            k3 = small.system.compiled(v + 0.005 * k2)
            v = v + 0.01 / 6 * (k1 + 2 * k2 + 2 * k3 + small.system.compiled(v + 0.01 * k3))
        apart = (np.array(found) - states[:-1])[:, slots]
        apart -= (apart @ inertia / inertia.sum())[:, None]
        worst = max(worst, np.degrees(np.sqrt((apart[:, study] ** 2).mean(axis=0))).max())
    return worst


def test_a_smaller_tolerance_takes_no_fewer_states_and_machines(ladders) -> None:
    orders = [ladders[t].areas[-1].bases.order for t in TOLERANCES]
    counts = [ladders[t].fit.count for t in TOLERANCES]
    angles = [ladders[t].fit.whole_deg for t in TOLERANCES]
    assert orders == sorted(orders)
    assert orders[0] < orders[-1]
    assert counts == sorted(counts)
    assert counts[0] == 0 < counts[-1]
    assert angles == sorted(angles, reverse=True)


def test_the_errors_that_decide_are_those_of_runs_along_the_samples(
    npcc_parts, npcc_swings, ladders
) -> None:
    for tolerance, ladder in ladders.items():
        fit = ladder.fit
        linear = true_error(npcc_parts, ladder.areas[-1], npcc_swings)
        assert fit.linear_deg == pytest.approx(linear, rel=1e-6)
        assert fit.truncation_deg <= TRUNCATION_SHARE * tolerance or fit.bound == BOUNDS[-1]
    taken = next(item for item in fit.tried if item.count == fit.count)
    near = true_error(npcc_parts, ladder.areas[0], npcc_swings)
    assert taken.error_deg == pytest.approx(near, rel=1e-6)
    assert near < linear


def test_the_machines_are_the_first_of_the_ranking(npcc_parts, npcc_swings, ladders) -> None:
    ladder = ladders[0.1]
    first = rank_retained(npcc_parts, npcc_swings).first(ladder.fit.count)
    assert set(ladder.retained) == set(first)


@pytest.mark.parametrize("bus", [3, 21, 29])
@pytest.mark.parametrize("tolerance", [0.1, 0.5])
def test_runs_with_the_ladder_keep_the_tolerance(npcc, npcc_parts, ladders, bus, tolerance) -> None:
    events = [gf.BusFault(bus, duration=0.15)]
    found = TolerantModel(ladders[tolerance], tolerance).run(npcc, events, 5.0)
    detailed = gf.simulate(npcc, events, 5.0)
    errors = gf.compare(detailed, found.trajectory, npcc_parts.study_units).units
    assert max(item.relative_rms_deg for item in errors) <= tolerance
    assert found.error_causes is not None


def test_a_tolerance_that_no_reduced_model_keeps_says_so(npcc, ladders) -> None:
    model = TolerantModel(ladders[0.1], 1e-4)
    assert not model.rules
    assert "no reduced model keeps a tolerance of 0.0001 degrees" in model.told
    found = model.run(npcc, [gf.BusFault(3, duration=0.1)], 1.0)
    assert found.modes == (Mode.DETAILED,) * len(found.modes)
    assert found.error_causes.linearization_deg == 0


def test_coarser_areas_are_those_that_a_reduction_of_its_own_gives(npcc_parts, npcc_swings) -> None:
    """By the transfer matrix at 1 Hz, from port voltages to port currents in logarithm and angle."""
    fine = gf.fold(npcc_parts, (), gf.BalancedTruncation(1e-5), swings=npcc_swings)
    for coarse in fine.truncated([1e-2, 1e-3]):
        bound = coarse.reducer.tolerance
        alone = gf.fold(npcc_parts, (), coarse.reducer, swings=npcc_swings)
        assert abs(coarse.bases.order - alone.bases.order) <= 1
        assert coarse.bases.bound <= bound
        assert coarse.bases.miss == pytest.approx(alone.bases.miss, rel=0.5)
    with pytest.raises(gf.OptionError, match=r"a bound of 9\.\de-06 give none of 1\.0e-06"):
        next(fine.truncated([1e-6]))


def test_options_that_are_given_win(npcc_parts, falling_costs) -> None:
    order = ReductionSettings(order=25)
    given = ModelSettings(ModelKind.ADAPTIVE, RetainSettings(count=3), order, tolerance_deg=0.5)
    ladder = given.build(npcc_parts)
    assert [area.reducer for area in ladder.areas] == [order.build(ported=True)] * 2
    assert len(ladder.retained) == 3
    assert (ladder.fit.bound, ladder.fit.count) == (None, None)
    only = ModelSettings(ModelKind.ADAPTIVE, RetainSettings(count=3), tolerance_deg=0.5)
    ladder = only.build(npcc_parts)
    assert ladder.fit.bound in BOUNDS
    assert len(ladder.retained) == 3


def test_what_was_chosen_is_made_again(npcc_parts, npcc_swings, ladders, falling_costs) -> None:
    for ladder in (ladders[2.0], ladders[0.1]):
        record = ladder.fit.record()
        again = fit_ladder(
            npcc_parts, record["tolerance_deg"], swings=npcc_swings, known=Fit.of_record(record)
        )
        assert again.fit == ladder.fit
        assert again.retained == ladder.retained
        for one, other in zip(again.areas, ladder.areas, strict=True):
            np.testing.assert_array_equal(one.bases.lift, other.bases.lift)


def test_a_file_keeps_what_was_chosen(npcc, ladders, tmp_path) -> None:
    save_reduced(tmp_path / "ladder.npz", ladders[0.5])
    family = load_reduced(tmp_path / "ladder.npz", npcc).family
    assert family.fit == ladders[0.5].fit
    adopted = ModelSettings(ModelKind.ADAPTIVE, tolerance_deg=0.5).adopt(family)
    record = ModelSettings(ModelKind.ADAPTIVE, tolerance_deg=0.5).record(adopted)
    assert record["fit"] == ladders[0.5].fit.record()


@pytest.mark.parametrize("wrong", [0.0, -1.0, float("nan"), float("inf")])
def test_a_tolerance_that_is_not_positive_makes_no_ladder(npcc_parts, wrong) -> None:
    with pytest.raises(gf.OptionError, match="is positive, not"):
        fit_ladder(npcc_parts, wrong)
