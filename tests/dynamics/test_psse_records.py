"""Device records from PSS/E dynamics data: what is taken over, what is replaced, what is refused."""

from __future__ import annotations

from dataclasses import replace

import pytest

import gridfold as gf
from gridfold.dynamics.own_models import answering
from gridfold.dynamics.psse_models import CLASSICAL_COLUMNS, Kind, kind_of
from gridfold.dynamics.psse_records import Unsupported, WithoutData, device_records
from gridfold.dynamics.registry import DEVICES
from gridfold.dynamics.typical_data import TYPICAL, hydro_settings
from gridfold.grid.dynamic_records import DynamicData, DynamicRecord, SkippedRecord
from gridfold.grid.energy_source import EnergySource

GENROU = (6.5, 0.05, 0.6, 0.06, 5.0, 1.0, 1.8, 1.75, 0.3, 0.5, 0.25, 0.15, 0.05, 0.3)
GENSAL = (6.5, 0.05, 0.06, 5.0, 1.0, 1.8, 1.1, 0.3, 0.25, 0.15, 0.05, 0.3)
SEXS = (0.1, 10.0, 100.0, 0.05, 0.0, 4.0)
TGOV1 = (0.05, 0.3, 1.2, 0.0, 2.1, 7.0, 0.0)
IEEEST = (1, 0, 0, 0, 0, 0, 0, 0, 0.1, 0.02, 0, 0, 2, 2, 5, 0.1, -0.1, 0, 0)
EXBAS = (0.0,) * 21
LOAD_MW, POWER_MW = 150.0, (60.0, 90.0, 25.0)


@pytest.fixture
def case():
    """Units 1:1, 2:1 and, out of service, 2:2; the impedances ZSORCE differ."""
    return gf.Case(
        name="two units",
        buses=(gf.Bus(1), gf.Bus(2, area=7)),
        branches=(gf.Branch(1, 2, reactance=0.1),),
        generators=(
            gf.Generator(
                1,
                active_mw=POWER_MW[0],
                control=gf.Control.SLACK,
                source_resistance=0.003,
                source_reactance=0.21,
            ),
            gf.Generator(2, active_mw=POWER_MW[1], source_resistance=0.004, source_reactance=0.22),
            gf.Generator(2, "2", active_mw=POWER_MW[2], in_service=False),
        ),
        loads=(gf.Load(1, "1", 50.0), gf.Load(2, "A", 100.0)),
    )


def data(*rows, skipped=()):
    """Records from (model, bus, values), or with an id behind the bus, one a line."""
    records = []
    for line, (model, bus, *rest) in enumerate(rows, start=1):
        unit_id, values = rest if len(rest) > 1 else ("1", rest[0])
        records.append(DynamicRecord(model, bus, unit_id, tuple(values), line))
    return DynamicData("own.dyr", tuple(records), tuple(skipped))


WHOLE = (("GENROU", 1, GENROU), ("GENCLS", 2, (4.0, 2.0)))


def outcomes(found):
    return {
        (item.model, item.outcome): [str(unit) for unit in item.units] for item in found.replaced
    }


def faults_of(case, content, **options):
    with pytest.raises(gf.CaseError) as raised:
        device_records(case, content, **options)
    assert "own.dyr" in str(raised.value)
    return raised.value.faults


def by_name(found):
    return {str(record): dict(record.parameters) for record in found.records}


def test_values_are_named_in_the_order_of_the_record_and_the_rest_comes_from_the_network(case):
    found = device_records(case, data(*WHOLE, ("SEXS", 1, SEXS)))
    records = by_name(found)
    columns = DEVICES["genrou"].psse_record
    assert records["genrou 1:1"] == {**dict(zip(columns, GENROU, strict=True)), "resistance": 0.003}
    assert records["gencls 2:1"] == {
        "inertia": 4.0,
        "damping": 2.0,
        "resistance": 0.004,
        "reactance": 0.22,
    }
    assert records["sexs 1:1"] == dict(zip(DEVICES["sexs"].psse_record, SEXS, strict=True))
    assert found.origins == {
        "genrou 1:1": "own.dyr:1",
        "gencls 2:1": "own.dyr:2",
        "sexs 1:1": "own.dyr:3",
    }
    assert found.replaced == found.skipped == ()


def test_salient_pole_machine_takes_its_resistance_from_the_network_too(case):
    found = device_records(case, data(("GENSAL", 2, GENSAL), WHOLE[0]))
    assert by_name(found)["gensal 2:1"]["resistance"] == 0.004


def test_a_record_that_is_a_comment_is_told_with_and_without_faults(case):
    comment = SkippedRecord(2, "2 'GENCLS' 1 4 0", is_comment=True)
    told = "own.dyr:2: it reads as a record but stands behind a /, so it is a comment: 2 'GENCLS' 1 4 0"
    lacking = replace(data(*WHOLE[:1]), skipped=(comment,))
    with pytest.raises(gf.CaseError) as raised:
        device_records(case, lacking)
    assert raised.value.faults[-1] == told
    assert told in device_records(case, replace(data(*WHOLE), skipped=(comment,))).skipped


def test_classical_machine_without_inertia_is_an_infinite_bus(case):
    found = device_records(case, data(WHOLE[0], ("GENCLS", 2, (0.0, 0.0))))
    assert by_name(found)["infinite_bus 2:1"] == {"resistance": 0.004, "reactance": 0.22}
    assert found.skipped == (
        "GENCLS 2:1 (own.dyr:2) has H = 0: an infinite bus behind 0.22 p.u. (ZSORCE)",
    )


def test_records_of_units_out_of_service_are_notices(case):
    rows = [*WHOLE, ("GENROU", 2, "2", (1.0,)), ("NEWGEN", 2, "2", ())]
    found = device_records(case, data(*rows))
    assert len(found.records) == 2
    assert found.skipped == (
        "own.dyr: GENROU: 1 record of units out of service, first 2:2 (line 3)",
        "own.dyr: NEWGEN: 1 record of units out of service, first 2:2 (line 4)",
    )
    assert found.unplaced == ()


@pytest.mark.parametrize(
    ("bus", "unit_id", "why"),
    [
        (2, "3", "bus 2 has no unit '3', but '1', '2'"),
        (2, "01", "bus 2 has no unit '01', but '1', '2'"),
        (2, "1.0", "bus 2 has no unit '1.0', but '1', '2'"),
        (4, "1", "bus 4 has no unit"),
        (22, "1", "there is no bus 22"),
        (0, "1", "there is no bus 0"),
    ],
)
@pytest.mark.parametrize("model", ["TGOV1", "SEXS", "IEEEST", "GENROU", "REGCA1"])
def test_a_record_that_names_no_unit_is_no_matter_of_service(case, model, bus, unit_id, why):
    larger = replace(case, buses=(*case.buses, gf.Bus(4)))
    found = device_records(larger, data(*WHOLE, (model, bus, unit_id, (1.0,))))
    assert found.unplaced == (f"{model} {bus}:{unit_id} (own.dyr:3): {why}",)
    assert found.skipped == ()


def test_a_model_of_which_nothing_is_known_names_no_unit_too(case):
    found = device_records(case, data(*WHOLE, ("NEWAVR", 9, ())))
    assert found.unplaced == ("NEWAVR 9:1 (own.dyr:3): there is no bus 9",)


def test_a_machine_with_a_slip_in_its_id_is_named_beside_the_unit_that_lacks_one(case):
    faults = faults_of(case, data(WHOLE[0], ("GENCLS", 2, "I", (4.0, 2.0))))
    assert faults[0].startswith("no machine for generators in service: 1 generator at 2:1")
    assert faults[1:] == ["GENCLS 2:I (own.dyr:2): bus 2 has no unit 'I', but '1', '2'"]


def test_a_unit_at_an_isolated_bus_is_known_though_it_is_not_in_the_case(case):
    without = replace(case, left_out=frozenset({gf.UnitKey(5, "1")}))
    found = device_records(without, data(*WHOLE, ("GENROU", 5, GENROU)))
    assert found.unplaced == ()
    assert found.skipped == (
        "own.dyr: GENROU: 1 record of units out of service, first 5:1 (line 3)",
    )


def test_a_record_of_a_known_model_without_a_bus_number_is_a_slip_and_not_a_comment(case):
    skipped = [
        SkippedRecord(3, "l 'TGOV1' 1 0.05", model="TGOV1"),
        SkippedRecord(4, "Line 'Toggle' 5", model="TOGGLE"),
        SkippedRecord(5, "7 'USRMDL' 1 'MYAVR'", gf.UnitKey(7, "1")),
    ]
    found = device_records(case, data(*WHOLE, skipped=skipped))
    assert found.unplaced == (
        "l 'TGOV1' 1 0.05 (own.dyr:3): it begins with no bus number",
        "7 'USRMDL' 1 'MYAVR' (own.dyr:5): there is no bus 7",
    )
    assert found.skipped == ("own.dyr:4: no device record: Line 'Toggle' 5",)


def test_a_stabilizer_without_exciter_and_a_governor_of_an_infinite_bus_are_told(case):
    stray = (("IEEEST", 1, IEEEST), ("TGOV1", 2, TGOV1))
    found = device_records(case, data(WHOLE[0], ("GENCLS", 2, (0.0, 0.0)), *stray))
    assert outcomes(found) == {
        ("IEEEST", "left out, the unit has no exciter for it"): ["1:1"],
        ("TGOV1", "left out, the machine has no turbine"): ["2:1"],
    }


@pytest.mark.parametrize("record", [("SEXS", 2, SEXS), ("TGOV1", 2, TGOV1)])
def test_a_controller_of_a_unit_without_machine_is_no_case(case, record):
    (fault,) = faults_of(case, data(WHOLE[0], record))
    assert fault.startswith("no machine for generators in service: 1 generator at 2:1")


@pytest.mark.parametrize("count", [0, 13, 15])
def test_wrong_number_of_values_is_refused(case, count):
    faults = faults_of(case, data(("GENROU", 1, (1.0,) * count), WHOLE[1]))
    assert faults == [f"GENROU 1:1 (own.dyr:1): expected 14 values, found {count}"]


def test_values_at_the_end_may_be_absent_where_the_model_has_defaults(case):
    found = device_records(case, data(*WHOLE, ("SEXS", 1, SEXS), ("IEEEST", 1, IEEEST[:-2])))
    assert "upper_cut_off" not in by_name(found)["ieeest 1:1"]
    faults = faults_of(case, data(*WHOLE, ("SEXS", 1, SEXS), ("IEEEST", 1, IEEEST[:-3])))
    assert faults == ["IEEEST 1:1 (own.dyr:4): expected 17 to 19 values, found 16"]


def test_a_value_that_a_record_leaves_to_others_is_told(case):
    esdc2a = (0.02, 20, 0.1, 0, 0, 0, 0, 1.0, 0.5, 0.1, 1.0, 0, 2.0, 0.1, 3.0, 0.3)
    found = device_records(case, data(WHOLE[0], ("GENROU", 2, GENROU), ("ESDC2A", 2, esdc2a)))
    assert found.skipped == (
        "own.dyr: ESDC2A: VRMAX follows from other values: 1 record, first 2:1 (line 3)",
        "own.dyr: ESDC2A: VRMIN follows from other values: 1 record, first 2:1 (line 3)",
    )
    assert by_name(found)["esdc2a 2:1"]["regulator_maximum"] == 0


def test_text_in_the_place_of_a_number_is_refused(case):
    faults = faults_of(case, data(WHOLE[0], ("GENCLS", 2, (4.0, "X"))))
    assert faults == ["GENCLS 2:1 (own.dyr:2): value 2 is 'X', not a number"]


def test_two_devices_of_one_role_at_a_unit_are_refused_supported_or_not(case):
    rows = [
        *WHOLE,
        ("SEXS", 1, SEXS),
        ("EXBAS", 1, EXBAS),
        ("REGCB1", 2, ()),
        ("TGOV1", 2, TGOV1),
    ]
    faults = faults_of(case, data(*rows), unsupported=Unsupported.DROP)
    assert faults == [
        "unit 1:1 has 2 exciters: SEXS (line 3), EXBAS (line 4)",
        "unit 2:1 has 2 machines: GENCLS (line 2), REGCB1 (line 5)",
    ]


def test_every_unsupported_model_is_listed_with_its_count_at_once(case):
    rows = [
        ("GENTPF", 1, GENROU),
        ("EXBAS", 1, EXBAS),
        ("GENTPF", 2, GENROU),
        ("CLODAL", 0, "*", (0.4,)),
        ("MYSVC", 2, "7", ()),
    ]
    written = SkippedRecord(9, "2 'USRMDL' 1 'MYGOV'", gf.UnitKey(2, "1"))
    assert faults_of(case, data(*rows, skipped=[written])) == [
        "CLODAL (load model) is not supported: 1 record at 0:*, 150.0 MW (100.0% of load), line 4",
        "MYSVC (unknown) is not supported: 1 record at 2:7, line 5",
        "GENTPF (machine) is not supported: 2 records, 150.0 MW (100.0% of generation), "
        "first 1:1, line 1",
        "EXBAS (exciter) is not supported: 1 record at 1:1, 60.0 MW (40.0% of generation), line 2",
        "a user-written model is not supported: line 9: 2 'USRMDL' 1 'MYGOV'",
    ]


@pytest.mark.parametrize("unsupported", [Unsupported.CLASSICAL, Unsupported.DROP])
def test_controllers_that_are_not_supported_are_left_out(case, unsupported):
    rows = [*WHOLE, ("EXBAS", 1, EXBAS), ("TWDM1T", 1, ()), ("PSS3B", 1, ()), ("MAXEX1", 1, ())]
    rows += [("COMPCC", 1, ()), ("NEWONE", 1, ()), ("TGOV1", 2, TGOV1)]
    found = device_records(case, data(*rows), unsupported=unsupported)
    assert list(by_name(found)) == ["genrou 1:1", "gencls 2:1", "tgov1 2:1"]
    assert outcomes(found) == {
        ("EXBAS", "left out, constant field voltage"): ["1:1"],
        ("TWDM1T", "left out, constant mechanical power"): ["1:1"],
        ("PSS3B", "left out"): ["1:1"],
        ("MAXEX1", "left out"): ["1:1"],
        ("COMPCC", "left out, the exciter holds the terminal voltage"): ["1:1"],
        ("NEWONE", "left out"): ["1:1"],
    }
    for item in found.replaced:
        assert (item.active_mw, item.share) == (60.0, pytest.approx(0.4))


@pytest.mark.parametrize(
    ("model", "values", "expected"),
    [
        ("GENTPF", GENROU, (5.0, 1.0, 0.3)),
        ("GENDCO", (*GENROU, 0.1), (5.0, 1.0, 0.3)),
        ("GENTPF", (*GENROU, 0.1, 0.0), (5.0, 1.0, 0.3)),
        ("GENTRA", (6.5, 5.0, 1.0, 1.8, 1.1, 0.3, 0.05, 0.3, 0.0), (5.0, 1.0, 0.3)),
    ],
)
def test_machine_becomes_classical_with_its_inertia_damping_and_transient_reactance(
    case, model, values, expected
):
    rows = [("GENROU", 1, GENROU), (model, 2, values)]
    rows += [("SEXS", 2, SEXS), ("TGOV1", 2, TGOV1), ("IEEEST", 2, IEEEST)]
    found = device_records(case, data(*rows), unsupported=Unsupported.CLASSICAL)
    names = ("inertia", "damping", "reactance", "resistance")
    made = dict(zip(names, (*expected, 0.004), strict=True))
    assert by_name(found)["gencls 2:1"] == made
    assert list(by_name(found)) == ["genrou 1:1", "gencls 2:1", "tgov1 2:1"]
    assert outcomes(found) == {
        (model, "classical machine GENCLS"): ["2:1"],
        ("SEXS", "left out, the machine has no field"): ["2:1"],
        ("IEEEST", "left out, the unit has no exciter for it"): ["2:1"],
    }


def test_a_short_record_of_a_machine_that_is_replaced_is_refused(case):
    rows = data(WHOLE[0], ("GENTPF", 2, GENROU[:8]))
    faults = faults_of(case, rows, unsupported=Unsupported.CLASSICAL)
    assert faults == ["GENTPF 2:1 (own.dyr:2): expected at least 9 values, found 8"]


@pytest.mark.parametrize(
    ("model", "unsupported"),
    [
        ("GENTPF", Unsupported.DROP),
        ("REGCB1", Unsupported.CLASSICAL),
        ("REGCB1", Unsupported.DROP),
        ("CGEN1", Unsupported.CLASSICAL),
        ("NEWGEN", Unsupported.CLASSICAL),
    ],
)
def test_what_cannot_be_a_machine_is_a_negative_load_without_controllers(case, model, unsupported):
    rows = [("GENROU", 1, GENROU), (model, 2, GENROU), ("REECB1", 2, ()), ("TGOV1", 2, TGOV1)]
    found = device_records(case, data(*rows), unsupported=unsupported)
    assert list(by_name(found)) == ["genrou 1:1", "negative_load 2:1"]
    assert outcomes(found) == {
        (model, "negative load"): ["2:1"],
        ("REECB1", "left out with its machine"): ["2:1"],
        ("TGOV1", "left out with its machine"): ["2:1"],
    }
    assert str(found.replaced[0]) == (
        f"{model}: negative load; 1 record at 2:1, 90.0 MW (60.0% of generation)"
    )


@pytest.mark.parametrize(
    ("model", "place", "power"),
    [
        ("CLODAL", (0, "*"), LOAD_MW),
        ("CLODBL", (2, "A"), 100.0),
        ("CLODBL", (2, "*"), 100.0),
        ("CLODBL", (2, "B"), 0.0),
        ("ACMTAR", (7, "*"), 100.0),
        ("CMLDBLU1", (2, "A"), 100.0),
        ("CLODZN", (1, "*"), LOAD_MW),
    ],
)
def test_load_models_are_left_out_with_the_load_that_they_are_for(case, model, place, power):
    rows = data(*WHOLE, (model, *place, (0.4,)))
    found = device_records(case, rows, unsupported=Unsupported.DROP)
    (item,) = found.replaced
    assert item.outcome == "left out, loads are what the study makes them"
    assert (item.of, item.active_mw, item.share) == ("load", power, pytest.approx(power / LOAD_MW))


def test_stabilizer_without_exciter_is_left_out_and_told(case):
    found = device_records(case, data(*WHOLE, ("IEEEST", 1, IEEEST)))
    assert outcomes(found) == {("IEEEST", "left out, the unit has no exciter for it"): ["1:1"]}


def test_generators_in_service_without_machine_are_refused_or_become_negative_loads(case):
    rows = data(WHOLE[0], ("TGOV1", 2, TGOV1))
    assert faults_of(case, rows, unsupported=Unsupported.DROP) == [
        "no machine for generators in service: 1 generator at 2:1, 90.0 MW (60.0% of generation): 2:1"
    ]
    found = device_records(case, rows, without_data=WithoutData.NEGATIVE_LOAD)
    assert outcomes(found) == {
        ("TGOV1", "left out with its machine"): ["2:1"],
        ("no dynamic data", "negative load"): ["2:1"],
    }


@pytest.mark.parametrize(
    ("source", "base_mva", "models", "inertia"),
    [
        ("unknown", 80.0, ["genrou", "sexs", "tgov1"], 5.0),
        ("steam", 100.0, ["genrou", "sexs", "tgov1"], 4.0),
        ("gas", 400.0, ["genrou", "sexs", "gast"], 5.0),
        ("hydro", 399.0, ["gensal", "sexs", "hygov"], 3.0),
        ("wind", 80.0, ["negative_load"], None),
    ],
)
def test_typical_data_go_by_kind_and_size_and_are_told(case, source, base_mva, models, inertia):
    lacking = replace(case.generators[1], source=EnergySource(source), base_mva=base_mva)
    other = replace(case, generators=(case.generators[0], lacking, case.generators[2]))
    found = device_records(other, data(WHOLE[0]), without_data=WithoutData.TYPICAL)
    records = [record for record in found.records if record.bus == 2]
    assert [record.model for record in records] == models
    (item,) = found.replaced
    assert (item.model, item.share) == ("no dynamic data", pytest.approx(0.6))
    if inertia is None:
        assert item.outcome == "negative load, a wind plant"
    else:
        assert records[0].parameters["inertia"] == inertia
        assert records[0].parameters["resistance"] == 0.004
        assert ("as nothing tells" in item.outcome) == (source == "unknown")
        built = gf.build_model(replace(other, devices=found.records))
        assert built.residual < 1e-9
        assert gf.small_signal(built).rightmost.real < 1e-6
        assert not [doubt for doubt in built.doubts if "2:1" in str(doubt)]


def test_typical_machines_lie_in_the_ranges_of_the_textbook():
    """Kundur, Power System Stability and Control, tables 3.2 and 4.2: thermal and hydraulic units."""
    thermal = {
        "d_reactance": (1.0, 2.3), "q_reactance": (1.0, 2.3), "d_transient_reactance": (0.15, 0.4),
        "q_transient_reactance": (0.3, 1.0), "subtransient_reactance": (0.12, 0.25),
        "leakage_reactance": (0.1, 0.2), "d_open_circuit_time": (3.0, 10.0),
        "q_open_circuit_time": (0.4, 2.0), "d_subtransient_open_circuit_time": (0.02, 0.05),
        "q_subtransient_open_circuit_time": (0.02, 0.05), "inertia": (2.5, 6.0),
    }  # fmt: skip
    hydraulic = {
        "d_reactance": (0.6, 1.5), "q_reactance": (0.4, 1.0), "d_transient_reactance": (0.2, 0.5),
        "subtransient_reactance": (0.15, 0.35), "leakage_reactance": (0.1, 0.2),
        "d_open_circuit_time": (1.5, 9.0), "d_subtransient_open_circuit_time": (0.01, 0.05),
        "q_subtransient_open_circuit_time": (0.01, 0.09), "inertia": (2.0, 4.0),
    }  # fmt: skip
    for source, chosen in TYPICAL.items():
        ranges = hydraulic if source is EnergySource.HYDRO else thermal
        for base in (50.0, 200.0, 600.0):
            machine = chosen.records(gf.Generator(1, base_mva=base))[0].parameters
            for name, (lowest, highest) in ranges.items():
                assert lowest <= machine[name] <= highest, (source, name)


def test_hydro_settings_follow_from_the_starting_times():
    """Kundur's example: TW = 2 s, TM = 2 H = 10 s give a droop of 0.43 and a reset time of 9 s."""
    found = hydro_settings(water=2.0, inertia=5.0)
    assert found == pytest.approx({"temporary_droop": 0.43, "reset_time": 9.0})


def test_user_written_models_are_left_out_and_a_unit_with_nothing_else_is_a_negative_load(case):
    skipped = [
        SkippedRecord(3, "1 'USRMDL' 1 'MYAVR'", gf.UnitKey(1, "1")),
        SkippedRecord(4, "2 'USRMDL' 1 'MYGEN'", gf.UnitKey(2, "1")),
        SkippedRecord(5, "2 'USRMDL' 2 'MYGEN'", gf.UnitKey(2, "2")),
        SkippedRecord(6, "Line 'Toggle' 5"),
    ]
    rows = data(WHOLE[0], skipped=skipped)
    found = device_records(case, rows, unsupported=Unsupported.CLASSICAL)
    assert list(by_name(found)) == ["genrou 1:1", "negative_load 2:1"]
    assert outcomes(found) == {
        ("user-written models", "left out"): ["1:1", "2:1"],
        ("no dynamic data but user-written models", "negative load"): ["2:1"],
    }
    assert found.skipped == (
        "own.dyr:5: user-written, of a unit out of service: 2 'USRMDL' 2 'MYGEN'",
        "own.dyr:6: no device record: Line 'Toggle' 5",
    )


def test_device_models_of_the_user_count_as_supported(case):
    rows = data(*WHOLE, ("MYAVR", 1, SEXS))
    mine = replace(DEVICES["sexs"], model="myavr")
    found = device_records(case, rows, devices={**DEVICES, "myavr": mine})
    assert "myavr 1:1" in by_name(found)


def test_the_table_of_names_agrees_with_the_models_that_gridfold_has():
    supported = answering(DEVICES)
    assert {name: kind_of(name, {}) for name in supported} == {
        name: kind_of(name, supported) for name in supported
    }


def test_positions_for_a_classical_machine_agree_with_the_models_that_gridfold_has():
    for model in ("GENROE", "GENROU", "GENSAE", "GENSAL", "GENTPJ1"):
        columns = DEVICES[model.lower()].psse_record
        names = ("inertia", "damping", "d_transient_reactance")
        assert tuple(columns.index(name) for name in names) == CLASSICAL_COLUMNS[model]
    assert all(kind_of(model, {}) is Kind.MACHINE for model in CLASSICAL_COLUMNS)


CONVERTER = {
    "REGCA1": (1, 0.02, 10.0, 0.9, 0.4, 1.22, 1.2, 0.9, 0.5, -1.3, 0.02, 0.7, 100.0, -100.0, 0.7),
    "REECB1": (
        0, 0, 1, 0, 0, -99.0, 99.0, 0.02, 0.0, 0.0, 0.0, 1.1, -1.1, 0.0, 0.05, 0.44, -0.44, 1.05,
        0.9, 0.0, 0.01, 10.0, 60.0, 0.02, 99.0, -99.0, 1.0, 0.0, 1.11, 0.02,
    ),
    "REPCA1": (
        0, 0, 0, "0", 0, 0, 1, 0.02, 18.0, 5.0, 0.0, 0.05, 0.0, 0.0, 0.0, 0.02, 0.1, -0.1, -1.0,
        1.0, 0.43, -0.43, 1.0, 0.05, 0.25, -1.0, 1.0, 99.0, -99.0, 1.0, 0.0, 0.1, 0.0, 0.0,
    ),
    "WTARA1": (0.007, 0.0),
}  # fmt: skip


def converter_rows(*models, **changed):
    rows = ((model, 2, changed.get(model, CONVERTER[model])) for model in models)
    return data(("GENROU", 1, GENROU), *rows)


def test_controls_of_a_converter_take_their_places_in_any_order_of_the_file(case):
    for models in (("REGCA1", "REECB1", "REPCA1"), ("REPCA1", "REECB1", "REGCA1")):
        found = device_records(case, converter_rows(*models))
        assert list(by_name(found)) == ["genrou 1:1", "regca1 2:1", "reecb1 2:1", "repca1 2:1"]
        assert found.replaced == ()
    assert kind_of("REGCA1", answering(DEVICES)) is Kind.CONVERTER
    assert kind_of("REPCA1", answering(DEVICES)) is Kind.CONTROL


@pytest.mark.parametrize(
    ("models", "lost"),
    [
        (("REGCA1", "REPCA1"), "REPCA1"),
        (("REGCA1", "REECB1", "WTARA1"), "WTARA1"),
    ],
)
def test_controls_that_nothing_listens_to_are_left_out_and_told(case, models, lost):
    found = device_records(case, converter_rows(*models))
    assert outcomes(found) == {(lost, "left out, nothing in its unit takes what it gives"): ["2:1"]}


def test_a_control_that_measures_elsewhere_is_refused_unless_that_is_accepted(case):
    remote = (2, 2, 1, *CONVERTER["REPCA1"][3:])
    near = converter_rows("REGCA1", "REECB1", "REPCA1", REPCA1=remote)
    assert device_records(case, near).replaced == ()
    far = converter_rows("REGCA1", "REECB1", "REPCA1", REPCA1=(1, *CONVERTER["REPCA1"][1:]))
    assert faults_of(case, far) == ["REPCA1 2:1 (own.dyr:4): it measures at bus 1"]
    found = device_records(case, far, unsupported=Unsupported.CLASSICAL)
    assert outcomes(found) == {("REPCA1", "measures at the terminals of its unit"): ["2:1"]}


def test_an_exciter_or_governor_beside_a_converter_is_left_out(case):
    rows = converter_rows("REGCA1", "REECB1")
    more = data(("SEXS", 2, SEXS), ("TGOV1", 2, TGOV1))
    found = device_records(case, replace(rows, records=(*rows.records, *more.records)))
    assert outcomes(found) == {
        ("SEXS", "left out, the machine has no field"): ["2:1"],
        ("TGOV1", "left out, the machine has no turbine"): ["2:1"],
    }
