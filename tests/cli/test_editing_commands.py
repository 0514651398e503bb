"""Edited cases on the command line."""

from __future__ import annotations

import json

import pytest
from plants import two_plants

import gridfold as gf


@pytest.fixture
def folder(tmp_path):
    """The small case as a folder."""
    two_plants().save(tmp_path / "plants")
    return tmp_path / "plants"


def test_a_case_is_written_with_edits_and_what_is_not_in_the_file_is_said(command, folder):
    raw = folder.parent / "grid.raw"
    edits = folder.parent / "edits.toml"
    edits.write_text('[[edits]]\nkind = "scale-load"\nfactor = 1.1\n')
    wanted = ("--edits", edits, "--set", "GENROU 101:1 H=4", "--set", "load 103 PL=90")
    code, out, err = command("convert", folder, raw, *wanted)
    assert (code, err) == (0, "")
    assert "edited: genrou 101:1: inertia 6.5 -> 4" in out
    assert "edited: load 103:1: active_mw 132 -> 90" in out
    assert "not in the file: stored reactive power" in out.replace("\n", " ")
    expected = two_plants().edit().scale_load(1.1).set("GENROU 101:1 H=4", "load 103 PL=90").case()
    read = gf.load_case(raw, raw.with_suffix(".dyr"))
    assert read.loads == expected.loads
    code, _, _ = command("convert", raw, raw.with_suffix(".dyr"), folder.parent / "back")
    assert code == 0
    assert gf.load_case(folder.parent / "back").fingerprint == read.fingerprint


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["convert", "npcc"], "say what is written: gridfold convert SOURCE TARGET"),
        (["info", "npcc", "--set", "bus 3"], "edit 1: bus 3: say what is set, as NAME=VALUE"),
        (["info", "npcc", "--set", "two_axis 3 H=1"], "there is no two_axis 3"),
        (["info", "npcc", "--edits", "nothing.toml"], "nothing.toml"),
        (
            [
                "simulate",
                "npcc",
                "--event",
                "bus-fault bus=3",
                "--set",
                "load 3 PL=9",
                "--set",
                "x 1 H=2",
            ],
            "edit 2: 'x' is no kind of record",
        ),
    ],
)
def test_faults_are_told_before_anything_is_done(command, arguments, told):
    code, out, err = command(*arguments)
    assert (code, out) == (2, "")
    assert told in " ".join(err.split())


def test_what_is_there_is_not_written_over(command, folder):
    code, _, err = command("convert", "npcc", folder)
    assert code == 2
    assert "exists already; nothing was written" in " ".join(err.split())
    assert command("convert", "npcc", folder, "--overwrite")[0] == 0
    assert gf.load_case(folder) == gf.load_case("npcc")


def test_info_of_files_tells_the_edited_case(command, folder):
    raw = folder.parent / "grid.raw"
    command("convert", folder, raw)
    _, out, _ = command("info", raw, "--set", "load 103 PL=90", "--json", "-")
    facts = json.loads(out)
    edited = gf.load_case(raw).edit().set("load 103 PL=90").case()
    assert facts["fingerprint"] == edited.fingerprint
    assert facts["case_notices"] == ["edited: load 103:1: active_mw 120 -> 90"]
