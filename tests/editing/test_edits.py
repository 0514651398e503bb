"""What edits do to a case, and what is said where they cannot."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from plants import two_plants

import gridfold as gf
from gridfold.dynamics.exciters.sexs import SEXS
from gridfold.editing import EDITS, Switch
from gridfold.grid.flow_controls import UnitControl


@pytest.fixture(scope="module")
def plants():
    return two_plants()


def parameter(case, model, bus, unit, name):
    (record,) = [r for r in case.devices if (r.model, r.bus, r.id) == (model, bus, unit)]
    return record.parameters[name]


def faults(editor):
    with pytest.raises(gf.CaseError) as raised:
        editor.case()
    return raised.value.faults


def test_the_small_case_is_sound_and_starts(plants):
    assert gf.validate_case(plants) == []
    assert gf.solve_power_flow(plants).mismatch < 1e-8


# Loads.


def test_scaled_loads_keep_their_power_factor_and_their_dependence_on_voltage(plants):
    case = plants.edit().scale_load(1.1, areas=2).case()
    before, after = plants.loads[1], case.loads[1]
    assert after.active_mw == pytest.approx(1.1 * before.active_mw)
    assert after.reactive_mvar == pytest.approx(1.1 * before.reactive_mvar)
    assert after.impedance_active_mw == pytest.approx(1.1 * before.impedance_active_mw)
    assert case.loads[0] == plants.loads[0]
    assert case.loads[2] == plants.loads[2]  # out of service


@pytest.mark.parametrize("place", [{}, {"areas": "1-2"}, {"zones": 2}, {"buses": "kv>100"}])
def test_loads_scaled_to_a_power_draw_it_together(plants, place):
    case = plants.edit().scale_load(active_mw=300.0, **place).case()
    drawn = sum(case.stored_power(load).real for load in case.loads if load.in_service)
    assert drawn == pytest.approx(300.0)


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ({}, "give factor or active_mw"),
        ({"factor": 1.1, "active_mw": 5.0}, "give factor or active_mw"),
        ({"factor": -1.0}, "factor must be 0 or more, not -1.0"),
        ({"factor": float("nan")}, "factor must be 0 or more, not nan"),
        ({"factor": 2.0, "areas": 7}, "there is no area 7"),
        ({"factor": 2.0, "buses": 101}, "there is no load in service in buses 101"),
    ],
)
def test_faults_of_a_scaling_are_named(plants, arguments, text):
    (fault,) = faults(plants.edit().scale_load(**arguments))
    assert fault.startswith("edit 1: ")
    assert text in fault


# Values by name.


@pytest.mark.parametrize(
    "text",
    [
        "GENROU 101:1 H=4",
        "genrou 101 inertia=4",
        "GENROU 101:1 h = 4.0",
        "GENROU 101:1 INERTIA=4, D=0",
    ],
)
def test_a_parameter_is_set_by_its_symbol_or_its_name(plants, text):
    case = plants.edit().set(text).case()
    assert parameter(case, "genrou", 101, "1", "inertia") == 4.0
    assert parameter(case, "genrou", 102, "1", "inertia") == 6.5


@pytest.mark.parametrize("name", ["T'd0", "T'do", "t'DO", "T\N{RIGHT SINGLE QUOTATION MARK}d0"])
def test_primes_and_the_o_of_open_circuit_may_be_written_in_several_ways(plants, name):
    case = plants.edit().set(f"GENROU 101:1 {name}=7").case()
    assert parameter(case, "genrou", 101, "1", "d_open_circuit_time") == 7.0
    assert parameter(case, "genrou", 101, "1", "d_subtransient_open_circuit_time") == 0.03


@pytest.mark.parametrize(
    ("text", "table", "position", "field", "value"),
    [
        ("branch 103-104:2 X=0.1", "branches", 3, "reactance", 0.1),
        ("line 104-103:2 B=0", "branches", 3, "susceptance", 0.0),
        ("transformer 104-102 WINDV1=0.98", "branches", 1, "ratio", 0.98),
        ("load 103 PL=90 QL=10", "loads", 0, "active_mw", 90.0),
        ("load 104:2 STATUS=1", "loads", 2, "in_service", True),
        ("gen 102:2 PG=20", "generators", 2, "active_mw", 20.0),
        ("unit 102:1 control=slack", "generators", 1, "control", gf.Control.SLACK),
        ("shunt 103 BL=-10", "shunts", 0, "susceptance_mvar", -10.0),
        ("bus 103 area=2", "buses", 2, "area", 2),
        ("bus 103 NAME='NEW TOWN' BASKV=345", "buses", 2, "name", "NEW TOWN"),
    ],
)
def test_values_of_the_network_are_set_by_their_symbols_in_psse(
    plants, text, table, position, field, value
):
    editor = plants.edit().set(text)
    if "slack" in text:
        editor = editor.set("gen 101:1 control=voltage")
    assert getattr(getattr(editor.case(), table)[position], field) == value


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("GENROU 109:1 H=4", "there is no bus 109; the nearest is genrou 102:1"),
        ("GENROU 101:7 H=4", "there is no genrou 101:7; at the bus: genrou 101:1"),
        ("GENROU 102 H=4", "genrou 102: say which, one of 102:1, 102:2"),
        ("SEXS 102:1 K=4", "at the bus: GENROU 102:1, GENROU 102:2"),
        ("GENROX 101:1 H=4", "did you mean 'GENROU'?"),
        ("lod 103 PL=4", "did you mean 'load'?"),
        ("GENROU 101:1 HH=4", "HH: GENROU has no such parameter; did you mean 'H'?"),
        ("GENROU 101:1 inertai=4", "did you mean 'inertia'?"),
        ("GENROU 101:1 H=four", "H: 'four' is not a number"),
        ("GENROU 101:1", "say what is set, as NAME=VALUE"),
        ("GENROU 101:1 H=4 5", "values are written NAME=VALUE, not '5'"),
        ("GENROU area:7 H=4", "there is no area 7"),
        ("SEXS area:2 K=4", "there is no machine at area 2"),
        ("shunt area:2 BL=4", "there is no shunt area:2 in case plants"),
        ("GENROU 101:1 H=4 H=5", "H is given twice"),
        ("GENROU 101:1 H=4 inertia=5", "inertia is inertia, which is given already"),
        ("H=4", "a record is written with a word and a place"),
        ("load 103 PLL=4", "did you mean 'PL'?"),
        ("load 103 bus=104", "it names the record"),
        ("load 104:2 STATUS=maybe", "'maybe' is neither true nor false"),
        ("branch 101-104 X=1", "there is no branch between buses 101 and 104"),
        ("branch 103-104 X=1", "say which circuit"),
        ("bus 103:1 VM=1", "a bus is named by BUS, not by '103:1'"),
    ],
)  # fmt: skip
def test_a_name_that_is_not_there_is_told_with_the_nearest(plants, text, told):
    (fault,) = faults(plants.edit().set(text))
    assert fault.startswith("edit 1: ")
    assert told in fault


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("GENROU 101:1 H=-4", "genrou 101:1 (edit 1): inertia must be positive, not -4.0"),
        ("GENROU 101:1 H=nan", "genrou 101:1 (edit 1): inertia is nan, not a finite number"),
        ("GENROU 101:1 T'q0=0", "genrou 101:1 (edit 1): q_open_circuit_time (T'q0) is 0"),
        ("gen 101:1 MBASE=0", "generator 101:1 (edit 1): base_mva must be positive, not 0.0"),
        ("branch 101-103 X=0 ratio=1.1", "branch 101-103:1 (edit 1): its impedance is zero"),
        ("gen 102:1 VS=1.03", "generator 102:2"),  # two units would hold two voltages
    ],
)
def test_a_value_out_of_range_is_told_with_record_and_edit(plants, text, told):
    assert faults(plants.edit().set(text))[0].startswith(told)


@pytest.mark.parametrize(
    ("text", "table", "field", "value", "positions"),
    [
        ("gen area:2 PG=70", "generators", "active_mw", 70.0, {1, 2}),
        ("gen 'SOUTH' PG=70", "generators", "active_mw", 70.0, {1, 2}),
        ("load 101-104 except zone:1 PL=7", "loads", "active_mw", 7.0, {0, 1, 2}),
        ("bus kv>=200 VM=1.01", "buses", "voltage_pu", 1.01, {2, 3}),
        ("line area:1 to area:2 X=0.3", "branches", "reactance", 0.3, {2, 3}),
    ],
)
def test_a_choice_means_all_records_there(plants, text, table, field, value, positions):
    records = getattr(plants.edit().set(text).case(), table)
    assert {k for k, record in enumerate(records) if getattr(record, field) == value} == positions


def test_what_was_done_to_many_records_is_told_of_the_first_ones(plants):
    (line,) = plants.edit().set("GENROU area:1-2 H=4").case().notices
    assert line.count("inertia 6.5 -> 4") == 3
    many = plants.edit().add(*(f"load 103:{k} PL=1" for k in "abcdefgh")).case()
    (line,) = many.edit().switch("load zone:2", "out").case().notices[-1:]
    assert line.endswith("load 103:c, and 5 more out")


def test_a_held_voltage_is_the_set_point_of_its_control_too(plants):
    control = UnitControl(101, "1", 1.0, 101, -50.0, 50.0)
    case = replace(plants, flow_controls=(control,)).edit().set("gen 101:1 VS=1.02").case()
    assert case.generators[0].voltage_pu == 1.02
    assert case.flow_controls == (control._replace(set_point_pu=1.02),)


# In and out.


def test_records_are_switched_out_and_in(plants):
    case = plants.edit().switch("branch 103-104:1, shunt 103, gen 102:2", "out").case()
    assert not case.branches[2].in_service
    assert not case.shunts[0].in_service
    assert not case.generators[2].in_service
    back = case.edit().switch("line 103-104:1, unit 101, area:2, shunt 103:1", "in").case()
    assert (back.branches, back.generators, back.shunts) == (
        plants.branches, plants.generators, plants.shunts,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("record", "state", "told"),
    [
        ("gen 101:1", "out", "has no slack generator"),
        ("branch 101-103", "out", "has no slack generator"),
        ("bus 103", "out", "bus 103 cannot be switched"),
        ("SEXS 101:1", "out", "sexs 101:1 cannot be switched"),
        ("gen 102:2", "off", "state is 'in' or 'out', not 'off'"),
        ("gen 102:2 PG=3", "out", "only set and add give values"),
    ],
)
def test_faults_of_switching_are_named(plants, record, state, told):
    assert any(told in fault for fault in faults(plants.edit().switch(record, state)))


def test_a_unit_that_comes_in_without_a_machine_is_told(plants):
    dead = replace(
        plants,
        generators=(*plants.generators[:2], replace(plants.generators[2], in_service=False)),
        devices=tuple(d for d in plants.devices if (d.bus, d.id) != (102, "2")),
    )
    (fault,) = faults(dead.edit().switch("gen 102:2", "in"))
    assert fault.startswith("generator 102:2 (edit 1) has no machine")


# Generation.


def test_redispatch_as_an_edit_is_that_of_the_event(plants):
    case = plants.edit().redispatch(30.0, areas=2).case()
    assert [g.active_mw for g in case.generators] == pytest.approx([100.0, 120.0, 60.0])
    event = gf.Redispatch(30.0, areas="2")
    assert event.dispatched(plants).generators == case.generators


def test_units_may_be_named_for_a_redispatch(plants):
    case = plants.edit().redispatch(-20.0, units="102:2").case()
    assert [g.active_mw for g in case.generators] == [100.0, 100.0, 30.0]


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        ({"active_mw": -60.0, "units": "102:2"}, "would give -10 MW, less than nothing"),
        ({"active_mw": 10.0, "units": "101:1"}, "101:1 at a slack bus balances what is left over"),
        ({"active_mw": 10.0, "units": "102:9"}, "there is no machine 102:9"),
        ({"active_mw": 10.0, "units": "102:2", "areas": 1}, "not both"),
        ({"active_mw": 10.0}, "say where"),
    ],
)
def test_faults_of_a_redispatch_are_named(plants, arguments, told):
    (fault,) = faults(plants.edit().redispatch(**arguments))
    assert told in fault


# New records.


def test_records_are_added_as_text_or_as_records(plants):
    editor = plants.edit().add(
        "bus 105 BASKV=230 NAME='NEW' area=2", "branch 104-105 R=0.001 X=0.02 B=0.05"
    )
    case = editor.add(gf.Load(105, "1", 25.0, 5.0), "shunt 105 BL=5").case()
    assert case.buses[-1] == gf.Bus(105, "NEW", 230.0, area=2)
    assert case.branches[-1] == gf.Branch(104, 105, "1", 0.001, 0.02, 0.05)
    assert case.loads[-1].active_mw == 25.0
    assert case.shunts[-1] == gf.Shunt(105, "1", 0.0, 5.0)
    assert gf.solve_power_flow(case).mismatch < 1e-8


def test_a_new_unit_needs_its_machine(plants):
    unit = "generator 104:1 PG=10 MBASE=50"
    (fault,) = faults(plants.edit().add(unit))
    assert fault.startswith("generator 104:1 (edit 1) has no machine")
    machine = "GENCLS 104:1 H=3 D=1 ZX=0.3"
    assert plants.edit().add(unit, machine).case().devices[-1].parameters["inertia"] == 3.0


def test_an_exciter_takes_the_place_of_another_one(plants):
    twice = faults(plants.edit().add("SEXS 101:1 K=1"))
    assert twice == ["edit 1: sexs 101:1 is there already"]
    second = faults(plants.edit().add("ESST1A 101:1 KA=50"))
    assert "unit 101:1 has 2 devices of one role: sexs, esst1a" in second
    text = "SCRX 101:1 TA/TB=0.1 TB=10 K=100 TE=0.1 EMIN=-5 EMAX=5 CSWITCH=0 RC/RFD=0"
    case = plants.edit().remove("SEXS 101:1").add(text).case()
    assert [d.model for d in case.devices] == ["genrou"] * 3 + ["scrx"]


@pytest.mark.parametrize(
    ("record", "told"),
    [
        ("load 103:1 PL=5", "load 103:1 is there already"),
        ("bus 103", "bus 103 is there already"),
        ("bus 106 BASKV=230", "the island of bus 106 (1 buses) has no generator in service"),
        ("load 106 PL=5", "load 106:1 (edit 1): there is no bus 106"),
        ("branch 103-106 X=1", "branch 103-106:1 (edit 1): there is no bus 106"),
        ("branch 103 X=1", "a branch is named FROM-TO:CIRCUIT, not '103'"),
        ("SEXS 102:1 K=3", "sexs 102:1 (edit 1): lead_lag_ratio is missing"),
        ("branch 103-104:3 R=0.1", "a new branch 103-104:3 needs X (reactance)"),
        ("bus 106 NAME=NEW", "a new bus 106 needs BASKV (base_kv)"),
        ("generator 104:1 PG=10", "a new generator 104:1 needs MBASE (base_mva)"),
        ("load 103:2", "a new load 103:2 needs its power, as NAME=VALUE"),
        ("shunt 104:1", "a new shunt 104:1 needs its power, as NAME=VALUE"),
    ],
)
def test_faults_of_new_records_are_named(plants, record, told):
    assert any(told in fault for fault in faults(plants.edit().add(record)))


def test_what_hangs_on_a_removed_record_is_told(plants):
    (fault,) = faults(plants.edit().remove("generator 102:2"))
    assert fault == "genrou 102:2: there is no generator 102:2"


# Edits together.


def test_all_faulty_edits_are_told_at_once(plants):
    editor = plants.edit().set("GENROU 9:1 H=4").scale_load(1.1).switch("gen 9:1", "out")
    assert [fault.split(":")[0] for fault in faults(editor)] == ["edit 1", "edit 3"]


def test_several_cases_go_on_from_one_editor_and_the_case_stays(plants):
    editor = plants.edit().scale_load(1.1)
    heavy, light = editor.set("GENROU 101:1 H=9").case(), editor.set("GENROU 101:1 H=2").case()
    assert parameter(heavy, "genrou", 101, "1", "inertia") == 9.0
    assert parameter(light, "genrou", 101, "1", "inertia") == 2.0
    assert plants == two_plants()
    assert len({plants.fingerprint, heavy.fingerprint, light.fingerprint}) == 3


def test_a_case_without_edits_is_the_case(plants):
    assert plants.edit().case() is plants


def test_notices_of_the_case_tell_what_was_done(plants):
    editor = plants.edit().scale_load(1.5, areas=1).set("GENROU 101:1 H=4")
    assert editor.switch("branch 103-104:2", "out").case().notices == (
        "edited: 1 load in areas 1 from 120 to 180 MW",
        "edited: genrou 101:1: inertia 6.5 -> 4",
        "edited: branch 103-104:2 out",
    )


def test_faults_that_the_case_had_before_are_no_faults_of_the_edits(plants):
    network = replace(plants, devices=())
    assert (
        network.edit().scale_load(1.1).set("gen 102:1 PG=90").case().generators[1].active_mw == 90
    )


def test_every_kind_of_edit_is_a_method_of_the_editor():
    names = {kind.replace("-", "_") for kind in EDITS}
    assert names <= {name for name in dir(gf.CaseEditor) if not name.startswith("_")}


def test_edits_may_be_applied_as_records(plants):
    case = gf.apply_edits(plants, [Switch("gen 102:2", "out")])
    assert case == plants.edit().switch("gen 102:2", "out").case()


def test_models_of_ones_own_are_edited_too(plants):
    mine = replace(SEXS, model="mine")
    devices = (*plants.devices[:3], replace(plants.devices[3], model="mine"))
    own = replace(plants, devices=devices)
    case = own.edit(mine).set("MINE 101:1 K=50").case()
    assert parameter(case, "mine", 101, "1", "regulator_gain") == 50.0
    assert "is no kind of record" in faults(own.edit().set("MINE 101:1 K=50"))[0]


def test_numbers_of_numpy_make_the_same_case(plants):
    def edited(number):
        editor = (
            plants.edit().scale_load(number(1.5), areas=number(2)).redispatch(number(5), areas=2)
        )
        load = gf.Load(103, "9", number(7))
        return editor.set(f"GENROU 101:1 H={number(4)}").add(load).case()

    assert edited(np.int64).fingerprint == edited(int).fingerprint
    assert plants.edit().scale_load(np.float64(1.5)).case().fingerprint == (
        plants.edit().scale_load(1.5).case().fingerprint
    )


def test_what_is_no_number_is_told_at_once(plants):
    with pytest.raises(gf.OptionError, match="factor must be a number, not 'much'"):
        plants.edit().scale_load("much")
    with pytest.raises(gf.OptionError, match="active_mw must be a number, not None"):
        plants.edit().redispatch(None, areas=1)


@pytest.mark.parametrize("record", [5, ["load 103 PL=5", "load 104:1 PL=5"], None])
def test_what_is_no_text_is_told_with_the_edit(plants, record):
    for editor in (
        plants.edit().set(record),
        plants.edit().remove(record),
        plants.edit().switch(record, "out"),
    ):
        (fault,) = faults(editor)
        assert fault.startswith("edit 1: a record is written with a word and a place")
        assert fault.endswith(f"not {record!r}")


def test_devices_of_loads_are_named_by_their_load(plants):
    text = (
        "IEELBL 104:1 "
        + " ".join(f"a{k}=0" for k in range(1, 9))
        + " n1=0 n2=0 n3=0 n4=0 n5=0 n6=0"
    )
    case = plants.edit().add(text).set("IEEL 104:1 a1=1 a4=1", "IEELBL 104 a7=0.5").case()
    assert case.devices[-1].key == case.loads[1].key
    names = ("active_weight_1", "reactive_weight_1", "active_frequency_factor")
    assert [case.devices[-1].parameters[name] for name in names] == [1.0, 1.0, 0.5]
