from __future__ import annotations

import pytest
from plants import two_plants

import gridfold as gf
from gridfold.editing.edit_files import edits_of

TEXT = """
[[edits]]
kind = "scale-load"
factor = 1.1
areas = "1"

[[edits]]
kind = "redispatch"
active_mw = 12
units = "102:1"

[[edits]]
kind = "set"
record = "GENROU 101:1 H=4"

[[edits]]
kind = "switch"
record = "branch 103-104:2"
state = "out"

[[edits]]
kind = "remove"
record = "SEXS 101:1"

[[edits]]
kind = "add"
record = "load 101:1 PL=2"
"""


def test_edits_of_a_file_are_those_of_the_editor(tmp_path):
    path = tmp_path / "edits.toml"
    path.write_text(TEXT)
    case = two_plants()
    editor = case.edit().scale_load(1.1, areas=1).redispatch(12, units="102:1")
    editor = editor.set("GENROU 101:1 H=4").switch("branch 103-104:2", "out")
    editor = editor.remove("SEXS 101:1").add("load 101:1 PL=2")
    assert case.edit().then(*gf.load_edits(path)).case() == editor.case()


def test_every_edit_of_a_file_that_is_wrong_is_told():
    records = [
        {"kind": "scale-load", "factr": 1.1},
        {"kind": "set", "record": "GENROU 101:1 H=4"},
        {"kind": "sett", "record": "GENROU 101:1 H=4"},
        {"kind": "switch", "record": "branch 103-104:2"},
    ]
    with pytest.raises(gf.OptionError) as raised:
        edits_of(records)
    assert str(raised.value).split("\n") == [
        "edit 1: scale-load has no 'factr'; did you mean 'factor'?",
        "edit 3: unknown kind 'sett'; did you mean 'set'?",
        "edit 4: switch needs state",
    ]


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("", "expected [[edits]] tables and nothing else"),
        ("[[event]]\nkind = 'set'", "expected [[edits]] tables and nothing else"),
        ("edits = 3", "expected [[edits]] tables and nothing else"),
        ("[[edits]", "not TOML"),
    ],
)
def test_a_file_of_something_else_is_refused_by_name(tmp_path, text, told):
    path = tmp_path / "edits.toml"
    path.write_text(text)
    with pytest.raises(gf.OptionError) as raised:
        gf.load_edits(path)
    assert str(path) in str(raised.value)
    assert told in str(raised.value)


def test_a_file_that_is_not_there_is_named(tmp_path):
    with pytest.raises(gf.OptionError, match=r"nothing\.toml"):
        gf.load_edits(tmp_path / "nothing.toml")
