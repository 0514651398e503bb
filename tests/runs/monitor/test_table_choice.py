"""Columns of a table that was written, chosen as they were watched."""

from contextlib import suppress

import pytest

import gridfold as gf
from gridfold.runs.monitor.table_choice import choose_columns

MONITOR = (
    "voltage 1-40, flow 3-2, 2-3, area:1 to area:2, current 3-2, area 1,2, field_voltage 21-26, "
    "interface WE = area:1 to area:2, load area:1, angle 23"
)


@pytest.fixture(scope="module")
def table(npcc):
    """Names and record of a table of much."""
    run = gf.simulate(npcc, (), 0.02, gf.RungeKutta4(0.01))
    frame = run.frame(MONITOR)
    return list(frame.columns[1:]), frame.attrs["columns"]


@pytest.mark.parametrize(
    "text",
    [
        "voltage 1-40", "voltage area:1 except bus:3", "voltage kv>100", "flow 3-2", "flow 2-3",
        "flow area:1 to area:2", "current 3-2", "area 1", "area 1,2", "field_voltage 23",
        "field_voltage", "load 3-20", "angle 23:2, voltage 5", "interface WE = area:1 to area:2",
    ],
)  # fmt: skip
def test_a_text_means_the_columns_that_it_would_watch(npcc, table, text):
    names, record = table
    watched = gf.simulate(npcc, (), 0.02, gf.RungeKutta4(0.01)).columns(text).names
    expected = {name for name in watched if name in names}
    assert expected
    assert set(choose_columns(names, record, text).names) == expected


def test_columns_are_also_chosen_by_their_names(table):
    names, record = table
    assert choose_columns(names, record, "interface_mw:WE").names == ("interface_mw:WE",)
    assert choose_columns(names, record, "interface").names == (
        "interface_mw:WE", "interface_mvar:WE",
    )  # fmt: skip
    flows = [name for name in names if name.startswith(("p_mw", "q_mvar"))]
    assert list(choose_columns(names, record, "flow").names) == flows
    found = choose_columns(names, record, "p_mw:*, voltage 3, every 5")
    assert found.every == 5
    assert found.names[-1] == "voltage_pu:3"
    assert choose_columns(names, record, "every 2").names == tuple(names)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("frequency 3", "the table has no 'frequency'; it has: voltage, flow"),
        ("voltages", "the table has no 'voltages'; did you mean 'voltage'"),
        ("voltage 99", "there is no bus 99"),
        ("flow 30-31", "no line 30-31"),
        ("area 3", "there is no area 3"),
        ("load 2", "no column of '2'"),
        ("field_voltage 99", "no bus 99"),
        ("voltage study area", "no study area is given here"),
    ],
)
def test_what_the_table_has_not_is_told_with_what_it_has(table, text, said):
    names, record = table
    with pytest.raises(gf.OptionError, match=said):
        choose_columns(names, record, text)


def test_without_metadata_columns_are_chosen_by_numbers_alone(table):
    names, _ = table
    assert choose_columns(names, {}, "voltage 3-4").names == ("voltage_pu:3", "voltage_pu:4")
    assert choose_columns(names, {}, "flow 3-2").names == ("p_mw:3-2", "q_mvar:3-2")
    with pytest.raises(gf.OptionError, match="without its metadata a table knows numbers alone"):
        choose_columns(names, {}, "voltage area:1")


@pytest.mark.parametrize(
    "record",
    [
        {"area": {"x": "1-3"}},
        {"area": {"1": "north"}},
        {"names": {"x": 1}},
        {"names": 3},
        {"kv": {"1": None}},
        {"study_buses": "1-99999999999999"},
    ],
    ids=str,
)
def test_damaged_metadata_are_an_error_or_without_effect(table, record):
    names, _ = table
    with suppress(gf.OptionError):
        assert choose_columns(names, record, "voltage 3").names == ("voltage_pu:3",)
