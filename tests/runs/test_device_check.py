"""What check_device finds of sound devices, and of each kind of fault."""

from __future__ import annotations

import pytest
from own_exciters import RECORD, line_of, own_file

import gridfold as gf
from gridfold.dynamics.device import Role
from gridfold.dynamics.registry import DEVICES
from gridfold.runs.device_check import check_device
from gridfold.runs.trial_case import trial_values

RATE = "dx[X.amplifier, i] = amplifier(x, u, p, i)[1]"
VALUES = dict(
    zip(("mode", "measuring_time", "gain", "time", "lowest", "highest"), RECORD, strict=True)
)


def found(path, **given):
    return check_device(gf.load_devices(path)["mine"], VALUES | given)


def faults(check):
    assert not check.passed
    return {item.test: item.text for item in check.findings if item.passed is False}


def test_a_sound_device_passes_every_test(tmp_path):
    check = found(own_file(tmp_path))
    assert check.passed
    assert check.records == ("MYAVR",)
    assert [(item.test, item.passed) for item in check.findings] == [
        ("kernels in plain Python", True),
        ("compiled kernels", True),
        ("start", True),
        ("Jacobian", True),
        ("limits", True),
        ("limits", True),
    ]
    assert "amplifier goes not above VMAX = 20, and comes back" in check.findings[-1].text


def test_lines_that_no_trial_reached_are_named(tmp_path):
    branch = "\n        if p[P.gain, i].real == 12345:\n            dx[X.amplifier, i] = 0.0"
    path = own_file(tmp_path, (RATE, RATE + branch))
    text = found(path).findings[0].text
    assert text.endswith(f"lines were run, not {path}:{line_of(path, '12345') + 1}")


def test_a_slip_ends_the_tests_with_its_place(tmp_path):
    path = own_file(tmp_path, (RATE, "dx[2, i] = 0.0"))
    (text,) = faults(found(path)).values()
    assert text.startswith(f"{path}:{line_of(path, 'dx[2, i]')}: device mine, derivative kernel")


def test_units_that_influence_one_another_are_found(tmp_path):
    path = own_file(tmp_path, (RATE, RATE + " + x[0, 0] - x[0, i]"))
    assert faults(found(path)) == {"compiled kernels": "units influence one another"}


def test_an_integrator_without_rest_has_no_start(tmp_path):
    path = own_file(tmp_path, (RATE, "dx[X.amplifier, i] = 1.0 + 0.0 * x[0, i]"))
    assert "has no equilibrium" in faults(found(path))["start"]


def test_a_slope_that_is_lost_is_found_in_the_jacobian(tmp_path):
    """The real part of a value has no derivative in the complex step."""
    path = own_file(
        tmp_path, ("u[U.stabilizer_signal, i] - v", "u[U.stabilizer_signal, i] - v.real")
    )
    assert "differs by" in faults(found(path, measuring_time=0.0))["Jacobian"]


def test_a_limit_that_does_not_hold_is_found(tmp_path):
    free = (
        "return limited_lag(p[P.gain, i] * error, x_a, ta, p[P.lowest, i], p[P.highest, i])",
        "return lag(p[P.gain, i] * error, x_a, ta)",
    )
    found_limits = [f.text for f in found(own_file(tmp_path, free)).findings if f.test == "limits"]
    for text, bound in zip(found_limits, ("VMIN = -20", "VMAX = 20"), strict=True):
        assert text.startswith(f"on {bound} the state amplifier goes on with ")


def test_a_state_that_sticks_to_its_limit_is_found(tmp_path):
    stuck = (
        RATE,
        RATE + "\n        if x[X.amplifier, i].real >= p[P.highest, i].real:\n"
        "            dx[X.amplifier, i] = 0.0",
    )
    text = faults(found(own_file(tmp_path, stuck)))["limits"]
    assert text == "the state amplifier does not come back from VMAX = 20"


def test_parameters_that_a_check_refuses_are_told_with_advice(tmp_path):
    refuse = ("    role=", "    check=lambda p: ['time TA is odd'],\n    role=")
    text = faults(found(own_file(tmp_path, refuse)))["parameters"]
    assert text == "mine 1:1: time TA is odd; give values that fit with --set NAME=VALUE"


def test_values_come_by_symbol_by_name_by_default_or_are_usual(tmp_path):
    device = gf.load_devices(own_file(tmp_path))["mine"]
    assert trial_values(device, {"KA": 7.0, "time": 0.1}) == {
        "mode": 1.0, "measuring_time": 0.5, "gain": 7.0, "time": 0.1, "lowest": -10.0, "highest": 5.0,
    }  # fmt: skip
    with pytest.raises(gf.OptionError, match="mine has no parameter 'KB'; there are mode M"):
        trial_values(device, {"KB": 7.0})


@pytest.mark.parametrize(
    ("model", "given"),
    [
        ("sexs", {"TA/TB": 0.1, "TB": 10.0, "K": 50.0, "TE": 0.05}),
        ("tgov1", {"R": 0.05}),
        ("classical", {}),
        ("infinite_bus", {}),
        ("non_reheat_turbine", {}),
        ("stab1", {}),
    ],
)
def test_models_of_the_package_of_every_role_pass(model, given):
    check = check_device(DEVICES[model], given)
    assert check.passed
    assert DEVICES[model].role in Role
