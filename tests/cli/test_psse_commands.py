"""Commands on files of PSS/E: own small ones, and the public cases where they are at hand."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest

import gridfold as gf
from gridfold.study.prepare import load_grid
from gridfold.study.study_file import parse_study

OWN = Path(__file__).parents[1] / "io"
RAW, DYR = OWN / "raw" / "revision_33.raw", OWN / "dyr" / "plain.dyr"
LACKING = OWN / "dyr" / "models_we_lack.dyr"
ISLAND = OWN / "raw" / "island_without_slack.raw"
ROOT = Path(__file__).resolve().parents[2]
CASES = Path(os.environ.get("GRIDFOLD_CASES", ROOT / ".." / "shared" / "data"))
KUNDUR = ("kundur/kundur.raw", "kundur/kundur_full.dyr")
NEW_ENGLAND = ("ieee39/IEEE39.raw", "ieee39/IEEE39.dyr")
WECC = ("wecc240/240busWECC_2018_PSS32_fixed_shunts.raw", "wecc240/240busWECC_2018_PSS.dyr")
TEXAS = ("activsg2000/ACTIVSg2000.RAW", "activsg2000/ACTIVSg2000_dynamics.dyr")
CLASSICAL = ("--unsupported", "classical")
BASIS = {
    "validated", "load_model", "replacements", "limits_moved", "unsupported", "case_notices",
}  # fmt: skip


def public(names):
    paths = [CASES / name for name in names]
    for path in paths:
        if not path.is_file():
            pytest.skip(f"{path} is absent; GRIDFOLD_CASES names the folder of public cases")
    return paths


def record(command, *arguments):
    """The JSON that a command prints."""
    code, out, err = command(*arguments, "--json", "-")
    assert (code, err) == (0, "")
    return json.loads(out)


def refusal(command, *arguments):
    """The text with which a command refuses, in one line."""
    code, out, err = command(*arguments)
    assert (code, out) == (2, "")
    assert "Traceback" not in err
    return " ".join(err.split())


def solid(text):
    """A text without blanks and line ends: paths are broken at any place."""
    return "".join(text.split())


def low_limit(folder):
    """Dynamic data whose governor has a limit below the operating point."""
    path = folder / "low.dyr"
    path.write_text(DYR.read_text().replace("0.30000       1.2000 ", "0.30000       0.2000 "))
    return path


def test_info_tells_records_areas_tie_lines_and_models(command):
    facts = record(command, "info", RAW, DYR)
    assert facts["file_counts"] == {
        "buses": 3,
        "loads": 1,
        "generators": 2,
        "lines": 2,
        "two-winding transformers": 1,
        "three-winding transformers": 0,
        "fixed shunts": 0,
        "switched shunts": 0,
    }
    assert facts["areas"] == [1, 2]
    assert facts["tie_lines"] == [
        {"from_bus": 2, "to_bus": 3, "circuit": "1", "areas": [1, 2]},
        {"from_bus": 1, "to_bus": 3, "circuit": "1", "areas": [1, 2]},
    ]
    assert [(item["model"], item["records"]) for item in facts["device_models"]] == [
        ("GENROU", 1), ("SEXS", 1), ("TGOV1", 1), ("IEEEST", 1), ("GENCLS", 1),
    ]  # fmt: skip
    assert all(item["implemented"] for item in facts["device_models"])
    assert facts["validated"] is True
    assert facts["equilibrium_residual"] < 1e-8
    assert (facts["missing"], facts["trouble"]) == ([], "")


def test_info_does_not_stop_for_missing_models(command):
    facts = record(command, "info", RAW, LACKING)
    lacking = {item["model"] for item in facts["device_models"] if not item["implemented"]}
    assert lacking == {
        "CLODAL", "FRQTPAT", "GENTPF", "EXBAS", "MAXEX1", "REGCB1", "REECD1", "TWDM1T",
    }  # fmt: skip
    assert {line.split()[0] for line in facts["missing"]} == lacking
    assert facts["validated"] is False
    assert facts["states"] is None
    assert facts["power_flow_mismatch"] < 1e-9
    code, out, _ = command("info", RAW, LACKING)
    assert code == 0
    assert "not validated: 8 faults of the dynamic data" in out
    assert "--unsupported classical" in out


def test_info_of_a_network_alone_has_its_power_flow(command):
    for path, buses in ((RAW, 3), (OWN / "raw" / "plain.m", 4)):
        facts = record(command, "info", path)
        assert facts["power_flow_mismatch"] < 1e-9
        assert (facts["states"], facts["device_models"]) == (None, [])
        assert facts["file_counts"]["buses"] == buses


def test_info_reports_a_network_that_does_not_converge(command, tmp_path):
    heavy = tmp_path / "heavy.raw"
    heavy.write_text(RAW.read_text().replace("120.000,    40.000", "12000.0,    4000.0"))
    facts = record(command, "info", heavy, DYR)
    assert facts["power_flow_mismatch"] is None
    assert facts["trouble"]
    code, out, _ = command("info", heavy, DYR)
    assert code == 0
    assert "does not converge" in out
    assert refusal(command, "simulate", heavy, DYR)


def test_info_reports_limits_beyond_the_start(command, tmp_path):
    facts = record(command, "info", RAW, low_limit(tmp_path))
    assert "VMAX" in facts["trouble"]
    assert facts["states"] is None
    assert record(command, "info", RAW, low_limit(tmp_path), "--on-limit", "adjust")["states"] > 0


def test_info_lists_the_network_that_is_left_out(command):
    facts = record(command, "info", ISLAND)
    assert facts["unsupported"][0].startswith("an island without a slack unit")
    assert facts["validated"] is False


def test_info_tells_of_built_in_cases_what_it_tells_of_files(command):
    facts = record(command, "info", "npcc")
    assert facts["validated"] is True
    assert {item["model"]: item["kind"] for item in facts["device_models"]} == {
        "two_axis": "machine", "ieee_type1": "exciter",
        "first_order_governor": "governor", "non_reheat_turbine": "turbine",
        "negative_load": "negative load",
    }  # fmt: skip
    assert facts["file_counts"] == {}


def test_commands_take_these_files_and_tell_the_same_basis(command):
    expected = None
    for arguments in (
        ("info", RAW, DYR),
        ("simulate", RAW, DYR, "--t-end", 0.2),
        ("eigenvalues", RAW, DYR),
        ("cct", RAW, DYR, "--buses", 2, "--t-end", 0.5, "--longest", 0.2),
    ):
        facts = record(command, *arguments, "--loads", "0.2,0.3,0.5")
        basis = {name: facts[name] for name in BASIS}
        expected = expected or basis
        assert basis == expected
    assert expected["load_model"] == "0.2,0.3,0.5"
    assert expected["validated"] is True


def test_simulate_stores_what_was_used_in_every_file(command, tmp_path):
    files = {kind: tmp_path / f"a.{kind}" for kind in ("csv", "parquet", "npz", "json")}
    options = [item for kind, path in files.items() for item in (f"--{kind}", path)]
    code, out, _ = command(
        "simulate", RAW, LACKING, *CLASSICAL, "--loads", "raw", "--fault-bus", 3,
        "--t-end", 0.2, *options,
    )  # fmt: skip
    assert code == 0
    assert "not validated: 9 kinds of dynamic data" in out
    assert "GENTPF: classical machine GENCLS" in out
    import pyarrow.parquet as pq

    with np.load(files["npz"]) as archive:
        stored = [json.loads(str(archive["metadata"]))]
    stored.append(json.loads(pq.read_schema(files["parquet"]).metadata[b"gridfold"]))
    stored.append(json.loads(files["json"].read_text()))
    stored.append(json.loads((tmp_path / "a.csv.meta.json").read_text()))
    for facts in stored:
        assert facts["load_model"] == "raw"
        assert facts["validated"] is False
        assert facts["method"] == "rk4"
        assert facts["method_reason"]
        found = {item["model"]: item for item in facts["replacements"]}
        assert found["GENTPF"]["outcome"] == "classical machine GENCLS"
        assert found["GENTPF"]["active_mw"] == 60.0
        assert found["REGCB1"]["outcome"] == "negative load"
        assert found["CLODAL"]["share"] == 1.0


def test_a_case_tells_the_faults_of_all_its_stages_and_their_options_at_once(command, tmp_path):
    """The network has an island without a slack unit, a unit no machine, a governor too low a limit."""
    dyr = low_limit(tmp_path)
    text = dyr.read_text()
    dyr.write_text(text[: text.index("   2 'GENCLS'")] + "   1 'FANCY9' 1  1 2 3 /\n")
    said = refusal(command, "eigenvalues", ISLAND, dyr)
    faults = ("an island without a slack unit", "FANCY9", "no machine for generators in service: 1")
    answers = ("--allow-unsupported-network", "--unsupported classical", "--no-data negative-load")
    assert all(fault in said for fault in (*faults, "tgov1 1:1: VMAX"))
    places = [said.index(answer) for answer in (*answers, "--on-limit adjust")]
    assert places == sorted(places)
    assert places[0] > said.index("tgov1 1:1: VMAX")
    # the options that it names are enough
    options = (answers[0], *" ".join(answers[1:]).split(), "--on-limit", "adjust")
    assert command("eigenvalues", ISLAND, dyr, *options)[0] == 0
    # what is answered already is not told, and nothing is told twice
    rest = refusal(command, "eigenvalues", ISLAND, dyr, *options[:-2])
    assert "tgov1 1:1: VMAX" in rest
    assert not any(fault in rest for fault in faults)
    assert said.count("an island without") == said.count("FANCY9 (") == 1


def test_what_is_chosen_stays_chosen_while_later_faults_are_looked_for(command, tmp_path):
    dyr = low_limit(tmp_path)
    text = dyr.read_text()
    dyr.write_text(text[: text.index("   2 'GENCLS'")])
    said = refusal(command, "eigenvalues", ISLAND, dyr, "--typical")
    assert "an island without a slack unit" in said
    assert "tgov1 1:1: VMAX" in said
    assert "--no-data" not in said


def test_python_tells_the_faults_of_network_and_dynamic_data_at_once(tmp_path):
    broken = tmp_path / "broken.dyr"
    broken.write_text("   1 'GENROU' 1  1 2 3 /\n")
    with pytest.raises(gf.CaseError) as refused:
        gf.load_case(ISLAND, broken)
    assert "an island without a slack unit" in str(refused.value)
    assert "GENROU" in str(refused.value)
    assert "allow_unsupported_network=True" in str(refused.value)


def test_limits_that_were_moved_are_told_and_are_no_doubt_by_themselves(command, tmp_path):
    path = low_limit(tmp_path)
    text = refusal(command, "eigenvalues", RAW, path)
    assert "VMAX" in text
    facts = record(command, "eigenvalues", RAW, path, "--on-limit", "adjust")
    (moved,) = facts["limits_moved"]
    assert moved.startswith("tgov1 1:1: VMAX (highest_valve) is 0.2")
    assert facts["validated"] is True


@pytest.mark.parametrize(
    "arguments",
    [
        ("simulate",),
        ("cct", "--buses", "3"),
        ("eigenvalues",),
        ("partition", "--study-buses", "1"),
        ("reduce", "--study-buses", "1"),
        ("calibrate", "--study-buses", "1"),
    ],
)
def test_missing_models_end_a_study_with_their_list_and_advice(command, arguments):
    name, *options = arguments
    text = refusal(command, name, RAW, LACKING, *options)
    assert "models_we_lack.dyr: 8 faults" in text
    assert "GENTPF (machine) is not supported: 1 record at 1:1, 60.0 MW (46.2% of" in text
    assert "--unsupported classical" in text


def test_generators_without_data_end_a_study_and_can_be_negative_loads(command, tmp_path):
    path = tmp_path / "one.dyr"
    path.write_text(DYR.read_text().replace("   2 'GENCLS' 1     4.0  2.0 /\n", ""))
    text = refusal(command, "simulate", RAW, path)
    assert "no machine for generators in service: 1 generator at 2:1, 70.0 MW" in text
    assert "--no-data negative-load" in text
    facts = record(command, "simulate", RAW, path, "--no-data", "negative-load", "--t-end", 0.1)
    assert [item["model"] for item in facts["replacements"]] == ["no dynamic data"]
    assert facts["validated"] is False


def test_an_unsupported_network_needs_leave(command):
    path = OWN / "raw" / "dc_and_facts.raw"
    text = refusal(command, "eigenvalues", path, DYR)
    assert solid(str(path)) in solid(text)
    assert "--allow-unsupported-network" in text


def test_a_file_that_hides_its_revision_is_read_as_it_is_told_on_every_way(command, tmp_path):
    buses = "1,'A',230.0,3\n2,'B',230.0,2\n3,'C',230.0,1\n"
    head, rest = RAW.read_text().split("    1,'NORTH", 1)
    path = tmp_path / "short.raw"
    path.write_text(head.replace(" 33,", ",") + buses + rest[rest.index("0 / END OF BUS") :])
    assert "--raw-revision 33" in refusal(command, "info", path)
    facts = record(command, "info", path, "--raw-revision", "33")
    assert facts["file_counts"]["buses"] == 3
    content = {
        "schema": 1,
        "case": {"source": path.name, "raw_revision": 33},
        "contingencies": {"bus_faults": "1-3"},
    }
    case = load_grid(parse_study(content), tmp_path)
    assert case.fingerprint == facts["fingerprint"]


def test_dc_lines_and_what_was_moved_are_told_with_every_result(command, tmp_path):
    station = OWN / "raw" / "station_35.raw"
    stored = record(command, "info", station)["case_notices"]
    assert any(line.startswith('dc line "NORD" draws 60.0 MW') for line in stored)
    assert not any("not the stored one" in line for line in stored)
    moved = record(command, "info", station, "--solve", "limits")["case_notices"]
    limited = 'at a reactive limit: the converter of VSC dc line "OST" at bus 5 150.0 Mvar'
    assert limited in moved
    run = ("simulate", station, DYR, "--fault-bus", 6, "--t-end", 0.2)
    facts = record(command, *run, "--solve", "limits")
    assert limited in facts["case_notices"]
    assert any('VSC dc line "OST" draws' in line for line in facts["case_notices"])
    content = {
        "schema": 1,
        "case": {"source": str(station), "solve": "limits"},
        "contingencies": {"bus_faults": "1-3"},
    }
    case = load_grid(parse_study(content), tmp_path)
    assert limited in case.notices


def test_a_case_without_an_operating_point_within_limits_can_be_looked_at(command, tmp_path):
    text = (OWN / "raw" / "station_30.raw").read_text()
    path = tmp_path / "heavy.raw"
    path.write_text(text.replace("180.0,50.0", "180.0,900.0"))
    facts = record(command, "info", path, "--solve", "limits")
    assert "no operating point was found" in facts["trouble"]
    assert "no operating point was found" in refusal(
        command, "eigenvalues", path, DYR, "--solve", "limits"
    )


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((RAW, "data.txt"), "suffix .dyr, not from data.txt"),
        (("npcc", DYR), "plain.dyr needs a RAW file"),
        ((DYR,), "plain.dyr holds dynamic data alone"),
        ((RAW,), "revision_33.raw holds the network alone"),
        ((RAW, "none.dyr"), "none.dyr"),
        (("none.raw", DYR), "none.raw"),
        (("grid.sav",), "grid.sav"),
        ((RAW, DYR, "--loads", "q"), "z, raw or P,I,Z"),
        ((RAW, DYR, "--loads", "0.5,0.1,0.1"), "add up to 0.7"),
        ((RAW, DYR, "--unsupported", "ignore"), "ignore"),
        ((RAW, DYR, "--no-data", "ignore"), "ignore"),
        ((RAW, DYR, "--raw-revision", "28"), "raw_revision must be one of 29 to 35, not 28"),
        (("npcc", "--solve", "limits"), "case npcc gives no set points and limits"),
        ((RAW, DYR, "--solve", "flat"), "flat"),
        (("npcc", "--raw-revision", "33"), "raw_revision is for RAW files of PSS/E, not for npcc"),
    ],
)
def test_files_and_options_that_do_not_fit_are_refused_by_name(command, arguments, words):
    assert solid(words) in solid(refusal(command, "eigenvalues", *arguments))


TWO_AREAS = Path(__file__).parents[2] / "examples" / "psse_study"


@pytest.mark.parametrize(
    ("model", "how"), [("hybrid", ("--outputs", "states")), ("retained", ("--retain-buses", 22))]
)
def test_a_reduced_model_keeps_its_load_model(command, tmp_path, model, how):
    raw, dyr = TWO_AREAS / "two_areas.raw", TWO_AREAS / "two_areas.dyr"
    area, path = ("--study-areas", 1), tmp_path / "k.npz"
    facts = record(command, "reduce", raw, dyr, *area, *how, "--loads", "raw", "--out", path)
    assert facts["load_model"] == "raw"
    with np.load(path) as archive:
        assert json.loads(str(archive["metadata"]))["load_model"] == "raw"
    begin = ("simulate", raw, dyr, *area, "--model", model, "--reduced", path, "--t-end", 0.1)
    assert record(command, *begin, "--loads", "raw")["status"] == "completed"
    assert "has loads raw, the model of the case z" in refusal(command, *begin)


def test_where_all_external_machines_are_retained_that_and_why_are_said(command):
    files = (TWO_AREAS / "two_areas.raw", TWO_AREAS / "two_areas.dyr")
    said = refusal(command, "reduce", *files, "--study-areas", 1, "--column-norm", 1)
    assert "all external machines are retained: none is left to be linear" in said


def test_without_a_choice_some_external_machine_is_linear(command):
    files = (TWO_AREAS / "two_areas.raw", TWO_AREAS / "two_areas.dyr")
    facts = record(command, "reduce", *files, "--study-areas", 1)
    assert len(facts["kept"]) == 1


def test_kundur_skips_the_switching_record_of_andes(command):
    files = public(KUNDUR)
    facts = record(command, "info", *files)
    assert facts["skipped"] == [{"line": 37, "text": "Line 'Toggle' Line_8 2.0"}]
    assert facts["validated"] is True
    facts = record(command, "partition", *files, "--study-areas", 1)
    assert facts["case_notices"] == [
        "kundur_full.dyr:37: no device record: Line 'Toggle' Line_8 2.0"
    ]


def test_new_england_runs_without_its_island(command):
    files = public(NEW_ENGLAND)
    assert "--allow-unsupported-network" in refusal(command, "simulate", *files)
    facts = record(
        command, "simulate", *files, "--allow-unsupported-network",
        "--fault-bus", 16, "--fault-duration", 0.05, "--t-end", 0.5,
    )  # fmt: skip
    assert facts["status"] == "completed"
    assert facts["replacements"] == []
    assert len(facts["unsupported"]) == 1
    assert facts["validated"] is False


def test_western_system_runs_with_its_converters(command):
    files = public(WECC)
    facts = record(command, "simulate", *files, "--t-end", 0.5)
    assert (facts["status"], facts["validated"]) == ("completed", True)
    assert facts["replacements"] == []
    assert facts["machines"] == 103


def test_texas_rides_through_a_fault(command):
    files = public(TEXAS)
    facts = record(command, "info", *files)
    assert len(facts["missing"]) == 1
    assert len(facts["tie_lines"]) == 131
    facts = record(
        command, "simulate", *files, *CLASSICAL, "--no-data", "negative-load",
        "--on-limit", "adjust", "--fault-bus", 1004, "--fault-duration", 0.05, "--t-end", 0.2,
    )  # fmt: skip
    assert facts["status"] == "completed"
    assert len(facts["limits_moved"]) == 40
    assert len(facts["replacements"]) == 1


INFINITE_BUSES = """0, 100.0, 33, 0, 1, 60.0
TWO INFINITE BUSES

1,'A',20.0,3,1,1,1,1.0,0.0
2,'B',20.0,2,1,1,1,1.0,0.0
0
0
0
1,'1',50.0,0.0,99.0,-99.0,1.0,0,100.0,0.0,0.2,0,0,1.0,1,100.0,99.0,-99.0
2,'1',50.0,0.0,99.0,-99.0,1.0,0,100.0,0.0,0.2,0,0,1.0,1,100.0,99.0,-99.0
0
1,2,'1',0.0,0.1,0.0
0
Q
"""


def test_a_model_without_states_has_no_eigenvalues_and_says_so(command, tmp_path):
    raw, dyr, record = (tmp_path / name for name in ("two.raw", "two.dyr", "modes.json"))
    raw.write_text(INFINITE_BUSES)
    dyr.write_text("1 'GENCLS' '1' 0 0 /\n2 'GENCLS' '1' 0 0 /\n")
    code, out, _ = command("eigenvalues", raw, dyr, "--json", record)
    assert code == 0
    assert "has no eigenvalues" in out
    assert json.loads(record.read_text())["modes"] == []


def test_typical_data_stand_for_missing_ones_on_request(command, tmp_path):
    dyr, units = tmp_path / "one.dyr", tmp_path / "units.csv"
    dyr.write_text(DYR.read_text().replace("   2 'GENCLS' 1     4.0  2.0 /\n", ""))
    units.write_text("bus,id,source\n2,1,gas\n")
    assert "--typical" in refusal(command, "simulate", RAW, dyr)
    given = ("--typical", "--unit-sources", units, "--t-end", 0.1)
    facts = record(command, "simulate", RAW, dyr, *given)
    (item,) = facts["replacements"]
    assert (item["outcome"], item["first"]) == ("typical GENROU, SEXS, GAST (a gas unit)", "2:1")
    assert facts["validated"] is False
    text = refusal(command, "simulate", RAW, dyr, "--typical", "--no-data", "negative-load")
    assert "give --typical or --no-data, not both" in text
    text = refusal(command, "simulate", RAW, dyr, "--unit-sources", units)
    assert "--unit-sources has no effect without --typical" in text
