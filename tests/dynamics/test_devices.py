"""What holds for every device model in the registry."""

from __future__ import annotations

import re
import sys

import numpy as np
import pytest

from gridfold.dynamics.device import Role, run_kernel
from gridfold.dynamics.evaluate import derivative_stage, output_stage, source_stage
from gridfold.dynamics.registry import DEVICES

UNITS = 3


@pytest.fixture(params=sorted(DEVICES))
def device(request):
    return DEVICES[request.param]


def some_rows(count: int, seed: int) -> np.ndarray:
    values = np.random.default_rng(seed).uniform(0.2, 1.2, (count, UNITS))
    return np.ascontiguousarray(values, dtype=np.complex128)


def stages(device, x, u, p):
    y = output_stage(device, x, u, p, source_stage(device, x, p))
    return y, derivative_stage(device, x, u, p, y)


def test_every_state_and_every_output_is_written(device):
    x, u, p = (
        some_rows(len(names), seed)
        for seed, names in enumerate((device.states, device.inputs, device.parameter_rows))
    )
    y, dx = np.full((len(device.signal_rows), UNITS), np.nan, complex), None
    empty = np.zeros((0, UNITS), complex)
    run_kernel(device.source, x, empty, p, y, empty)
    run_kernel(device.output, x, u, p, y, empty)
    dx = np.full((len(device.states), UNITS), np.nan, complex)
    run_kernel(device.derivative, x, u, p, y, dx)
    assert np.isfinite(y).all()
    assert np.isfinite(dx).all()


def test_units_do_not_influence_one_another(device):
    x, u, p = (
        some_rows(len(names), seed)
        for seed, names in enumerate((device.states, device.inputs, device.parameter_rows))
    )
    y, dx = stages(device, x, u, p)
    for unit in range(UNITS):
        alone = [np.ascontiguousarray(rows[:, [unit]]) for rows in (x, u, p)]
        y_alone, dx_alone = stages(device, *alone)
        np.testing.assert_array_equal(y_alone[:, 0], y[:, unit])
        np.testing.assert_array_equal(dx_alone[:, 0], dx[:, unit])


def test_kernels_are_plain_python_and_equal_to_their_compiled_form(device):
    x, u, p = (
        some_rows(len(names), seed).real.copy()
        for seed, names in enumerate((device.states, device.inputs, device.parameter_rows))
    )
    compiled_y, compiled_dx = stages(device, *(rows.astype(complex) for rows in (x, u, p)))
    y = np.zeros((len(device.signal_rows), UNITS))
    dx = np.zeros((len(device.states), UNITS))
    for kernel in (device.source, device.output, device.derivative):
        if kernel is not None:
            kernel(x, u, p, y, dx)
    np.testing.assert_allclose(compiled_y.real, y, rtol=1e-13, atol=1e-14)
    np.testing.assert_allclose(compiled_dx.real, dx, rtol=1e-13, atol=1e-14)


def test_start_has_as_many_targets_as_free_quantities(device):
    assert len(device.targets) == len(device.set_points) + len(device.solved_inputs)


def test_only_machines_and_devices_of_loads_have_a_source_and_without_converters_an_admittance(
    device,
):
    is_machine = device.role in (Role.MACHINE, Role.LOAD)
    assert (device.source is not None) == is_machine
    assert (device.admittance is not None) == (
        is_machine and device.model not in ("regca1", "dera1")
    )


@pytest.mark.parametrize(
    "model",
    [m for m, d in DEVICES.items() if d.admittance is not None and d.characteristic is None],
)
def test_admittance_is_the_slope_of_the_stator_current(model):
    device = DEVICES[model]
    x, p = some_rows(len(device.states), 1), some_rows(len(device.parameter_rows), 2)
    names = list(device.inputs)
    admittance = device.admittance(dict(zip(device.parameter_rows, p.real, strict=True)))
    source = source_stage(device, x, p)
    u = some_rows(len(names), 3)
    y = output_stage(device, x, u, p, source)
    voltage = u[names.index("voltage_real")].real + 1j * u[names.index("voltage_imag")].real
    current = (source[0] + 1j * source[1]) - admittance * voltage
    power = voltage * np.conj(current)
    rows = dict(zip(device.signal_rows, y.real, strict=True))
    np.testing.assert_allclose(rows["active_power"], power.real, rtol=1e-12, atol=1e-13)
    np.testing.assert_allclose(rows["reactive_power"], power.imag, rtol=1e-12, atol=1e-13)
    np.testing.assert_allclose(rows["terminal_voltage"], np.abs(voltage), rtol=1e-13)


#: Constants of parameter rows that are not the symbol's letters and digits.
_CONSTANTS = {
    "X'd": "XD1", "X'q": "XQ1", "X''d": "X2", "T'd0": "TD1", "T''d0": "TD2", "T'q0": "TQ1",
    "T''q0": "TQ2", "ZR": "RA", "ZX": "XD1", "dVRMAX": "ADDED", "VEMIN": "EMIN", "EFDMIN": "EMIN",
    "TA/TB": "RATIO", "K/T": "RATIO", "T1/T3": "LEAD_1", "T2/T4": "LEAD_2", "CSWITCH": "SWITCH",
    "RC/RFD": "CROWBAR", "r": "TEMPORARY", "Rperm": "SIGMA", "Rtemp": "DELTA", "M": "CODE",
}  # fmt: skip


def test_constants_of_parameter_rows_are_their_symbols(device):
    """Kernels of the package number their rows, as the parameters of that symbol stand."""
    names = vars(sys.modules[next(iter(device.kernels.values())).__module__])
    for row, parameter in enumerate(device.parameters):
        plain = re.sub(r"\W", "", parameter.symbol).upper()
        name = _CONSTANTS.get(parameter.symbol, plain)
        assert names.get(name, row) == row, f"{name} is row {row}"
    if "BASE_SPEED" in names:
        assert names["BASE_SPEED"] == len(device.parameter_rows) - 1
