"""Usual values of device parameters: both ends of every range, both sides of every order."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import pytest

import gridfold as gf
from gridfold.dynamics.plausible import case_doubts, device_doubts
from gridfold.dynamics.registry import DEVICES
from gridfold.dynamics.usual_values import ORDERS, RANGES
from gridfold.runs.loading import load_case

ROOT = Path(__file__).resolve().parents[2]
CASES = Path(os.environ.get("GRIDFOLD_CASES", ROOT / ".." / "shared" / "data"))

#: Of each row a value that is beyond, the two ends, and a value beyond the other one.
ENDS = {
    "machine.inertia": (0.9, 1, 10, 11),
    "machine.damping": (-0.01, 0, 20, 21),
    "machine.reactance": (0.049, 0.05, 0.7, 0.71),
    "machine.saturation_10": (-0.01, 0, 0.6, 0.61),
    "machine.saturation_12": (-0.01, 0, 2, 2.1),
    "machine.resistance": (-0.01, 0, 0.05, 0.051),
    "machine.d_reactance": (0.39, 0.4, 3, 3.1),
    "machine.q_reactance": (0.24, 0.25, 3, 3.1),
    "machine.d_transient_reactance": (0.079, 0.08, 0.7, 0.71),
    "machine.q_transient_reactance": (0.079, 0.08, 1.5, 1.6),
    "machine.transient_reactance": (0.079, 0.08, 0.7, 0.71),
    "machine.subtransient_reactance": (0.059, 0.06, 0.6, 0.61),
    "machine.leakage_reactance": (0.019, 0.02, 0.4, 0.41),
    "machine.d_open_circuit_time": (0.9, 1, 15, 16),
    "machine.q_open_circuit_time": (0.19, 0.2, 3, 3.1),
    "machine.d_subtransient_open_circuit_time": (0.0049, 0.005, 0.2, 0.21),
    "machine.q_subtransient_open_circuit_time": (0.0049, 0.005, 0.3, 0.31),
    "exciter.measuring_time": (-0.01, 0, 0.5, 0.51),
    "exciter.regulator_gain": (0.9, 1, 1000, 1100),
    "exciter.regulator_time": (-0.01, 0, 1, 1.1),
    "exciter.lag_time": (-0.01, 0, 50, 51),
    "exciter.lead_time": (-0.01, 0, 50, 51),
    "exciter.lead_lag_ratio": (-0.01, 0, 1, 1.1),
    "exciter.exciter_gain": (-1.1, -1, 2, 2.1),
    "exciter.exciter_time": (-0.01, 0, 3, 3.1),
    "exciter.feedback_gain": (-0.01, 0, 1, 1.1),
    "exciter.feedback_time": (-0.01, 0, 5, 5.1),
    "exciter.regulator_maximum": (0.49, 0.5, 100, 110),
    "exciter.regulator_minimum": (-110, -100, 1, 1.1),
    "exciter.field_voltage_maximum": (0.9, 1, 100, 110),
    "exciter.field_voltage_minimum": (-110, -100, 1, 1.1),
    "exciter.error_maximum": (-0.01, 0, 100, 110),
    "exciter.error_minimum": (-110, -100, 0, 0.01),
    "exciter.saturation_1": (-0.01, 0, 2, 2.1),
    "exciter.saturation_2": (-0.01, 0, 3, 3.1),
    "exciter.saturation_voltage_1": (-0.01, 0, 10, 11),
    "exciter.saturation_voltage_2": (-0.01, 0, 10, 11),
    "exciter.saturation_a": (-0.01, 0, 1, 1.1),
    "exciter.saturation_b": (-0.01, 0, 5, 5.1),
    "exciter.rectifier_loading": (-0.01, 0, 1, 1.1),
    "exciter.inner_gain": (0.09, 0.1, 1000, 1100),
    "exciter.inner_time": (-0.01, 0, 1, 1.1),
    "exciter.inner_feedback_gain": (-0.01, 0, 2, 2.1),
    "exciter.potential_gain": (-0.01, 0, 20, 21),
    "exciter.current_gain": (-0.01, 0, 20, 21),
    "exciter.source_reactance": (-0.01, 0, 1, 1.1),
    "exciter.potential_angle": (-91, -90, 90, 91),
    "governor.droop": (0.009, 0.01, 0.1, 0.11),
    "governor.governor_gain": (9, 10, 100, 110),
    "governor.governor_time": (-0.01, 0, 5, 5.1),
    "governor.valve_time": (-0.01, 0, 10, 11),
    "governor.highest_valve": (0.49, 0.5, 2, 2.1),
    "governor.lowest_valve": (-0.51, -0.5, 0.9, 0.91),
    "governor.reheater_lead_time": (-0.01, 0, 10, 11),
    "governor.reheater_time": (-0.01, 0, 20, 21),
    "governor.turbine_damping": (-0.01, 0, 2, 2.1),
    "governor.fuel_time": (-0.01, 0, 1, 1.1),
    "governor.turbine_time": (-0.01, 0, 1, 1.1),
    "governor.exhaust_time": (-0.01, 0, 10, 11),
    "governor.temperature_limit": (0.49, 0.5, 1.5, 1.6),
    "governor.temperature_gain": (-0.01, 0, 10, 11),
    "governor.highest_fuel": (0.49, 0.5, 2, 2.1),
    "governor.lowest_fuel": (-0.51, -0.5, 0.9, 0.91),
    "governor.temporary_droop": (0.019, 0.02, 2, 2.1),
    "governor.reset_time": (0.9, 1, 30, 31),
    "governor.filter_time": (-0.01, 0, 0.5, 0.51),
    "governor.servo_time": (-0.01, 0, 1, 1.1),
    "governor.gate_velocity": (0.009, 0.01, 2, 2.1),
    "governor.highest_gate": (0.29, 0.3, 2, 2.1),
    "governor.lowest_gate": (-0.51, -0.5, 0.9, 0.91),
    "governor.water_time": (0.19, 0.2, 5, 5.1),
    "governor.turbine_gain": (0.49, 0.5, 2, 2.1),
    "governor.no_load_flow": (-0.01, 0, 0.3, 0.31),
    "governor.governor_lag_time": (-0.01, 0, 10, 11),
    "governor.governor_lead_time": (-0.01, 0, 20, 21),
    "governor.gate_time": (0.019, 0.02, 1, 1.1),
    "governor.opening_rate": (0.009, 0.01, 10, 11),
    "governor.closing_rate": (-11, -10, -0.01, -0.009),
    "governor.chest_time": (-0.01, 0, 2, 2.1),
    "governor.crossover_time": (-0.01, 0, 20, 21),
    "governor.outlet_time": (-0.01, 0, 20, 21),
    "governor.chest_fraction": (-0.01, 0, 1, 1.1),
    "governor.reheater_fraction": (-0.01, 0, 1, 1.1),
    "governor.crossover_fraction": (-0.01, 0, 1, 1.1),
    "governor.outlet_fraction": (-0.01, 0, 1, 1.1),
    "turbine.charging_time": (0.049, 0.05, 5, 5.1),
    "stabilizer.stabilizer_gain": (-110, -100, 100, 110),
    "stabilizer.input_gain_1": (-110, -100, 100, 110),
    "stabilizer.input_gain_2": (-110, -100, 100, 110),
    "stabilizer.input_time_1": (-0.01, 0, 1, 1.1),
    "stabilizer.input_time_2": (-0.01, 0, 1, 1.1),
    "stabilizer.lead_time_1": (-0.01, 0, 15, 16),
    "stabilizer.lag_time_1": (-0.01, 0, 15, 16),
    "stabilizer.lead_time_2": (-0.01, 0, 15, 16),
    "stabilizer.lag_time_2": (-0.01, 0, 15, 16),
    "stabilizer.lead_time_3": (-0.01, 0, 15, 16),
    "stabilizer.lag_time_3": (-0.01, 0, 15, 16),
    "stabilizer.washout_lead_time": (0.09, 0.1, 50, 51),
    "stabilizer.washout_time": (0.09, 0.1, 50, 51),
    "stabilizer.highest_signal": (0.009, 0.01, 0.5, 0.51),
    "stabilizer.lowest_signal": (-0.51, -0.5, 0, 0.01),
}

#: Of each row a larger and a smaller value that are usual, and two that are not.
SIDES = {
    "machine.d_reactance>q_reactance": ((1.8, 1.8), (1.7, 1.8)),
    "machine.d_reactance>d_transient_reactance": ((0.5, 0.5), (0.5, 0.6)),
    "machine.q_reactance>q_transient_reactance": ((0.5, 0.5), (0.5, 0.6)),
    "machine.q_transient_reactance>d_transient_reactance": ((0.3, 0.3), (0.2, 0.3)),
    "machine.d_transient_reactance>subtransient_reactance": ((0.25, 0.25), (0.2, 0.25)),
    "machine.q_reactance>subtransient_reactance": ((0.4, 0.4), (0.3, 0.4)),
    "machine.q_transient_reactance>subtransient_reactance": ((0.25, 0.25), (0.2, 0.25)),
    "machine.subtransient_reactance>leakage_reactance": ((0.15, 0.15), (0.14, 0.15)),
    "machine.d_open_circuit_time>d_subtransient_open_circuit_time": ((0.1, 0.1), (0.03, 8.0)),
    "machine.q_open_circuit_time>q_subtransient_open_circuit_time": ((0.2, 0.2), (0.05, 0.4)),
    "machine.d_open_circuit_time>q_open_circuit_time": ((1.5, 1.5), (1.0, 1.5)),
    "exciter.regulator_maximum>regulator_minimum": ((1.0, 0.9), (1.0, 1.0)),
    "exciter.field_voltage_maximum>field_voltage_minimum": ((1.0, 0.9), (1.0, 1.0)),
    "exciter.error_maximum>error_minimum": ((0.1, -0.1), (0.0, 0.0)),
    "exciter.inner_maximum>inner_minimum": ((1.0, 0.9), (1.0, 1.0)),
    "governor.highest_valve>lowest_valve": ((0.9, 0.8), (0.8, 0.8)),
    "governor.highest_fuel>lowest_fuel": ((0.9, 0.8), (0.8, 0.8)),
    "governor.highest_gate>lowest_gate": ((0.9, 0.8), (0.8, 0.8)),
    "governor.reheater_time>reheater_lead_time": ((7.0, 7.0), (2.0, 7.0)),
    "governor.temporary_droop>droop": ((0.05, 0.05), (0.04, 0.05)),
    "stabilizer.highest_signal>lowest_signal": ((0.1, -0.1), (0.0, 0.0)),
}
UNIT = gf.Generator(1, active_mw=80.0, control=gf.Control.SLACK)


def doubts(role, parameters, unit=UNIT):
    """Rows that a device of a role with these parameters alone is told for."""
    model = next(
        device.model
        for device in DEVICES.values()
        if device.role.name.lower() == role
        and set(parameters) <= {item.name for item in device.parameters}
        and device.states
    )
    case = gf.Case(
        name="one",
        buses=(gf.Bus(1),),
        branches=(),
        generators=(unit,),
        devices=(gf.DeviceRecord(model, 1, "1", parameters),),
    )
    return [row for doubt in device_doubts(case) for row in doubt.rows]


def test_every_row_is_looked_at_here():
    assert [row.name for row in RANGES] == list(ENDS)
    assert [row.name for row in ORDERS] == list(SIDES)


@pytest.mark.parametrize("row", ENDS)
def test_ends_of_a_range_are_usual_and_what_is_beyond_is_not(row):
    role, parameter = row.split(".")
    below, lowest, highest, above = ENDS[row]
    for value in (lowest, highest):
        assert doubts(role, {parameter: value}) == []
    for value in (below, above):
        assert doubts(role, {parameter: value}) == [row]


@pytest.mark.parametrize("row", SIDES)
def test_parameters_out_of_their_order_are_told(row):
    role, names = row.split(".")
    usual, odd = (dict(zip(names.split(">"), pair, strict=True)) for pair in SIDES[row])
    assert row not in doubts(role, usual)
    assert row in doubts(role, odd)


GENROU = {
    "d_open_circuit_time": 8.0,
    "d_subtransient_open_circuit_time": 0.03,
    "q_open_circuit_time": 0.4,
    "q_subtransient_open_circuit_time": 0.05,
    "inertia": 6.5,
    "damping": 0.0,
    "d_reactance": 1.8,
    "q_reactance": 1.7,
    "d_transient_reactance": 0.3,
    "q_transient_reactance": 0.55,
    "subtransient_reactance": 0.25,
    "leakage_reactance": 0.2,
    "saturation_10": 0.04,
    "saturation_12": 0.2,
}


@pytest.mark.parametrize(
    "slip",
    [
        {"d_open_circuit_time": 0.03, "d_subtransient_open_circuit_time": 8.0},
        {"q_open_circuit_time": 0.05, "q_subtransient_open_circuit_time": 0.4},
        {"inertia": 65.0},
        {"inertia": 0.65},
        {"q_reactance": 170.0},
        {"q_reactance": 17.0},
        {"d_reactance": 0.18},
        {"d_transient_reactance": 0.03},
        {"leakage_reactance": 2.0},
        {"d_open_circuit_time": 8000.0},
    ],
)
def test_slips_in_a_machine_of_kundurs_book_are_told_and_the_machine_is_not(slip):
    assert doubts("machine", GENROU) == []
    assert doubts("machine", GENROU | slip)


def test_one_record_is_one_doubt_with_file_and_line():
    parameters = {"inertia": 65.0, "q_reactance": 170.0}
    case = gf.Case(
        name="one",
        buses=(gf.Bus(1),),
        branches=(),
        generators=(UNIT,),
        devices=(gf.DeviceRecord("genrou", 1, "1", parameters),),
        origins={"genrou 1:1": "own.dyr:7"},
    )
    (doubt,) = device_doubts(case)
    assert str(doubt) == (
        "genrou 1:1 (own.dyr:7): inertia (H) is 65 s, usually 1 to 10; "
        "q_reactance (Xq) is 170 p.u., usually 0.25 to 3"
    )


def test_a_machine_on_the_base_of_the_system_is_looked_at_on_the_power_that_it_gives():
    # 900 MVA on a base of 100 MVA: H is 9 times, X a ninth of what they are on 900 MVA.
    on_system = {"inertia": 6.5 * 9, "d_reactance": 1.8 / 9}
    assert doubts("machine", on_system, replace(UNIT, active_mw=700.0)) == []
    assert doubts("machine", on_system) == ["machine.inertia", "machine.d_reactance"]
    forgotten = {"inertia": 6.5, "d_reactance": 1.8}  # of 900 MVA, beside a base of 100 MVA
    rows = doubts("machine", forgotten, replace(UNIT, active_mw=700.0))
    assert rows == ["machine.inertia", "machine.d_reactance"]


def test_the_base_of_a_unit_is_its_rating_where_it_is_not_that_of_the_system():
    unit = replace(UNIT, active_mw=700.0, base_mva=900.0)
    assert doubts("machine", {"inertia": 6.5, "d_reactance": 1.8}, unit) == []


def test_an_infinite_bus_and_units_out_of_service_are_as_they_like():
    odd = {"inertia": 65.0}
    assert doubts("machine", odd, replace(UNIT, in_service=False)) == []
    infinite = gf.DeviceRecord("infinite_bus", 1, "1", {"resistance": 0.0, "reactance": 1e-5})
    case = gf.Case("one", (gf.Bus(1),), (), (UNIT,), devices=(infinite,))
    assert not list(device_doubts(case))


def test_models_of_the_user_are_looked_at_by_the_names_of_their_parameters():
    mine = replace(DEVICES["sexs"], model="mine")
    record = gf.DeviceRecord("mine", 1, "1", {"regulator_gain": 20_000.0})
    case = gf.Case("one", (gf.Bus(1),), (), (UNIT,), devices=(record,))
    (doubt,) = device_doubts(case, DEVICES | {"mine": mine})
    assert doubt.rows == ("exciter.regulator_gain",)


def test_doubts_are_named_where_there_is_no_start(npcc):
    branches = (replace(npcc.case.branches[0], ratio=0.01), *npcc.case.branches[1:])
    case = replace(npcc.case, branches=branches)
    with pytest.raises(gf.PowerFlowError) as raised:
        gf.build_model(case)
    text = str(raised.value)
    assert "did not converge" in text
    branch = case.locate(branches[0])
    assert f"may be why:\n  {branch}: turns ratio is 0.01, usually 0.8 to 1.25\n" in text
    assert len(text.split("may be why:")[1].splitlines()) == 8
    assert "... and 13 more" in text


def test_a_new_kind_of_doubt_comes_before_more_of_the_same():
    units = tuple(replace(UNIT, id=name) for name in "123")
    odd = ({"inertia": 65.0}, {"inertia": 66.0}, {"q_reactance": 170.0})
    records = (gf.DeviceRecord("genrou", 1, unit.id, p) for unit, p in zip(units, odd, strict=True))
    case = gf.Case("three", (gf.Bus(1),), (), units, devices=tuple(records))
    assert [doubt.record[-1] for doubt in case_doubts(case)] == ["1", "3", "2"]


@pytest.mark.parametrize(
    ("files", "count", "kinds"),
    [
        (("kundur/kundur.raw", "kundur/kundur_full.dyr"), 4, 1),
        (("npcc/npcc_curent.raw", "npcc/npcc_curent.dyr"), 13, 5),
        (("ieee39/IEEE39.raw", "ieee39/IEEE39.dyr"), 20, 11),
        (("psse/genrou/case.raw", "psse/genrou/case.dyr"), 0, 0),
        (("samples/case25_v35_savnwb.raw",), 0, 0),
        (("samples/wscc9_3wxfr.raw",), 0, 0),
    ],
)
def test_public_cases_give_few_kinds_of_doubts(files, count, kinds):
    paths = [CASES / name for name in files]
    if not all(path.is_file() for path in paths):
        pytest.skip(f"{paths[0]} is absent; GRIDFOLD_CASES names the folder of public cases")
    case = load_case(
        *paths,
        unsupported="classical",
        without_data="negative_load",
        allow_unsupported_network=True,
    )
    found = case_doubts(case)
    assert (len(found), len({row for doubt in found for row in doubt.rows})) == (count, kinds)


def test_the_built_in_case_is_doubted_where_a_machine_stands_for_a_region(npcc):
    found = [doubt.record for doubt in npcc.doubts]
    assert len(found) == 18
    assert "two_axis 78:1" in found  # H of 1000 s, X of 0.0001 p.u.: the equivalent of a region
