"""The list of contingencies, against the tables of the case."""

import pytest

import gridfold as gf
from gridfold.study.generate import (
    contingency_from_record,
    list_contingencies,
)
from gridfold.study.study_file import parse_study

STUDY_AREA = frozenset(range(1, 37))


@pytest.fixture(scope="module")
def npcc():
    return gf.load_case("npcc")


def listed(case, folder=None, **keys):
    further = {name: keys.pop(name) for name in ("contingency",) if name in keys}
    study = parse_study({"schema": 1, "contingencies": keys, **further})
    return list_contingencies(study, case, STUDY_AREA, folder)


def test_a_fault_at_every_bus_of_the_study_area(npcc):
    found = listed(npcc, bus_faults="study area", clearing_time=0.2, start=1.0)
    assert [item.number for item in found] == list(range(1, 37))
    assert [item.events for item in found] == [
        (gf.BusFault(bus, 1.0, 0.2),) for bus in range(1, 37)
    ]


def test_both_ends_of_every_branch_inside_the_study_area(npcc):
    found = listed(npcc, line_faults="study area")
    inside = [b for b in npcc.branches if {b.from_bus, b.to_bus} <= STUDY_AREA]
    assert len(found) == 2 * len(inside)
    ends = [(item.events[0].branch, item.events[0].fraction) for item in found]
    assert len(set(ends)) == len(ends)
    assert all(item.events[0].trip for item in found)
    for item in found:
        bus = int(item.name.rsplit(" ", 1)[1])
        first, last = item.events[0].branch.split(":")[0].split("-")
        assert bus == int(first if item.events[0].fraction == 0 else last)


def test_parallel_branches_are_told_apart_by_their_circuit(npcc):
    found = listed(npcc, line_faults="all")
    assert len({item.name for item in found}) == 2 * len(npcc.branches)


def test_every_machine_of_an_area_is_tripped(npcc):
    found = listed(npcc, machine_trips="area 1")
    units = [item.events[0] for item in found]
    assert [(unit.bus, unit.id) for unit in units] == [
        (g.bus, g.id) for g in npcc.generators if g.bus in STUDY_AREA
    ]


def test_places_are_told_by_one_grammar(npcc):
    faults = listed(npcc, bus_faults="study area except 3-36", line_faults="area:1 to area:2")
    assert [item.name for item in faults[:2]] == ["bus 1", "bus 2"]
    area = {bus.number: bus.area for bus in npcc.buses}
    ties = [b for b in npcc.branches if {area[b.from_bus], area[b.to_bus]} == {1, 2}]
    assert len(faults) == 2 + 2 * len(ties) > 2
    (trip,) = listed(npcc, machine_trips="21:1")
    assert trip.events == (gf.MachineTrip(21, "1", 0.0),)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("area 99", "contingencies.bus_faults: there is no area 99 in case npcc"),
        ("3,999", "there is no bus 999 in case npcc"),
        ("everywhere", "names nothing"),
        ("9-3", "ends before it starts"),
        ("", "names nothing"),
    ],
)
def test_a_wrong_place_is_refused(npcc, text, said):
    with pytest.raises((gf.OptionError, gf.CaseFileError), match=said):
        listed(npcc, bus_faults=text)


def test_a_table_gives_contingencies_of_one_or_more_events(npcc, tmp_path):
    (tmp_path / "list.csv").write_text(
        "name,event,kind,bus,duration,branch,time\n"
        "# a comment\n"
        "short,,bus-fault,3,0.1,,\n"
        "double,1,bus-fault,5,0.2,,\n"
        "double,2,branch-trip,,,3-2,0.2\n"
    )
    found = listed(npcc, tmp_path, csv="list.csv")
    assert [(item.name, item.kind) for item in found] == [
        ("short", "bus fault"),
        ("double", "events"),
    ]
    assert found[1].events == (gf.BusFault(5, duration=0.2), gf.BranchTrip("3-2", 0.2))


def test_events_of_contingencies_may_name_their_bus(npcc, tmp_path):
    (tmp_path / "table.csv").write_text("name,kind,bus,duration\nby table,bus-fault,Pontiac,0.1\n")
    by_file = {"name": "by file", "events": [{"kind": "bus-fault", "bus": "Pontiac"}]}
    none = {"bus_faults": "none", "line_faults": "none"}
    found = listed(npcc, tmp_path, contingency=[by_file], csv="table.csv", **none)
    (bus,) = [bus.number for bus in npcc.buses if bus.name.strip() == "Pontiac"]
    assert [item.events[0].bus for item in found] == [bus, bus]
    wrong = {"name": "wrong", "events": [{"kind": "bus-fault", "bus": "Pontiak"}]}
    with pytest.raises(gf.EventError, match=r"contingency 'wrong': bus: .*did you mean 'Pontiac'"):
        listed(npcc, contingency=[wrong], **none)


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ("name,kind,bus\nx,bus-fault,3\nx,bus-fault,4\nx,bus-fault,5\n", "list.csv:4: 'x' is"),
        ("name,kind,bus\nx,bus-fault,3\ny,bus-fault,4\nx ,bus-fault,3\n", "name in line 2"),
        ("name,kind,bus\nx,bus-fault,3\nx\u200b,bus-fault,4\n", "name in line 2 already"),
        ("name,event,kind,bus\nx,1,bus-fault,3\nx,1,bus-fault,4\n", "this event in line 2"),
        ("name,event,kind,bus\nx,,bus-fault,3\nx,,bus-fault,4\n", "this event in line 2"),
    ],
)
def test_rows_of_one_name_are_never_joined_in_silence(npcc, tmp_path, table, said):
    (tmp_path / "list.csv").write_text(table)
    with pytest.raises(gf.CaseFileError) as caught:
        listed(npcc, tmp_path, csv="list.csv")
    assert said in str(caught.value)


@pytest.mark.parametrize("name", ["bus  3", "bus 3\u200b", "\u202ebus 3", "bus\u00a03"])
def test_names_that_look_alike_are_one_name(npcc, name):
    section = {"name": name, "events": [{"kind": "bus-fault", "bus": 4}]}
    with pytest.raises(gf.OptionError, match="one name: 'bus 3', "):
        listed(npcc, bus_faults="3", contingency=[section])


def test_faults_of_a_table_are_named_with_their_lines(npcc, tmp_path):
    (tmp_path / "list.csv").write_text(
        "name,kind,bus,tme\nshort,bus-falt,3,\n,bus-fault,3,\nlong,bus-fault,x,\n"
    )
    with pytest.raises(gf.CaseFileError) as caught:
        listed(npcc, tmp_path, csv="list.csv")
    text = "\n".join(caught.value.faults)
    assert "list.csv:2" in text
    assert "did you mean 'bus-fault'?" in text
    assert "list.csv:3: name is empty" in text
    assert "list.csv:4" in text


def test_an_event_that_does_not_fit_names_its_contingency(npcc):
    section = {"name": "far away", "events": [{"kind": "bus-fault", "bus": 999}]}
    with pytest.raises(gf.EventError, match=r"contingency 'far away'.*no bus 999"):
        listed(npcc, contingency=[section])
    late = {"name": "late", "events": [{"kind": "bus-fault", "bus": 3, "start": 99}]}
    with pytest.raises(gf.EventError, match=r"'late'.*the run ends at 16 s"):
        listed(npcc, contingency=[late])


def test_nothing_to_do_and_two_of_one_name_are_refused(npcc):
    with pytest.raises(gf.OptionError, match="no contingencies"):
        listed(npcc)
    section = {"name": "bus 3", "events": [{"kind": "bus-fault", "bus": 4}]}
    with pytest.raises(gf.OptionError, match="one name: 'bus 3'"):
        listed(npcc, bus_faults="3", contingency=[section])


def test_a_record_read_back_is_the_same_contingency(npcc):
    for item in listed(npcc, bus_faults="1-3", line_faults="1-9", machine_trips="21-27"):
        assert contingency_from_record(item.record()) == item
