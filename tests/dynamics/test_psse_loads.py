"""Load models of PSS/E dynamics data: which loads they speak of, and which record counts."""

from __future__ import annotations

from dataclasses import replace

import pytest

import gridfold as gf
from gridfold.dynamics.own_models import answering
from gridfold.dynamics.psse_loads import LoadDevices, load_devices
from gridfold.dynamics.psse_records import device_records
from gridfold.dynamics.registry import DEVICES
from gridfold.grid.dynamic_records import DynamicData, DynamicRecord

IEEL = (0.4, 0.0, 0.6, 0.4, 0.0, 0.6, 2.0, -1.8, 2.0, 1.0, 0.0, 2.0, 1.0, 0.0)
CIM5 = (1, 0.01, 0.1, 3, 0.01, 0.1, 0, 0, 1, 0, 1.2, 0, 0, 1.3, 0.6, 0.7, 10, 5, 2.0, 1.0)
LOADS = (
    gf.Load(1, "1", 50.0, area=3, zone=4, owner=5),
    gf.Load(2, "A", 100.0, owner=6),
    gf.Load(2, "B", 20.0, owner=6),
    gf.Load(2, "C", 10.0, in_service=False),
    gf.Load(2, "D", 0.0, 5.0),
)


@pytest.fixture
def case() -> gf.Case:
    return gf.Case(
        name="loads",
        buses=(gf.Bus(1), gf.Bus(2, area=7, zone=8)),
        branches=(gf.Branch(1, 2, reactance=0.1),),
        generators=(gf.Generator(1, active_mw=180.0, control=gf.Control.SLACK),),
        loads=LOADS,
    )


def found_in(case: gf.Case, *rows: tuple[str, int, str]) -> LoadDevices:
    records = [
        DynamicRecord(model, bus, name, CIM5 if model.startswith("CIM5") else IEEL, line)
        for line, (model, bus, name) in enumerate(rows, start=1)
    ]
    return load_devices(case, records, answering(DEVICES), "own.dyr")


def names(found: LoadDevices) -> list[str]:
    return [str(record) for record in found.records]


@pytest.mark.parametrize(
    ("row", "loads"),
    [
        (("IEELBL", 2, "A"), ["2:load-A"]),
        (("IEELBL", 2, "*"), ["2:load-A", "2:load-B", "2:load-D"]),
        (("IEELOW", 6, "*"), ["2:load-A", "2:load-B"]),
        (("IEELZN", 4, "*"), ["1:load-1"]),
        (("IEELZN", 8, "B"), ["2:load-B"]),
        (("IEELAR", 3, "*"), ["1:load-1"]),
        (("IEELAR", 7, "*"), ["2:load-A", "2:load-B", "2:load-D"]),
        (("IEELAL", 0, "*"), ["1:load-1", "2:load-A", "2:load-B", "2:load-D"]),
    ],
)
def test_a_record_speaks_of_the_loads_of_its_scope_in_service(case, row, loads):
    assert names(found_in(case, row)) == [f"ieel {load}" for load in loads]


def test_the_narrowest_scope_counts(case):
    rows = (("IEELAL", 0, "*"), ("CIM5AR", 7, "*"), ("IEELZN", 8, "B"), ("IEELBL", 2, "B"))
    found = found_in(case, *rows)
    assert sorted(names(found)) == ["cim5 2:load-A", "ieel 1:load-1", "ieel 2:load-B"]
    assert found.origins["ieel 2:load-B"] == "own.dyr:4"
    assert found.origins["ieel 1:load-1"] == "own.dyr:1"
    assert found.notices == [
        "own.dyr: CIM5AR 7:* (line 2): 1 load draws no active power, so that no motor runs there, "
        "first load 2:D"
    ]


def test_two_records_of_one_scope_are_a_fault(case):
    found = found_in(case, ("IEELBL", 2, "*"), ("CIM5BL", 2, "A"))
    assert found.faults == ["load 2:A has 2 load models: IEELBL (line 1), CIM5BL (line 2)"]


@pytest.mark.parametrize(
    ("row", "why"),
    [
        (("IEELBL", 9, "1"), "IEELBL 9:1 (own.dyr:1): there is no bus 9"),
        (
            ("IEELBL", 2, "Q"),
            "IEELBL 2:Q (own.dyr:1): bus 2 has no load 'Q', but 'A', 'B', 'C', 'D'",
        ),
        (("IEELAR", 1, "*"), "IEELAR 1:* (own.dyr:1): area 1 has no load"),
        (("IEELZN", 8, "9"), "IEELZN 8:9 (own.dyr:1): zone 8 has no load with id '9'"),
    ],
)
def test_a_record_that_speaks_of_no_load_is_unplaced(case, row, why):
    found = found_in(case, row)
    assert (found.records, found.unplaced) == ([], [why])


def test_a_record_of_a_load_out_of_service_has_no_effect(case):
    found = found_in(case, ("IEELBL", 2, "C"))
    assert found.records == found.unplaced == []
    assert found.notices == ["own.dyr: IEELBL 2:C (line 1): its loads are out of service"]


def test_a_record_with_too_few_values_names_its_line(case):
    rows = [DynamicRecord("IEELBL", 2, "A", (0.4,), 3)]
    found = load_devices(case, rows, answering(DEVICES), "own.dyr")
    assert found.faults == ["IEELBL 2:A (own.dyr:3): expected 14 values, found 1"]


def test_devices_of_loads_stand_beside_those_of_generators(case):
    rows = (
        DynamicRecord("GENCLS", 1, "1", (4.0, 1.0), 1),
        DynamicRecord("IEELAL", 0, "*", IEEL, 2),
        DynamicRecord("CIM5BL", 2, "A", CIM5, 3),
    )
    found = device_records(case, DynamicData("own.dyr", rows))
    assert [str(record) for record in found.records] == [
        "gencls 1:1", "ieel 1:load-1", "cim5 2:load-A", "ieel 2:load-B", "ieel 2:load-D",
    ]  # fmt: skip
    assert found.replaced == found.unplaced == ()
    generators = (replace(case.generators[0], source_reactance=0.2),)
    built = gf.build_model(replace(case, generators=generators, devices=found.records))
    assert built.residual < 1e-9
