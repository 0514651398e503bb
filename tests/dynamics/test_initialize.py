from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from cases import one_machine_infinite_bus

import gridfold as gf
from gridfold.dynamics.model import RESIDUAL_GOOD, RESIDUAL_LIMIT


def without(case: gf.Case, *models: str) -> gf.Case:
    return replace(case, devices=tuple(d for d in case.devices if d.model not in models))


def test_equilibrium_of_npcc_has_a_residual_below_1e_8(npcc):
    assert np.abs(npcc.compiled(npcc.x0)).max() < 1e-8
    assert npcc.warnings == ()


def test_machines_start_at_the_powers_and_voltages_of_the_power_flow(npcc):
    signals = npcc.signals(npcc.x0[None, :])[0]
    flow = npcc.power_flow
    for unit, power in zip(npcc.case.generators, flow.unit_power, strict=True):
        if unit.key not in npcc.machines:
            continue
        active, reactive, voltage = (
            signals[npcc.slots(name, (unit.key,))][0]
            for name in ("active_power", "reactive_power", "terminal_voltage")
        )
        assert active == pytest.approx(power.real, abs=1e-9)
        assert reactive == pytest.approx(power.imag, abs=1e-9)
        expected = abs(flow.voltage[npcc.case.bus_index[unit.bus]])
        assert voltage == pytest.approx(expected, abs=1e-10)


def test_network_gives_the_power_flow_voltages_at_every_bus(npcc):
    voltages = npcc.bus_voltages(npcc.x0[None, :])[0]
    np.testing.assert_allclose(voltages, npcc.power_flow.voltage, rtol=0, atol=1e-10)


def test_without_controllers_field_voltage_and_power_are_constants_of_the_start(npcc):
    case = without(npcc.case, "ieee_type1", "first_order_governor", "non_reheat_turbine")
    model = gf.build_model(case)
    assert model.n_states == 4 * 48
    assert np.abs(model.compiled(model.x0)).max() < 1e-8
    signals, expected = (m.signals(m.x0[None, :])[0] for m in (model, npcc))
    for name in ("field_voltage", "mechanical_power"):
        np.testing.assert_allclose(
            signals[model.slots(name, model.machines)],
            expected[npcc.slots(name, npcc.machines)],
            atol=1e-9,
        )


def test_a_governor_whose_power_nothing_asks_for_is_an_error_that_names_it(npcc):
    with pytest.raises(gf.InitializationError, match=r"first_order_governor 21:1.*governor_power"):
        gf.build_model(without(npcc.case, "non_reheat_turbine"))


def test_parameters_on_another_machine_base_give_the_same_machine():
    same, other = (gf.build_model(one_machine_infinite_bus(2.0, base)) for base in (100.0, 250.0))
    x = same.x0 + np.array([0.3, 0.01])
    np.testing.assert_allclose(other.x0, same.x0, rtol=1e-12)
    np.testing.assert_allclose(other.compiled(x), same.compiled(x), rtol=1e-12)


def test_a_machine_that_cannot_give_its_power_is_an_error_that_names_device_and_equation():
    # The operating point of another case: the machine's field cannot be found at zero voltage.
    case = one_machine_infinite_bus()
    flow = gf.solve_power_flow(case)
    broken = replace(flow, voltage=np.array([0.0, 1.0], dtype=complex))
    with (
        np.errstate(all="ignore"),
        pytest.raises(gf.InitializationError, match=r"classical 1:1.*(target|d )"),
    ):
        gf.build_model(case, broken)


@pytest.mark.parametrize(
    ("error", "outcome"), [(1e-10, "silent"), (1e-7, "warning"), (1e-5, "refused")]
)
def test_residual_of_the_equilibrium_is_accepted_warned_of_or_refused(error, outcome):
    """A power flow that is off by `error` leaves the machine out of balance by about as much."""
    case = one_machine_infinite_bus()
    flow = gf.solve_power_flow(case)
    scale = error * 2 * 3.0
    tampered = replace(flow, voltage=flow.voltage * np.array([1.0, 1 + 1j * scale / 0.83]))
    assert RESIDUAL_GOOD == 1e-8
    assert RESIDUAL_LIMIT == 1e-6
    if outcome == "refused":
        with pytest.raises(gf.InitializationError, match=r"d\(speed:1:1\)/dt"):
            gf.build_model(case, tampered)
    else:
        warnings = gf.build_model(case, tampered).warnings
        assert len(warnings) == (outcome == "warning")
        assert all("speed:1:1" in text for text in warnings)
