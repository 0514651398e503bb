"""The monitor language as text."""

import pytest

import gridfold as gf
from gridfold.runs.monitor import DEFAULT_MONITOR, Monitor, parse_monitor
from gridfold.runs.monitor.text import Statement


def test_a_quantity_holds_until_the_next_one():
    found = parse_monitor("flow 101-103, 2-3:B, voltage 1001-1050, area:2 except kv<100, angle")
    assert found == Monitor(
        (
            Statement("flow", "101-103, 2-3:B"),
            Statement("voltage", "1001-1050, area:2 except kv<100"),
            Statement("angle"),
        )
    )


@pytest.mark.parametrize("text", ["voltage, every 5", "every 5 steps, voltage", "Voltage, EVERY 5"])
def test_every_how_many_th_step_is_part_of_the_text(text):
    assert parse_monitor(text) == Monitor((Statement("voltage"),), 5)


def test_every_how_many_th_step_alone_is_about_what_tables_hold():
    assert parse_monitor("every 5") == Monitor((), 5)


def test_areas_are_a_quantity_where_they_begin_and_a_place_with_a_colon():
    assert parse_monitor("area 1,2, voltage area:3, 7").statements == (
        Statement("area", "1, 2"),
        Statement("voltage", "area:3, 7"),
    )


def test_an_interface_may_have_a_name_and_names_may_hold_commas():
    (named, plain, quoted) = parse_monitor(
        'interface WEST-EAST = 1-2, "A, B"-7, interface area:1 to area:2, interface "N, S" = 3-4'
    ).statements
    assert named == Statement("interface", '1-2, "A, B"-7', "WEST-EAST")
    assert plain == Statement("interface", "area:1 to area:2")
    assert quoted.label == "N, S"


def test_an_interface_with_its_name_ends_the_one_before():
    text = "interface WEST = 1-2, 3-4, EAST = 5-6, kv=230, voltage 3, every 2, every 2"
    *interfaces, voltage = parse_monitor(text).statements
    assert interfaces == [
        Statement("interface", "1-2, 3-4", "WEST"),
        Statement("interface", "5-6, kv=230", "EAST"),
    ]
    assert voltage == Statement("voltage", "3")


def test_what_tables_hold_by_default_is_a_monitor():
    kinds = [statement.kind for statement in parse_monitor(DEFAULT_MONITOR).statements]
    assert kinds == ["angle", "speed", "voltage"]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "it is empty"),
        (" ", "it is empty"),
        (",", "a comma of ',' has nothing beside it"),
        ("101-103", "'101-103' has no quantity before it"),
        ("voltage, every", "'every' is followed by a number of steps, such as every 5$"),
        ("voltage, every 2, every 3", "'every' is given twice, with 2 and 3 steps"),
        ("voltage, every 0", "followed by a number"),
        ("voltage, every 2.5", "followed by a number"),
        (
            "voltage north, flow 7",
            "voltage: 'north' names nothing.*flow: a line is written 101-103",
        ),
        ("interface", "an interface is followed by its lines"),
        ("voltage 1,,2", "a comma of 'voltage 1,,2' has nothing beside it"),
        ("interface A = 1-2, interface A = 2-3", "interface A is given twice, as 1-2 and 2-3"),
        ("interface A = 1-2, A = 2-3", "interface A is given twice, as 1-2 and 2-3"),
        ("flow 7", "all lines of a bus are bus:101 to all"),
        ('voltage "A', "a quote is not closed"),
    ],
)
def test_what_has_no_meaning_is_told_with_its_part(text, said):
    with pytest.raises(gf.OptionError, match=f"--monitor: .*{said}"):
        parse_monitor(text, "--monitor")
