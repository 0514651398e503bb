"""Codes of RAW files: those of the manual, and any other."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

import gridfold as gf
from gridfold.io.powerio_cases import read_network
from gridfold.io.raw_codes import check_codes
from gridfold.io.raw_records import complete_records
from gridfold.io.raw_sections import find_sections

RAW = Path(__file__).parent / "raw"
#: A record of each section, its code in braces, with all values of the manual and some others.
RECORDS = {
    "BUS": ("1,'A, B',230.0,{},1,1,1,1.0,0.0", 32, "1234", ("0", "5", "9", "-1", "X")),
    "LOAD": ("1,'1 ',{},1,1,10,5,0,0,0,0,1", 32, "01", ("2", "-1")),
    "FIXED SHUNT": ("1,'1 ',{},0.0,10.0", 33, "01", ("2",)),
    "GENERATOR": ("1,'1 ',10,0,9,-9,1.0,0,100,0,1,0,0,1,{},100,20,0", 33, "01", ("2", "7")),
    "BRANCH": ("1,2,'1 ',0.01,0.1,0,0,0,0,0,0,0,0,{},1", 33, "01", ("2", "3")),
    "TRANSFORMER": ("1,2,0,'1 ',1,1,1,0,0,2,'T 1',{},1\n0,0.1,100\n1\n1", 33, "01", ("2", "7")),
    "SWITCHED SHUNT": ("1,1,0,{},1.1,0.9,0,100,' ',10", 33, "01", ("2",)),
}


def section_of(section, record, revision):
    """A RAW file with one record, its place among the sections told by its marker."""
    head = f"0, 100.0, {revision}, 0, 1, 60.0\nTITLE\nTITLE\n"
    return f"{head}0 / END OF SYSTEM-WIDE DATA, BEGIN {section} DATA\n{record}\n0 / END\nQ\n"


def faults(section, record, revision=33):
    return looked_at(section_of(section, record, revision), revision).faults


def looked_at(text, revision=33):
    """What is found in a file, with its blank fields written out."""
    sections = find_sections(text, revision)
    complete = replace(sections, text=complete_records(sections, revision).text)
    return check_codes(complete, revision, "own.raw")


@pytest.mark.parametrize("section", RECORDS)
def test_codes_of_the_manual_pass_and_others_are_named_with_their_line(section):
    record, revision, known, others = RECORDS[section]
    for code in (*known, ""):
        assert faults(section, record.format(code), revision) == []
    for code in others:
        (fault,) = faults(section, record.format(code), revision)
        assert fault.startswith("line 5: ")
        assert f" is {code}; its codes are {', '.join(known)}" in fault


def test_positions_follow_the_revision():
    unit = "1,'1 ',10,0,9,-9,1.0,0,0,100,0,1,0,0,1,{},100,20,0"
    assert faults("GENERATOR", unit.format("1"), 35) == []
    assert "STAT of a generator is 7" in faults("GENERATOR", unit.format("7"), 35)[0]
    line = "1,2,'1 ',0.01,0.1,0,'N',{},0,0,0,0,{{}},1".format(",".join("0" * 12))
    assert faults("BRANCH", line.format("1"), 34) == []
    assert "ST of a branch is 2" in faults("BRANCH", line.format("2"), 34)[0]
    shunt = "1,'1',1,0,{},1.1,0.9,0,0,100,' ',10"
    assert faults("SWITCHED SHUNT", shunt.format("0"), 35) == []
    assert "STAT of a switched shunt is 5" in faults("SWITCHED SHUNT", shunt.format("5"), 35)[0]


def test_a_transformer_with_three_windings_may_have_one_of_them_out():
    record = "1,2,3,'1 ',1,1,1,0,0,2,'T',{},1\n0,0.1,100,0,0.1,100,0,0.1,100\n1\n1\n1"
    for code in "01234":
        assert faults("TRANSFORMER", record.format(code)) == []
    assert "is 5; its codes are 0, 1, 2, 3, 4" in faults("TRANSFORMER", record.format("5"))[0]


@pytest.mark.parametrize(
    ("base", "fault", "told"),
    [
        (
            "-5",
            ["line 5: MBASE of generator 1:1 is -5; it must be positive, or blank for SBASE"],
            [],
        ),
        ("0", [], ["generator 1:1 (own.raw:5): MBASE is 0; SBASE is taken"]),
        ("0.0", [], ["generator 1:1 (own.raw:5): MBASE is 0; SBASE is taken"]),
        ("", [], []),
        ("0.1", [], []),
    ],
)
def test_a_base_of_a_unit_is_positive_or_blank(base, fault, told):
    unit = f"1,'1 ',10,0,9,-9,1.0,0,{base},0,1,0,0,1,1,100,20,0"
    found = looked_at(section_of("GENERATOR", unit, 33))
    assert found.faults == fault
    assert [str(doubt) for doubt in found.doubts] == told


@pytest.mark.parametrize(
    ("power", "status", "bus_type", "told"),
    [
        (20.05, "1", "2", []),
        (21.0, "1", "2", ["active power PG is 21 MW, above PT 20 MW"]),
        (4.95, "1", "2", []),
        (4.0, "1", "2", ["active power PG is 4 MW, below PB 5 MW"]),
        (21.0, "0", "2", []),
        (21.0, "1", "3", []),
    ],
)
def test_power_beyond_the_limits_of_the_record_is_a_doubt(power, status, bus_type, told):
    unit = f"1,'1 ',{power},0,9,-9,1.0,0,100,0,1,0,0,1,{status},100,20.0,5.0"
    text = section_of("BUS", f"1,'A',230.0,{bus_type},1,1,1,1.0,0.0", 33).replace(
        "0 / END\nQ", f"0 / END OF BUS DATA, BEGIN GENERATOR DATA\n{unit}\n0 / END\nQ"
    )
    found = looked_at(text).doubts
    assert [doubt.texts for doubt in found] == [(text,) for text in told]
    assert all(str(doubt).startswith("generator 1:1 (own.raw:7): ") for doubt in found)


def test_all_codes_of_a_file_are_refused_at_once(tmp_path):
    text = (RAW / "revision_33.raw").read_text()
    path = tmp_path / "codes.raw"
    path.write_text(text.replace("230.0000,3,", "230.0000,9,").replace("'1 ',1,", "'1 ',2,", 1))
    with pytest.raises(gf.CaseError) as raised:
        read_network(path)
    assert len(raised.value.faults) == 2
