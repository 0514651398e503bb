"""Ladders of folded areas in files."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

import gridfold as gf
from gridfold.equivalents.families import Mode
from gridfold.equivalents.ladder import Ladder
from gridfold.equivalents.saved import load_reduced, save_reduced
from gridfold.io.reduced_files import ReducedFile, write_reduced

SECONDS = {Mode.DETAILED: 4e-5, Mode.RETAINED: 1 / 3e5, Mode.LINEAR: 2e-5, Mode.WHOLE: 1e-6}
ARRAYS = ("lift", "restrict", "weights", "input_weights", "hankel")


@pytest.fixture(scope="module")
def ladder(npcc_retained, npcc_linear):
    light = {Mode.LINEAR: 1 / 3}
    return Ladder((npcc_retained, npcc_linear), True, step_seconds=SECONDS, light_limits=light)


@pytest.fixture
def saved(ladder, tmp_path):
    save_reduced(tmp_path / "ladder.npz", ladder)
    return tmp_path / "ladder.npz"


def rewrite(path, arrays=None, **header):
    """The file as gridfold writes it, with another header and other arrays; None takes one out."""
    with np.load(path) as archive:
        content = dict(archive)
    metadata = json.loads(str(content.pop("metadata"))) | header
    content |= arrays or {}
    kept = {name: value for name, value in content.items() if value is not None}
    metadata.pop("sha256")
    write_reduced(path, ReducedFile(metadata, kept))


def header_of(path):
    with np.load(path) as archive:
        return json.loads(str(archive["metadata"]))


def assert_same_ports(found, expected):
    """Equal to the last bit."""
    for name in ("diagonal", "coupling", "b", "offset", "c", "current", "voltage", "turned"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))


def test_a_ladder_comes_back_to_the_last_bit(saved, ladder, npcc):
    loaded, norm = load_reduced(saved, npcc)
    assert norm is None
    assert (loaded.whole, loaded.step_seconds) == (True, SECONDS)
    assert loaded.light_limits == ladder.light_limits
    assert loaded.rungs == ladder.rungs
    assert loaded.modes == ladder.modes
    for found, area in zip(loaded.areas, ladder.areas, strict=True):
        assert (found.retained, found.ports) == (area.retained, area.ports)
        assert (found.reducer, found.bases.bound) == (area.reducer, area.bases.bound)
        assert found.bases.miss == area.bases.miss
        for name in ("lift", "restrict", "weights", "input_weights", "hankel_values"):
            np.testing.assert_array_equal(getattr(found.bases, name), getattr(area.bases, name))
        assert_same_ports(found.linear_ports, area.linear_ports)
        np.testing.assert_array_equal(found.states.lift_matrix, area.states.lift_matrix)


@pytest.mark.parametrize("event", [gf.BusFault(3, duration=0.2), gf.BranchFault("3-2")])
def test_runs_with_the_loaded_ladder_equal_those_with_the_saved_one(saved, ladder, npcc, event):
    rule = gf.SwitchingRule(30.0, whole_deg=5.0)
    before, after = (
        gf.simulate_adaptive(npcc, family, rule, [event], 4.0)
        for family in (ladder, load_reduced(saved, npcc).family)
    )
    assert len(set(before.modes)) >= 2
    assert after.switches == before.switches
    np.testing.assert_array_equal(after.trajectory.states, before.trajectory.states)


def test_a_modal_truncation_without_costs_can_be_saved_too(tmp_path, npcc, npcc_parts):
    reducer = gf.ModalTruncation(order=80)
    modal = Ladder((gf.fold(npcc_parts, reducer=reducer),))
    save_reduced(tmp_path / "m.npz", modal)
    loaded = load_reduced(tmp_path / "m.npz", npcc).family
    assert (loaded.areas[0].reducer, loaded.step_seconds) == (reducer, {})
    assert (loaded.areas[0].bases.bound, loaded.areas[0].bases.hankel_values) == (None, None)
    assert_same_ports(loaded.areas[0].linear_ports, modal.areas[0].linear_ports)


@pytest.mark.parametrize("part", ARRAYS)
@pytest.mark.parametrize(
    "fault", ["missing", "shorter", "not finite", "other type", "flat", "one number"]
)
def test_damaged_arrays_are_refused(saved, npcc, part, fault):
    name = f"area1_{part}"
    with np.load(saved) as archive:
        array = archive[name]
    damaged = {
        "missing": None,
        "shorter": array[1:] if part != "hankel" else array.reshape(1, -1),
        "not finite": np.where(np.arange(array.size).reshape(array.shape) == 3, np.nan, array),
        "other type": array.astype(np.float32),
        "one number": np.float64(1.0),
        "flat": array.ravel() if part != "hankel" else array[:, None],
    }[fault]
    rewrite(saved, {name: damaged})
    with pytest.raises(gf.CaseFileError, match=rf"ladder\.npz.*\n(.*\n)*.*({name}|{part} has)"):
        load_reduced(saved, npcc)


@pytest.mark.parametrize(
    "change",
    [
        {"areas": []},
        {"areas": [{"retained": [[42, "1"]]}]},
        {"areas": [{"retained": [["x", "1"]], "bound": None, "miss": 0.0}]},
        {"areas": [{"retained": [], "bound": "small", "miss": 0.0}]},
        {"areas": [{"retained": [], "bound": None, "miss": "none"}]},
        {"whole": False},
        {"step_seconds": {"detailed": 1.0}},
        {"step_seconds": {"sideways": 1.0}},
        {"step_seconds": {"detailed": "fast"}},
        {"light_limits": {"hybrid": 0.1}},
        {"light_limits": {"linear": "little"}},
        {"study_buses": list(range(1, 30))},
        {"reducer": {"name": "Own"}},
        {"reducer": {"name": "BalancedTruncation", "speed": 1}},
        {"reducer": {"name": "BalancedTruncation", "tolerance": -1.0}},
    ],
    ids=str,
)
def test_a_header_that_does_not_fit_the_arrays_is_refused(saved, npcc, change):
    rewrite(saved, **change)
    with pytest.raises(
        gf.CaseFileError, match=r"ladder\.npz.*\n.*(fit together|is not known|missing)"
    ):
        load_reduced(saved, npcc)


@pytest.mark.parametrize("key", ["areas", "whole", "step_seconds", "light_limits"])
def test_a_header_without_one_of_the_keys_of_a_ladder_is_refused(saved, npcc, key):
    rewrite(saved, **{key: 3})
    with pytest.raises(gf.CaseFileError, match=f"{key} is 3 in the header"):
        load_reduced(saved, npcc)


def test_an_area_with_other_retained_machines_is_refused(saved, npcc):
    areas = header_of(saved)["areas"]
    areas[0]["retained"] = areas[0]["retained"][1:]
    rewrite(saved, areas=areas)
    with pytest.raises(gf.CaseFileError, match="does not fit together"):
        load_reduced(saved, npcc)


def test_a_retained_machine_of_the_study_area_is_refused(saved, npcc):
    areas = header_of(saved)["areas"]
    areas[1]["retained"] = [[23, "1"]]
    rewrite(saved, areas=areas)
    with pytest.raises(gf.CaseFileError, match="23:1 is retained and not in the external area"):
        load_reduced(saved, npcc)


def test_another_case_or_operating_point_is_refused(saved, ladder, npcc, tmp_path):
    other = gf.build_model(gf.load_case("npcc-pst"))
    with pytest.raises(gf.OptionError, match="belongs to case npcc with"):
        load_reduced(saved, other)
    shifted = replace(ladder.areas[0], origin=npcc.x0 + 1e-3)
    save_reduced(tmp_path / "s.npz", replace(ladder, areas=(shifted, ladder.areas[1])))
    with pytest.raises(gf.OptionError, match="another operating point"):
        load_reduced(tmp_path / "s.npz", npcc)


def test_a_reducer_that_is_not_the_packages_own_is_not_written(tmp_path, ladder):
    own = replace(ladder.areas[0], reducer=gf.Unreduced())
    with pytest.raises(gf.OptionError, match="BalancedTruncation or ModalTruncation"):
        save_reduced(tmp_path / "a.npz", replace(ladder, areas=(own,)))
    assert list(tmp_path.iterdir()) == []
