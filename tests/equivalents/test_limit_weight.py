"""Limits of linear machines are passed over where sample swings show that they hardly matter."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from limited_cases import npcc_with_sexs

import gridfold as gf
from gridfold.equivalents import limit_weight
from gridfold.equivalents.adaptive import simulate_adaptive
from gridfold.equivalents.choice import ModelSettings
from gridfold.equivalents.families import Mode
from gridfold.equivalents.limit_weight import light_limits
from gridfold.equivalents.model_kind import ModelKind
from gridfold.equivalents.small_models import SmallModels
from gridfold.equivalents.swings import sample_swings
from gridfold.equivalents.switching import SwitchingRule
from gridfold.partition import Partition, partition

FAULT, T_END = gf.BusFault(3, duration=0.3), 2.0
LINEAR_ONLY = SwitchingRule(float("inf"))


def parts_of(npcc: gf.DetailedModel, room: float) -> Partition:
    model = gf.build_model(npcc_with_sexs(npcc, room))
    return partition(model, range(1, 37))


@pytest.fixture(scope="module")
def limited(npcc) -> gf.Ladder:
    parts = parts_of(npcc, 0.15)
    units = parts.external_units[:1]
    return gf.Ladder((gf.fold(parts, units), gf.fold(parts)), whole=True)


@pytest.fixture(scope="module")
def found(limited):
    return light_limits(limited, sample_swings(limited.parts, [[FAULT]], T_END))


def test_the_error_is_that_of_a_run_without_limits(limited, found):
    model = limited.parts.model
    blind = replace(LINEAR_ONLY, limits=False)
    only = SmallModels(replace(limited, areas=limited.areas[1:], whole=False))
    run = simulate_adaptive(model, only, blind, [FAULT], T_END).trajectory
    detailed = gf.simulate(model, [FAULT], T_END)
    units, coi = limited.study_units, gf.AngleReference.CENTRE_OF_INERTIA
    error = run.rotor_angle_deg(units, coi) - detailed.rotor_angle_deg(units, coi)
    after = detailed.times >= FAULT.duration
    expected = np.sqrt((error[after] ** 2).mean(axis=0)).max()
    assert found[Mode.LINEAR] == pytest.approx(expected, rel=0.02)


def test_what_moves_angles_by_more_than_the_bound_counts(limited, found, monkeypatch):
    assert set(found) == {Mode.RETAINED, Mode.LINEAR}
    monkeypatch.setattr(limit_weight, "LIGHT_DEG", 0.9 * min(found.values()))
    assert light_limits(limited, sample_swings(limited.parts, [[FAULT]], T_END)) == {}


def test_limits_that_never_act_show_nothing(npcc):
    parts = parts_of(npcc, 1000.0)
    ladder = gf.Ladder((gf.fold(parts),))
    assert light_limits(ladder, sample_swings(parts, [[FAULT]], T_END)) == {}


def test_a_run_stays_in_a_model_whose_limits_are_light_and_says_so(limited, found):
    model = limited.parts.model
    light = replace(limited, areas=limited.areas[1:], whole=False, light_limits=found)
    heavy = replace(light, light_limits={})
    runs = [
        simulate_adaptive(model, SmallModels(ladder), LINEAR_ONLY, [FAULT], T_END)
        for ladder in (light, heavy)
    ]
    assert runs[0].modes == (Mode.DETAILED, Mode.LINEAR)
    assert any("reached" in switch.reason for switch in runs[1].switches)
    said = [
        [notice.text for notice in run.trajectory.notices if "passed over" in notice.text]
        for run in runs
    ]
    assert len(said[0]) == 1
    assert f"by {found[Mode.LINEAR]:.2g} degrees" in said[0][0]
    assert said[1] == []


def test_settings_ask_the_sample_swings(npcc):
    parts = parts_of(npcc, 0.02)
    ladder = ModelSettings(ModelKind.LINEAR).build(parts)
    assert set(ladder.light_limits) == {Mode.LINEAR}
    assert (
        ladder.light_limits[Mode.LINEAR] == light_limits(ladder, sample_swings(parts))[Mode.LINEAR]
    )
