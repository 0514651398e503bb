from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

import gridfold as gf
from gridfold.dynamics.equilibrium import find_equilibrium
from gridfold.equivalents.families import Mode
from gridfold.equivalents.ladder import Ladder
from gridfold.equivalents.switching import Band, SwitchingRule
from gridfold.errors import OptionError
from gridfold.grid.timeline import build_timeline

DETAILED, RETAINED, LINEAR, WHOLE = Mode.DETAILED, Mode.RETAINED, Mode.LINEAR, Mode.WHOLE
INFINITE = float("inf")


@pytest.fixture(scope="module")
def parts(npcc_parts):
    return npcc_parts


@pytest.fixture(scope="module")
def ladder(npcc_retained, npcc_linear):
    return Ladder((npcc_retained, npcc_linear), whole=True)


def costs(detailed, retained, linear, whole):
    return {DETAILED: detailed, RETAINED: retained, LINEAR: linear, WHOLE: whole}


@pytest.mark.parametrize(
    ("seconds", "expected"),
    [
        (costs(4, 3, 2, 1), (RETAINED, LINEAR, WHOLE)),
        (costs(4, 5, 2, 1), (DETAILED, LINEAR, WHOLE)),
        (costs(4, 2, 3, 1), (RETAINED, RETAINED, WHOLE)),
        (costs(4, 2, 2, 1), (RETAINED, RETAINED, WHOLE)),
        (costs(4, 3, 1, 2), (RETAINED, LINEAR, LINEAR)),
        (costs(4, 5, 6, 1), (DETAILED, DETAILED, WHOLE)),
        (costs(1, 2, 3, 4), (DETAILED, DETAILED, DETAILED)),
    ],
)
def test_a_rung_that_is_not_cheaper_than_the_one_above_is_not_used(ladder, seconds, expected):
    assert replace(ladder, step_seconds=seconds).modes == expected


def test_without_costs_all_rungs_that_there_are_are_used(ladder):
    assert ladder.modes == ladder.rungs == (RETAINED, LINEAR, WHOLE)
    short = Ladder(ladder.areas[:1], whole=True)
    assert short.rungs == short.modes == (RETAINED, WHOLE)
    cheap = replace(short, step_seconds={DETAILED: 3.0, RETAINED: 2.0, WHOLE: 1.0})
    assert cheap.modes == (RETAINED, WHOLE)
    assert Ladder(ladder.areas[1:]).modes == (LINEAR,)


def test_costs_are_measured_for_the_detailed_model_and_every_rung(ladder):
    measured = ladder.measured()
    assert set(measured.step_seconds) == {DETAILED, RETAINED, LINEAR, WHOLE}
    assert all(seconds > 0 for seconds in measured.step_seconds.values())
    assert measured.step_seconds[WHOLE] < measured.step_seconds[DETAILED]
    assert WHOLE in measured.modes


def test_every_rung_comes_from_the_area_that_it_needs(npcc, ladder):
    n_exact = {RETAINED: 14, LINEAR: 9, WHOLE: 0}
    for mode, count in n_exact.items():
        assert len(npcc.machines) - len(ladder.build(mode, npcc).unlimited) == count
    order = ladder.build(WHOLE, npcc).system.compiled.n_states
    assert order == 9 * 9 + ladder.areas[1].bases.order
    short = Ladder(ladder.areas[:1], whole=True)
    assert short.build(WHOLE, npcc).system.compiled.n_states > order


def test_a_ladder_moves_with_both_areas_and_keeps_its_costs(npcc, ladder):
    trip = build_timeline(npcc.case, [gf.BranchTrip("3-2")], 1.0)[-1].state
    model = npcc.for_state(trip)
    point = find_equilibrium(model, npcc.x0)
    known = replace(ladder, step_seconds=costs(4, 3, 2, 1))
    moved = known.moved(model, point)
    for mode in (RETAINED, LINEAR):
        assert moved.how(mode).startswith("linearized anew")
        coordinates = moved.build(mode, model).coordinates
        again = coordinates.lift(coordinates.restrict(point.x))
        np.testing.assert_allclose(again, point.x, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(moved.origin, point.x)
    assert moved.step_seconds == known.step_seconds
    assert moved.modes == ladder.moved(model, point).modes == (RETAINED, LINEAR, LINEAR)


def test_two_models_have_the_bands_of_the_paper():
    pair = (Mode.HYBRID, LINEAR)
    assert SwitchingRule(67.0).bands(pair) == (
        Band(Mode.HYBRID, INFINITE, 67.0),
        Band(LINEAR, 67.0, 0.0),
    )
    assert SwitchingRule(0.0).bands(pair) == (Band(Mode.HYBRID, INFINITE, 0.0),)
    assert SwitchingRule(INFINITE).bands(pair) == (Band(LINEAR, INFINITE, 0.0),)
    assert SwitchingRule(67.0, whole_deg=5.0).bands(pair) == SwitchingRule(67.0).bands(pair)


@pytest.mark.parametrize(
    ("angle", "whole", "expected"),
    [
        (60.0, 6.0, [(RETAINED, INFINITE, 60.0), (LINEAR, 60.0, 6.0), (WHOLE, 6.0, 0.0)]),
        (60.0, 0.0, [(RETAINED, INFINITE, 60.0), (LINEAR, 60.0, 0.0)]),
        (0.0, 0.0, [(RETAINED, INFINITE, 0.0)]),
        (0.0, 6.0, [(RETAINED, INFINITE, 0.0)]),
        (INFINITE, 0.0, [(LINEAR, INFINITE, 0.0)]),
        (INFINITE, 6.0, [(LINEAR, INFINITE, 6.0), (WHOLE, 6.0, 0.0)]),
        (INFINITE, INFINITE, [(WHOLE, INFINITE, 0.0)]),
        (5.0, 50.0, [(RETAINED, INFINITE, 5.0), (WHOLE, 5.0, 0.0)]),
    ],
)
def test_three_models_have_up_to_three_bands(angle, whole, expected):
    bands = SwitchingRule(angle, whole_deg=whole).bands((RETAINED, LINEAR, WHOLE))
    assert bands == tuple(Band(*band) for band in expected)


@pytest.mark.parametrize(
    ("modes", "expected"),
    [
        ((DETAILED, DETAILED, WHOLE), [(DETAILED, INFINITE, 6.0), (WHOLE, 6.0, 0.0)]),
        ((RETAINED, RETAINED, RETAINED), [(RETAINED, INFINITE, 0.0)]),
        ((RETAINED, LINEAR, LINEAR), [(RETAINED, INFINITE, 60.0), (LINEAR, 60.0, 0.0)]),
        ((RETAINED, WHOLE), [(RETAINED, INFINITE, 60.0), (WHOLE, 60.0, 0.0)]),
        ((RETAINED,), [(RETAINED, INFINITE, 0.0)]),
    ],
)
def test_neighbours_with_the_same_model_are_one_band(modes, expected):
    bands = SwitchingRule(60.0, whole_deg=6.0).bands(modes)
    assert bands == tuple(Band(*band) for band in expected)


def test_bands_cover_all_deviations_once():
    for angle in (0.0, 3.0, 60.0, INFINITE):
        for whole in (0.0, 3.0, 100.0, INFINITE):
            bands = SwitchingRule(angle, whole_deg=whole).bands((RETAINED, LINEAR, WHOLE))
            assert bands[0].highest == INFINITE
            assert bands[-1].lowest == 0.0
            for upper, lower in pairwise(bands):
                assert upper.lowest == lower.highest
            assert all(band.highest > band.lowest for band in bands)


@pytest.mark.parametrize(
    "options", [{"angle_deg": -1.0}, {"whole_deg": -1.0}, {"dwell": -0.1}, {"dwell": INFINITE}]
)
def test_rules_that_make_no_sense_are_refused(options):
    name = "angle threshold" if "angle_deg" in options else next(iter(options))
    with pytest.raises(OptionError, match=name):
        SwitchingRule(**({"angle_deg": 60.0} | options))


FAULT = gf.BusFault(3, start=0.5, duration=0.2)


def run_on(parts, ladder, rule):
    return gf.simulate_adaptive(parts.model, ladder, rule, [FAULT], 10.0)


@pytest.fixture(scope="module")
def patient(parts, ladder):
    return run_on(parts, ladder, SwitchingRule(40.0, whole_deg=5.0, dwell=0.3))


def test_a_run_climbs_after_the_fault_and_ends_linear_throughout(patient):
    assert patient.trajectory.status is gf.Status.COMPLETED
    assert patient.modes[0] is WHOLE
    assert DETAILED in patient.modes
    assert LINEAR in patient.modes
    assert patient.modes[-1] is WHOLE


def test_every_rung_is_used_within_its_band(parts, ladder, patient):
    angles = patient.trajectory.rotor_angle_deg(parts.study_units, ladder.reference_unit)
    worst, times = np.abs(angles - angles[0]).max(axis=1), patient.trajectory.times
    starts = [switch.time for switch in patient.switches]
    highest = {DETAILED: INFINITE, RETAINED: INFINITE, LINEAR: 40.0, WHOLE: 5.0}
    for switch, end in zip(patient.switches, [*starts[1:], 10.0], strict=True):
        inside = (times > switch.time + 0.011) & (times < end - 0.011)
        assert (worst[inside] <= highest[switch.after] + 1e-6).all()


def test_a_cheaper_model_takes_over_only_after_the_dwell(parts, ladder, patient):
    order = [DETAILED, RETAINED, LINEAR, WHOLE]
    angles = patient.trajectory.rotor_angle_deg(parts.study_units, ladder.reference_unit)
    worst, times = np.abs(angles - angles[0]).max(axis=1), patient.trajectory.times
    down = [
        switch
        for switch in patient.switches
        if switch.before in (RETAINED, LINEAR)
        and order.index(switch.after) > order.index(switch.before)
    ]
    assert down
    for switch in down:
        limit = 5.0 if switch.after is WHOLE else 40.0
        before = (times > switch.time - 0.3 + 0.011) & (times < switch.time)
        assert (worst[before] <= limit + 1e-6).all()


def test_without_a_dwell_there_are_more_switches(parts, ladder, patient):
    hasty = run_on(parts, ladder, SwitchingRule(40.0, whole_deg=5.0))
    assert len(hasty.switches) > len(patient.switches)


def test_all_rungs_together_stay_close_to_the_detailed_run(parts, patient):
    detailed = gf.simulate(parts.model, [FAULT], 10.0)
    assert gf.compare(detailed, patient.trajectory, parts.study_units).worst.rms_deg < 1.0


@pytest.mark.parametrize("rung", [RETAINED, LINEAR])
def test_voltages_of_a_small_model_are_those_of_the_whole_state_it_stands_for(parts, ladder, rung):
    rule = {RETAINED: SwitchingRule(0.0, INFINITE), LINEAR: SwitchingRule(INFINITE, INFINITE)}[rung]
    fault = [gf.BusFault(3, duration=0.1)]
    run = gf.simulate_adaptive(parts.model, gf.SmallModels(ladder), rule, fault, 0.5)
    part = run.trajectory.parts[-1]
    assert part.piece.segment.coordinates is not None
    voltages = part.bus_voltages()
    expected = part.model.bus_voltages(part.piece.full_states[part.rows])
    np.testing.assert_allclose(voltages, expected, rtol=0, atol=1e-12)
    assert np.ptp(np.abs(voltages), axis=0).max() > 1e-2
