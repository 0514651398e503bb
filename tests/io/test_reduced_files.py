from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

import gridfold as gf
from gridfold.dynamics.equilibrium import find_equilibrium
from gridfold.equivalents.saved import load_reduced, save_reduced
from gridfold.grid.timeline import build_timeline
from gridfold.io.array_files import ArrayForm, Forms
from gridfold.io.reduced_files import VERSION, ReducedFile, read_reduced, write_reduced

HEADER = {
    "case": "small",
    "fingerprint": "abc",
    "study_buses": [1, 2],
    "column_norm": 1.0,
    "reducer": {"name": "BalancedTruncation", "tolerance": 1e-5, "order": None},
    "bound": 0.1,
    "kept_exactly": 0,
    "outputs": "states",
}
ARRAYS = {"x0": np.array([1 / 3, np.pi, 1e-300])}


@pytest.fixture(scope="module")
def family(npcc):
    parts = gf.partition(npcc, range(1, 37))
    return gf.reduce(parts, gf.BalancedTruncation(order=60))


@pytest.fixture
def saved(family, tmp_path):
    save_reduced(tmp_path / "npcc.npz", family)
    return tmp_path / "npcc.npz"


def forms(header, names):
    """Of the arrays of small files."""
    return Forms({"x0": ArrayForm("f", (3,))}, {})


def rewrite(path, arrays=None, **changes):
    """The file again as gridfold writes it, with other values in its header and other arrays."""
    with np.load(path) as archive:
        content = dict(archive)
    header = json.loads(str(content.pop("metadata"))) | changes
    header.pop("sha256")
    kept = {name: value for name, value in (content | (arrays or {})).items() if value is not None}
    write_reduced(path, ReducedFile(header, kept))


def test_a_file_gives_back_header_and_arrays_to_the_last_bit(tmp_path):
    write_reduced(tmp_path / "a.npz", ReducedFile(HEADER, ARRAYS))
    content = read_reduced(tmp_path / "a.npz", forms)
    assert HEADER.items() <= content.header.items()
    assert content.header["version"] == VERSION
    np.testing.assert_array_equal(content.arrays["x0"], ARRAYS["x0"])


def test_a_file_that_is_missing_is_refused_by_name(tmp_path):
    with pytest.raises(gf.CaseFileError, match=r"none\.npz.*\n.*cannot be read"):
        read_reduced(tmp_path / "none.npz", forms)


def _other_archive(path):
    np.savez(path, metadata=np.array(json.dumps({"case": "npcc"})), states=np.eye(2))


def _pickled(path):
    with path.open("wb") as stream:
        np.save(stream, np.array([{}], dtype=object), allow_pickle=True)


def _one_array(path):
    with path.open("wb") as stream:
        np.save(stream, np.eye(3))


@pytest.mark.parametrize(
    "write",
    [
        lambda path: path.write_text("time,angle\n0,1\n"),
        lambda path: path.write_bytes(b""),
        lambda path: path.write_bytes(b"PK\x03\x04 not a zip"),
        _one_array,
        lambda path: np.savez(path, metadata=np.array("{")),
        _other_archive,
        _pickled,
    ],
    ids=["text", "empty", "no zip", "one array", "no JSON", "result of a run", "pickle"],
)
def test_something_else_is_refused_by_name(tmp_path, write):
    path = tmp_path / "other.npz"
    write(path)
    with pytest.raises(
        gf.CaseFileError, match=r"other\.npz.*\n.*(of a reduced model|NumPy archive)"
    ):
        read_reduced(path, forms)


def test_a_damaged_file_is_refused(saved):
    content = saved.read_bytes()
    saved.write_bytes(content[: len(content) // 2])
    with pytest.raises(gf.CaseFileError, match="damaged"):
        read_reduced(saved, forms)


def test_another_version_of_the_format_is_refused_with_both_numbers(saved):
    rewrite(saved, version=VERSION + 1)
    with pytest.raises(gf.OptionError, match=rf"{saved.name}.*version {VERSION + 1} .*{VERSION};"):
        read_reduced(saved, forms)


@pytest.mark.parametrize("key", HEADER)
def test_a_header_without_one_of_its_keys_is_refused(tmp_path, key):
    header = {k: v for k, v in HEADER.items() if k != key}
    if key == "bound":  # None is a bound that there is not
        header["bound"] = "small"
    write_reduced(tmp_path / "a.npz", ReducedFile(header, ARRAYS))
    with pytest.raises(gf.CaseFileError, match=f"{key} is"):
        read_reduced(tmp_path / "a.npz", forms)


def test_the_reduced_area_comes_back_to_the_last_bit(saved, family, npcc):
    loaded, norm = load_reduced(saved, npcc)
    assert norm == 1.0
    assert loaded.kept == family.kept
    assert loaded.reducer == family.reducer
    assert loaded.reduction.order == 60
    assert loaded.reduction.bound == family.reduction.bound
    assert loaded.area.full.state_names == family.area.full.state_names
    np.testing.assert_array_equal(loaded.area.b, family.area.b)
    np.testing.assert_array_equal(loaded.area.states.lift_matrix, family.area.states.lift_matrix)
    np.testing.assert_array_equal(loaded.area.full.a, family.area.full.a)


@pytest.mark.parametrize("angle_deg", [0.0, 20.0, np.inf])
def test_runs_with_the_loaded_model_equal_those_with_the_saved_one(saved, family, npcc, angle_deg):
    rule = gf.SwitchingRule(angle_deg)
    events = [gf.BusFault(3, duration=0.2)]
    loaded = load_reduced(saved, npcc).family
    before = gf.simulate_adaptive(npcc, family, rule, events, 4.0)
    after = gf.simulate_adaptive(npcc, loaded, rule, events, 4.0)
    np.testing.assert_array_equal(after.trajectory.states, before.trajectory.states)
    assert after.switches == before.switches


def test_a_loaded_model_moves_to_another_operating_point_like_the_saved_one(saved, family, npcc):
    events = [gf.BranchFault("3-2", duration=0.1)]
    rule = gf.SwitchingRule(20.0)
    loaded = load_reduced(saved, npcc).family
    before = gf.simulate_adaptive(npcc, family, rule, events, 2.0)
    after = gf.simulate_adaptive(npcc, loaded, rule, events, 2.0)
    np.testing.assert_array_equal(after.trajectory.states, before.trajectory.states)


def test_a_modal_truncation_can_be_saved_too(tmp_path, npcc):
    parts = gf.partition(npcc, range(1, 37))
    modal = gf.reduce(parts, gf.ModalTruncation(order=80))
    save_reduced(tmp_path / "m.npz", modal)
    loaded = load_reduced(tmp_path / "m.npz", npcc).family
    assert loaded.reducer == gf.ModalTruncation(order=80)
    assert (loaded.reduction.bound, loaded.reduction.hankel_values) == (None, None)
    np.testing.assert_array_equal(loaded.area.a, modal.area.a)


def test_another_case_is_refused_with_both_fingerprints(saved):
    other = gf.build_model(gf.load_case("npcc-pst"))
    with pytest.raises(gf.OptionError, match="belongs to case npcc ") as raised:
        load_reduced(saved, other)
    assert str(saved) in str(raised.value)
    assert other.case.fingerprint[:16] in str(raised.value)


def test_another_operating_point_is_refused_with_the_state_that_differs(tmp_path, family, npcc):
    stages = build_timeline(npcc.case, [gf.BranchTrip("3-2", time=0.0)], 1.0)
    tripped = npcc.for_state(stages[-1].state)
    moved = family.moved(tripped, find_equilibrium(tripped, npcc.x0))
    save_reduced(tmp_path / "moved.npz", moved)
    with pytest.raises(gf.OptionError, match=r"moved\.npz.*another operating point: \w+:\d+:\d"):
        load_reduced(tmp_path / "moved.npz", npcc)


@pytest.mark.parametrize("name", ["area_lift", "full_a", "drift", "u0"])
def test_an_array_that_is_one_number_is_refused(saved, npcc, name):
    rewrite(saved, {name: np.float64(1.0)})
    with pytest.raises(gf.CaseFileError, match=rf"npcc\.npz.*\n(.*\n)*.*{name} has shape \(\)"):
        load_reduced(saved, npcc)


def test_arrays_that_do_not_fit_the_study_area_are_refused(saved, npcc):
    rewrite(saved, study_buses=list(range(1, 30)))
    with pytest.raises(gf.CaseFileError, match=r"npcc\.npz.*\n.*u0 has shape"):
        load_reduced(saved, npcc)


def test_a_column_norm_that_keeps_other_machines_is_not_written(tmp_path, family):
    with pytest.raises(gf.OptionError, match=r"5 p\.u\. keeps other machines"):
        save_reduced(tmp_path / "a.npz", family, column_norm=5.0)
    assert list(tmp_path.iterdir()) == []


def test_a_reducer_that_is_not_the_packages_own_is_not_written(tmp_path, family):
    class Own(gf.BalancedTruncation):
        pass

    with pytest.raises(gf.OptionError, match="BalancedTruncation or ModalTruncation"):
        save_reduced(tmp_path / "a.npz", replace(family, reducer=Own(order=60)))


def _tampered(array, generator):
    """Neighbours of an array: of other type, shape, value or position."""
    place = int(generator.integers(max(array.size, 1)))
    yield array.astype("O")
    yield array[None]
    yield array[:-1]
    yield np.concatenate([array, array[-1:]])
    if array.dtype.kind == "U":
        return
    yield array.astype(np.float32)
    for value in (np.nan, 1e18) if array.dtype.kind == "f" else (-1, len(array), 2**62):
        changed = array.copy()
        changed.flat[place] = value
        yield changed
    yield -array


def _arrays_of(path):
    with np.load(path) as archive:
        return {name: archive[name] for name in archive.files if name != "metadata"}


def test_a_file_in_which_any_array_was_tampered_with_is_refused(saved, npcc, tmp_path):
    """A seeded sample; the digest stays that of the true file."""
    generator = np.random.default_rng(12)
    with np.load(saved) as archive:
        metadata = archive["metadata"]
    arrays = _arrays_of(saved)
    changes = [{name: None} for name in arrays if name != "hankel"]
    changes += [{name: new} for name, a in arrays.items() for new in _tampered(a, generator)]
    changes = [changes[k] for k in generator.permutation(len(changes))[:60]]
    for change in [*changes, {"hankel": None}, {"more": np.zeros(3)}]:
        kept = {name: a for name, a in (arrays | change).items() if a is not None}
        np.savez(tmp_path / "t.npz", metadata=metadata, **kept)
        with pytest.raises(gf.CaseFileError, match=r"t\.npz"):
            load_reduced(tmp_path / "t.npz", npcc)


def test_a_value_that_fits_and_was_not_written_is_told_by_the_digest(saved, npcc):
    arrays = _arrays_of(saved)
    with np.load(saved) as archive:
        metadata = archive["metadata"]
    np.savez(saved, metadata=metadata, **(arrays | {"drift": arrays["drift"] + 1e-9}))
    with pytest.raises(gf.CaseFileError, match="not that which was written: its SHA-256 differs"):
        load_reduced(saved, npcc)


@pytest.mark.parametrize("value", [60, -1, 2**62])
def test_a_partner_beyond_the_coordinates_is_refused_by_its_position(saved, npcc, value):
    partners = _arrays_of(saved)["area_partners"]
    partners[5] = value
    rewrite(saved, {"area_partners": partners})
    with pytest.raises(
        gf.CaseFileError, match=f"area_partners holds position {value}, which is not"
    ):
        load_reduced(saved, npcc)


def test_coordinates_that_are_not_each_others_partners_are_refused(saved, npcc):
    partners = _arrays_of(saved)["area_partners"]
    rewrite(saved, {"area_partners": np.zeros_like(partners)})
    with pytest.raises(gf.CaseFileError, match="not the partner of its partner"):
        load_reduced(saved, npcc)


@pytest.mark.parametrize("key", ["bound", "column_norm", "kept_exactly"])
@pytest.mark.parametrize("text", ["NaN", "Infinity", "true", '"1"', "[]"])
def test_a_number_of_the_header_that_is_none_is_refused(saved, npcc, key, text):
    with np.load(saved) as archive:
        header = json.loads(str(archive["metadata"])) | {key: "HERE"}
    metadata = json.dumps(header).replace('"HERE"', text)
    np.savez(saved, metadata=np.array(metadata), **_arrays_of(saved))
    with pytest.raises(gf.CaseFileError):
        load_reduced(saved, npcc)
