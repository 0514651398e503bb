"""Reduced models of grids with infinite buses: where they are, and what there is to compare."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import replace

import numpy as np
import pytest
from row_of_areas import row_of_areas

import gridfold as gf
from gridfold.equivalents.calibrate import ThresholdKind
from gridfold.equivalents.choice import ModelSettings, RetainSettings
from gridfold.equivalents.model_kind import ModelKind
from gridfold.partition import couple

FAULT = gf.BusFault(15, duration=0.02)
FIRST = range(11, 16)


def with_infinite(buses: Collection[int], count: int = 2) -> gf.DetailedModel:
    """Areas in a row in which the machines at `buses` are infinite buses."""
    case = row_of_areas(count)
    kept = tuple(record for record in case.devices if record.bus not in buses)
    added = tuple(
        gf.DeviceRecord("infinite_bus", bus, "1", {"reactance": 0.25}) for bus in sorted(buses)
    )
    return gf.build_model(replace(case, devices=(*kept, *added)))


@pytest.fixture(scope="module")
def one_far() -> gf.Partition:
    """One of the two external machines, that with the smallest column norm, is an infinite bus."""
    return gf.partition(with_infinite([21]), FIRST)


@pytest.fixture(scope="module")
def all_far() -> gf.Partition:
    """Both are."""
    return gf.partition(with_infinite([21, 22]), FIRST)


def largest_error(parts: gf.Partition, family: object, rule: gf.SwitchingRule) -> float:
    """Largest error of a rotor angle in the study area in degrees."""
    detailed = gf.simulate(parts.model, [FAULT], 2.0)
    run = gf.simulate_adaptive(parts.model, family, rule, [FAULT], 2.0).trajectory
    assert run.status is detailed.status is gf.Status.COMPLETED
    units = [unit for unit in parts.study_units if unit in parts.model.machines]
    return max(error.largest_deg for error in gf.compare(detailed, run, units).units)


def test_the_reference_is_the_furthest_machine_that_has_a_rotor(one_far):
    found = couple(one_far)
    assert str(found.units[int(np.argmin(found.norms))]) == "21:1"
    assert str(found.reference) == "22:1"


@pytest.mark.parametrize("kind", [gf.reduce, gf.whole_system])
def test_models_of_the_paper_run_beside_an_infinite_bus(one_far, kind):
    family = kind(one_far)
    assert str(family.reference_unit) == "22:1"
    assert largest_error(one_far, family, gf.SwitchingRule(0.0)) < 0.5
    assert largest_error(one_far, family, gf.SwitchingRule(20.0)) < 5.0


def test_a_ladder_runs_beside_an_infinite_bus(one_far):
    ladder = gf.Ladder((gf.fold(one_far),), whole=True)
    assert str(ladder.reference_unit) == "22:1"
    assert largest_error(one_far, ladder, gf.SwitchingRule(0.0)) < 0.3
    assert largest_error(one_far, ladder, gf.SwitchingRule(math.inf, whole_deg=5.0)) < 2.0


def test_where_infinite_buses_alone_are_left_to_be_linear_there_is_no_state_to_reduce(one_far):
    units = [unit for unit in one_far.external_units if str(unit) == "22:1"]
    with pytest.raises(gf.OptionError, match="infinite buses: there is no state to reduce"):
        gf.fold(one_far, units)
    with pytest.raises(gf.OptionError, match="no state to reduce"):
        ModelSettings(ModelKind.ADAPTIVE, RetainSettings(count=1)).build(one_far)


def test_an_infinite_bus_may_be_among_the_retained(one_far):
    infinite = [unit for unit in one_far.external_units if str(unit) == "21:1"]
    ladder = gf.Ladder((gf.fold(one_far, infinite),))
    assert largest_error(one_far, ladder, gf.SwitchingRule(math.inf)) < 2.0


@pytest.mark.parametrize("count", [0, 2])
def test_machines_are_ranked_beside_an_infinite_bus(count):
    one_far = gf.partition(with_infinite([21], 3), FIRST)
    settings = ModelSettings(ModelKind.ADAPTIVE, RetainSettings(count=count))
    family = settings.build(one_far)
    assert largest_error(one_far, family, settings.rule) < 2.0


def test_thresholds_are_calibrated_beside_an_infinite_bus(one_far):
    found = gf.calibrate(one_far, [FAULT], 2.0, workers=1)
    assert set(found.thresholds) == set(ThresholdKind)
    assert all(threshold.value is not None for threshold in found.thresholds.values())


@pytest.mark.parametrize("kind", [gf.reduce, gf.whole_system])
@pytest.mark.parametrize("angle", [0.0, 10.0])
def test_an_external_area_of_infinite_buses_is_exact(all_far, kind, angle):
    """Nothing in it moves, so there is nothing that a reduction could lose."""
    family = kind(all_far)
    assert family.reference_unit is None
    exact = kind is gf.reduce or angle == 0
    assert largest_error(all_far, family, gf.SwitchingRule(angle)) < (1e-6 if exact else 5.0)


def test_deviations_from_infinite_buses_are_those_from_the_synchronous_frame(all_far):
    """The exact model takes over at the step at which the angle itself passes the threshold."""
    rule = gf.SwitchingRule(10.0)
    done = gf.simulate_adaptive(all_far.model, gf.reduce(all_far), rule, [FAULT], 2.0)
    angles = done.trajectory.rotor_angle_deg(all_far.study_units)
    worst = np.abs(angles - angles[0]).max(axis=1)
    for switch in done.switches[2:]:
        row = int(np.argmin(np.abs(done.trajectory.times - switch.time)))
        above = worst[row] > 10.0
        assert above is np.True_ if switch.after.value == "hybrid" else not above
    assert len(done.switches) > 2


def test_an_external_area_of_infinite_buses_has_no_state_to_fold(all_far):
    with pytest.raises(gf.OptionError, match="no state to reduce"):
        gf.fold(all_far)


def test_a_study_area_without_a_rotor_is_simulated_but_not_compared():
    parts = gf.partition(with_infinite([11, 12]), FIRST)
    model, ladder = parts.model, gf.Ladder((gf.fold(parts),))
    run = gf.simulate_adaptive(model, ladder, gf.SwitchingRule(67.0), [FAULT], 1.0).trajectory
    detailed = gf.simulate(model, [FAULT], 1.0)
    assert np.abs(run.rotor_angle_deg()[-1] - detailed.rotor_angle_deg()[-1]).max() < 2.0
    with pytest.raises(gf.OptionError, match="no unit among those asked for has a rotor"):
        gf.compare(detailed, run, parts.study_units)
    with pytest.raises(gf.OptionError, match="no angles to err in"):
        gf.error_budget(ladder, gf.SwitchingRule(0.0), [FAULT], 0.2)
    with pytest.raises(gf.OptionError, match="nothing can be compared"):
        gf.calibrate(parts, [FAULT], 1.0)


def test_a_grid_of_infinite_buses_alone_runs_and_has_no_modes():
    model = with_infinite([11, 12, 21, 22])
    parts = gf.partition(model, FIRST)
    run = gf.simulate(model, [FAULT], 0.5)
    assert run.status is gf.Status.COMPLETED
    healthy = np.abs(run.bus_voltage())[[0, -1]]
    assert healthy[1] == pytest.approx(np.abs(model.power_flow.voltage), abs=1e-8)
    modes = gf.small_signal(model)
    assert (len(modes.eigenvalues), modes.rightmost) == (0, None)
    assert gf.critical_clearing_time(model, FAULT, 0.1, 0.2, 0.5).bounded is False
    for family in (gf.reduce(parts), gf.whole_system(parts)):
        for angle in (0.0, math.inf):
            done = gf.simulate_adaptive(model, family, gf.SwitchingRule(angle), [FAULT], 0.5)
            np.testing.assert_allclose(
                np.abs(done.trajectory.bus_voltage()), np.abs(run.bus_voltage()), atol=1e-9
            )


def test_models_without_states_are_saved_and_looked_for_in_other_topologies(tmp_path):
    parts = gf.partition(with_infinite([11, 12, 21, 22]), FIRST)
    gf.save_reduced(tmp_path / "none.npz", gf.reduce(parts), 1.0)
    family = gf.load_reduced(tmp_path / "none.npz", parts.model).family
    trip = [gf.MachineTrip(12, "1", 0.1)]
    for each in (family, gf.whole_system(parts)):
        done = gf.simulate_adaptive(parts.model, each, gf.SwitchingRule(5.0), trip, 0.5)
        assert done.trajectory.status is gf.Status.COMPLETED
