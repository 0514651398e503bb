"""Slips in kernels of a user's own are errors with file, device, kernel and row, whatever they are."""

from __future__ import annotations

import numpy as np
import pytest
from device_alone import machine_with
from own_exciters import RECORD, line_of, own_file

import gridfold as gf
from gridfold.dynamics.device import Role, compiled_kernel, run_kernel
from gridfold.dynamics.evaluate import derivative_stage, output_stage, source_stage
from gridfold.dynamics.guarded import interpreted
from gridfold.dynamics.own_kernels import try_kernels
from gridfold.dynamics.registry import DEVICES
from gridfold.dynamics.trial_points import trial_points

NAMES = ("mode", "measuring_time", "gain", "time", "lowest", "highest")
VALUES = dict(zip(NAMES, RECORD, strict=True))
RATE = "dx[X.amplifier, i] = amplifier(x, u, p, i)[1]"
FIELD = "y[Y.field_voltage, i] = amplifier(x, u, p, i)[0]"
#: What is written in place of a line of the derivative kernel, and what is said of it.
SLIPS = {
    "a row too many": ("dx[2, i] = 0.0", r"dx\[2, 0\] is beyond its rows \(0 measured, 1 amplifier\)"),
    "a negative row": ("dx[-1, i] = 0.0", r"dx\[-1, 0\] is beyond its rows"),
    "a row of inputs": ("dx[X.amplifier, i] = u[2, i]", r"u\[2, 0\] is beyond its rows"),
    "a row of parameters": ("dx[X.amplifier, i] = p[8, i]", r"p\[8, 0\] is beyond its rows"),
    "a row of outputs": ("dx[X.amplifier, i] = y[1, i]", r"y\[1, 0\] is beyond its rows"),
    "the next unit": ("dx[X.amplifier, i + 1] = 0.0", r"dx\[1, 3\] is beyond the units 0 to 2"),
    "a state not set": ("pass", r"row 1 of dx \(amplifier\) is not set"),
    "a unit not set": ("dx[X.amplifier, 0] = 0.0", r"row 1 of dx \(amplifier\) is not set for unit 1"),
    "a float as row": ("dx[1.0, i] = 0.0", r"dx\[1\.0, 0\]: a row is a whole number, not 1\.0"),
    "a float as unit": ("dx[1, i / 1] = 0.0", r"a unit is a whole number, not 0\.0"),
    "a value as row": ("dx[p[P.mode, i], i] = 0.0", r"a row is a whole number"),
    "a truth as row": ("dx[i == i, i] = 0.0", r"a row is a whole number, not True"),
    "one index": ("dx[X.amplifier] = 0.0", r"dx\[1\] is not indexed by row and unit"),
    "three indices": ("dx[X.amplifier, i, 0] = 0.0", r"is not indexed by row and unit"),
    "a slice": ("dx[X.amplifier, :] = 0.0", r"dx\[1, :\] is a slice; kernels are loops over units"),
    "a whole matrix": ("dx[X.amplifier, i] = (2 * x)[0, i]", r"TypeError: unsupported operand"),
    "writing into states": (f"{RATE}; x[X.amplifier, i] = 0.0", r"row 1 of x \(amplifier\) is set"),
    "writing into inputs": (f"{RATE}; u[0, i] = 0.0", r"row 0 of u \(terminal_voltage\) is set, which"),
    "writing into parameters": (f"{RATE}; p[P.gain, i] = 1.0", r"row 2 of p \(gain\) is set, which"),
    "writing into outputs": (f"{RATE}; y[0, i] = 0.0", r"row 0 of y \(field_voltage\) is set, which"),
    "reading before": ("dx[X.amplifier, i] += 1.0", r"row 1 of dx \(amplifier\) is read before"),
    "no number": ("dx[X.amplifier, i] = None", r"is set to None, which is not a number"),
    "a text": ("dx[X.amplifier, i] = 'x'", r"is set to 'x', which is not a number"),
    "a list": ("dx[X.amplifier, i] = [1.0]", r"is set to \[1\.0\], which is not a number"),
    "a complex number": ("dx[X.amplifier, i] = 1j", r"is set to the complex number 1j"),
    "always NaN": ("dx[X.amplifier, i] = float('nan')", r"\(amplifier\) is never a finite number"),
    "always infinite": ("dx[X.amplifier, i] = x[0, i] * 1e308 * 1e308", r"is never a finite number"),
    "a division by zero": ("dx[X.amplifier, i] = 1 / 0", r"ZeroDivisionError"),
    "a quotient by zero that is clipped": (
        "dx[X.amplifier, i] = min((1 / (x[0, i] - x[0, i])).real, 1.0)",
        r"divide by zero encountered",
    ),
    "an unknown name": ("dx[X.amplifier, i] = gone", r"NameError: name 'gone' is not defined"),
    "an unknown row": ("dx[X.gone, i] = 0.0", r"AttributeError: .*'gone'"),
    "complex numbers compared": (
        "dx[X.amplifier, i] = 1.0 if x[0, i] > 0 else 0.0",
        r"TypeError: '>' not supported .*; compare real parts, \.real",
    ),
    "an exception": ("raise ValueError('no')", r"ValueError: no"),
    "end of the program": ("raise SystemExit(0)", r"asks to end the program \(exit code 0\)"),
}  # fmt: skip


def model_with(path):
    device = gf.load_devices(path)
    return gf.build_model(machine_with({"mine": VALUES}), devices=device)


@pytest.mark.parametrize("slip", SLIPS)
def test_a_slip_is_an_error_that_names_file_line_device_kernel_and_row(tmp_path, slip):
    body, told = SLIPS[slip]
    path = own_file(tmp_path, (RATE, body))
    with pytest.raises(gf.DeviceError, match=told) as raised:
        model_with(path)
    text = str(raised.value)
    assert "device mine" in text
    if "not set" in told or "never" in told:
        assert text.startswith(
            f"{path}:{line_of(path, 'def derivative')}: device mine, derivative kernel: "
        )
    else:
        assert text.startswith(f"{path}:{line_of(path, body)}: device mine")


def test_slips_of_all_kernels_are_told_at_once(tmp_path):
    path = own_file(tmp_path, (RATE, "dx[7, i] = 0.0"), (FIELD, "y[1, i] = 0.0"))
    with pytest.raises(gf.DeviceError) as raised:
        model_with(path)
    assert len(raised.value.faults) == 2
    assert "output kernel: y[1, 0] is beyond its rows (0 field_voltage)" in raised.value.faults[0]
    assert "derivative kernel: dx[7, 0]" in raised.value.faults[1]


@pytest.mark.parametrize(
    ("condition", "what"),
    [
        ("x[X.amplifier, i].real > p[P.highest, i].real", "beyond its limit"),
        ("x[X.amplifier, i].real <= p[P.lowest, i].real", "on its limit"),
        ("p[P.mode, i].real == 7", "with another code"),
        ("p[P.measuring_time, i].real == 0", "without a time constant"),
        ("u[U.terminal_voltage, i].real < 0", "with an input that is negative"),
        ("u[U.stabilizer_signal, i].real > 15", "with an input that is large"),
        ("x[X.measured, i].real == 0", "with a state at zero"),
    ],
)
def test_slips_in_branches_are_found(tmp_path, condition, what):
    body = f"{RATE}\n        if {condition}:\n            dx[5, i] = 0.0"
    with pytest.raises(gf.DeviceError, match=r"dx\[5, \d\] is beyond its rows"):
        model_with(own_file(tmp_path, (RATE, body)))


def test_slips_in_functions_that_a_kernel_calls_are_found_there(tmp_path):
    path = own_file(tmp_path, ("x[X.measured, i], p[P.measuring_time, i])[0]", "x[9, i], 0.0)[0]"))
    with pytest.raises(gf.DeviceError) as raised:
        model_with(path)
    assert f"{path}:{line_of(path, 'x[9, i]')}: device mine, output kernel: x[9, 0]" in str(
        raised.value
    )


def test_what_only_the_compiler_refuses_is_told_with_its_line(tmp_path):
    body = "dx[X.amplifier, i] = len(str(i)) + [k for k in (1.0, {'a': 2})][0]"
    path = own_file(tmp_path, (RATE, body))
    with pytest.raises(
        gf.DeviceError, match="derivative kernel: it cannot be compiled for real numbers: "
    ) as raised:
        model_with(path)
    assert str(raised.value).startswith(f"{path}:{line_of(path, body)}: device mine")


def test_a_row_that_no_trial_reached_is_no_access_to_memory(tmp_path):
    """The compiled kernel reads NaN and writes nowhere, whatever the index that the data give."""
    body = f"k = int(1e6 * p[P.gain, i].real)\n        {RATE}\n        dx[k, i] = x[k, i]"
    device = gf.load_devices(own_file(tmp_path, (RATE, body)))["mine"]
    x, u, y, dx = (np.full((n, 1), 0.5, complex) for n in (2, 2, 1, 2))
    p = np.full((len(device.parameter_rows), 1), 0.5, complex)
    p[2] = 1e5
    run_kernel(device.derivative, x, u, p, y, dx)
    assert np.isfinite(dx).all()
    body = f"k = int(1e6 * p[P.gain, i].real)\n        {RATE}\n        dx[1, i] = x[-k, i]"
    device = gf.load_devices(own_file(tmp_path, (RATE, body), name="other.py"))["mine"]
    run_kernel(device.derivative, x, u, p, y, dx)
    assert np.isnan(dx[1, 0])


def test_a_sound_device_is_built_and_rests(tmp_path):
    model = model_with(own_file(tmp_path))
    assert model.residual < 1e-8
    assert model.own_devices.keys() == {"mine"}


@pytest.mark.parametrize("model", sorted(DEVICES))
def test_kernels_of_the_package_keep_to_their_rows_on_guarded_arrays(model):
    device = DEVICES[model]
    parameters = np.random.default_rng(3).uniform(0.2, 1.2, (len(device.parameter_rows), 2))
    assert list(try_kernels(device, parameters)) == []


def test_trials_have_each_limit_reached_and_passed_on_both_sides():
    device = DEVICES["sexs"]
    parameters = np.full((len(device.parameter_rows), 1), 1.0)
    row = device.states.index("exciter_voltage")
    gaps = {round(float((q.x[row] - q.p[4])[0]), 9) for q in trial_points(device, parameters)}
    assert {-1.0, 0.0, 1.0} <= gaps


def test_interpreted_kernels_give_what_compiled_ones_do():
    device = DEVICES["esst4b"]
    random = np.random.default_rng(0)
    x, u, p = (
        random.uniform(0.2, 1.2, (len(names), 1))
        for names in (device.states, device.inputs, device.parameter_rows)
    )
    y, dx = np.zeros((len(device.signal_rows), 1)), np.zeros_like(x)
    for kernel in device.kernels.values():
        plain = interpreted(kernel)
        assert plain is not kernel
        with np.errstate(all="ignore"):
            plain(x, u, p, y, dx)
    z = [np.asarray(rows, dtype=complex) for rows in (x, u, p)]
    outputs = output_stage(device, *z, source_stage(device, z[0], z[2]))
    np.testing.assert_allclose(y, outputs.real, rtol=1e-12)
    np.testing.assert_allclose(
        dx, derivative_stage(device, *z, outputs).real, rtol=1e-12, atol=1e-12
    )


def test_the_guard_of_compiled_kernels_is_for_those_of_others_alone():
    device = DEVICES["sexs"]
    assert device.role is Role.EXCITER
    assert "guarded" not in str(compiled_kernel(device.derivative)._sig)


def test_a_kernel_that_does_not_end_is_told(tmp_path):
    body = "while x[0, i].real < 1e9:\n            pass"
    path = own_file(tmp_path, (RATE, body))
    with pytest.raises(
        gf.DeviceError, match=r"derivative kernel: it does not end within \d+ lines"
    ):
        model_with(path)


def test_an_iteration_that_ends_at_ordinary_points_is_let_be(tmp_path):
    body = f"while x[0, i].real > 10:\n            pass\n        {RATE}"
    assert model_with(own_file(tmp_path, (RATE, body))).residual < 1e-8


def test_what_a_kernel_prints_while_it_is_tried_is_not_shown(tmp_path, capsys):
    device = gf.load_devices(own_file(tmp_path, (RATE, f"print(i)\n        {RATE}")))["mine"]
    parameters = np.full((len(device.parameter_rows), 1), 1.0)
    assert list(try_kernels(device, parameters)) == []
    assert capsys.readouterr().out == ""
