"""Criteria as text."""

import pytest

import gridfold as gf
from gridfold.grid.criteria import CRITERIA, PRESETS
from gridfold.io.criterion_records import (
    criteria_of,
    criterion_from_record,
    criterion_schema,
    parse_criterion,
)

FILE = """
[[criteria]]
preset = "voltage back to 0.9 within 1 s"
buses = "kv>=100"

[[criteria]]
kind = "voltage-dip"
level = 0.8
longest = 0.5
of_initial = true
name = "dip"
"""


def test_a_file_gives_criteria_by_kind_and_by_preset(tmp_path):
    path = tmp_path / "criteria.toml"
    path.write_text(FILE)
    assert gf.load_criteria(path) == (
        gf.VoltageRecovery(0.9, 1.0, buses="kv>=100"),
        gf.VoltageDip(0.8, 0.5, of_initial=True, name="dip"),
    )


@pytest.mark.parametrize("text", list(PRESETS))
def test_a_preset_is_given_by_its_name(text):
    assert parse_criterion(text) == criterion_from_record({"preset": text}) == PRESETS[text]


def test_a_criterion_is_given_by_kind_and_fields():
    found = parse_criterion("voltage-recovery level=0.9 within=1.5 buses=1-5,area:2")
    assert found == gf.VoltageRecovery(0.9, 1.5, buses="1-5,area:2")
    found = parse_criterion("voltage-dip level=0.8 buses='area:1 except kv<100' longest=0.2")
    assert found == gf.VoltageDip(0.8, 0.2, buses="area:1 except kv<100")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "no such preset or kind"),
        ("voltage back to 0.9 within 2 s", "did you mean 'voltage back to 0.9 within 1 s'"),
        ("voltage back to 0.9 within 2 s", "voltage-recovery level=0.9 within=1"),
        ("frequency from 58 to 61 Hz", "frequency-band lowest_hz=59 highest_hz=61"),
        (
            "damping at least 3",
            "did you mean 'damping at least 3 %'? With other numbers: damping percent=3",
        ),
        ("voltage-dip", "voltage-dip needs level"),
        ("voltage-dip levl=0.8", "did you mean 'level'"),
        ("voltage-dip level=high", "level: 'high' is not a number"),
        ("voltage-dip level=0.8 level=0.9", "each name once"),
        ("voltage-dip level=-1", "level must be a positive number"),
        ("dipp level=0.8", "unknown kind 'dipp'"),
    ],
)
def test_wrong_texts_are_told(text, message):
    with pytest.raises(gf.OptionError) as caught:
        parse_criterion(text)
    assert message in str(caught.value)
    assert repr(text) in str(caught.value)


def test_every_wrong_table_is_told(tmp_path):
    records = [
        {"preset": "damping at least 4 %"},
        {"level": 0.8},
        {"kind": "damping", "preset": "damping at least 3 %"},
        {"kind": "damping", "percent": 3},
        {"preset": "damping at least 3 %", "level": 0.8},
        {"kind": "frequency-band", "lowest_hz": True},
    ]
    with pytest.raises(gf.OptionError) as caught:
        criteria_of(records, "file: ")
    lines = str(caught.value).splitlines()
    assert [line.split(":")[1].split()[1] for line in lines] == ["1", "2", "3", "5", "6"]
    for line, text in zip(
        lines,
        ("did you mean", "kind or preset is missing", "not both", "has no 'level'", "wrong type"),
        strict=True,
    ):
        assert text in line


def test_the_schema_has_every_field_of_every_kind():
    properties = criterion_schema()["properties"]
    assert properties["kind"]["enum"] == list(CRITERIA)
    for kind in CRITERIA.values():
        assert set(kind.__dataclass_fields__) <= set(properties)
    assert properties["lowest_hz"] == {"type": "number"}
    assert properties["of_initial"] == {"type": "boolean"}
