"""Device models of a user's own beside those of the package: names, records, and what does not fit."""

from __future__ import annotations

from dataclasses import replace

import pytest
from device_alone import machine_with
from own_exciters import RECORD, line_of, own_file

import gridfold as gf
from gridfold.dynamics.device import (
    Bound,
    Device,
    Parameter,
    Role,
    limits,
    positions,
)
from gridfold.dynamics.own_models import answering, device_models
from gridfold.dynamics.registry import DEVICES


def rate(x, u, p, y, dx):
    for i in range(x.shape[1]):
        dx[0, i] = u[0, i] - x[0, i]


MINE = Device(
    model="mine",
    title="mine",
    role=Role.EXCITER,
    parameters=(Parameter("gain", "K", "p.u."),),
    states=("field_voltage",),
    inputs=("terminal_voltage",),
    derivative=rate,
    set_points=("reference",),
    targets=("field_voltage",),
    psse_record=("gain",),
)


def faults(device):
    with pytest.raises(gf.DeviceError) as raised:
        device_models(device)
    return raised.value.faults


def test_own_models_stand_beside_those_of_the_package_however_they_are_given():
    for given in (MINE, [MINE], (d for d in [MINE]), {"mine": MINE}, {**DEVICES, "mine": MINE}):
        assert device_models(given) == {**DEVICES, "mine": MINE}
    assert device_models() is DEVICES


def test_what_is_no_device_is_refused_with_advice():
    with pytest.raises(gf.DeviceError, match=r"'my\.py' is no Device; .* gridfold\.load_devices"):
        device_models(["my.py"])
    with pytest.raises(gf.DeviceError, match="'yours' stands for the model 'mine'"):
        device_models({"yours": MINE})


WRONG = {
    "states": ({"states": "field_voltage"}, "its states are 'field_voltage', not a tuple of names"),
    "model": ({"model": ""}, "its model cannot be ''"),
    "reserved": ({"model": "negative_load"}, "its model cannot be 'negative_load'"),
    "role": ({"role": "exciter"}, "its role cannot be 'exciter'"),
    "parameters": ({"parameters": ("gain",)}, "its parameters are not a tuple of Parameter"),
    "twice": ({"inputs": ("terminal_voltage",) * 2}, "its inputs have terminal_voltage more than once"),
    "state and output": (
        {"outputs": ("field_voltage",), "output": rate},
        "its states and outputs have field_voltage more than once",
    ),
    "targets": ({"targets": ("gone",)}, "its targets name 'gone'; there are field_voltage"),
    "defaults": ({"defaults": {"gone": 0.0}}, "its defaults name 'gone'; there are field_voltage"),
    "limits": ({"limits": limits("low", "high")}, "its limits name 'low', 'high'; there are gain"),
    "limited state": ({"limits": limits("gain", "gain", "gone")}, "its limits name 'gone', 'gone'"),
    "record": ({"psse_record": ("gone",)}, "its psse_record name 'gone'; there are gain"),
    "incomplete record": ({"psse_record": (None,), "psse_names": ("A",)}, "has no psse_record"),
    "names alone": ({"psse_record": (), "psse_names": ("A",)}, "has no psse_record"),
    "icons": ({"psse_icons": 2}, "it has 2 ICONs among the 1 of its record"),
    "start": ({"targets": ()}, "it has 0 targets for 1 set points and solved inputs"),
    "no kernel": ({"derivative": None}, "it has states, but no derivative kernel"),
    "output kernel": ({"output": rate}, "it has a kernel for its outputs, but no outputs"),
    "arguments": ({"derivative": lambda x, u: None}, "its derivative kernel takes 2 arguments"),
    "decorated": ({"derivative": print}, "its derivative kernel is no plain function"),
    "machine": ({"role": Role.MACHINE}, "a machine needs two sources"),
    "admittance": (
        {"admittance": lambda p: 1j},
        "only machines and devices of loads have a source and an admittance",
    ),
    "role's signal": (
        {"states": ("voltage",), "targets": ("voltage",)},
        "its role gives field_voltage, which is none of its states and outputs",
    ),
    "turbine": (
        {"role": Role.TURBINE, "states": ("mechanical_power",), "targets": ("mechanical_power",)},
        "give it the role of a governor",
    ),
    "lacking": (
        {"parameters": (*MINE.parameters, Parameter("time", "T", "s"))},
        "its psse_record lacks time, which have no default",
    ),
}  # fmt: skip


@pytest.mark.parametrize("what", WRONG)
def test_a_definition_that_does_not_fit_together_is_told(what):
    change, told = WRONG[what]
    found = faults(replace(MINE, **change))
    assert any(told in fault for fault in found), found
    assert all(fault.startswith(f"device {change.get('model', 'mine')}") for fault in found)


def test_all_faults_of_all_models_are_told_at_once():
    other = replace(MINE, model="other", psse_record=(), targets=("gone",))
    found = faults([replace(MINE, targets=("lost",), psse_icons=3), other])
    assert len(found) == 3


def test_two_own_models_have_neither_one_name_nor_one_record(tmp_path):
    first, second = own_file(tmp_path, name="a.py"), own_file(tmp_path, name="b.py")
    second.write_text(second.read_text().replace("0.0", "0.1", 1))
    with pytest.raises(gf.DeviceError) as raised:
        gf.load_devices(first, second)
    assert f"device mine ({second}) has the name of device mine ({first})" in str(raised.value)
    (fault,) = faults([MINE, replace(MINE, model="other", psse_names=("mine",))])
    assert "device other" in fault
    assert "answers MINE records, as device mine" in fault


def test_one_model_that_two_files_share_is_one(tmp_path):
    own_file(tmp_path, name="shared.py")
    for name in ("a.py", "b.py"):
        (tmp_path / name).write_text("from shared import MINE\n")
    assert set(gf.load_devices(tmp_path / "a.py", tmp_path / "b.py")) - set(DEVICES) == {"mine"}


def test_a_model_of_the_package_is_replaced_only_if_that_is_said():
    named = replace(MINE, model="sexs")
    answers = replace(MINE, psse_names=("SEXS", "ESST5B"))
    assert "has the name of a model of gridfold; set replaces_built_in=True" in faults(named)[0]
    assert "answers SEXS records, as a model of gridfold does" in faults(answers)[0]
    named, answers = (replace(d, replaces_built_in=True) for d in (named, answers))
    assert device_models(named)["sexs"] is named
    known = answering(device_models(answers))
    assert (known["SEXS"], known["ESST5B"]) == (answers, answers)
    assert known["IEEET1"] is DEVICES["ieeet1"]


def test_whole_numbers_are_a_range():
    assert [Bound.INTEGER.holds(v) for v in (3, -2.0, 0.5, float("nan"))] == [
        True,
        True,
        False,
        False,
    ]


def test_positions_are_numbers_by_name_in_order():
    rows = positions(Parameter("gain", "K", "-"), "reference", "base_speed")
    assert tuple(rows) == (0, 1, 2)
    assert (rows.gain, rows.reference, rows.base_speed) == (0, 1, 2)
    with pytest.raises(gf.DeviceError, match="more than once: 'a', 'a'"):
        positions("a", "a")
    with pytest.raises(gf.DeviceError, match="no name of a row: 'TA/TB'"):
        positions("TA/TB")


def test_rows_in_another_order_are_other_code(tmp_path):
    """Else compiled code of before, with the rows as they were, would be taken from the disk."""
    swapped = ('STATES = ("measured", "amplifier")', 'STATES = ("amplifier", "measured")')
    one = gf.load_devices(own_file(tmp_path))["mine"]
    other = gf.load_devices(own_file(tmp_path, swapped, name="other.py"))["mine"]
    assert one.own_digest != other.own_digest


def test_where_a_file_lies_and_its_comments_do_not_count(tmp_path):
    one = gf.load_devices(own_file(tmp_path))["mine"]
    commented = ("PARAMETERS = (\n", "# a comment\nPARAMETERS = (\n")
    other = gf.load_devices(own_file(tmp_path, commented, name="other.py"))["mine"]
    assert one.own_digest == other.own_digest


@pytest.mark.parametrize(
    ("field", "text", "told"),
    [
        ("check", "lambda p: None", "its check gives None, not texts"),
        ("check", "lambda p: 'wrong'", "its check gives 'wrong', not texts"),
        ("check", "lambda p: p['gone']", "mine.py:{line}: device mine: KeyError: 'gone'"),
        ("resolve", "lambda p, base: None", "its resolve gives None, not all parameters by name"),
        ("resolve", "lambda p, base: {}", "its resolve gives {}, not all parameters by name"),
        ("guess", "lambda p, known: None", "its guess gives None, not a mapping"),
        ("guess", "lambda p, known: {'amplifier': [1, 2, 3]}", "not numbers of 1 units"),
        ("guess", "lambda p, known: {'amplifier': 'x'}", "not numbers of 1 units"),
    ],
)
def test_functions_that_give_something_else_are_told(tmp_path, field, text, told):
    path = own_file(tmp_path, ("    role=", f"    {field}={text},\n    role="))
    devices = gf.load_devices(path)
    values = dict(zip(devices["mine"].psse_record, RECORD, strict=True))
    with pytest.raises(gf.DeviceError) as raised:
        gf.build_model(machine_with({"mine": values}), devices=devices)
    assert told.replace("{line}", str(line_of(path, f"{field}="))) in str(raised.value)
    assert str(path) in str(raised.value)


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ("None", "not finite numbers"),
        ("[1j] * 7", "not complex numbers"),
        ("float('nan')", "not finite"),
    ],
)
def test_an_admittance_that_is_none_is_told(given, told):
    device = replace(DEVICES["classical"], model="mine", admittance=lambda p: eval(given))
    with pytest.raises(gf.DeviceError, match=f"its admittance gives .*, {told}"):
        gf.build_model(
            replace(
                case := machine_with({}),
                devices=tuple(
                    gf.DeviceRecord("mine", 1, "1", {"inertia": 3.0, "transient_reactance": 0.3})
                    if record.model == "genrou"
                    else record
                    for record in case.devices
                ),
            ),
            devices=device,
        )
