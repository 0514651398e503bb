"""A study of an edited case."""

from __future__ import annotations

from hashlib import sha256

import pytest
from plants import two_plants
from study_stores import new_store

import gridfold as gf
from gridfold.report.study_tables import study_facts
from gridfold.study.named_files import read_named
from gridfold.study.prepare import load_grid
from gridfold.study.study_file import parse_study

EDITS = {"kind": "set", "record": "GENROU 101:1 H=4"}


@pytest.fixture
def folder(tmp_path):
    two_plants().save(tmp_path / "plants")
    (tmp_path / "heavy.toml").write_text('[[edits]]\nkind = "scale-load"\nfactor = 1.1\n')
    return tmp_path


def study(**more):
    return parse_study({"schema": 1, "case": {"source": "plants", "edits": "heavy.toml"}, **more})


def test_edits_of_the_file_come_before_those_of_the_study(folder):
    case = load_grid(study(edits=[{"kind": "set", "record": "load 103 PL=9"}, EDITS]), folder)
    expected = two_plants().edit().scale_load(1.1).set("load 103 PL=9", "GENROU 101:1 H=4").case()
    assert case.fingerprint == expected.fingerprint
    assert case.notices == expected.notices


def test_edits_are_part_of_what_a_study_is(folder):
    hashes = read_named(study(), folder).hashes
    assert hashes["heavy.toml"] == sha256((folder / "heavy.toml").read_bytes()).hexdigest()
    assert study(edits=[EDITS]).content()["edits"] == [EDITS]
    assert study().content()["case"]["edits"] == "heavy.toml"


def test_an_edit_that_is_wrong_is_told_with_its_number(folder):
    with pytest.raises(
        gf.CaseError, match="edit 2: genrou 101:1: HH: GENROU has no such parameter"
    ):
        load_grid(study(edits=[{"kind": "set", "record": "GENROU 101:1 HH=4"}]), folder)
    with pytest.raises(gf.OptionError, match="edit 1: set needs record"):
        load_grid(study(edits=[{"kind": "set"}]), folder)


def test_a_study_tells_its_edits(tmp_path):
    notices = ["edited: genrou 101:1: inertia 6.5 -> 4", "something else"]
    with new_store(tmp_path / "s", case_notices=notices) as store:
        assert study_facts(store)["Edits (1)"].plain == "genrou 101:1: inertia 6.5 -> 4"
    with new_store(tmp_path / "t", case_notices=notices[1:]) as store:
        assert not any(name.startswith("Edits") for name in study_facts(store))
