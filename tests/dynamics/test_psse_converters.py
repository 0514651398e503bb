"""The converter REGCA1 with its electrical and plant controls REECA1, REECB1 and REPCA1."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from converter_cases import PLANT, RECORDS, converter_case
from device_alone import Alone, alone_in, jacobian_error, lag, lead_lag, residual

import gridfold as gf
from gridfold.dynamics.converters.tracking import FOLLOW, FREQUENCY
from gridfold.grid.network_state import NetworkState

UNIT = "1:1"
WITH_A = ("regca1", "reeca1", "repca1")
FREQUENCIES = (0.01j, 0.3j, 2j, 9j, 60j, 0.5 + 1j)


def built_with(
    models: tuple[str, ...] = PLANT, base: float = 100.0, **changes: dict[str, float]
) -> gf.DetailedModel:
    return gf.build_model(converter_case(models, base, **changes))


@cache
def start_of(models: tuple[str, ...] = PLANT) -> gf.DetailedModel:
    return built_with(models)


def alone(model: str, **changes: float) -> Alone:
    """A device of a plant; a control without the plant's references stands alone."""
    models = {"regca1": ("regca1",), "repca1": PLANT}.get(model, ("regca1", model))
    built = built_with(models, **{model: changes}) if changes else start_of(models)
    return alone_in(built, model)


EVERY_WAY = [
    {"voltage_code": voltage, "reactive_code": reactive, "power_factor_code": factor}
    for voltage in (0.0, 1.0)
    for reactive in (0.0, 1.0)
    for factor in (0.0, 1.0)
    if not (factor and reactive and not voltage)
]


@pytest.mark.parametrize("control", ["reeca1", "reecb1"])
@pytest.mark.parametrize("codes", EVERY_WAY)
@pytest.mark.parametrize("base", [100.0, 160.0])
def test_start_is_an_equilibrium_for_every_way_of_control(control, codes, base):
    built = built_with(("regca1", control), base, **{control: codes})
    assert residual(built) < 1e-9
    assert not built.warnings
    run = gf.simulate(built, [], 0.5)
    assert run.signal("active_power", [UNIT])[-1, 0] == pytest.approx(0.8, abs=1e-9)


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"reference_code": 0.0},
        {"compensation_code": 1.0, "compensation_reactance": 0.05},
        {"frequency_code": 0.0},
        {"reactive_integral_gain": 0.0},
        {"power_integral_gain": 0.0},
        {"lower_dead_band": -0.02, "upper_dead_band": 0.02},
        {"filter_time": 0.0, "power_time": 0.0, "order_time": 0.0},
        {"lag_time": 0.0, "lead_time": 0.0},
    ],
)
def test_plant_control_starts_in_equilibrium_and_stays_there(changes):
    built = built_with(base=160.0, repca1=changes)
    assert residual(built) < 1e-9
    run = gf.simulate(built, [], 1.0)
    assert np.abs(run.states - run.states[0]).max() < 1e-8


@pytest.mark.parametrize("models", [PLANT, WITH_A, ("regca1",)])
@pytest.mark.parametrize("events", [None, NetworkState(bus_faults=frozenset({(1, 0.5j)}))])
def test_jacobian_equals_central_differences_off_the_equilibrium(models, events):
    built = start_of(models) if events is None else start_of(models).for_state(events)
    x = built.x0 + 0.001 * np.random.default_rng(1).standard_normal(built.n_states)
    assert jacobian_error(built, x) < 1e-5


def test_current_is_given_along_and_across_the_followed_voltage():
    converter = alone("regca1")
    found = converter.signals(converter.x, converter.u)
    current = complex(found["source_real"], found["source_imag"])
    turned = current * np.exp(-1j * found["voltage_angle"])
    assert turned == pytest.approx(found["active_current"] - 1j * found["reactive_current"])
    voltage = complex(converter.u[0, 0], converter.u[1, 0])
    assert voltage * np.conj(current) == pytest.approx(
        complex(found["active_power"], found["reactive_power"])
    )


def test_currents_follow_their_commands_with_the_time_of_the_converter():
    converter = alone("regca1")
    for s in FREQUENCIES:
        for name in ("active", "reactive"):
            gain = converter.gain(f"{name}_current_command", s, f"{name}_current")
            assert gain == pytest.approx(lag(s, 0.02), rel=1e-9)


def test_loop_follows_an_angle_as_a_filter_of_second_order_and_a_frequency_without_error():
    converter = alone("regca1")
    v_r, v_i = converter.u[:2, 0]
    for s in (0.3j, 5j, 60j, 200j):
        by_real, by_imag = (
            converter.gain(f"voltage_{part}", s, "voltage_angle") for part in ("real", "imag")
        )
        followed = -v_i * by_real + v_r * by_imag
        forward = (1 + 1 / (s * FREQUENCY)) / (s * FOLLOW)
        assert followed == pytest.approx(forward / (1 + forward), rel=1e-9)
    # A voltage that turns 1 Hz faster than the frame, as its own states see it.
    x, step, turn = converter.x.copy(), 1e-4, 2 * np.pi
    voltage = complex(v_r, v_i)
    for k in range(6000):
        turned = voltage * np.exp(1j * turn * step * k)
        u = converter.u.copy()
        u[:2, 0] = turned.real, turned.imag
        x = x + step * converter.stages(x, u)[1].real
    found = converter.signals(x, u)
    assert found["measured_frequency"] == pytest.approx(1 + 1 / 60, abs=1e-6)
    ahead = np.exp(1j * found["voltage_angle"]) / turned
    assert np.angle(ahead) == pytest.approx(turn * step, abs=1e-5)


@pytest.mark.parametrize(
    ("voltage", "active", "reactive"),
    [(0.45, 0.0, 0.3), (0.6, 0.25 * 0.488, 0.3), (0.8, 0.75 * 0.8, 0.3), (1.3, 0.8, 0.23)],
)
def test_low_voltage_takes_active_and_high_voltage_reactive_current(voltage, active, reactive):
    """Gain (v - 0.5) / 0.4 and limit 1.22 (v - 0.4) / 0.5 below 0.9; 0.7 (v - 1.2) above 1.2."""
    converter = alone("regca1")
    x = converter.x.copy()
    rows = converter.device.states
    for name, value in (("followed_voltage", voltage), ("filtered_voltage", voltage),
                        ("active_current", 0.8), ("reactive_current", 0.3)):  # fmt: skip
        x[rows.index(name), 0] = value
    found = converter.signals(x, converter.u)
    assert found["given_active_current"] == pytest.approx(active, abs=1e-12)
    assert found["given_reactive_current"] == pytest.approx(reactive, abs=1e-12)


def test_reactive_current_is_not_absorbed_beyond_its_limit():
    converter = alone("regca1", lowest_reactive_current=-0.2)
    x = converter.x.copy()
    x[converter.device.states.index("followed_voltage"), 0] = 2.0
    assert converter.signals(x, converter.u)["given_reactive_current"] == -0.2


def test_active_current_recovers_at_its_rate_and_stays_below_the_limit_of_the_voltage():
    converter = alone("regca1")
    x = converter.x.copy()
    at = converter.device.states.index("active_current")
    x[at, 0] = 0.1
    assert converter.rates(x, converter.u)["active_current"] == 10.0
    low = converter.inputs(
        voltage_real=-0.3 * converter.u[0, 0], voltage_imag=-0.3 * converter.u[1, 0]
    )
    settled = converter.signals(converter.run(low, 0.5)[-1], low)
    size = settled["terminal_voltage"]
    assert settled["active_current"] == pytest.approx(1.22 * (size - 0.4) / 0.5, abs=1e-6)


@pytest.mark.parametrize(("command", "limited"), [(0.9, True), (-0.9, False)])
def test_rate_of_the_reactive_current_is_limited_on_the_side_of_its_start(command, limited):
    converter = alone("regca1", reactive_rise_rate=2.0, reactive_fall_rate=-3.0)
    assert converter.signals(converter.x, converter.u)["reactive_current"] > 0
    u = converter.inputs(reactive_current_command=command)
    rate = converter.rates(converter.x, u)["reactive_current"]
    assert rate == pytest.approx(2.0 if limited else command / 0.02)


@pytest.mark.parametrize("control", ["reeca1", "reecb1"])
def test_reactive_commands_have_the_transfer_functions_of_their_diagram(control):
    constant_q = alone(control, reactive_code=0.0, injection_gain=0.0)
    v = constant_q.u[0, 0]
    q = alone(control, injection_gain=0.0)
    voltage = alone(control, voltage_code=0.0, injection_gain=0.0)
    factor = alone(control, reactive_code=0.0, power_factor_code=1.0, injection_gain=0.0)
    tangent = factor.value("power_factor_tangent")
    for s in FREQUENCIES:
        inner, outer = 3.0 + 20.0 / s, 0.3 + 2.0 / s
        for device, name, expected in (
            (constant_q, "reactive_reference", lag(s, 0.03) / v),
            (q, "reactive_reference", inner * outer),
            (q, "reactive_power", -inner * outer),
            (q, "terminal_voltage", -inner * lag(s, 0.02)),
            (voltage, "reactive_reference", inner),
            (factor, "active_power", tangent * lag(s, 0.05) * lag(s, 0.03) / v),
        ):
            gain = device.gain(name, s, "reactive_current_command")
            assert gain == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("control", ["reeca1", "reecb1"])
def test_active_command_follows_its_reference_and_falls_with_the_voltage(control):
    device = alone(control)
    v, order = device.u[0, 0], device.u[3, 0]
    for s in FREQUENCIES:
        gain = device.gain("active_reference", s, "active_current_command")
        assert gain == pytest.approx(lag(s, 0.04) / v, rel=1e-9)
        gain = device.gain("terminal_voltage", s, "active_current_command")
        assert gain == pytest.approx(-order / v**2 * lag(s, 0.02), rel=1e-9)


@pytest.mark.parametrize("control", ["reeca1", "reecb1"])
@pytest.mark.parametrize("priority", [0.0, 1.0])
def test_both_currents_share_the_highest_current(control, priority):
    device = alone(control, priority_code=priority, reactive_code=0.0, highest_current=1.0)
    v = device.u[0, 0]
    u = device.inputs(reactive_reference=0.9, active_reference=0.15)
    x = device.run(u, 1.0)[-1]
    found = device.signals(x, u)
    active, reactive = found["active_current_command"], found["reactive_current_command"]
    own = (0.44 / v, 0.95 / v)
    if priority:
        assert active == pytest.approx(own[1], abs=1e-6)
        assert reactive == pytest.approx(min(own[0], np.sqrt(1 - active**2)), abs=1e-6)
    else:
        assert reactive == pytest.approx(own[0], abs=1e-6)
        assert active == pytest.approx(min(own[1], np.sqrt(1 - reactive**2)), abs=1e-6)
    assert "highest_reactive_power" in device.limits_at(x, u)


@pytest.mark.parametrize(
    ("changes", "input_name", "push", "limit"),
    [
        ({}, "active_reference", 0.5, "highest_power"),
        ({}, "active_reference", -0.9, "lowest_power"),
        ({"highest_power_rate": 1.0}, "active_reference", 0.2, "highest_power_rate"),
        ({"lowest_power_rate": -1.0}, "active_reference", -0.2, "lowest_power_rate"),
        ({"reactive_code": 0.0}, "reactive_reference", -0.9, "lowest_reactive_power"),
        ({"voltage_code": 0.0}, "reactive_reference", 0.5, "highest_voltage"),
        (
            {"highest_current": 9.0, "reactive_code": 0.0},
            "terminal_voltage",
            -0.9,
            "highest_injection",
        ),
        (
            {"highest_current": 9.0, "reactive_code": 0.0},
            "terminal_voltage",
            0.9,
            "lowest_injection",
        ),
    ],
)
def test_limits_of_reecb1_act(changes, input_name, push, limit):
    device = alone("reecb1", **changes)
    u = device.inputs(**{input_name: push})
    states = device.run(u, 0.3)
    assert limit in device.limits_at(states[20], u) | device.limits_at(states[-1], u)


def test_reecb1_supports_the_voltage_beyond_its_dead_band_at_once():
    device = alone("reecb1", voltage_filter_time=0.0, reactive_code=0.0)
    before = device.signals(device.x, device.u)["reactive_current_command"]
    for drop, expected in ((-0.1, 2.0 * (0.1 - 0.02)), (-0.02, 0.0), (0.05, -2.0 * (0.05 - 0.01))):
        u = device.inputs(terminal_voltage=drop)
        after = device.signals(device.x, u)["reactive_current_command"]
        assert after - before == pytest.approx(expected, abs=1e-9)


def test_integrals_and_power_stand_while_the_voltage_is_off():
    device = alone("reecb1", dip_voltage=0.9)
    u = device.inputs(terminal_voltage=-0.2, active_reference=-0.3, reactive_power=-0.1)
    rates = device.rates(device.x, u)
    assert rates["measured_voltage"] < 0
    for name in ("reactive_integral", "voltage_integral", "reactive_lag", "power_order"):
        assert rates[name] == 0.0
    assert device.signals(device.x, u)["voltage_dip"] == 1.0


@pytest.mark.parametrize(("hold", "expected"), [(0.2, 0.1), (-0.2, None), (0.0, 0.0)])
def test_support_of_reeca1_is_held_after_a_dip(hold, expected):
    device = alone("reeca1", support_hold_time=hold, limit_hold_time=0.0, reactive_code=0.0)
    low = device.inputs(terminal_voltage=-0.4)
    dip = device.run(low, 0.1)[-1]
    own = device.x[device.device.states.index("reactive_lag"), 0]
    v_low, v_ref = low[0, 0], device.value("voltage_reference")
    supported = device.signals(dip, low)["reactive_current_command"]
    assert supported == pytest.approx(own + 2.0 * (v_ref - v_low - 0.02), abs=1e-2)
    after = device.inputs(terminal_voltage=-0.1)
    states = device.run(after, 0.3, x=dip)
    v_after, held = after[0, 0], 0.0 if expected is None else expected
    if expected is None:
        held = 2.0 * (v_ref - v_after - 0.02)
    lagged = states[300][device.device.states.index("reactive_lag"), 0]
    found = device.signals(states[300], after)["reactive_current_command"]
    assert found - lagged == pytest.approx(held, abs=1e-3)
    lagged = states[-1][device.device.states.index("reactive_lag"), 0]
    found = device.signals(states[-1], after)["reactive_current_command"]
    assert found - lagged == pytest.approx(0.0, abs=1e-9)


def test_limit_of_the_active_current_stands_after_a_dip():
    device = alone("reeca1", reactive_code=0.0)
    low = device.inputs(terminal_voltage=-0.62)
    dip = device.run(low, 0.2)[-1]
    v_low = low[0, 0]
    table = 0.5 + (v_low - 0.2) / 0.3 * 0.4
    assert device.signals(dip, low)["active_current_command"] == pytest.approx(table, abs=1e-3)
    states = device.run(device.u, 0.4, x=dip)
    for at, held in ((500, True), (-1, False)):
        active = device.signals(states[at], device.u)["active_current_command"]
        assert active == pytest.approx(table if held else device.u[3, 0] / device.u[0, 0], abs=2e-3)


def test_tables_of_reeca1_limit_each_current_by_the_voltage_and_may_be_absent():
    names = {f"{of}_table_{what}_{k}": 0.0 for of in ("reactive", "active") for k in range(1, 5)
             for what in ("voltage", "current")}  # fmt: skip
    free, tight = (
        alone("reeca1", priority_code=1.0, dip_voltage=-9.0, **more) for more in (names, {})
    )
    for device, expected in ((free, 1.3), (tight, 0.5 + (0.4 - 0.2) / 0.3 * 0.4)):
        u = device.inputs(terminal_voltage=0.4 - device.u[0, 0])
        x = device.run(u, 1.0)[-1]
        assert device.signals(x, u)["active_current_command"] == pytest.approx(
            min(expected, device.u[3, 0] / 0.4), abs=1e-6
        )
    assert "active_table_current_1" in tight.limits_at(x, u)


def test_plant_control_has_the_transfer_functions_of_its_diagram():
    plant = alone("repca1")
    reactive = alone("repca1", reference_code=0.0)
    compensated = alone("repca1", compensation_code=1.0, compensation_reactance=0.05,
                        filter_time=0.0)  # fmt: skip
    v, p, q = compensated.u[:3, 0]
    drop = v - 0.05j * np.conj(complex(p, q)) / v
    along = drop.real / abs(drop)
    for s in FREQUENCIES:
        pi = (2.0 + 5.0 / s) * lead_lag(s, 0.1, 0.5)
        power = (1.0 + 0.5 / s) * lag(s, 0.1)
        for device, name, output, expected in (
            (plant, "terminal_voltage", "reactive_reference", -pi * lag(s, 0.02)),
            (plant, "reactive_power", "reactive_reference", -0.02 * pi * lag(s, 0.02)),
            (reactive, "reactive_power", "reactive_reference", -pi * lag(s, 0.02)),
            (compensated, "reactive_power", "reactive_reference", pi * 0.05 / v * along),
            (plant, "active_power", "active_reference", -power * lag(s, 0.25)),
        ):
            assert device.gain(name, s, output) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize(("slip", "gain"), [(0.01, 20.0), (-0.01, 5.0)])
def test_plant_gives_less_at_high_and_more_at_low_frequency_beyond_its_band(slip, gain):
    plant = alone("repca1", power_integral_gain=0.0, lower_frequency_band=-0.002,
                  upper_frequency_band=0.001, order_time=0.0, highest_power=9.0)  # fmt: skip
    u = plant.inputs(measured_frequency=slip)
    beyond = slip - 0.002 if slip > 0 else slip + 0.001
    change = plant.signals(plant.x, u)["active_reference"] - plant.u[1, 0]
    assert change == pytest.approx(-gain * beyond, abs=1e-9)


@pytest.mark.parametrize(
    ("input_name", "push", "limit"),
    [
        ("terminal_voltage", -0.3, "highest_error"),
        ("terminal_voltage", 0.3, "lowest_reactive_power"),
        ("active_power", -0.9, "highest_power"),
        ("active_power", 0.9, "lowest_power"),
    ],
)
def test_limits_of_the_plant_control_act(input_name, push, limit):
    plant = alone("repca1")
    u = plant.inputs(**{input_name: push})
    states = plant.run(u, 3.0, step=2e-3)
    assert limit in plant.limits_at(states[5], u) | plant.limits_at(states[-1], u)


def test_plant_control_stands_below_its_freeze_voltage():
    plant = alone("repca1")
    u = plant.inputs(terminal_voltage=-0.4)
    assert plant.rates(plant.x, u)["plant_reactive_integral"] == 0.0


def test_without_controls_a_converter_gives_constant_currents():
    built = start_of(("regca1",))
    run = gf.simulate(built, [gf.BusFault(1, duration=0.05)], 1.0)
    currents = run.signal("active_current", [UNIT])
    assert currents[-1, 0] == pytest.approx(currents[0, 0], abs=1e-4)


def test_a_bolted_fault_at_its_own_bus_is_ridden_through():
    run = gf.simulate(start_of(), [gf.BusFault(1, start=0.1, duration=0.15)], 5.0)
    assert np.isfinite(run.states).all()
    power = run.signal("active_power", [UNIT])[:, 0]
    during = (run.times > 0.12) & (run.times < 0.24)
    assert np.abs(power[during]).max() < 1e-12
    assert power[-1] == pytest.approx(0.8, abs=1e-2)


def test_a_converter_can_be_tripped_and_has_no_rotor():
    built = start_of()
    assert built.machines == ()
    run = gf.simulate(built, [gf.MachineTrip(1, "1", time=0.2)], 0.5)
    assert run.signal("active_power", [UNIT])[10, 0] == pytest.approx(0.8, abs=1e-9)
    assert np.isnan(run.signal("active_power", [UNIT])[-1, 0])
    # No current from bus 1: its voltage is that of the infinite bus behind line and reactance.
    grid = run.bus_voltage([1, 2])[-1]
    assert grid[0] == pytest.approx(grid[1], abs=1e-12)


def test_converters_alone_do_not_keep_an_island_alive():
    run = gf.simulate(start_of(), [gf.BranchTrip("1-2", time=0.2)], 0.5)
    assert np.abs(run.bus_voltage([1])[-1, 0]) == 0.0


@pytest.mark.parametrize(
    ("models", "changes", "fault"),
    [
        (("regca1",), {"regca1": {"low_voltage_power_code": 2.0}}, "Lvplsw 2 is neither"),
        (("regca1",), {"regca1": {"no_current_voltage": 0.95}}, "Lvpnt0 is above"),
        (("regca1",), {"regca1": {"reactive_fall_rate": 1.0}}, "Iqrmin is the rate of falling"),
        (("regca1", "reecb1"), {"reecb1": {"voltage_code": 3.0}}, "VFLAG 3 is neither"),
        (("regca1", "reecb1"), {"reecb1": {"upper_dead_band": -0.005}}, "has to hold zero"),
        (
            ("regca1", "reecb1"),
            {"reecb1": {"voltage_proportional_gain": 0.0, "voltage_integral_gain": 0.0}},
            "Kvp and Kvi are both 0",
        ),
        (("regca1", "reeca1"), {"reeca1": {"reactive_table_voltage_3": 0.1}}, "Vq1 to Vq4"),
        (PLANT, {"repca1": {"lag_time": 0.0}}, "Tfv is 0: lead_time Tft"),
        (PLANT, {"repca1": {"frequency_code": 2.0}}, "Fflag 2 is neither"),
    ],
)
def test_impossible_parameters_are_refused_with_their_symbol(models, changes, fault):
    with pytest.raises(gf.CaseError, match=fault):
        built_with(models, **changes)


def test_start_beyond_a_limit_is_named():
    with pytest.raises(
        gf.InitializationError, match=r"highest_power\) is 0.5, the start needs 0.8"
    ):
        built_with(("regca1", "reecb1"), reecb1={"highest_power": 0.5})


def test_records_have_the_length_of_the_psse_data_sheets():
    lengths = {model: len(RECORDS[model]) for model in ("regca1", "reecb1", "reeca1", "repca1")}
    assert lengths == {"regca1": 15, "reecb1": 30, "reeca1": 51, "repca1": 34}


def test_converters_without_a_machine_are_refused_by_name():
    case = converter_case(PLANT)
    alone_there = replace(
        case,
        buses=case.buses[:1],
        branches=(),
        generators=(replace(case.generators[0], control=gf.Control.SLACK),),
        loads=(gf.Load(1, active_mw=80.0),),
        devices=tuple(device for device in case.devices if device.bus == 1),
    )
    with pytest.raises(gf.InitializationError, match="a voltage to follow: 1:1"):
        gf.build_model(alone_there)
