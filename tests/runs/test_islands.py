"""Parts of a grid on their own: their speeds, what they cost, and events where nothing is energized."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from cases import POWER_MW, H, one_machine_infinite_bus
from row_of_areas import row_of_areas

import gridfold as gf
from gridfold.runs.summary import summarize
from gridfold.study.study_file import parse_study
from gridfold.study.summary import trajectory_figures

ALONE = gf.BranchTrip("1-2", 0.5)
SEPARATE = [gf.BranchTrip("15-25:1", 0.5), gf.BranchTrip("15-25:2", 0.5)]


@pytest.fixture(scope="module")
def smib() -> gf.DetailedModel:
    """A machine without losses or damping that sends 80 MW to an infinite bus."""
    return gf.build_model(one_machine_infinite_bus())


@pytest.fixture(scope="module")
def row() -> gf.DetailedModel:
    """Three areas in a row."""
    return gf.build_model(row_of_areas(3))


@pytest.fixture(scope="module")
def ladder(row: gf.DetailedModel) -> gf.SmallModels:
    parts = gf.partition(row, [*range(11, 16), *range(21, 26)])
    return gf.SmallModels(gf.Ladder((gf.fold(parts),)))


def texts(run: gf.Trajectory) -> list[str]:
    return [notice.text for notice in run.notices]


@pytest.mark.parametrize("limit", [0.12, 0.05])
def test_a_machine_alone_without_load_is_off_speed_when_its_power_has_made_it_so(smib, limit):
    """Nothing brakes it: its speed is 1 + P t / (2 H)."""
    rate = POWER_MW / 100 / (2 * H)
    criterion = gf.SynchronismCriterion(speed_limit=limit)
    run = gf.simulate(smib, [ALONE], 5.0, criterion=criterion)
    assert (run.status, run.culprit) == (gf.Status.OFF_SPEED, "speed:1:1")
    assert run.times[-1] == pytest.approx(0.5 + limit / rate, abs=0.0101)
    assert run.signal("speed")[-1, 0] == pytest.approx(1 + rate * (run.times[-1] - 0.5), rel=1e-9)
    figures = trajectory_figures(run)
    assert (figures["status"], figures["stable"]) == ("off speed", False)
    assert figures["critical_machine"] == "1:1"
    assert figures["reason"].startswith("off speed: speed:1:1 at ")
    highest = summarize(run).frequency.highest_hz
    assert highest == pytest.approx(60 * run.signal("speed").max(), rel=1e-12)


def test_the_speed_limit_is_at_12_percent_and_may_be_wide_open(smib):
    assert gf.SynchronismCriterion() == gf.SynchronismCriterion(180.0, 0.12)
    assert "0.12 p.u. from synchronous speed" in str(gf.SynchronismCriterion())
    run = gf.simulate(smib, [ALONE], 5.0, criterion=gf.SynchronismCriterion(speed_limit=math.inf))
    assert run.status is gf.Status.COMPLETED
    assert run.metadata()["speed_limit"] is None
    assert "speed" not in run.metadata()["criterion"]


@pytest.mark.parametrize("limit", [0.0, -0.1, math.nan])
def test_a_speed_limit_that_is_not_positive_is_refused(limit):
    with pytest.raises(gf.OptionError, match="speed limit"):
        gf.SynchronismCriterion(speed_limit=limit)


def test_a_study_file_sets_the_speed_limit():
    criterion = parse_study({"run": {"speed_limit": 0.3, "angle_limit_deg": 120.0}}).run.criterion
    assert criterion == gf.SynchronismCriterion(120.0, 0.3)


def test_an_island_with_too_much_load_is_off_speed_from_below(smib):
    run = gf.simulate(smib, [ALONE, gf.LoadStep(1, 0.5, active_mw=300.0)], 16.0)
    assert run.status is gf.Status.OFF_SPEED
    assert run.signal("speed")[-1, 0] < 0.88


def test_an_island_that_settles_within_the_limit_is_stable(row):
    run = gf.simulate(row, SEPARATE, 10.0)
    assert run.status is gf.Status.COMPLETED
    assert trajectory_figures(run)["stable"]


def test_frequencies_are_those_of_the_centre_of_inertia_of_each_island(row):
    run = gf.simulate(row, SEPARATE, 5.0)
    inertia, speed = row.inertia(row.machines), run.signal("speed")
    before = run.times < 0.5 - 1e-9
    every = speed @ inertia / inertia.sum()
    parts = [speed[:, k] @ inertia[k] / inertia[k].sum() for k in (slice(0, 2), slice(2, 6))]
    expected = 60 * np.concatenate([every[before], *(part[~before] for part in parts)])
    found = summarize(run).frequency
    assert found.lowest_hz == pytest.approx(expected.min(), rel=1e-12)
    assert found.highest_hz == pytest.approx(expected.max(), rel=1e-12)
    at = int(np.argmax(parts[1])), int(np.argmin(parts[0]))
    assert {found.highest_at, found.lowest_at} <= {*run.times[list(at)], *run.times[[0]]} | {
        run.times[int(np.argmax(parts[0]))],
        run.times[int(np.argmin(parts[1]))],
    }


def test_islanded_generation_and_lost_load_are_those_before_the_disturbance(row):
    power = {unit.key: p.real for unit, p in zip(
        row.case.generators, row.power_flow.unit_power * row.case.base_mva, strict=True
    )}  # fmt: skip
    cut = summarize(gf.simulate(row, SEPARATE, 1.0)).cut_off
    units = [gf.UnitKey(11, "1"), gf.UnitKey(12, "1")]
    assert (cut.islands, cut.lost_load_mw) == (2, 0.0)
    assert cut.islanded_mw == pytest.approx(sum(power[unit] for unit in units), rel=1e-12)
    tripped = [*SEPARATE, gf.MachineTrip(11, "1", 0.6)]
    cut = summarize(gf.simulate(row, tripped, 0.7)).cut_off
    assert cut.islanded_mw == pytest.approx(power[units[1]], rel=1e-12)
    run = gf.simulate(row, [*tripped, gf.MachineTrip(12, "1", 0.65)], 0.7)
    cut = summarize(run).cut_off
    assert (cut.islands, cut.islanded_mw) == (1, 0.0)
    assert cut.lost_load_mw == pytest.approx(1290.0, rel=1e-12)
    figures = trajectory_figures(run)
    assert (figures["islands"], figures["islanded_mw"]) == (1, 0.0)
    assert figures["lost_load_mw"] == cut.lost_load_mw


def test_where_nothing_is_energized_any_more_nothing_is_stable(row):
    events = [gf.MachineTrip(unit.bus, unit.id, 0.2) for unit in row.machines]
    run = gf.simulate(row, events, 0.5)
    figures = trajectory_figures(run)
    assert (figures["islands"], figures["stable"]) == (0, False)
    assert figures["lost_load_mw"] == pytest.approx(3 * 1390.0)
    assert "de-energized" in figures["reason"]
    assert "lowest_voltage" not in figures


def test_a_reduced_model_is_off_speed_when_the_detailed_one_is(row, ladder):
    events = [gf.BranchTrip("11-13", 0.5)]
    detailed = gf.simulate(row, events, 10.0)
    assert (detailed.status, detailed.culprit) == (gf.Status.OFF_SPEED, "speed:11:1")
    for rule in (gf.SwitchingRule(0.0), gf.SwitchingRule(67.0)):
        run = gf.simulate_adaptive(row, ladder, rule, events, 10.0).trajectory
        assert (run.status, run.culprit) == (detailed.status, detailed.culprit)
        assert run.times[-1] == pytest.approx(detailed.times[-1], abs=0.05)


def test_a_small_model_watches_the_speeds_of_its_linear_machines(row, ladder):
    """A load that the governors cannot carry slows down the whole grid, far machines included."""
    events = [gf.LoadStep(35, 0.5, active_mw=900.0)]
    criterion = gf.SynchronismCriterion(speed_limit=0.002)
    detailed = gf.simulate(row, events, 10.0, criterion=criterion)
    run = gf.simulate_adaptive(
        row, ladder, gf.SwitchingRule(math.inf), events, 10.0, criterion=criterion
    )
    assert detailed.status is run.trajectory.status is gf.Status.OFF_SPEED
    assert run.trajectory.times[-1] == pytest.approx(detailed.times[-1], abs=0.1)


DEAD = [gf.BusFault(14, start=0.1, duration=0.05, trip_bus=True)]


@pytest.mark.parametrize(
    ("event", "text"),
    [
        (gf.BusFault(15, start=0.4, duration=0.05), "fault at bus 15: no effect, bus 15 de-energized"),
        (gf.LoadStep(15, 0.4, 10.0), "load at bus 15 +10 MW +0 Mvar: no effect, bus 15 de-energized"),
        (gf.LoadStep(12, 0.4), "load at bus 12 +0 MW +0 Mvar: no effect, it was so already"),
        (gf.BranchTrip("14-15", 0.4), "branch 14-15 tripped: no effect, it was so already"),
        (gf.MachineTrip(12, "1", 0.4), None),
        (gf.BranchTrip("11-13", 0.4), None),
    ],
)  # fmt: skip
def test_events_where_nothing_is_energized_say_that_they_had_no_effect(row, event, text):
    dead = [*DEAD, gf.BranchTrip("15-25:1", 0.2), gf.BranchTrip("15-25:2", 0.2)]
    run = gf.simulate(row, [*dead, event], 0.5)
    idle = [line for line in texts(run) if "no effect" in line]
    assert idle == ([] if text is None else [text])
    without = gf.simulate(row, dead, 0.5)
    if text is not None:
        np.testing.assert_allclose(run.states[-1], without.states[-1], atol=1e-9)


def test_reclosing_between_dead_buses_and_faults_on_dead_branches_have_no_effect(smib):
    case = smib.case
    far = replace(
        case,
        buses=(*case.buses, gf.Bus(3), gf.Bus(4)),
        branches=(
            *case.branches, gf.Branch(2, 3, reactance=0.1), gf.Branch(3, 4, reactance=0.1),
        ),
    )  # fmt: skip
    events = [
        gf.BranchTrip("2-3", 0.1),
        gf.BranchFault("3-4", 0.2, 0.05, 0.5, trip=False),
        gf.BranchTrip("3-4", 0.3),
        gf.BranchReclose("3-4", 0.4),
    ]
    run = gf.simulate(gf.build_model(far), events, 0.5)
    named = ("fault on branch 3-4", "branch 3-4 tripped", "branch 3-4 reclosed")
    idle = [line for line in texts(run) if "no effect" in line]
    assert idle == [f"{name}: no effect, buses 3, 4 de-energized" for name in named]


def test_what_is_off_already_can_be_tripped_without_effect(smib, row):
    run = gf.simulate(smib, [ALONE, gf.BranchTrip("2-1", 0.6)], 0.7)
    assert "branch 2-1 tripped: no effect, it was so already" in texts(run)
    twice = [gf.MachineTrip(11, "1", 0.1), gf.MachineTrip(11, "1", 0.2)]
    assert texts(gf.simulate(row, twice, 0.3))[-1] == (
        "machine 11:1 tripped: no effect, it was so already"
    )
