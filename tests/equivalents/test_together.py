"""Adaptive runs side by side are the runs that each disturbance has by itself."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from limited_cases import npcc_with_sexs

import gridfold as gf
from gridfold.equivalents.adaptive import AdaptiveRun, simulate_adaptive
from gridfold.equivalents.families import Mode
from gridfold.equivalents.folded import FoldedArea, fold
from gridfold.equivalents.together import simulate_adaptive_batch
from gridfold.errors import EventError, OptionError
from gridfold.runs.summary import summarize

DEGREE = 1e-9
T_END = 4.0
EXACT, LINEAR = gf.SwitchingRule(0.0), gf.SwitchingRule(5.0, np.inf, dwell=0.5)
#: Clearing times on and off the grid of steps, one machine that loses synchronism, a start at rest.
FAULTS: tuple[list[gf.Event], ...] = (
    [gf.BusFault(9, 0.0, 0.1)],
    [gf.BusFault(9, 0.1033, 0.0871, 0.001, 0.02)],
    [gf.BusFault(21, 0.0, 0.05)],
    [gf.BusFault(23, 0.1, 1.0)],
    [gf.BusFault(40, 0.25, 0.2)],
    [gf.BusFault(3, 0.0, 0.15)],
    [],
    [gf.BusFault(120, 0.0, 0.1)],
    [gf.BusFault(30, 0.0, 0.1234)],
    [gf.BusFault(5, 0.0, 0.1), gf.BusFault(9, 1.0, 0.1)],
)


def together(
    model: gf.DetailedModel,
    family: gf.SmallModels,
    rule: gf.SwitchingRule,
    disturbances: Sequence[Sequence[gf.Event]],
    stepper: gf.Stepper | None = None,
) -> list[AdaptiveRun]:
    """Runs side by side, of which all is compared with the runs one by one."""
    found = dict(simulate_adaptive_batch(model, family, rule, disturbances, T_END, stepper))
    runs = []
    for number, events in enumerate(disturbances):
        run, alone = found[number], simulate_adaptive(model, family, rule, events, T_END, stepper)
        assert isinstance(run, AdaptiveRun), run
        assert run.modes == alone.modes
        here, there = run.trajectory, alone.trajectory
        assert np.array_equal(here.times, there.times), events
        assert (here.status, here.culprit) == (there.status, there.culprit), events
        assert here.notices == there.notices
        assert [(s.time, s.before, s.after, s.reason) for s in run.switches] == [
            (s.time, s.before, s.after, s.reason) for s in alone.switches
        ]
        apart = np.abs(here.rotor_angle_deg() - there.rotor_angle_deg())
        assert np.nanmax(apart, initial=0.0) < DEGREE, events
        assert np.abs(here.states - there.states).max() < 1e-9
        runs.append(run)
    return runs


@pytest.fixture(scope="module")
def ladder(npcc_retained: FoldedArea, npcc_linear: FoldedArea) -> gf.SmallModels:
    return gf.SmallModels(gf.Ladder((npcc_retained, npcc_linear), whole=True))


def test_retained_runs_are_those_that_they_are_alone(
    npcc: gf.DetailedModel, npcc_retained: FoldedArea
) -> None:
    runs = together(npcc, gf.SmallModels(npcc_retained), EXACT, FAULTS)
    assert {mode for run in runs for mode in run.modes} == {Mode.DETAILED, Mode.RETAINED}
    assert {run.trajectory.status.value for run in runs} == {"completed", "lost synchronism"}


def test_the_adams_rule_has_no_longer_memory_than_alone(
    npcc: gf.DetailedModel, npcc_retained: FoldedArea
) -> None:
    small = gf.SmallModels(npcc_retained)
    together(npcc, small, EXACT, FAULTS, gf.AdamsBashforthMoulton4(0.01))


def test_linear_runs_leave_the_columns_where_everything_is_linear(
    npcc: gf.DetailedModel, npcc_linear: FoldedArea
) -> None:
    small = gf.SmallModels(gf.Ladder((npcc_linear,), whole=True))
    runs = together(npcc, small, LINEAR, FAULTS)
    assert {mode for run in runs for mode in run.modes} == {
        Mode.DETAILED, Mode.LINEAR, Mode.WHOLE,
    }  # fmt: skip


def test_the_ladder_is_climbed_alike(npcc: gf.DetailedModel, ladder: gf.SmallModels) -> None:
    rule = gf.SwitchingRule(20.0, whole_deg=5.0, dwell=0.5)
    runs = together(npcc, ladder, rule, FAULTS)
    assert len({mode for run in runs for mode in run.modes}) == 4


def test_other_networks_and_relays_go_their_own_way(
    npcc: gf.DetailedModel, ladder: gf.SmallModels
) -> None:
    branch = npcc.case.branches[3]
    unit = next(unit for unit in npcc.machines if unit.bus < 37)
    gone = [gf.BranchFault(f"{branch.from_bus}-{branch.to_bus}", 0.0, 0.1)]
    gone += [gf.MachineTrip(unit.bus, unit.id, 1.0)]
    planners = [gf.Redispatch(100.0, areas="1"), gf.BusFault(9, 0.1, 0.1)]
    settings = [gf.SetParameter(unit.bus, "voltage_reference", change=0.02, time=0.1, id=unit.id)]
    relay = [gf.BusFault(9, 0.1, 0.1), gf.DistanceRelay("9-8", 8)]
    together(npcc, ladder, EXACT, [*FAULTS[:4], gone, planners, settings, relay])


def test_a_member_that_meets_a_limit_goes_on_detailed(npcc: gf.DetailedModel) -> None:
    model = gf.build_model(npcc_with_sexs(npcc, 0.05))
    small = gf.SmallModels(fold(gf.partition(model, range(1, 37))))
    faults = [[gf.BusFault(bus, 0.0, 0.1)] for bus in (50, 58, 73, 100, 9, 21)]
    runs = together(model, small, EXACT, faults)
    reasons = [switch.reason for run in runs for switch in run.switches]
    assert any("reached" in reason for reason in reasons)
    assert any(run.modes.count(Mode.DETAILED) > 1 for run in runs)


def test_voltages_along_rows_are_the_extremes_of_all_buses(
    npcc: gf.DetailedModel, ladder: gf.SmallModels
) -> None:
    branch = npcc.case.branches[3]
    cleared = [gf.BranchFault(f"{branch.from_bus}-{branch.to_bus}", 0.0, 0.1)]
    found = dict(simulate_adaptive_batch(npcc, ladder, LINEAR, [*FAULTS[:4], cleared], T_END))
    for run in found.values():
        assert isinstance(run, AdaptiveRun)
        trajectory = run.trajectory
        assert trajectory.voltage_range is not None
        last = trajectory.models[-1].state
        rows = np.concatenate(
            [np.full(len(part), part.model.state == last) for part in trajectory.parts]
        )
        known = np.abs(trajectory.bus_voltage())[rows]
        figures = summarize(trajectory)
        assert figures.lowest_voltage is not None
        assert figures.highest_voltage is not None
        assert figures.lowest_voltage.value == pytest.approx(known.min(), abs=1e-11)
        assert figures.highest_voltage.value == pytest.approx(known.max(), abs=1e-11)
        row, bus = np.unravel_index(np.argmin(known), known.shape)
        assert figures.lowest_voltage.bus == npcc.case.buses[bus].number
        assert figures.lowest_voltage.at_seconds == trajectory.times[rows][row]


def test_what_is_wrong_with_one_is_told_and_stops_no_other(
    npcc: gf.DetailedModel, npcc_retained: FoldedArea
) -> None:
    wrong: list[list[gf.Event]] = [[gf.BusFault(9)], [gf.BusFault(99999)], [gf.BusFault(21)]]
    found = dict(simulate_adaptive_batch(npcc, npcc_retained, EXACT, wrong, 1.0))
    assert isinstance(found[1], EventError)
    assert isinstance(found[0], AdaptiveRun)
    assert isinstance(found[2], AdaptiveRun)


def test_runs_that_cannot_go_side_by_side_say_why(
    npcc: gf.DetailedModel, npcc_retained: FoldedArea
) -> None:
    with pytest.raises(OptionError, match="trapezoidal"):
        list(
            simulate_adaptive_batch(
                npcc, npcc_retained, EXACT, FAULTS, 1.0, gf.ImplicitTrapezoidal(0.01)
            )
        )
