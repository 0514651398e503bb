"""Records of RAW files that gridfold has no model for, in service and out of it."""

from __future__ import annotations

from pathlib import Path

import pytest
from raw_texts import BUSES, UNITS, raw_text, with_field

import gridfold as gf
from gridfold.io.powerio_cases import read_network

FACTS = "'STATCOM',3,0,1,0.0,0.0,1.0,100.0,0.0,1.1,0.9,1.1,0.0,0.05,100.0,1,0.0,0.0,0"
CIRCUIT = (  # two converters, two dc buses, a link
    "'TRIANGLE',2,2,1,1,100.0,0.0,0",
    *(f"{bus},2,20.0,5.0,0.0,5.0,230.0,0.4,1.0,1.5,0.5,0.00625,60.0,1.0,0.1,1" for bus in (3, 5)),
    "1,3,1,1,'D1',0,0.0,1",
    "2,5,1,1,'D2',0,0.0,1",
    "1,2,'1',1,5.0,0.1",
)
#: Twelve numbers, one of them a 0 at the beginning of a line, a whole number and a text.
GENERIC = ("'G1','PVBLOCK',1,3,12,1,1,1,1,1", "1,2,3,4,5,6,7,8,9,10", "0,2", "5", "'X'")
MOTOR = "4,'M1',1,1,1,1,1,1,2,100.0,4.16,1,10.0,1.0,0.01,0.1,3.0,0.02,0.1,0.01,0.1,0.1"
RECORDS = {
    "FACTS DEVICE": ((FACTS,), 3, 'FACTS device "STATCOM"'),
    "MULTI-TERMINAL DC": (CIRCUIT, 4, 'dc line with more than two ends "TRIANGLE"'),
    "GNE": (GENERIC, 7, 'GNE device "G1"'),
    "INDUCTION MACHINE": ((MOTOR,), 2, "induction machine 4:M1"),
}


def read(folder: Path, changes: dict[str, tuple[str, ...]], **options: bool) -> gf.Case:
    path = folder / "case.raw"
    path.write_text(raw_text(changes), encoding="utf-8")
    return read_network(path, **options)


def line_of(folder: Path, record: str) -> int:
    return (folder / "case.raw").read_text().split("\n").index(record) + 1


@pytest.mark.parametrize("section", RECORDS)
def test_a_record_out_of_service_is_told_and_changes_nothing(section, tmp_path):
    lines, status, name = RECORDS[section]
    off = with_field(lines[0], status, "0")
    case = read(tmp_path, {section: (off, *lines[1:])})
    assert case.unsupported == ()
    wanted = f"{name} (line {line_of(tmp_path, off)}), out of service, left out"
    assert [notice for notice in case.notices if "out of service" in notice] == [wanted]
    assert case.branches == read(tmp_path, {}).branches


@pytest.mark.parametrize("section", RECORDS)
@pytest.mark.parametrize("status", ["1", ""])
def test_a_record_in_service_is_refused_by_its_name_and_line_or_left_out(section, status, tmp_path):
    lines, place, name = RECORDS[section]
    live = with_field(lines[0], place, status)
    with pytest.raises(gf.CaseFileError) as raised:
        read(tmp_path, {section: (live, *lines[1:])})
    told = f"{name} (line {line_of(tmp_path, live)})"
    assert raised.value.faults == [f"not supported: {told}"]
    case = read(tmp_path, {section: (live, *lines[1:])}, allow_unsupported=True)
    assert case.unsupported == (told,)


@pytest.mark.parametrize("section", ["MULTI-TERMINAL DC", "GNE"])
def test_each_record_of_several_lines_is_one(section, tmp_path):
    lines, status, _ = RECORDS[section]
    other = with_field(with_field(lines[0], status, "0"), 0, "'OTHER'")
    case = read(tmp_path, {section: (*lines, other, *lines[1:])}, allow_unsupported=True)
    assert len(case.unsupported) == 1
    assert sum('"OTHER"' in notice for notice in case.notices) == 1


def test_a_step_up_transformer_matters_where_its_unit_runs(tmp_path):
    unit = with_field(UNITS[1], 12, "0.1")
    idle = with_field(unit, 14, "0")
    assert read(tmp_path, {"GENERATOR": (UNITS[0], idle)}).unsupported == ()
    with pytest.raises(gf.CaseFileError, match=r"generator 2:1 \(case.raw:15\): step-up"):
        read(tmp_path, {"GENERATOR": (UNITS[0], unit)})


def test_a_dc_line_at_a_bus_that_is_not_there_is_named_with_its_line(tmp_path):
    ends = ("77,1,1,100.0,1.0", "5,2,2,20.0,1.0")
    with pytest.raises(gf.CaseFileError) as raised:
        read(tmp_path, {"VSC DC LINE": ("'OST',1,0.7,1,1.0", *ends)})
    where = f"(case.raw:{line_of(tmp_path, ends[0]) - 1})"
    assert raised.value.faults == [f'VSC dc line "OST" {where}: there is no bus 77']


WRONG = [
    ("BUS", BUSES[2], 0, "x3", "I of a bus is no number: x3"),
    ("BUS", BUSES[2], 0, "-3", "I of a bus is -3; it must be a whole number"),
    ("BUS", BUSES[2], 0, "3.5", "I of a bus is 3.5; it must be a whole number"),
    ("BUS", BUSES[2], 0, "1e30", "I of a bus is 1e30; it must be a whole number"),
    ("BUS", BUSES[2], 4, "-1", "AREA of a bus is -1; it must be a whole number"),
    ("BUS", BUSES[2], 7, "nan", "VM of a bus is no number: nan"),
    ("GENERATOR", UNITS[1], 0, "2.5", "I of a generator is 2.5; it must be a whole number"),
    ("GENERATOR", UNITS[1], 7, "-1", "IREG of a generator is -1; it must be a whole number"),
    ("GENERATOR", UNITS[1], 2, "lots", "PG of a generator is no number: lots"),
    ("LOAD", "-4,'1',1,1,1,180.0,50.0", 1, "'1'", "I of a load is -4; it must be a whole number"),
    ("FIXED SHUNT", "4,'1',1,0,20", 4, "inf", "BL of a fixed shunt is no number: inf"),
    ("SWITCHED SHUNT", "4,1,0,1,1.05,0.95", 0, "-4", "I of a switched shunt is -4;"),
    ("AREA", "1,1,0,10,'A'", 0, "one", "I of an area is no number: one"),
    ("BRANCH", "3,4,'9',0.01,0.08", 1, "-4.5", "J of a branch is -4.5; it must be a whole number"),
]  # fmt: skip


@pytest.mark.parametrize(("section", "record", "place", "value", "fault"), WRONG)
def test_a_field_that_is_no_such_number_is_named_with_its_line(
    section, record, place, value, fault, tmp_path
):
    spoilt = with_field(record, place, value)
    with pytest.raises(gf.CaseFileError) as raised:
        read(tmp_path, {section: (spoilt,)})
    told = f"line {line_of(tmp_path, spoilt)}: {fault}"
    assert any(line.startswith(told) for line in raised.value.faults)


@pytest.mark.parametrize(
    ("header", "fault"),
    [
        ("0,abc,33,0,1,60.0", "SBASE of the header is abc; it must be a positive number"),
        ("0,-100.0,33,0,1,60.0", "SBASE of the header is -100.0; it must be a positive number"),
        ("0,100.0,33,0,1,0", "BASFRQ of the header is 0; it must be a positive number"),
    ],
)
def test_bases_of_the_header_are_positive(header, fault, tmp_path):
    path = tmp_path / "case.raw"
    path.write_text(raw_text({}, header), encoding="utf-8")
    with pytest.raises(gf.CaseFileError) as raised:
        read_network(path)
    assert raised.value.faults[0] == f"line 1: {fault}"
