"""RAW and DYR together: own small files, and the public cases where they are at hand."""

import os
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

import gridfold as gf
from gridfold.dynamics.initialize import OnLimit
from gridfold.runs.loading import load_psse

OWN = Path(__file__).parents[1] / "io"
RAW = OWN / "raw" / "revision_33.raw"
ROOT = Path(__file__).resolve().parents[2]
CASES = Path(os.environ.get("GRIDFOLD_CASES", ROOT / ".." / "shared" / "data"))
KUNDUR = ("kundur/kundur.raw", "kundur/kundur_full.dyr")
NPCC = ("npcc/npcc_curent.raw", "npcc/npcc_curent.dyr")
NEW_ENGLAND = ("ieee39/IEEE39.raw", "ieee39/IEEE39.dyr")
WECC = ("wecc240/240busWECC_2018_PSS32_fixed_shunts.raw", "wecc240/240busWECC_2018_PSS.dyr")
TEXAS = ("activsg2000/ACTIVSg2000.RAW", "activsg2000/ACTIVSg2000_dynamics.dyr")


def own(name="plain.dyr", **options):
    return load_psse(RAW, OWN / "dyr" / name, **options)


def public(names, **options):
    paths = [CASES / name for name in names]
    for path in paths:
        if not path.is_file():
            pytest.skip(f"{path} is absent; GRIDFOLD_CASES names the folder of public cases")
    return load_psse(*paths, **options)


def models(loaded):
    return Counter(record.model for record in loaded.case.devices)


def test_raw_and_dyr_make_a_case_that_starts_at_an_equilibrium():
    loaded = own()
    assert loaded.replacements == loaded.notices == loaded.case.unsupported == ()
    model = gf.build_model(loaded.case)
    assert model.warnings == ()
    assert np.abs(model.compiled(model.x0)).max() < 1e-8
    run = gf.simulate(model, t_end=1.0)
    assert np.abs(run.states - model.x0).max() < 1e-8


def test_devices_know_their_file_and_line_and_faults_tell_them(tmp_path):
    case = own().case
    assert case.locate(case.devices[1]) == "sexs 1:1 (plain.dyr:5)"
    assert case.locate(case.generators[0]).startswith("generator 1:1 (revision_33.raw:")
    text = (OWN / "dyr" / "plain.dyr").read_text()
    path = tmp_path / "wrong.dyr"
    path.write_text(text.replace("6.5000", "-6.5000"))
    with pytest.raises(gf.CaseError, match=r"genrou 1:1 \(wrong.dyr:2\): .*must be positive"):
        gf.build_model(load_psse(RAW, path).case)


def test_network_alone_has_no_devices():
    loaded = load_psse(RAW)
    assert loaded.case.devices == ()
    assert gf.solve_power_flow(loaded.case).mismatch < 1e-9


def test_models_that_gridfold_lacks_are_listed_all_at_once():
    with pytest.raises(gf.CaseError) as raised:
        own("models_we_lack.dyr")
    faults = raised.value.faults
    lacking = ["CLODAL", "FRQTPAT", "GENTPF", "EXBAS", "MAXEX1", "REGCB1", "REECD1", "TWDM1T"]
    assert [fault.split()[0] for fault in faults] == lacking


@pytest.mark.parametrize(
    ("choice", "devices", "machine"),
    [
        ("classical", ["gencls 1:1", "tgov1 1:1", "negative_load 2:1"], "classical machine GENCLS"),
        ("drop", ["negative_load 1:1", "negative_load 2:1"], "negative load"),
    ],
)
def test_what_was_replaced_goes_with_the_case(choice, devices, machine):
    loaded = own("models_we_lack.dyr", unsupported=choice)
    assert [str(record) for record in loaded.case.devices] == devices
    assert loaded.case.unsupported == ()
    assert loaded.case.replacements == loaded.replacements
    told = [str(item) for item in loaded.case.replacements]
    assert f"GENTPF: {machine}; 1 record at 1:1, 60.0 MW (46.2% of generation)" in told
    assert loaded.notices == ()
    assert loaded.case.unplaced == ("GENROU 9:1 (models_we_lack.dyr:9): there is no bus 9",)
    if choice == "classical":
        assert gf.build_model(loaded.case).n_states == 4


def test_notes_have_no_part_in_comparisons_and_fingerprints():
    loaded = own("models_we_lack.dyr", unsupported="classical")
    bare = gf.Case(
        **{
            name: getattr(loaded.case, name)
            for name in loaded.case.__dataclass_fields__
            if name not in ("unsupported", "notices", "origins", "replacements", "file_counts")
        }
    )
    assert bare == loaded.case
    assert bare.fingerprint == loaded.case.fingerprint


def test_unknown_choices_are_refused():
    with pytest.raises(gf.OptionError, match="unsupported must be one of error, classical, drop"):
        own(unsupported="ignore")
    with pytest.raises(
        gf.OptionError, match="without_data must be one of error, negative_load, typical"
    ):
        own(without_data="")


def test_limits_beyond_the_start_are_an_error_or_are_moved_with_a_warning(tmp_path):
    text = (OWN / "dyr" / "plain.dyr").read_text()
    path = tmp_path / "low.dyr"
    path.write_text(text.replace("0.30000       1.2000 ", "0.30000       0.2000 "))
    case = load_psse(RAW, path).case
    with pytest.raises(gf.InitializationError, match=r"tgov1 1:1: VMAX"):
        gf.build_model(case)
    (warning,) = gf.build_model(case, on_limit=OnLimit.ADJUST).warnings
    assert warning.startswith("limit moved to the start: tgov1 1:1: VMAX (highest_valve) is 0.2")


def test_two_area_system_of_kundur_is_read_but_for_its_switching_records():
    loaded = public(KUNDUR)
    assert models(loaded) == {"genrou": 4, "exdc2": 4, "tgov1": 4}
    assert loaded.replacements == ()
    assert loaded.notices == ("kundur_full.dyr:37: no device record: Line 'Toggle' Line_8 2.0",)
    model = gf.build_model(loaded.case)
    assert np.abs(model.compiled(model.x0)).max() < 1e-9
    assert gf.small_signal(model).rightmost.real < -0.1


def test_npcc_conversion_starts_at_an_equilibrium():
    loaded = public(NPCC)
    assert models(loaded) == {"genrou": 27, "gencls": 21, "ieeex1": 24, "tgov1": 29}
    assert loaded.replacements == loaded.notices == ()
    model = gf.build_model(loaded.case)
    assert np.abs(model.compiled(model.x0)).max() < 1e-9


def test_new_england_system_has_the_load_model_of_its_file():
    loaded = public(NEW_ENGLAND, allow_unsupported_network=True)
    assert models(loaded) == {"genrou": 10, "ieeet1": 10, "ieeeg1": 10, "ieel": 19}
    assert loaded.replacements == loaded.case.unplaced == ()
    assert len(loaded.case.unsupported) == 1  # an island without a slack unit
    model = gf.build_model(loaded.case)
    assert np.abs(model.compiled(model.x0)).max() < 1e-9


def test_western_system_has_its_inverters():
    loaded = public(WECC)
    assert loaded.replacements == ()
    assert models(loaded) == {
        "genrou": 103,
        "regca1": 37,
        "reecb1": 37,
        "repca1": 37,
        "sexs": 103,
        "gast": 47,
        "tgov1": 31,
        "hygov": 25,
        "ieeest": 10,
    }
    model = gf.build_model(loaded.case)
    assert model.residual < 1e-8
    assert not model.warnings
    assert len(model.machines) == 103


def test_texas_system_lacks_data_of_units_alone():
    with pytest.raises(gf.CaseError) as raised:
        public(TEXAS)
    (without_data,) = raised.value.faults
    assert without_data.startswith("no machine for generators in service: 98 generators, 9364.4 MW")


def test_texas_system_takes_typical_data_for_what_is_no_wind_plant():
    """The code of the wind machines (WMOD) tells 81 of the 98 units without data."""
    loaded = public(TEXAS, without_data="typical")
    found = {item.outcome: item.count for item in loaded.replacements}
    assert found == {
        "negative load, a wind plant": 81,
        "typical GENROU, SEXS, TGOV1 (steam as nothing tells)": 17,
    }
    assert loaded.case.replacements == loaded.replacements


def test_a_table_tells_what_drives_the_units(tmp_path):
    dyr, units = tmp_path / "one.dyr", tmp_path / "units.csv"
    text = (OWN / "dyr" / "plain.dyr").read_text()
    dyr.write_text(text.replace("   2 'GENCLS' 1     4.0  2.0 /\n", ""))
    units.write_text("bus,id,source\n2,1,hydro\n")
    loaded = load_psse(RAW, dyr, without_data="typical", unit_sources=units)
    assert [item.outcome for item in loaded.replacements] == [
        "typical GENSAL, SEXS, HYGOV (a hydro unit)"
    ]
    assert gf.build_model(loaded.case).residual < 1e-9
    units.write_text("bus,id,source\n2,1,hydro\n2,1,gas\n9,1,gas\n1,1,coal fire\n")
    with pytest.raises(gf.CaseFileError) as raised:
        load_psse(RAW, dyr, without_data="typical", unit_sources=units)
    faults = [fault.partition("units.csv:")[2] for fault in raised.value.faults]
    assert [fault.partition(";")[0] for fault in faults] == [
        "5: source: 'coal fire' is not one of unknown, steam, gas, hydro, wind, solar",
        "3: unit 2:1 is given twice",
        "4: there is no unit 9:1 in case revision_33",
    ]
    with pytest.raises(gf.OptionError, match="unit_sources is for PSS/E's dynamic data"):
        gf.load_case("npcc", unit_sources=units)


def test_texas_system_has_every_model_of_its_dynamic_data():
    loaded = public(TEXAS, without_data="negative_load")
    assert {item.model: item.count for item in loaded.replacements} == {"no dynamic data": 98}
    assert models(loaded) == {
        "genrou": 314,
        "gensal": 20,
        "negative_load": 98,
        "esst4b": 212,
        "expic1": 52,
        "exac2": 31,
        "ieeet1": 16,
        "esdc1a": 10,
        "exac1": 4,
        "scrx": 4,
        "esac1a": 2,
        "esac6a": 2,
        "esdc2a": 1,
        "ggov1": 288,
        "ieeeg1": 26,
        "hygov": 20,
        "ieeest": 333,
    }
    model = gf.build_model(loaded.case, on_limit=OnLimit.ADJUST)
    assert np.abs(model.compiled(model.x0)).max() < 1e-8
    assert sum("limit moved" in warning for warning in model.warnings) == 40


def test_the_dynamic_model_of_a_dc_line_is_left_out_and_not_validated(tmp_path):
    """Its ends stay constant, which is another model than that of the file."""
    text = (OWN / "dyr" / "plain.dyr").read_text()
    path = tmp_path / "dc.dyr"
    station = OWN / "raw" / "station_35.raw"
    path.write_text(f"{text}\n'NORD' 'CDC4T' 75.0 26.0 /\n'WEST' 'CDC4T' 75.0 26.0 /\n")
    (left_out,) = load_psse(station, path).replacements
    assert (left_out.model, left_out.units) == ("CDC4T", (gf.UnitKey(3, "NORD"),))
    assert left_out.outcome.startswith("left out; both ends of the dc line stay")
    assert load_psse(station, OWN / "dyr" / "plain.dyr").replacements == ()
