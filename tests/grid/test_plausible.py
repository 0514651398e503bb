"""Usual values of network data: both ends of every range of the table."""

from __future__ import annotations

from dataclasses import replace

import pytest

import gridfold as gf
from gridfold.grid.plausible import NETWORK_ROWS, network_doubts
from gridfold.powerflow.plausible import flow_doubts

LINE = gf.Branch(1, 2, resistance=0.01, reactance=0.1)
CASE = gf.Case(
    name="two buses",
    buses=(gf.Bus(1, base_kv=230.0), gf.Bus(2, base_kv=230.0)),
    branches=(LINE,),
    generators=(
        gf.Generator(1, active_mw=80.0, base_mva=120.0, control=gf.Control.SLACK),
        gf.Generator(2, active_mw=80.0, base_mva=120.0),
    ),
    loads=(gf.Load(2, "1", 150.0, 20.0),),
    shunts=(gf.Shunt(2, "1", 0.0, 10.0),),
)

#: Of each row: what is changed, values that are usual, and values that are not.
ROWS = {
    "case.frequency": ("case", "frequency_hz", (50.0, 60.0), (49.0, 55.0, 61.0, 600.0)),
    "case.base": ("case", "base_mva", (1.0, 10_000.0), (0.9, 10_001.0)),
    "bus.base_kv": ("buses", "base_kv", (0.1, 1200.0), (0.09, 1201.0)),
    "bus.voltage": ("buses", "voltage_pu", (0.8, 1.2), (0.79, 1.21)),
    "branch.impedance": ("unknown voltage", "reactance", (2.99,), (3.01, -3.01)),
    "branch.ohms": ("branches", "reactance", (0.945, -0.945), (0.946, -0.946)),  # 1 p.u. is 529 ohm
    "branch.r_over_x": ("branches", "resistance", (0.3, 0.0), (0.301, -0.01)),
    "branch.reactance": ("branches", "reactance", (0.0001,), (-0.0001,)),
    "branch.charging": ("branches", "susceptance", (-0.05, 3.0), (-0.051,)),
    "branch.length": ("branches", "susceptance", (10.0,), (10.1,)),
    "branch.ratio": ("branches", "ratio", (0.8, 1.25), (0.79, 1.26, 0.1)),
    "branch.shift": ("branches", "shift_deg", (-180.0, 180.0), (-181.0, 181.0)),
    "generator.base": ("generators", "base_mva", (64.0, 20_000.0), (20_001.0,)),
    "generator.loading": ("generators", "active_mw", (150.0, -150.0), (150.1, -150.1)),
    "generator.voltage": ("generators", "voltage_pu", (0.8, 1.2), (0.79, 1.21)),
    "load.power": ("loads", "active_mw", (9_999.0,), (10_001.0, -10_001.0)),
    "shunt.power": ("shunts", "susceptance_mvar", (3000.0, -3000.0), (3001.0, -3001.0)),
}


def changed(table, field, value):
    """The case with another value in the last record of a table."""
    if table == "case":
        return replace(CASE, **{field: value})
    if table == "unknown voltage":
        line = replace(LINE, **{field: value})
        return replace(CASE, buses=(gf.Bus(1), gf.Bus(2)), branches=(line,))
    return replace_last(table, **{field: value})


def replace_last(table, **fields):
    *others, last = getattr(CASE, table)
    return replace(CASE, **{table: (*others, replace(last, **fields))})


def rows(case):
    return [row for doubt in network_doubts(case) for row in doubt.rows]


def test_every_row_is_looked_at_here_and_the_case_is_not_doubted():
    assert [row.usual.name for row in NETWORK_ROWS] == list(ROWS)
    assert rows(CASE) == []


@pytest.mark.parametrize("row", ROWS)
def test_ends_of_a_range_are_usual_and_what_is_beyond_is_not(row):
    table, field, usual, odd = ROWS[row]
    for value in usual:
        assert row not in rows(changed(table, field, value)), value
    for value in odd:
        assert row in rows(changed(table, field, value)), value


def test_a_small_base_of_a_unit_is_a_doubt_of_its_own():
    assert rows(replace_last("generators", base_mva=0.05, active_mw=0.05)) == []
    assert rows(replace_last("generators", base_mva=0.04, active_mw=0.04)) == ["generator.base"]


@pytest.mark.parametrize(
    ("table", "fields"),
    [
        ("branches", {"resistance": 0.0, "reactance": -0.1}),  # a series capacitor
        ("branches", {"resistance": 1e-7, "reactance": -0.01}),
        ("branches", {"resistance": 5e-4, "reactance": 1e-4}),  # a short link
        ("loads", {"active_mw": 20_000.0, "in_service": False}),
        ("shunts", {"susceptance_mvar": 1e5, "in_service": False}),
        ("generators", {"active_mw": 500.0, "in_service": False}),
        ("generators", {"active_mw": 500.0, "base_mva": 100.0}),  # on the base of the system
    ],
)
def test_what_is_sound_or_does_not_act_is_not_doubted(table, fields):
    assert rows(replace_last(table, **fields)) == []


def test_a_transformer_may_have_any_impedance_in_ohms():
    ends = (gf.Bus(1, base_kv=400.0), gf.Bus(2, base_kv=110.0))
    assert rows(replace(CASE, buses=ends, branches=(replace(LINE, reactance=2.9),))) == []
    odd = replace(CASE, buses=ends, branches=(replace(LINE, reactance=3.1),))
    assert rows(odd) == ["branch.impedance"]


def test_low_voltage_may_have_large_impedances_in_per_unit():
    low = replace(CASE, buses=tuple(replace(bus, base_kv=0.4) for bus in CASE.buses))
    line = replace(LINE, resistance=150.0, reactance=40.0)
    assert rows(replace(low, branches=(line,))) == []
    assert rows(replace(CASE, branches=(line,))) == ["branch.ohms", "branch.r_over_x"]


def test_a_doubt_names_record_file_and_line():
    case = replace(changed("branches", "ratio", 0.1), origins={"branch 1-2:1": "own.raw:12"})
    (doubt,) = network_doubts(case)
    assert str(doubt) == "branch 1-2:1 (own.raw:12): turns ratio is 0.1, usually 0.8 to 1.25"


def test_a_slack_unit_that_has_to_make_up_for_a_slip_is_told():
    sound = gf.solve_power_flow(CASE)
    assert not list(flow_doubts(sound))
    limit = 1.25 * 120.0
    for load, told in ((limit + 78.0, False), (limit + 82.0, True)):
        flow = gf.solve_power_flow(
            replace(
                CASE,
                branches=(),
                buses=CASE.buses[:1],
                generators=(CASE.generators[0],),
                loads=(gf.Load(1, "1", load - 80.0),),
                shunts=(),
            )
        )
        assert [doubt.rows for doubt in flow_doubts(flow)] == [("start.balance",)] * told


def test_a_solved_voltage_is_told_where_the_stored_one_is_usual():
    def at(reactive):
        unit = replace(CASE.generators[1], control=gf.Control.POWER, reactive_mvar=0.0)
        load = gf.Load(2, "1", 80.0, reactive)
        case = replace(CASE, generators=(CASE.generators[0], unit), loads=(load,), shunts=())
        flow = gf.solve_power_flow(case)
        voltage = float(abs(flow.voltage[1]))
        return voltage, [doubt.rows for doubt in flow_doubts(flow)]

    # Without active power over X: V = (1 + sqrt(1 - 4 Q X)) / 2, which is 0.8 at Q = 1.6 p.u.
    sound, none = at(155.0)
    low, told = at(165.0)
    assert (sound > 0.8, none) == (True, [])
    assert (low < 0.8, told) == (True, [("start.voltage",)])
