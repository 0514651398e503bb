"""Wind turbines behind a converter: WTDTA1, WTTQA1, WTPTA1 and WTARA1 with REECA1 and REPCA1."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from converter_cases import RECORDS, TURBINE, converter_case
from device_alone import Alone, alone_in, jacobian_error, lag, residual

import gridfold as gf

UNIT = "1:1"
FREQUENCIES = (0.01j, 0.3j, 2j, 9j, 60j, 0.5 + 1j)
SPEED = 0.98 + (0.8 - 0.6) / (0.9 - 0.6) * (1.2 - 0.98)
MODELS = ("wtdta1", "wttqa1", "wtpta1", "wtara1")


def built_with(base: float = 100.0, **changes: dict[str, float]) -> gf.DetailedModel:
    return gf.build_model(converter_case(TURBINE, base, **changes))


@cache
def start_of() -> gf.DetailedModel:
    return built_with()


def alone(model: str, **changes: float) -> Alone:
    return alone_in(built_with(**{model: changes}) if changes else start_of(), model)


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"wttqa1": {"torque_code": 1.0}},
        {"reeca1": {"speed_code": 1.0}},
        {"reeca1": {"speed_code": 1.0}, "wttqa1": {"torque_code": 1.0}},
        {"wtdta1": {"turbine_share": 0.0}},
        {"wtdta1": {"shaft_frequency": 0.0}},
        {"wtara1": {"starting_pitch": 0.0}},
        {"wtpta1": {"speed_integral_gain": 0.0, "lowest_pitch": -5.0}},
    ],
)
def test_start_is_an_equilibrium_that_stays(changes):
    built = built_with(130.0, **changes)
    assert residual(built) < 1e-9
    run = gf.simulate(built, [], 1.0)
    assert np.abs(run.states - run.states[0]).max() < 1e-8


def test_start_has_the_speed_of_its_power_on_the_rating_of_the_turbine():
    for rating, power in ((0.0, 0.8), (125.0, 0.64)):
        found = alone("wttqa1", turbine_rating=rating)
        speed = 0.98 + (power - 0.6) / 0.3 * 0.22
        values = found.signals(found.x, found.u)
        assert values["reference_speed"] == pytest.approx(speed)
        assert values["torque_integral"] == pytest.approx(power / speed)
        assert values["active_reference"] == pytest.approx(0.8)


def test_jacobian_equals_central_differences_off_the_equilibrium():
    x = start_of().x0 + 1e-4 * np.random.default_rng(1).standard_normal(start_of().n_states)
    assert jacobian_error(start_of(), x) < 1e-5


def test_a_speed_reference_passes_through_the_torque_control():
    """The plant's power goes to the torque control, and what that gives to the electrical control."""
    slots = start_of().layout.signal_slots
    block = {b.device.model: b for b in start_of().layout.blocks}
    unit = gf.UnitKey(1, "1")
    rows = {model: block[model].device.inputs for model in ("wttqa1", "reeca1")}
    plant = block["wttqa1"].inputs[rows["wttqa1"].index("active_reference_before"), 0]
    torque = block["reeca1"].inputs[rows["reeca1"].index("active_reference"), 0]
    assert plant == block["repca1"].signal_index[0, 0] == slots[unit, "active_reference_before"]
    assert torque == block["wttqa1"].signal_index[0, 0] == slots[unit, "active_reference"]


def test_torque_control_has_the_transfer_functions_of_its_diagram():
    by_speed, by_power = alone("wttqa1"), alone("wttqa1", torque_code=1.0)
    slope = (1.2 - 0.98) / (0.9 - 0.6)
    for s in FREQUENCIES:
        pi = 3.0 + 0.6 / s
        for device, name, expected in (
            (by_speed, "generator_speed", SPEED * pi + 0.8 / SPEED),
            (by_speed, "active_power", -SPEED * pi * slope * lag(s, 0.05) * lag(s, 30.0)),
            (by_power, "active_reference_before", pi),
            (by_power, "active_power", -pi),
        ):
            assert device.gain(name, s, "active_reference") == pytest.approx(expected, rel=1e-9)


def test_drive_train_swings_at_its_frequency_and_turns_as_one_mass_below_it():
    train = alone("wtdta1", damping=0.0, shaft_damping=0.0)
    h_t, h_g = 2 * 5.0 * 0.9, 2 * 5.0 * 0.1
    stiff = (2 * np.pi * 1.8) ** 2 * h_t * h_g / (h_t + h_g)
    torque = 0.8 / SPEED**2
    for s in FREQUENCIES:
        # Linearized: h_t s wt = -torque wt - T, h_g s wg = T + torque wg - P / w0, T = K (wt - wg) / s.
        matrix = np.array([[h_t * s + torque + stiff / s, -stiff / s],
                           [-stiff / s, h_g * s - torque + stiff / s]])  # fmt: skip
        expected = np.linalg.solve(matrix, [0.0, -1.0 / SPEED])
        for name, value in zip(("turbine_speed", "generator_speed"), expected, strict=True):
            assert train.gain("active_power", s, name) == pytest.approx(value, rel=1e-9)
    single = alone("wtdta1", damping=0.5, turbine_share=0.0)
    for s in FREQUENCIES:
        expected = -1 / SPEED / (10.0 * s + 0.5)
        assert single.gain("active_power", s, "generator_speed") == pytest.approx(
            expected, rel=1e-9
        )


def test_pitch_control_has_the_transfer_functions_of_its_diagram():
    pitch = alone("wtpta1", lowest_pitch=-5.0)
    for s in FREQUENCIES:
        by_speed, by_power = 150.0 + 5.0 / s, 3.0 + 30.0 / s
        for name, expected in (
            ("turbine_speed", by_speed),
            ("reference_speed", -by_speed),
            ("power_order", 0.1 * by_speed + by_power),
        ):
            gain = pitch.gain(name, s, "pitch_angle")
            assert gain == pytest.approx(expected * lag(s, 0.3), rel=1e-9)


def test_aerodynamic_power_falls_with_the_pitch_beyond_its_start():
    wind = alone("wtara1")
    found = [wind.signals(wind.x, wind.inputs(pitch_angle=more)) for more in (0.0, 2.0)]
    fall = found[0]["aerodynamic_power"] - found[1]["aerodynamic_power"]
    assert fall == pytest.approx(0.007 * 5.0 * 2.0)


@pytest.mark.parametrize(
    ("model", "input_name", "push", "limit"),
    [
        ("wttqa1", "generator_speed", 0.3, "highest_torque"),
        ("wttqa1", "generator_speed", -0.3, "lowest_torque"),
        ("wtpta1", "turbine_speed", 0.3, "highest_pitch"),
        ("wtpta1", "turbine_speed", -0.3, "lowest_pitch"),
        ("wtpta1", "turbine_speed", 0.1, "highest_pitch_rate"),
        ("wtpta1", "turbine_speed", -0.1, "lowest_pitch_rate"),
    ],
)
def test_limits_act(model, input_name, push, limit):
    deep = {"lowest_pitch": -50.0} if limit == "lowest_pitch_rate" else {}
    device = alone(model, **deep)
    u = device.inputs(**{input_name: push})
    states = device.run(u, 5.0, step=2e-3)
    assert limit in device.limits_at(states[2], u) | device.limits_at(states[-1], u)


def test_torque_stands_while_the_electrical_control_sees_a_dip():
    torque = alone("wttqa1")
    u = torque.inputs(voltage_dip=1.0, generator_speed=0.05)
    assert torque.rates(torque.x, u)["torque_integral"] == 0.0


def test_a_fault_speeds_the_turbine_up_and_its_pitch_brings_it_back():
    run = gf.simulate(start_of(), [gf.BusFault(1, start=0.1, duration=0.15)], 20.0)
    speed = run.signal("generator_speed", [UNIT])[:, 0]
    assert speed.max() > SPEED + 0.01
    assert speed[-1] == pytest.approx(SPEED, abs=5e-3)
    assert run.signal("active_power", [UNIT])[-1, 0] == pytest.approx(0.8, abs=1e-2)


@pytest.mark.parametrize(
    ("model", "changes", "fault"),
    [
        ("wttqa1", {"torque_code": 2.0}, "Tflag 2 is neither"),
        ("wttqa1", {"integral_gain": 0.0}, "nothing decides the torque"),
        ("wttqa1", {"power_3": 0.3}, "p1 to p4 do not rise"),
        ("wttqa1", {"lowest_torque": 2.0}, "Temin is above"),
        ("wtdta1", {"turbine_share": 1.0}, "Htfrac is 1, not below 1"),
        ("wtpta1", {"lowest_pitch_rate": 1.0}, "RTetamin is the rate of falling"),
    ],
)
def test_impossible_parameters_are_refused_with_their_symbol(model, changes, fault):
    with pytest.raises(gf.CaseError, match=fault):
        built_with(**{model: changes})


def test_records_have_the_length_of_the_psse_data_sheets():
    lengths = {model: len(RECORDS[model]) for model in MODELS}
    assert lengths == {"wtdta1": 5, "wttqa1": 16, "wtpta1": 10, "wtara1": 2}
