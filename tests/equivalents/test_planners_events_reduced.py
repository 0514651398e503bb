"""Reduced models with the events of planners and with relays: what stays small, and what does not."""

from __future__ import annotations

import numpy as np
import pytest

import gridfold as gf
from gridfold.equivalents.adaptive import AdaptiveRun
from gridfold.equivalents.families import Mode

RULE = gf.SwitchingRule(67.0)
STAGES = (gf.SheddingStage(59.985, 0.1, 0.05), gf.SheddingStage(59.98, 0.2, 0.05))


@pytest.fixture(scope="module")
def ladder(npcc_retained, npcc_linear) -> gf.SmallModels:
    return gf.SmallModels(gf.Ladder((npcc_retained, npcc_linear)))


@pytest.fixture(scope="module")
def whole(npcc_parts) -> gf.SmallModels:
    return gf.SmallModels(gf.whole_system(npcc_parts))


def error(npcc, run: AdaptiveRun, events) -> tuple[float, float]:
    """Largest error of a rotor angle of the study area, and the largest swing there, in degrees."""
    units = run.trajectory.model.machines[:9]
    detailed = gf.simulate(npcc, events, run.trajectory.t_end).rotor_angle_deg(units)
    reduced = run.trajectory.rotor_angle_deg(units)
    return float(np.nanmax(np.abs(reduced - detailed))), float(np.nanmax(np.ptp(detailed, axis=0)))


def modes(run: AdaptiveRun) -> list[Mode]:
    return [switch.after for switch in run.switches]


@pytest.mark.parametrize(
    ("event", "part"),
    [
        (gf.LoadShed(0.2, buses="1-20", time=0.5), 0.01),
        (gf.LoadShed(0.1, areas="2", time=0.5), 0.03),
        (gf.BranchOpenEnd("29-37", 29, 0.5), 0.03),
        (gf.ShuntStep(3, 200.0, time=0.5), 0.01),
        (gf.SetParameter(23, "power_reference", change=0.5, id="2", time=0.5), 0.01),
        (gf.SetParameter(23, "voltage_reference", change=0.02, id="2", time=0.5), 0.01),
    ],
    ids=[
        "shed inside",
        "shed outside",
        "open end",
        "shunt",
        "power reference",
        "voltage reference",
    ],
)
def test_small_models_follow_about_the_new_operating_point(npcc, ladder, event, part):
    run = gf.simulate_adaptive(npcc, ladder, RULE, [event], 4.0)
    assert modes(run) == [Mode.LINEAR]
    largest, swing = error(npcc, run, [event])
    assert largest < part * swing
    assert "models about the new operating point" in run.trajectory.notices[-1].text


def test_a_parameter_of_a_linear_machine_takes_the_detailed_model(npcc, ladder, npcc_parts):
    far = npcc_parts.external_units[5]
    event = gf.SetParameter(far.bus, "voltage_reference", change=0.03, id=far.id, time=0.5)
    run = gf.simulate_adaptive(npcc, ladder, RULE, [event], 4.0)
    assert modes(run) == [Mode.LINEAR, Mode.DETAILED]
    assert run.switches[1].reason == (
        f"voltage_reference of unit {far} is set, and small models have the unit linear"
    )
    largest, _ = error(npcc, run, [event])
    assert largest < 1e-6


def test_a_redispatched_run_starts_flat_on_small_models(npcc, ladder):
    events = [gf.Redispatch(100.0, areas="1"), gf.BusFault(3, 1.0, 0.1)]
    run = gf.simulate_adaptive(npcc, ladder, RULE, events, 4.0)
    before = run.trajectory.times < 1.0
    assert modes(run) == [Mode.LINEAR, Mode.DETAILED, Mode.LINEAR]
    assert np.ptp(run.trajectory.rotor_angle_deg()[before], axis=0).max() < 1e-4
    largest, swing = error(npcc, run, events)
    assert largest < 0.02 * swing


def test_relays_in_the_study_area_act_on_small_models_as_on_the_detailed_one(npcc, ladder):
    relay = gf.UnderFrequencyShedding(STAGES, areas="1", measured_at=3)
    events = [gf.LoadStep(3, 0.5, active_mw=600.0), relay]
    run = gf.simulate_adaptive(npcc, ladder, RULE, events, 5.0)
    detailed = gf.simulate(npcc, events, 5.0)
    times = [
        [notice.time for notice in found.notices if "under-frequency" in notice.text]
        for found in (run.trajectory, detailed)
    ]
    assert set(modes(run)) == {Mode.LINEAR}
    assert len(times[0]) == 2
    assert times[0] == pytest.approx(times[1], abs=0.02)
    assert run.trajectory.models[-1].state == detailed.models[-1].state


def test_a_relay_outside_of_the_study_area_takes_the_detailed_model_throughout(npcc, ladder):
    relay = gf.UnderFrequencyShedding(STAGES, areas="1", measured_at=78)
    events = [gf.LoadStep(3, 0.5, active_mw=600.0), relay]
    run = gf.simulate_adaptive(npcc, ladder, RULE, events, 2.0)
    assert modes(run) == [Mode.DETAILED]
    assert run.trajectory.notices[0].text == (
        "the detailed model throughout: a relay watches bus 78, outside of the study area"
    )
    np.testing.assert_allclose(run.trajectory.states, gf.simulate(npcc, events, 2.0).states)


def test_without_an_exact_area_relays_take_the_detailed_model(npcc, whole):
    relay = gf.DistanceRelay("2-33", 2)
    run = gf.simulate_adaptive(npcc, whole, gf.SwitchingRule(6.0), [gf.BusFault(3), relay], 1.0)
    assert set(modes(run)) == {Mode.DETAILED}


def test_nothing_in_the_study_area_is_linear_where_relays_watch(npcc, npcc_linear):
    family = gf.SmallModels(gf.Ladder((npcc_linear,), whole=True))
    rule = gf.SwitchingRule(67.0, whole_deg=15.0)
    fault, relay = gf.BusFault(3, 0.1, 0.02), gf.DistanceRelay("2-33", 2)
    assert Mode.WHOLE in modes(gf.simulate_adaptive(npcc, family, rule, [fault], 1.0))
    assert Mode.WHOLE not in modes(gf.simulate_adaptive(npcc, family, rule, [fault, relay], 1.0))
