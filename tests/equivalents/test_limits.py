"""Limits of linear units: the run goes back to the detailed model, or tells of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from area_cases import Unreduced
from limited_cases import LIMITED, npcc_with_ieeet1, npcc_with_sexs

import gridfold as gf
from gridfold.dynamics.equilibrium import Equilibrium
from gridfold.equivalents.adaptive import LIMIT_DWELL, AdaptiveRun, simulate_adaptive
from gridfold.equivalents.compare import compare
from gridfold.equivalents.families import Mode, reduce_external, whole_system
from gridfold.equivalents.limit_watches import listed
from gridfold.equivalents.saved import load_reduced, save_reduced
from gridfold.equivalents.small_models import SmallModels
from gridfold.equivalents.switching import SwitchingRule
from gridfold.numerics.watch import BoxWatch
from gridfold.partition import Partition, partition

INFINITE = float("inf")
#: A short fault at whose clearing limits act, and are reached again later on.
FAULT = gf.BusFault(3, duration=0.3)
ROOM, T_END = 0.15, 4.0
KINDS = pytest.mark.parametrize("kind", ["partitioned", "whole"])
RULES = pytest.mark.parametrize("angle_deg", [0.0, 30.0, INFINITE])


def parts_of(model: gf.DetailedModel) -> Partition:
    return partition(model, range(1, 37))


def family_of(model: gf.DetailedModel, kind: str) -> SmallModels:
    parts = parts_of(model)
    return SmallModels(whole_system(parts) if kind == "whole" else reduce_external(parts))


@pytest.fixture(scope="module")
def limited(npcc) -> gf.DetailedModel:
    return gf.build_model(npcc_with_sexs(npcc, ROOM))


@pytest.fixture(scope="module")
def families(limited) -> dict[str, SmallModels]:
    return {kind: family_of(limited, kind) for kind in ("partitioned", "whole")}


@pytest.fixture(scope="module")
def wide(npcc) -> gf.DetailedModel:
    return gf.build_model(npcc_with_sexs(npcc, 1000.0))


@pytest.fixture(scope="module")
def wide_families(wide) -> dict[str, SmallModels]:
    return {kind: family_of(wide, kind) for kind in ("partitioned", "whole")}


@pytest.fixture(scope="module")
def at_limit(npcc) -> gf.DetailedModel:
    """A machine whose start is just between its limits."""
    return gf.build_model(npcc_with_sexs(npcc, 0.0, ["71:1"]))


@pytest.fixture(scope="module")
def detailed(limited) -> gf.Trajectory:
    return gf.simulate(limited, [FAULT], T_END)


def run_with(
    model: gf.DetailedModel, small: SmallModels, angle_deg: float, limits: bool = True
) -> AdaptiveRun:
    return simulate_adaptive(model, small, SwitchingRule(angle_deg, limits=limits), [FAULT], T_END)


def limit_texts(run: AdaptiveRun) -> list[str]:
    return [notice.text for notice in run.trajectory.notices if "limit" in notice.text]


def passed_texts(run: AdaptiveRun) -> list[str]:
    return [notice.text for notice in run.trajectory.notices if "wrong beyond" in notice.text]


@KINDS
@RULES
def test_a_limit_that_is_reached_brings_back_the_detailed_model_and_a_closer_run(
    limited, families, detailed, kind, angle_deg
):
    run = run_with(limited, families[kind], angle_deg)
    careless = run_with(limited, families[kind], angle_deg, limits=False)
    reached = [switch for switch in run.switches if switch.reason.endswith("reached")]
    later = [switch for switch in reached if switch.before is not Mode.DETAILED]
    assert all(switch.after is Mode.DETAILED for switch in reached)
    assert all("of sexs" in switch.reason for switch in reached)
    assert reached[0].before is Mode.DETAILED
    assert reached[0].time == FAULT.duration
    assert later
    assert passed_texts(run) == []
    assert not any("reached" in switch.reason for switch in careless.switches)
    assert any("EMAX of sexs" in text for text in passed_texts(careless))
    error, without = (compare(detailed, r.trajectory).worst.rms_deg for r in (run, careless))
    assert error < 0.5 * without


@KINDS
def test_no_linear_phase_goes_on_beyond_a_limit(limited, families, kind):
    run = run_with(limited, families[kind], INFINITE)
    units = [unit for unit in limited.machines if str(unit) in LIMITED]
    start = limited.x0[limited.slots("exciter_voltage", tuple(units))]
    for piece in run.trajectory.run.pieces:
        if piece.segment.coordinates is not None:
            states = piece.states_at(limited.slots("exciter_voltage", tuple(units)))
            assert np.all(np.abs(states[:-1] - start) <= ROOM + 2e-6)


def test_the_detailed_model_stays_for_the_dwell_time_at_least(limited, families):
    run = run_with(limited, families["partitioned"], INFINITE)
    ends = [*(switch.time for switch in run.switches[1:]), T_END]
    for switch, end in zip(run.switches, ends, strict=True):
        if switch.reason.endswith("reached"):
            assert end - switch.time >= LIMIT_DWELL - 1e-9 or end == T_END
    assert all(b.before is a.after for a, b in zip(run.switches, run.switches[1:], strict=False))


@KINDS
@RULES
def test_limits_far_away_change_nothing(wide, wide_families, kind, angle_deg):
    small = wide_families[kind]
    run, careless = (run_with(wide, small, angle_deg, limits) for limits in (True, False))
    watched = [len(piece.segment.switches) for piece in run.trajectory.run.pieces]
    free = [len(piece.segment.switches) for piece in careless.trajectory.run.pieces]
    assert sum(watched) > sum(free)
    assert run.switches == careless.switches
    np.testing.assert_array_equal(run.trajectory.states, careless.trajectory.states)
    assert run.trajectory.notices == careless.trajectory.notices


@KINDS
def test_without_limits_nothing_is_watched(npcc, kind):
    small = family_of(npcc, kind)
    run = run_with(npcc, small, 30.0)
    assert all(small.limits(npcc, mode) is None for mode in (Mode.LINEAR, Mode.HYBRID))
    switches = [watch for piece in run.trajectory.run.pieces for watch in piece.segment.switches]
    assert not any(isinstance(watch, BoxWatch) for watch in switches)
    assert small.family.at_limits == ()


def test_kept_units_follow_their_limits_in_the_hybrid_model(limited, detailed):
    small = SmallModels(reduce_external(parts_of(limited), Unreduced(), column_norm=0.0))
    run = run_with(limited, small, 0.0)
    assert [switch.after for switch in run.switches] == [Mode.DETAILED, Mode.HYBRID]
    assert small.limits(limited, Mode.HYBRID) is None
    assert small.limits(limited, Mode.LINEAR) is not None
    assert compare(detailed, run.trajectory).worst.largest_deg < 1e-7


def test_a_limit_that_bounds_no_state_is_seen_between_phases_and_told_after_the_run(npcc):
    model = gf.build_model(npcc_with_sexs(npcc, ROOM, exciter_time=0.0))
    small = family_of(model, "partitioned")
    limits = small.limits(model, Mode.LINEAR)
    assert limits is not None
    assert limits.watch is None
    assert len(limits.others) == 2 * len(LIMITED)
    run = run_with(model, small, INFINITE)
    assert run.switches[1].time == FAULT.duration
    assert run.switches[1].reason.endswith("reached")
    wider = gf.build_model(npcc_with_sexs(npcc, 2 * ROOM, exciter_time=0.0))
    told = run_with(wider, family_of(wider, "partitioned"), INFINITE)
    assert not any("reached" in switch.reason for switch in told.switches)
    assert any("EMAX of sexs 71:1" in text for text in passed_texts(told))
    times = [notice.time for notice in told.trajectory.notices]
    assert times == sorted(times)


@KINDS
def test_an_operating_point_at_a_limit_is_told_and_does_not_stop_the_linear_model(at_limit, kind):
    small = family_of(at_limit, kind)
    assert set(small.family.at_limits) == {"EMIN of sexs 71:1", "EMAX of sexs 71:1"}
    run = simulate_adaptive(at_limit, small, SwitchingRule(INFINITE), t_end=1.0)
    assert [switch.after for switch in run.switches] == [Mode.LINEAR]
    (text,) = limit_texts(run)
    assert "operating point" in text
    assert "EMAX of sexs 71:1" in text


def test_a_family_that_has_moved_tells_the_limits_of_its_new_operating_point(wide, wide_families):
    step = [gf.LoadStep(3, time=0.5, active_mw=100.0)]
    model, small = wide, wide_families["whole"]
    after = simulate_adaptive(model, small, SwitchingRule(6.0), step, 1.0).trajectory.models[-1]
    moved = small.family_for(after)
    assert moved is not None
    assert moved is not small.family
    assert moved.at_limits == ()
    # The same with the highest field voltage just where that operating point has it.
    slot = model.slots("exciter_voltage", (gf.UnitKey(71, "1"),))[0]
    needed = {"field_voltage_maximum": float(moved.origin[slot])}
    devices = tuple(
        replace(record, parameters={**record.parameters, **needed})
        if (record.model, str(record.key)) == ("sexs", "71:1")
        else record
        for record in model.case.devices
    )
    tight = gf.build_model(replace(model.case, devices=devices))
    family = whole_system(parts_of(tight))
    assert family.at_limits == ()
    point = Equilibrium(moved.origin, moved.rate)
    again = family.moved(tight.for_state(after.state), point)
    assert again.at_limits == ("EMAX of sexs 71:1",)


def test_the_regulator_of_a_commutator_exciter_is_watched(npcc):
    model = gf.build_model(npcc_with_ieeet1(npcc, 0.1, "71:1"))
    run = run_with(model, family_of(model, "partitioned"), INFINITE)
    reasons = [switch.reason for switch in run.switches if "reached" in switch.reason]
    assert any("VRMAX of ieeet1 71:1" in reason for reason in reasons)


def test_limits_at_the_operating_point_belong_to_a_saved_reduction_too(at_limit, tmp_path):
    family = reduce_external(parts_of(at_limit))
    save_reduced(tmp_path / "area.npz", family)
    assert load_reduced(tmp_path / "area.npz", at_limit).family.at_limits == family.at_limits != ()


def test_of_many_limits_the_first_are_named():
    assert listed(["a", "b", "c"]) == "a, b, c"
    assert listed(["a", "b", "c", "d", "e"]) == "a, b, c and 2 more"


def test_a_held_limit_that_would_let_go_is_told_and_brings_back_the_detailed_model(at_limit):
    """The highest field voltage is that of the start, the lowest is far away."""
    devices = tuple(
        replace(record, parameters={**record.parameters, "field_voltage_minimum": -100.0})
        if (record.model, str(record.key)) == ("sexs", "71:1")
        else record
        for record in at_limit.case.devices
    )
    model = gf.build_model(replace(at_limit.case, devices=devices))
    small = family_of(model, "partitioned")
    assert small.family.at_limits == ("EMAX of sexs 71:1",)
    run, careless = (run_with(model, small, INFINITE, limits) for limits in (True, False))
    assert any("let go" in text for text in limit_texts(careless))
    assert any("EMAX of sexs 71:1 reached" in switch.reason for switch in run.switches)
    detailed = gf.simulate(model, [FAULT], T_END)
    error, without = (compare(detailed, r.trajectory).worst.rms_deg for r in (run, careless))
    assert error <= without


def test_what_is_held_between_two_limits_never_lets_go(at_limit):
    small = family_of(at_limit, "partitioned")
    run = run_with(at_limit, small, INFINITE)
    assert [switch.after for switch in run.switches] == [Mode.DETAILED, Mode.LINEAR]
    assert not any("let go" in text for text in limit_texts(run))
