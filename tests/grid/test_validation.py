import time
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import gridfold as gf
from gridfold.grid.case import number_fields
from gridfold.grid.validation import require_valid

TABLES = ("buses", "branches", "generators", "loads", "shunts", "devices")


def plus(case, table, *records):
    return replace(case, **{table: (*getattr(case, table), *records)})


def with_first(case, table, **changes):
    first, *rest = getattr(case, table)
    return replace(case, **{table: (replace(first, **changes), *rest)})


def only_fault(case):
    faults = gf.validate_case(case)
    assert len(faults) == 1, faults
    return faults[0]


def test_a_sound_case_has_no_faults(ring):
    assert gf.validate_case(ring) == []
    require_valid(ring)


@pytest.mark.parametrize(
    ("table", "record"),
    [
        ("generators", gf.Generator(9, control=gf.Control.POWER)),
        ("loads", gf.Load(9)),
        ("shunts", gf.Shunt(9)),
    ],
)
def test_record_at_an_unknown_bus_is_a_fault(ring, table, record):
    assert only_fault(plus(ring, table, record)) == f"{record}: there is no bus 9"


@pytest.mark.parametrize(("first", "second"), [(9, 1), (1, 9)])
def test_either_end_of_a_branch_must_be_a_bus(ring, first, second):
    case = plus(ring, "branches", gf.Branch(first, second, reactance=0.1))
    assert only_fault(case) == f"branch {first}-{second}:1: there is no bus 9"


def test_both_unknown_ends_of_a_branch_are_reported(ring):
    faults = gf.validate_case(plus(ring, "branches", gf.Branch(8, 9, reactance=0.1)))
    assert faults == [f"branch 8-9:1: there is no bus {number}" for number in (8, 9)]


def test_device_of_no_generator_is_a_fault(ring):
    case = plus(ring, "devices", gf.DeviceRecord("classical", 3, "2"))
    assert only_fault(case) == "classical 3:2: there is no generator 3:2"


@pytest.mark.parametrize("table", TABLES)
def test_record_given_three_times_is_one_fault(ring, table):
    record = getattr(ring, table)[0]
    assert only_fault(plus(ring, table, record, record)) == f"{record} is given 3 times"


def test_devices_of_one_unit_may_differ_in_model(ring):
    case = plus(ring, "devices", gf.DeviceRecord("ieee_type1", 3, "1"))
    assert gf.validate_case(case) == []


def test_parallel_circuits_from_both_ends_need_ids_of_their_own(ring):
    fault = only_fault(plus(ring, "branches", gf.Branch(3, 2, reactance=0.1)))
    assert fault == "branch 3-2:1 and branch 2-3:1 are two circuits with one id"
    assert gf.validate_case(plus(ring, "branches", gf.Branch(3, 2, "2", reactance=0.1))) == []


@pytest.mark.parametrize("change", [{"ratio": 1.02}, {"shift_deg": 30.0}])
def test_a_transformer_without_impedance_is_a_fault_and_a_plain_branch_joins_its_buses(
    ring, change
):
    assert gf.validate_case(plus(ring, "branches", gf.Branch(2, 4))) == []
    case = plus(ring, "branches", gf.Branch(2, 4, **change))
    assert only_fault(case).startswith("branch 2-4:1: its impedance is zero, and a transformer's")
    assert gf.validate_case(plus(ring, "branches", gf.Branch(2, 4, reactance=1e-4))) == []
    assert gf.validate_case(plus(ring, "branches", gf.Branch(2, 4, resistance=1e-4))) == []


def test_branch_from_a_bus_to_itself_is_a_fault(ring):
    case = plus(ring, "branches", gf.Branch(2, 2, reactance=0.1))
    assert only_fault(case) == "branch 2-2:1: it joins a bus to itself"


@pytest.mark.parametrize(
    ("table", "name"),
    [
        ("buses", "base_kv"),
        ("buses", "voltage_pu"),
        ("branches", "ratio"),
        ("generators", "base_mva"),
        ("generators", "share"),
    ],
)
@pytest.mark.parametrize("value", [0.0, -1.0])
def test_quantity_that_must_be_positive_is_checked(ring, table, name, value):
    record = getattr(ring, table)[0]
    fault = only_fault(with_first(ring, table, **{name: value}))
    assert fault == f"{record}: {name} must be positive, not {value!r}"


def test_set_point_must_be_positive(ring):
    case = plus(ring, "generators", gf.Generator(4, voltage_pu=-1.0))
    assert only_fault(case) == "generator 4:1: voltage_pu must be positive, not -1.0"


def test_bus_number_must_be_positive(ring):
    assert only_fault(plus(ring, "buses", gf.Bus(0))) == "bus 0: number must be positive, not 0"


@pytest.mark.parametrize("name", ["base_mva", "frequency_hz"])
@pytest.mark.parametrize("value", [0.0, -60.0, float("nan"), float("inf"), 10**400])
def test_system_quantity_must_be_a_positive_number(ring, name, value):
    fault = only_fault(replace(ring, **{name: value}))
    assert fault == f"{name} must be a positive number, not {value!r}"


@settings(max_examples=150, deadline=None)
@given(st.data())
def test_any_number_that_is_not_finite_is_reported_with_its_record(ring, data):
    located = replace(ring, buses=tuple(replace(bus, latitude=41.0) for bus in ring.buses))
    table = data.draw(st.sampled_from(TABLES[:-1]))
    records = list(getattr(located, table))
    position = data.draw(st.integers(0, len(records) - 1))
    name = data.draw(st.sampled_from(sorted(number_fields(records[position]))))
    value = data.draw(st.sampled_from([float("nan"), float("inf"), float("-inf"), 10**400]))
    records[position] = replace(records[position], **{name: value})
    faults = gf.validate_case(replace(located, **{table: tuple(records)}))
    assert f"{records[position]}: {name} is {value!r}, not a finite number" in faults


@pytest.mark.parametrize("value", [float("nan"), float("inf"), float("-inf")])
def test_device_parameter_that_is_not_finite_is_a_fault(ring, value):
    case = with_first(ring, "devices", parameters={"inertia": value})
    assert only_fault(case) == f"classical 3:1: inertia is {value!r}, not a finite number"


def test_conflicting_set_points_at_one_bus_are_a_fault(ring):
    fault = only_fault(plus(ring, "generators", gf.Generator(3, "2", voltage_pu=1.01)))
    assert fault == (
        "generator 3:2: it holds 1.01 p.u. where generator 3:1 holds 1.02 p.u. at the same bus"
    )


@pytest.mark.parametrize("changes", [{"control": gf.Control.POWER}, {"in_service": False}])
def test_set_point_of_a_unit_that_regulates_nothing_is_ignored(ring, changes):
    unit = gf.Generator(3, "2", voltage_pu=1.01, **changes)
    assert gf.validate_case(plus(ring, "generators", unit)) == []


def test_island_without_generator_is_a_fault(ring):
    case = plus(plus(ring, "buses", gf.Bus(5), gf.Bus(6)), "branches", gf.Branch(5, 6, reactance=1))
    assert only_fault(case) == "the island of bus 5 (2 buses) has no generator in service"


def test_island_whose_generator_is_out_of_service_has_none(ring):
    case = plus(plus(ring, "buses", gf.Bus(5)), "generators", gf.Generator(5, in_service=False))
    assert only_fault(case) == "the island of bus 5 (1 buses) has no generator in service"


def test_island_without_slack_is_a_fault(ring):
    case = plus(plus(ring, "buses", gf.Bus(5)), "generators", gf.Generator(5))
    assert only_fault(case) == "the island of bus 5 (1 buses) has no slack generator"


def test_an_island_may_have_several_slack_buses(ring):
    case = plus(ring, "generators", gf.Generator(4, control=gf.Control.SLACK))
    assert gf.validate_case(case) == []


def test_units_at_joined_buses_hold_one_voltage(ring):
    unit = gf.Generator(2, voltage_pu=1.03)
    case = plus(plus(ring, "branches", gf.Branch(2, 1, "9")), "generators", unit)
    assert only_fault(case) == (
        "generator 2:1: it holds 1.03 p.u. where generator 1:1 holds 1.0 p.u. at a bus that is joined "
        "to its own"
    )


def test_two_slack_units_at_one_bus_are_sound(ring):
    case = plus(ring, "generators", gf.Generator(1, "3", control=gf.Control.SLACK))
    assert gf.validate_case(case) == []


def test_opening_branches_can_make_an_island_without_slack(ring):
    branches = tuple(
        replace(branch, in_service=branch.from_bus == 4 and branch.to_bus == 3)
        for branch in ring.branches
    )
    assert gf.validate_case(replace(ring, branches=branches)) == [
        "the island of bus 2 (1 buses) has no generator in service",
        "the island of bus 3 (2 buses) has no slack generator",
    ]


def test_a_case_without_buses_is_a_fault():
    empty = gf.Case("empty", (), (), ())
    assert gf.validate_case(empty) == ["there is no bus"]
    with pytest.raises(gf.CaseError, match=r"case empty: 1 fault\n  there is no bus"):
        require_valid(empty)


def test_validation_reports_every_fault_not_the_first(ring):
    case = replace(
        ring,
        frequency_hz=0.0,
        buses=(*ring.buses, gf.Bus(2), gf.Bus(5, base_kv=-1.0)),
        branches=(
            *ring.branches,
            gf.Branch(1, 1, reactance=0.1),
            gf.Branch(2, 4, ratio=1.1),
            gf.Branch(2, 77, reactance=float("nan")),
            gf.Branch(3, 2, reactance=0.1),
        ),
        generators=(*ring.generators, gf.Generator(1, "4", voltage_pu=1.1, share=0.0)),
        loads=(*ring.loads, gf.Load(78, active_mw=float("inf"))),
        shunts=(*ring.shunts, gf.Shunt(79)),
        devices=(*ring.devices, gf.DeviceRecord("classical", 80, "1", {"inertia": float("nan")})),
        origins={"branch 2-4:1": "branches.csv:8"},
    )
    expected = {
        "frequency_hz must be a positive number, not 0.0",
        "bus 2 is given 2 times",
        "bus 5: base_kv must be positive, not -1.0",
        "branch 1-1:1: it joins a bus to itself",
        "branch 2-4:1 (branches.csv:8): its impedance is zero, and a transformer's ratio or shift "
        "needs one",
        "branch 2-77:1: reactance is nan, not a finite number",
        "branch 2-77:1: there is no bus 77",
        "branch 3-2:1 and branch 2-3:1 are two circuits with one id",
        "generator 1:4: share must be positive, not 0.0",
        "generator 1:4: it holds 1.1 p.u. where generator 1:1 holds 1.0 p.u. at the same bus",
        "load 78:1: active_mw is inf, not a finite number",
        "load 78:1: there is no bus 78",
        "shunt 79:1: there is no bus 79",
        "classical 80:1: inertia is nan, not a finite number",
        "classical 80:1: there is no generator 80:1",
    }
    faults = gf.validate_case(case)
    assert set(faults) == expected
    assert len(faults) == len(expected)
    with pytest.raises(gf.CaseError) as error:
        require_valid(case)
    assert error.value.faults == faults
    assert all(fault in str(error.value) for fault in expected)


def test_checking_many_islands_takes_time_in_proportion():
    """Twice the islands took four times the time: 400,000 of them, hours."""
    buses = tuple(gf.Bus(n) for n in range(1, 20001))
    slack = gf.Generator(1, "1", active_mw=1.0, control=gf.Control.SLACK)
    case = gf.Case("islands", buses, (), (slack,))
    began = time.perf_counter()
    faults = gf.validate_case(case)
    assert len(faults) == 19999
    assert faults[0] == "the island of bus 2 (1 buses) has no generator in service"
    assert time.perf_counter() - began < 10.0
