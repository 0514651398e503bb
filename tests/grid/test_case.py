from dataclasses import fields, replace

import pytest

import gridfold as gf
from gridfold.grid.case import number_fields

TABLES = ("buses", "branches", "generators", "loads", "shunts", "devices")


def with_first(case, table, **changes):
    first, *rest = getattr(case, table)
    return replace(case, **{table: (replace(first, **changes), *rest)})


def test_records_are_named_by_bus_and_id():
    assert str(gf.Bus(7)) == "bus 7"
    assert str(gf.Branch(3, 2, "b")) == "branch 3-2:b"
    assert str(gf.Generator(23, "2")) == "generator 23:2"
    assert str(gf.Load(3)) == "load 3:1"
    assert str(gf.Shunt(3, "x")) == "shunt 3:x"
    assert str(gf.DeviceRecord("two_axis", 23, "2")) == "two_axis 23:2"


def test_bus_index_gives_the_position_of_a_bus_number(ring):
    shuffled = replace(ring, buses=ring.buses[::-1])
    assert shuffled.bus_index == {4: 0, 3: 1, 2: 2, 1: 3}


def test_branches_out_are_those_out_of_service(ring):
    assert ring.branches_out == {4}


def test_a_record_is_located_by_file_and_line_where_known(ring):
    located = replace(ring, origins={"bus 2": "buses.csv:3"})
    assert located.locate(ring.buses[1]) == "bus 2 (buses.csv:3)"
    assert located.locate(ring.buses[0]) == "bus 1"


def test_origins_have_no_part_in_comparisons(ring):
    assert replace(ring, origins={"bus 2": "buses.csv:3"}) == ring


def test_number_fields_leave_out_texts_flags_and_absent_values():
    shunt = {"bus", "conductance_mw", "susceptance_mvar"}
    assert set(number_fields(gf.Shunt(3, susceptance_mvar=5.0))) == shunt
    assert "latitude" not in number_fields(gf.Bus(1))
    assert number_fields(gf.Bus(1, latitude=41.0))["latitude"] == 41.0


@pytest.mark.parametrize("table", TABLES)
def test_fingerprint_depends_on_every_field_of_every_record(table, ring):
    first = getattr(ring, table)[0]
    for item in fields(first):
        other = {"parameters": {"inertia": 5.0}, "control": gf.Control.POWER}.get(item.name, 77)
        changed = with_first(ring, table, **{item.name: other})
        label = (table, item.name) == ("buses", "owner")  # no simulation depends on it
        assert (changed.fingerprint == ring.fingerprint) == label, item.name


def test_fingerprint_depends_on_base_and_frequency_but_not_on_name_or_origins(ring):
    assert replace(ring, base_mva=50.0).fingerprint != ring.fingerprint
    assert replace(ring, frequency_hz=50.0).fingerprint != ring.fingerprint
    renamed = replace(ring, name="other", description="told", origins={"bus 1": "x:1"})
    renamed = replace(renamed, unsupported=("a dc line",), notices=("bus 4 left out",))
    assert renamed == replace(ring, name="other", description="told")
    assert renamed.fingerprint == ring.fingerprint
