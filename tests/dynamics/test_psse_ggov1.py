"""The general governor GGOV1: start, its controllers one by one, their change-over."""

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
from gridfold.dynamics.governors.ggov1 import TAU
from gridfold.dynamics.registry import DEVICES

#: Of the public case ACTIVSg2000, with a rating of the turbine of 100 MW.
RECORD = (
    1, 1, 0.04, 1, 0.05, -0.05, 10, 2, 0, 1, 1, 0.15, 0.1289, 1.3041, 0.2, 0.5, 0, 0, 3, 1, 1, 1,
    0, 0.1, -0.1, 0, 0.01, 10, 0.1, 100, 0, 4, 5, 99, -99,
)  # fmt: skip
FREE = {"highest_error": 9.0, "lowest_error": -9.0, "opening_rate": 99.0, "closing_rate": -99.0,
        "acceleration_gain": 0.0}  # fmt: skip
FREQUENCIES = (0.01j, 0.3j, 2j, 9j, 40j)


def built_with(base: float = 100.0, **changes: float) -> gf.DetailedModel:
    return gf.build_model(machine_with({"ggov1": named("ggov1", RECORD, **changes)}, base))


@cache
def start_of() -> gf.DetailedModel:
    return built_with()


def alone(**changes: float) -> Alone:
    return alone_in(built_with(**changes) if changes else start_of(), "ggov1")


def power(governor: Alone, x: np.ndarray, u: np.ndarray) -> float:
    return governor.signals(x, u)["mechanical_power"]


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"feedback_code": 0.0, "droop": 0.0},
        {"feedback_code": -1.0},
        {"feedback_code": -2.0},
        {"supervisory_gain": 0.02},
        {"dead_band": 0.001},
        {"proportional_gain": 0.0},
        {"load_gain": 0.0, "load_integral_gain": 0.0},
        {"engine_delay": 0.4, "turbine_damping": 0.5},
        {"turbine_damping": -1.0, "temperature_time": 0.0},
        {"turbine_rating": 0.0},
        {"turbine_rating": 130.0},
    ],
)
def test_start_is_an_equilibrium_that_stays(changes):
    built = built_with(250.0, **changes)
    assert residual(built) < 1e-9
    run = gf.simulate(built, [], t_end=1.0)
    assert np.abs(run.signal("speed") - 1).max() < 1e-9


def test_power_is_in_per_unit_of_the_rating_of_the_turbine_or_of_the_machine():
    fuels = []
    for rating, base in ((0.0, 100.0), (130.0, 130.0), (0.0, 250.0)):
        governor = alone_in(
            built_with(250.0 if base == 250.0 else 100.0, turbine_rating=rating), "ggov1"
        )
        total = power(governor, governor.x, governor.u) * 100.0
        fuel = governor.signals(governor.x, governor.u)["requested_fuel"]
        assert 1.3041 * (fuel - 0.2) * base == pytest.approx(total, rel=1e-9)
        fuels.append(fuel)
    assert len(set(fuels)) == 3


@pytest.mark.parametrize("change", [{}, {"engine_delay": 0.3, "governor_derivative_gain": 0.5}])
def test_jacobian_equals_central_differences_off_the_equilibrium(change):
    built = built_with(**change) if change else start_of()
    x = built.x0 + 1e-4 * np.random.default_rng(1).standard_normal(built.n_states)
    assert jacobian_error(built, x) < 1e-5


def turbine(s: complex, stroke: float) -> complex:
    """Fuel asked for to power, then slip to power at a constant stroke."""
    delay = np.exp(-0.05 * s)
    return 1.3041 * delay * lead_lag(s, 0.1, 0.5) * np.array([lag(s, 0.1289), stroke])


def test_governor_in_charge_has_the_transfer_function_of_its_diagram():
    changes = {"turbine_lead_time": 0.1, "engine_delay": 0.05, "governor_derivative_gain": 0.3}
    governor = alone(**FREE, **changes)
    stroke = governor.x[7, 0]
    for s in FREQUENCIES[:4]:
        pid = 10 + 2 / s + s * 0.3 * lag(s, 1.0)
        by_fuel, by_slip = turbine(s, stroke)
        expected = -pid * by_fuel + by_slip
        assert governor.gain("speed", s, "mechanical_power") == pytest.approx(expected, rel=1e-3)
        expected = -pid * by_fuel * 0.04 * lag(s, 1.0)
        assert governor.gain("active_power", s, "mechanical_power") == pytest.approx(
            expected, rel=1e-3
        )


@pytest.mark.parametrize("code", [0, -1, -2])
def test_droop_follows_the_signal_that_is_chosen(code):
    """With the feedback of a stroke a lasting slip changes the fuel by slip over droop."""
    governor = alone(**FREE, feedback_code=float(code), flow_code=0.0)
    gain = governor.gain("speed", 1e-6j, "requested_fuel")
    if code == 0:
        assert abs(gain) > 1e5
    else:
        assert gain == pytest.approx(-1 / 0.04, rel=1e-3)


def test_dead_band_hides_a_small_slip():
    governor = alone(**FREE, dead_band=0.002, flow_code=0.0)
    for slip, error in ((0.0015, 0.0), (0.005, -0.003)):
        u = governor.inputs(speed=slip)
        fuel = governor.signals(governor.x, u)["requested_fuel"]
        assert fuel - governor.x[2, 0] == pytest.approx(10 * error, abs=1e-9)


def test_load_limit_takes_over_and_holds_the_power_at_its_reference():
    governor = alone(**FREE, load_limit=0.85, flow_code=0.0)
    u = governor.inputs(speed=-0.02)
    states = governor.run(u, 60.0, step=5e-3)
    assert "load_limit" in governor.limits_at(states[-1], u)
    assert power(governor, states[-1], u) == pytest.approx(0.85, abs=1e-3)
    # The governor's integral follows the fuel in the meantime, so that it does not wind up.
    assert states[-1][2, 0] < 1.0
    back = governor.inputs(speed=0.001)
    after = governor.run(back, 3.0, x=states[-1], step=5e-3)[-1]
    assert power(governor, after, back) < 0.84


def test_acceleration_limit_raises_the_fuel_no_faster_than_its_gain_allows():
    """Ka (aset - a) = 10 * 0.01 per second while the speed is constant."""
    governor = alone(highest_error=9.0, opening_rate=99.0, flow_code=0.0, load_limit=9.0)
    u = governor.inputs(speed=-0.03)
    x = governor.x.copy()
    x[governor.device.states.index("acceleration_filter")] = -0.03
    states = governor.run(u, 1.5, x=x, step=2e-3)[250::250]
    fuels = [governor.signals(state, u)["requested_fuel"] for state in states]
    assert np.diff(fuels) / 0.5 == pytest.approx(0.1, rel=1e-2)
    assert TAU * 0.1 < 0.005


def test_valve_moves_no_faster_than_its_rates_and_stays_in_its_range():
    governor = alone(**(FREE | {"opening_rate": 0.1, "closing_rate": -0.2}), load_limit=9.0)
    for slip, rate in ((-0.1, 0.1), (0.1, -0.2)):
        u = governor.inputs(speed=slip)
        assert governor.rates(governor.x, u)["valve_stroke"] == pytest.approx(rate)
    up = governor.inputs(speed=-0.1)
    x = governor.run(up, 6.0, step=4e-3)[-1]
    assert x[7, 0] == pytest.approx(1.0, abs=1e-3)
    assert "highest_valve" in governor.limits_at(x, up)


def test_supervisory_control_brings_the_power_back_to_its_set_point():
    governor = alone(**FREE, supervisory_gain=0.01)
    u = governor.inputs(active_power=0.02)
    rate = governor.rates(governor.x, u)
    assert rate["supervisory_power"] == pytest.approx(0.0)
    states = governor.run(u, 5.0, step=5e-3)
    assert states[-1][5, 0] == pytest.approx(-0.01 * 0.02 * (5.0 - 1.0), rel=1e-2)


@pytest.mark.parametrize(
    ("changes", "fault"),
    [
        ({"feedback_code": 2.0}, "Rselect 2 is none"),
        ({"flow_code": 3.0}, "Flag 3 is neither"),
        ({"closing_rate": 0.1}, "Rclose is the rate"),
        ({"acceleration_time": 0.0}, "Ta is 0: acceleration_gain Ka"),
        ({"load_integral_gain": 0.0}, "both or neither"),
        ({"governor_integral_gain": 0.0}, "Kigov is 0"),
        ({"lowest_valve": 2.0}, "Vmin is above"),
    ],
)
def test_records_that_make_no_sense_are_refused(changes, fault):
    with pytest.raises(gf.CaseError, match=fault):
        built_with(**changes)


def test_start_beyond_the_load_limit_names_it():
    with pytest.raises(gf.InitializationError, match="Ldref"):
        built_with(load_limit=0.6)


def test_record_has_33_numbers_behind_its_two_codes():
    assert len(DEVICES["ggov1"].psse_record) == 35
