"""Device models from a user's own files answer records of dynamics data."""

from __future__ import annotations

import numpy as np
import pytest
from own_exciters import PLAIN, RAW, RECORD, own_dyr, own_file

import gridfold as gf
from gridfold.runs.basis import basis_of
from gridfold.runs.case_info import examine_files

FAULT = [gf.BusFault(13, start=0.1, duration=0.05)]
VALUES = dict(
    zip(("mode", "measuring_time", "gain", "time", "lowest", "highest"), RECORD, strict=True)
)


def faults_of(folder, *records, **options):
    with pytest.raises(gf.CaseError) as raised:
        gf.load_case(RAW, own_dyr(folder, *records), **options)
    return raised.value


def own_records(case):
    return {
        record.key: dict(record.parameters) for record in case.devices if record.model == "mine"
    }


def test_own_models_answer_plain_and_user_written_records(tmp_path):
    devices = gf.load_devices(own_file(tmp_path))
    case = gf.load_case(RAW, own_dyr(tmp_path), devices=devices)
    assert own_records(case) == {gf.UnitKey(12, "1"): VALUES, gf.UnitKey(22, "1"): VALUES}
    assert (case.replacements, case.unplaced) == ((), ())
    assert case.locate(next(r for r in case.devices if r.model == "mine")).endswith("(own.dyr:13)")


def test_without_the_model_the_records_are_unsupported_and_the_advice_names_devices(tmp_path):
    error = faults_of(tmp_path)
    assert [fault.partition(" is not supported")[0] for fault in error.faults] == [
        "MYAVR (unknown)",
        "a user-written model",
    ]
    assert "--devices FILE.py (devices=)" in str(error)


def test_an_own_copy_of_a_library_model_moves_as_that_does(tmp_path):
    """With a record of equal meaning the run equals that of SEXS: TA/TB = 1 leaves its lead-lag out."""
    path = own_file(tmp_path)
    record = "{bus} 'MYAVR' 1  0 0.0 50.0 0.05 0.0 5.0 /"
    sexs = "{bus} 'SEXS' 1 1.0 10.0 50.0 0.05 0.0 5.0 /"
    devices = gf.load_devices(path)
    own = gf.build_model(gf.load_case(RAW, own_dyr(tmp_path, record, record), devices=devices),
                         devices=devices)  # fmt: skip
    library = gf.build_model(gf.load_case(RAW, own_dyr(tmp_path, sexs, sexs)))
    angles = [gf.simulate(model, FAULT, 3.0).rotor_angle_deg() for model in (own, library)]
    np.testing.assert_allclose(angles[0], angles[1], atol=1e-6)


@pytest.mark.parametrize(
    ("record", "told"),
    [
        ("{bus} 'MYAVR' 1  2 0.02 50.0 0.05 /", "expected 5 to 6 values, found 4"),
        ("{bus} 'MYAVR' 1  2 0.02 50.0 0.05 -20.0 20.0 1.0 /", "expected 5 to 6 values, found 7"),
        ("{bus} 'MYAVR' 1  2.5 0.02 50.0 0.05 -20.0 20.0 /", "value 1 is 2.5, an ICON, which"),
        ("{bus} 'MYAVR' 1  'A' 0.02 50.0 0.05 -20.0 20.0 /", "value 1 is 'A', not a number"),
        (
            "{bus} 'USRMDL' 1 'MYAVR' 4 0 2 5 2 0  2 0.02 50.0 0.05 -20.0 20.0 /",
            "it announces 2 ICONs and 5 CONs and has 6 values; mine takes 1 ICONs and 5 CONs",
        ),
        (
            "{bus} 'USRMDL' 1 'MYAVR' 4 0 1 5 2 0  2 0.02 50.0 0.05 -20.0 /",
            "it announces 1 ICONs and 5 CONs and has 5 values",
        ),
    ],
)  # fmt: skip
def test_a_record_of_an_own_model_with_wrong_values_is_told(tmp_path, record, told):
    error = faults_of(tmp_path, record, devices=gf.load_devices(own_file(tmp_path)))
    (fault,) = error.faults
    assert fault.startswith("MYAVR 12:1 (own.dyr:13): ")
    assert told in fault


def test_values_at_the_end_have_their_defaults(tmp_path):
    devices = gf.load_devices(own_file(tmp_path))
    short = "{bus} 'MYAVR' 1  2 0.02 50.0 0.05 -20.0 /"
    case = gf.load_case(RAW, own_dyr(tmp_path, short), devices=devices)
    model = gf.build_model(case, devices=devices)
    block = next(b for b in model.layout.blocks if b.device.model == "mine")
    row = block.device.parameter_rows.index("highest")
    assert dict(zip(block.units, block.parameters[row], strict=True)) == {
        gf.UnitKey(12, "1"): 5.0,
        gf.UnitKey(22, "1"): 20.0,
    }


def test_a_model_of_the_package_is_replaced_where_that_is_said_and_it_is_told(tmp_path):
    sexs = "{bus} 'SEXS' 1 0.1 10.0 50.0 0.05 0.0 5.0 /"
    answers = ('psse_names=("MYAVR",)', 'psse_names=("SEXS",)')
    with pytest.raises(gf.DeviceError, match="answers SEXS records, as a model of gridfold does"):
        gf.load_devices(own_file(tmp_path, answers))
    path = own_file(
        tmp_path,
        ('psse_names=("MYAVR",)', 'psse_names=("SEXS",), replaces_built_in=True'),
        ("psse_icons=1", "psse_icons=0"),
    )
    devices = gf.load_devices(path)
    case = gf.load_case(RAW, own_dyr(tmp_path, sexs, sexs), devices=devices)
    assert [record.model for record in case.devices].count("mine") == 2
    own = "{bus} 'SEXS' 1 0 0.02 50.0 0.05 -20.0 20.0 /"
    case = gf.load_case(RAW, own_dyr(tmp_path, own, own), devices=devices)
    basis = basis_of(gf.build_model(case, devices=devices))
    told = f"device mine ({path}) is a model of your own: 2 units, in place of gridfold's sexs"
    assert told in basis.notices


def test_own_models_of_a_result_are_told(tmp_path):
    path = own_file(tmp_path)
    devices = gf.load_devices(path)
    case = gf.load_case(RAW, own_dyr(tmp_path), devices=devices)
    basis = basis_of(gf.build_model(case, devices=devices))
    assert f"device mine ({path}) is a model of your own: 2 units" in basis.notices
    assert basis.validated


def test_info_counts_records_of_own_models_as_such(tmp_path):
    devices = gf.load_devices(own_file(tmp_path))
    found = examine_files(RAW, own_dyr(tmp_path), gf.LoadModel(), devices=devices)
    counts = {item.model: (item.kind, item.records, item.own) for item in found.models}
    assert counts["MYAVR"] == ("exciter", 2, True)
    assert counts["GENROU"] == ("machine", 4, False)
    assert found.skipped == ()
    assert found.model is not None


def test_what_a_file_prints_does_not_reach_standard_output(tmp_path, capsys):
    devices = gf.load_devices(own_file(tmp_path, ("from numba", 'print("loaded")\nfrom numba')))
    assert "mine" in devices
    assert capsys.readouterr() == ("", "loaded\n")


def test_a_reduced_model_is_for_the_code_that_it_was_made_with(tmp_path):
    dyr = own_dyr(tmp_path, PLAIN, PLAIN)

    def model(path):
        devices = gf.load_devices(path)
        return gf.build_model(gf.load_case(RAW, dyr, devices=devices), devices=devices)

    one, path = model(own_file(tmp_path)), tmp_path / "reduced.npz"
    gf.save_reduced(path, gf.reduce(gf.partition(one, frozenset(range(11, 16)))))
    assert gf.load_reduced(path, one).family.parts.study_buses == frozenset(range(11, 16))
    spoilt = ("dx[X.amplifier, i] = amplifier", "dx[X.amplifier, i] = 1.1 * amplifier")
    other = model(own_file(tmp_path, spoilt, name="other.py"))
    with pytest.raises(gf.OptionError, match="made with another device model mine of your own"):
        gf.load_reduced(path, other)


def test_a_file_may_import_its_neighbours(tmp_path):
    (tmp_path / "law").mkdir()
    (tmp_path / "law" / "gain.py").write_text("GAIN = 3.0\n")
    path = own_file(
        tmp_path,
        ("from numba", "from law.gain import GAIN\nfrom numba"),
        ('Parameter("gain", "KA", "p.u.")', 'Parameter("gain", "KA", "p.u.", default=GAIN)'),
    )
    device = gf.load_devices(path)["mine"]
    assert {p.name: p.default for p in device.parameters}["gain"] == 3.0
