"""What a text chooses of a case, found by hand in a small one."""

import time

import pytest

import gridfold as gf
from gridfold.grid.selection import (
    LineEnd,
    select_buses,
    select_lines,
    select_machines,
    select_numbers,
)
from gridfold.grid.selection_text import Word, as_ranges, parse_selection

STUDY = frozenset({101, 105})


@pytest.fixture(scope="module")
def case():
    """Four buses with gaps in their numbers in two areas, two lines side by side, three machines."""
    buses = (
        gf.Bus(101, "NORTH 1", 345.0, area=1, zone=1, owner=1),
        gf.Bus(105, "North 2", 138.0, area=1, zone=2, owner=7),
        gf.Bus(230, "SOUTH, OLD", 138.0, area=2, zone=2, owner=7),
        gf.Bus(999, "O'NEIL", 13.8, area=9, zone=2, owner=1),
    )
    branches = (
        gf.Branch(101, 105, "1", reactance=0.1),
        gf.Branch(105, 230, "1", reactance=0.1),
        gf.Branch(105, 230, "B2", reactance=0.1, in_service=False),
        gf.Branch(999, 230, "1", reactance=0.1),
    )
    units = (gf.Generator(101, "1"), gf.Generator(101, "G2"), gf.Generator(999, "1"))
    names = {"area_names": {1: "LAND", 2: "COAST"}, "zone_names": {2: "RIM"}}
    return gf.Case("small", buses, branches, units, owner_names={7: "CITY"}, **names)


@pytest.mark.parametrize(
    ("text", "buses"),
    [
        ("100-300", (101, 105, 230)),
        ("999,101-105,101", (999, 101, 105)),
        ("area:1", (101, 105)),
        ("area:1,9", (101, 105, 999)),
        ("areas 1, 9", (101, 105, 999)),
        ("area:1, bus:999", (101, 105, 999)),
        ("zone:2 except area:9", (105, 230)),
        ("owner:7", (105, 230)),
        ("kv:138", (105, 230)),
        ("kv 13.8-138", (105, 230, 999)),
        ("kv>=138", (101, 105, 230)),
        ("kv > 138", (101,)),
        ("KV<138", (999,)),
        ("kv<=138, 101", None),
        ("kv<=138, bus:101", (105, 230, 999, 101)),
        ('"north*"', (101, 105)),
        ("'NORTH  1'", (101,)),
        ('"south, old",101', (230, 101)),
        ('"O\'NEIL"', (999,)),
        ('area:"land"', (101, 105)),
        ('zone:"RIM" except owner:"city"', (999,)),
        ("all", (101, 105, 230, 999)),
        ("All except 105, 900-1000", (101, 230)),
        ("except area:1,2", (999,)),
        ("none", ()),
        ("study  area", (101, 105)),
        ("study area, 999 except kv>300", (105, 999)),
    ],
)
def test_buses_are_chosen_in_the_order_of_the_text(case, text, buses):
    if buses is None:
        with pytest.raises(gf.OptionError, match=r"no bus of 101 kV .* known: 13\.8, 138, 345"):
            select_buses(text, case)
    else:
        assert select_buses(text, case, study=STUDY) == buses


@pytest.mark.parametrize(
    ("text", "units"),
    [
        ("all", ("101:1", "101:G2", "999:1")),
        ("900-1000, 101:G2", ("999:1", "101:G2")),
        ('"north 1":1', ("101:1",)),
        ("area:1 except 101:G2", ("101:1",)),
        ("area:1,9", ("101:1", "101:G2", "999:1")),
    ],
)
def test_machines_are_chosen_by_id_or_by_their_buses(case, text, units):
    assert tuple(map(str, select_machines(text, case))) == units


def test_machines_are_chosen_among_those_that_may_be(case):
    last = [gf.UnitKey(999, "1")]
    assert select_machines("all", case, among=last) == (gf.UnitKey(999, "1"),)
    with pytest.raises(gf.OptionError, match="there is no machine at bus 101"):
        select_machines("101", case, among=last)


@pytest.mark.parametrize(
    ("text", "ends"),
    [
        ("101-105", [(0, 101)]),
        ("105-101", [(0, 105)]),
        ("230-105", [(1, 230), (2, 230)]),
        ("230-105:B2, 999-230", [(2, 230), (3, 999)]),
        ("101-105, 105-101, area:1", [(0, 101), (0, 105)]),
        ("'north 2'-'SOUTH, OLD':1", [(1, 105)]),
        ("area:1", [(0, 101)]),
        ("area:2 to area:1", [(1, 230), (2, 230)]),
        ("area:1 to all", [(1, 105), (2, 105)]),
        ("bus:100-240", [(0, 101), (1, 105), (2, 105)]),
        ("kv:138,13.8", [(1, 105), (2, 105), (3, 999)]),
        ("all except 105-230:B2", [(0, 101), (1, 105), (3, 999)]),
        ("all except bus:105", [(3, 999)]),
        ("study area", [(0, 101)]),
    ],
)
def test_lines_are_chosen_by_name_by_what_they_join_or_within_buses(case, text, ends):
    assert select_lines(text, case, study=STUDY) == tuple(LineEnd(*end) for end in ends)


def test_where_buses_are_usual_a_line_has_its_word(case):
    within = select_lines("100-300", case, word=Word.BUS)
    assert [line.position for line in within] == [0, 1, 2]
    assert select_lines("line:101-105", case, word=Word.BUS) == (LineEnd(0, 101),)
    assert select_lines("105-230:B2", case, word=Word.BUS) == (LineEnd(2, 105),)


def test_numbers_of_areas_come_from_their_buses(case):
    assert select_numbers("1-5", case, "areas", Word.AREA) == (1, 2)
    assert select_numbers("kv<100", case, "areas", Word.AREA) == (9,)


@pytest.mark.parametrize("text", ["1-99999999", "0-999999999999999999"])
def test_a_long_range_takes_no_longer(case, text):
    began = time.perf_counter()
    assert select_buses(text, case) == (101, 105, 230, 999)
    assert time.perf_counter() - began < 0.1


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("102", "there is no bus 102 in case small; the nearest is 101$"),
        ("106-229", "there is no bus in the range 106-229 in case small; the nearest is 105"),
        ("101,7; 8", "'7; 8' in '101,7; 8' names nothing"),
        (
            "8, area:4",
            "no bus 8 in case small; the nearest is 101; there is no area 4 .* 1, 2, 9",
        ),
        ("area:1,105", "there is no area 105 .* known: 1, 2, 9; the bus is written bus:105"),
        ("area:1 except 105", "after 'except' say what '105' is: bus:105 or area:105"),
        ('"NORT 1"', "no bus 'NORT 1' in case small; did you mean 'NORTH 1'"),
        ('area:"COST"', "no area 'COST' in case small; did you mean 'COAST'"),
        ('owner:"X"', "no owner 'X' in case small; known: 'CITY'"),
        ("kv:230", "no bus of 230 kV in case small; known: 13.8, 138, 345"),
        ("101:1", "machine 101:1 is no bus, and buses are chosen here"),
        ("line:101-105", "line 101-105 is no bus"),
        ("study area", "no study area is given here"),
        ("9-3", "ends before it starts"),
        ("kv:300-200", "ends before it starts"),
        ("-3", "'-3' names nothing"),
        ("", "'' names nothing"),
        ("101,,105", "'' in '101,,105' names nothing"),
        ("101,", "'' in '101,' names nothing"),
        ("1e3", "names nothing"),
        ("nan", "names nothing"),
        ("٣", "names nothing"),
        ("9" * 4000, "names nothing"),
        ('"NORTH', "a quote is not closed"),
        ("area:1 except", "'' in 'area:1 except' names nothing"),
        ("north", "names nothing; what is chosen is written as 3,7 or 1-36"),
    ],
)
def test_what_names_nothing_is_refused_in_a_short_message(case, text, said):
    with pytest.raises(gf.OptionError, match=said) as caught:
        select_buses(text, case)
    assert len(str(caught.value)) < 250


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("101-230", "there is no line 101-230 in case small; lines from there lead to 105"),
        ("105-230:9", "there is no line 105-230:9 in case small; its circuits: 1, B2"),
        ("area:1 to area:9", "there is no line from area 1 to area 9"),
        ("area:9", "no line of case small lies within 'area:9'"),
        ("101", "a line is written 101-103 or 101-103:CIRCUIT, not '101'"),
        ("101:1", "a line is written"),
        ("101-777", "there is no bus 777"),
    ],
)
def test_lines_that_are_not_there_are_told_with_those_that_are(case, text, said):
    with pytest.raises(gf.OptionError, match=said):
        select_lines(text, case)


def test_machines_that_are_not_there_are_told_with_those_that_are(case):
    with pytest.raises(
        gf.OptionError, match="there is no machine 101:3; at its bus: 101:1, 101:G2"
    ):
        select_machines("101:3", case)
    with pytest.raises(gf.OptionError, match="line 101-105:1 is no machine"):
        select_machines("101-105:1", case)


def test_the_words_of_a_text_need_no_case():
    assert parse_selection("3, 5-9 except 7") == parse_selection("bus:3,5-9 EXCEPT bus:7")
    with pytest.raises(gf.OptionError, match=r"contingencies: .*'x'.* 'y'"):
        parse_selection("x,1,y", "contingencies")


@pytest.mark.parametrize("text", ["1-36", "3", "3,7", "1-2,5,9-12,140"])
def test_ranges_of_numbers_are_text_and_back(case, text):
    buses = tuple(gf.Bus(number) for number in range(1, 141))
    assert as_ranges(select_buses(text, gf.Case("line", buses, (), ()))) == text
