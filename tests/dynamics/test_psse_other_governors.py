"""Governors DEGOV, DEGOV1, HYGOVD, IEEEG3, IEESGO and PIDGOV: start, transfer functions, limits."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from device_alone import (
    Alone,
    alone_in,
    jacobian_error,
    lag,
    lead_lag,
    machine_with,
    named,
    residual,
)

import gridfold as gf
from gridfold.dynamics.registry import DEVICES

RECORDS = {
    "degov": (0.1, 0.05, 0.2, 8.0, 0.3, 0.04, 0.06, 0.04, 1.1, 0.0),
    "degov1": (0, 0.1, 0.05, 0.2, 8.0, 0.3, 0.04, 0.06, 0.04, 1.1, 0.0, 0.05, 0.4),
    "hygovd": (
        0.05, 0.4, 6.0, 0.05, 0.3, 0.15, 1.2, 0.0, 1.4, 1.15, 0.5, 0.08, 0.0006, -0.0004, 0.0,
    ),
    "ieeeg3": (0.3, 0.04, 0.2, -0.15, 1.1, 0.0, 0.05, 0.3, 5.0, 1.2, 0.55, 1.05, 1.4, 1.1),
    "ieesgo": (0.2, 0.1, 0.5, 0.12, 5.0, 0.5, 20.0, 0.59, 0.43, 1.1, 0.0),
    "pidgov": (
        0, 0.05, 0.1, 3.0, 0.6, 0.5, 0.05, 0.3, 0.4, 0.1, 0.5, 0.6, 0.8, 0.95, 1.05, 1.0, 0.0, 1.1,
        1.2, 0.2, -0.25,
    ),
}  # fmt: skip
EVERY = pytest.mark.parametrize("model", RECORDS)
FREQUENCIES = (0.05j, 0.3j, 2j, 9j)


def built_with(model: str, base: float = 100.0, **changes: float) -> gf.DetailedModel:
    return gf.build_model(machine_with({model: named(model, RECORDS[model], **changes)}, base))


@cache
def start_of(model: str) -> gf.DetailedModel:
    return built_with(model)


def alone(model: str, **changes: float) -> Alone:
    return alone_in(built_with(model, **changes) if changes else start_of(model), model)


@EVERY
@pytest.mark.parametrize("base", [100.0, 250.0])
def test_start_is_an_equilibrium_at_the_power_of_the_machine(model, base):
    built = built_with(model, base)
    assert residual(built) < 1e-9
    governor = alone_in(built, model)
    assert governor.signals(governor.x, governor.u)["mechanical_power"] == pytest.approx(0.8)


@pytest.mark.parametrize(
    ("model", "changes"),
    [
        ("degov1", {"feedback_code": 1.0}),
        ("pidgov", {"feedback_code": 1.0}),
        ("degov", {"engine_delay": 0.0}),
        ("degov", {"box_time_1": 0.0, "box_lead_time": 0.0}),
    ],
)
def test_every_choice_starts_in_equilibrium(model, changes):
    assert residual(built_with(model, **changes)) < 1e-9


@EVERY
def test_jacobian_equals_central_differences_off_the_equilibrium(model):
    built = start_of(model)
    x = built.x0 + 0.001 * np.random.default_rng(1).standard_normal(built.n_states)
    assert jacobian_error(built, x) < 1e-6


def pade(s: complex, time: float) -> complex:
    """exp(-s T) as the model has it."""
    z = s * time
    return (1 - z / 2 + z * z / 12) / (1 + z / 2 + z * z / 12)


def diesel(s: complex) -> complex:
    """From the error to the throttle."""
    box = (1 + 0.2 * s) / (1 + 0.1 * s + 0.1 * 0.05 * s * s)
    return 8.0 / s * lead_lag(s, 0.3, 0.04) * lag(s, 0.06) * box


def expected_gain(model: str, s: complex, governor: Alone) -> complex:
    """Slip to mechanical power, from the block diagram."""
    at_start = governor.signals(governor.x, governor.u)
    if model in ("degov", "degov1"):
        droop = 0.05 if model == "degov1" else 0.0
        throttle = -diesel(s) / (1 + droop * diesel(s))
        return pade(s, 0.04) * throttle + at_start["mechanical_power"]
    if model == "hygovd":
        return -0.5 * (0.8 / 1.15 + 0.08)  # within the dead band the turbine damps, and no more
    if model == "ieeeg3":
        servo = lag(s, 0.04) / (0.3 * s)
        gate = -servo / (1 + servo * (0.05 + 0.3 * 5.0 * s * lag(s, 5.0)))
        return 1.1 * gate * lead_lag(s, (0.55 - 1.05 * 1.4 / 1.1) * 1.2, 0.55 * 1.2)
    if model == "ieesgo":
        valve = -20.0 * lag(s, 0.2) * lead_lag(s, 0.1, 0.5)
        chest = valve * lag(s, 0.12)
        reheater = 0.59 * chest * lag(s, 5.0)
        return 0.41 * chest + 0.57 * reheater + 0.43 * reheater * lag(s, 0.5)
    regulator = ((3.0 + 0.6 / s) * lag(s, 0.05) + 0.5 * s * lag(s, 0.05)) * lag(s, 0.05)
    gate = -regulator * lag(s, 0.3)
    slope = (0.95 - 0.6) / (0.8 - 0.5)
    inertia = 1.1 * 1.2
    return slope * lead_lag(s, -inertia, inertia / 2) * gate - 0.4


@EVERY
def test_governor_has_the_transfer_function_of_its_diagram(model):
    governor = alone(model)
    for s in FREQUENCIES:
        expected = expected_gain(model, s, governor)
        assert governor.gain("speed", s, "mechanical_power") == pytest.approx(expected, rel=1e-9)


def test_power_feedback_of_pidgov_and_degov1_passes_its_droop():
    governor = alone("pidgov")
    for s in FREQUENCIES:
        by_slip = governor.gain("speed", s, "gate")
        expected = 0.05 * lag(s, 0.1) * by_slip
        assert governor.gain("active_power", s, "gate") == pytest.approx(expected, rel=1e-9)
    governor = alone("degov1", feedback_code=1.0)
    for s in FREQUENCIES:
        expected = -0.05 * lag(s, 0.4) * diesel(s)
        assert governor.gain("active_power", s, "throttle") == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize(
    ("slip", "limit", "value"), [(-0.03, "highest_throttle", 1.1), (0.03, "lowest_throttle", 0.0)]
)
@pytest.mark.parametrize("model", ["degov", "degov1"])
def test_throttle_stops_at_its_limit_and_leaves_it_at_once(model, slip, limit, value):
    governor = alone(model, **({"droop": 0.01} if model == "degov1" else {}))
    row = governor.device.states.index("throttle")
    u = governor.inputs(speed=slip)
    x = governor.run(u, 12.0, step=4e-3)[-1]
    assert limit in governor.limits_at(x, u)
    assert x[row, 0] == pytest.approx(value, abs=1e-2)
    back = governor.run(governor.inputs(speed=-slip), 0.8, x=x, step=4e-3)[-1]
    assert abs(back[row, 0] - value) > 0.05


def test_gate_of_pidgov_moves_no_faster_than_its_velocities_and_stays_in_its_range():
    governor = alone("pidgov")
    row = governor.device.states.index("gate")
    for slip, rate, end in ((-0.1, 0.2, 1.0), (0.1, -0.25, 0.0)):
        u = governor.inputs(speed=slip)
        states = governor.run(u, 12.0, step=4e-3)
        gates = np.array([x[row, 0] for x in states])
        rates = np.diff(gates) / 4e-3
        assert np.abs(rates).max() == pytest.approx(abs(rate), rel=1e-6)
        assert gates[-1] == pytest.approx(end, abs=1e-2)


def test_gate_of_ieeeg3_moves_no_faster_than_its_rates_and_stays_in_its_range():
    governor = alone("ieeeg3")
    row = governor.device.states.index("gate")
    for slip, rate, end in ((-0.2, 0.2, 1.1), (0.2, -0.15, 0.0)):
        u = governor.inputs(speed=slip)
        gates = np.array([x[row, 0] for x in governor.run(u, 12.0, step=4e-3)])
        assert np.abs(np.diff(gates) / 4e-3).max() == pytest.approx(abs(rate), rel=1e-6)
        assert gates[-1] == pytest.approx(end, abs=1e-2)


def hygov_gate(s: complex) -> complex:
    """From the speed that the governor sees to the desired gate."""
    regulator = lag(s, 0.05) * (1 + 6.0 * s) / (0.4 * 6.0 * s)
    return -regulator / (1 + 0.05 * regulator)


@pytest.mark.parametrize(("slip", "edge"), [(0.002, 0.0006), (-0.002, -0.0004)])
@pytest.mark.parametrize("below", [-0.0004, 0.0004])
def test_hygovd_acts_on_the_speed_beyond_its_dead_band_whatever_the_sign_of_dbl(slip, edge, below):
    governor = alone("hygovd", dead_band_below=below)
    u = governor.inputs(speed=slip)
    assert governor.rates(governor.x, u)["speed_filter"] == pytest.approx((edge - slip) / 0.05)
    within = governor.inputs(speed=0.9 * edge)
    assert max(map(abs, governor.rates(governor.x, within).values())) < 1e-9
    beyond = Alone(governor.device, governor.x, u, governor.p)
    for s in FREQUENCIES:
        assert beyond.gain("speed", s, "desired_gate") == pytest.approx(hygov_gate(s), rel=1e-9)


def test_gate_of_hygovd_is_in_per_unit_of_the_rating_of_the_turbine():
    gates = [
        alone("hygovd", turbine_rating=rating).x[1, 0] - 0.08 for rating in (0.0, 100.0, 160.0)
    ]
    assert gates[0] == pytest.approx(gates[1], rel=1e-12)
    assert gates[2] == pytest.approx(gates[0] / 1.6, rel=1e-12)


def test_water_first_turns_the_power_of_pidgov_the_wrong_way():
    governor = alone("pidgov", turbine_damping=0.0)
    u = governor.inputs(speed=-0.01)
    powers = [governor.signals(x, u)["mechanical_power"] for x in governor.run(u, 6.0, step=4e-3)]
    assert min(powers) < powers[0] - 1e-3
    assert powers[-1] > powers[0]


@pytest.mark.parametrize(("slip", "end"), [(-0.06, 1.1), (0.06, 0.0)])
def test_valve_of_ieesgo_stays_in_its_range(slip, end):
    governor = alone("ieesgo")
    u = governor.inputs(speed=slip)
    x = governor.run(u, 60.0, step=2e-2)[-1]
    assert governor.signals(x, u)["mechanical_power"] == pytest.approx(end, abs=1e-3)
    assert len(governor.limits_at(x, u)) == 1


@pytest.mark.parametrize(
    ("model", "zero"),
    [
        ("degov", {"box_time_2": 0.0}),
        ("degov", {"actuator_time_1": 0.0}),
        ("degov", {"actuator_time_2": 0.0}),
        ("ieeeg3", {"pilot_time": 0.0}),
        ("ieeeg3", {"water_time": 0.0}),
        ("ieesgo", {"governor_lag_time": 0.0}),
        ("ieesgo", {"valve_time": 0.0}),
        ("ieesgo", {"chest_time": 0.0}),
        ("pidgov", {"droop_time": 0.0}),
        ("pidgov", {"control_time": 0.0, "derivative_gain": 0.0}),
    ],
)
def test_time_constants_of_zero_act_as_very_small_ones(model, zero):
    without = alone(model, **zero)
    small = Alone(without.device, without.x, without.u, without.p.copy())
    name = next(iter(zero))
    small.p[without.device.parameter_rows.index(name)] = 1e-7
    for s in FREQUENCIES:
        expected = small.gain("speed", s, "mechanical_power")
        assert without.gain("speed", s, "mechanical_power") == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize(
    ("model", "changes", "fault"),
    [
        ("degov", {"box_time_1": 0.0}, "T1 is 0: box_lead_time T3"),
        ("degov", {"actuator_time_1": 0.0, "actuator_time_2": 0.0}, "T4 has to be 0"),
        ("degov", {"lowest_throttle": 2.0}, "TMIN is above"),
        ("degov1", {"feedback_code": 2.0}, "M 2 is neither"),
        ("hygovd", {"lowest_gate": 2.0}, "GMIN is above"),
        ("ieeeg3", {"closing_rate": 0.1}, "UC is positive"),
        ("ieeeg3", {"flow_by_head": 0.0}, "a11 is 0"),
        ("ieesgo", {"governor_lag_time": 0.0, "valve_time": 0.0}, "T2 has to be 0"),
        ("pidgov", {"gate_1": 0.05}, "does not rise"),
        ("pidgov", {"droop": 0.0}, "Rperm is 0"),
        ("pidgov", {"closing_rate": 0.1}, "Velmin is positive"),
    ],
)
def test_records_that_make_no_sense_are_refused(model, changes, fault):
    with pytest.raises(gf.CaseError, match=fault):
        built_with(model, **changes)


def test_records_have_the_length_of_the_psse_data_sheets():
    lengths = {model: len(DEVICES[model].psse_record) for model in RECORDS}
    assert lengths == {
        "degov": 10,
        "degov1": 13,
        "hygovd": 15,
        "ieeeg3": 14,
        "ieesgo": 11,
        "pidgov": 21,
    }
