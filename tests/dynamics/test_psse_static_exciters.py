"""Static and simple exciters: ESST1A, ESST4B, ST6B, EXPIC1, SCRX, EXAC4, DC4B, IEEET2, IEEET3."""

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
    saturation_slope,
)

import gridfold as gf
from gridfold.dynamics.registry import DEVICES

RECORDS = {
    "esst1a": (
        1, 1, 0.02, 0.2, -0.15, 0.4, 1.5, 0.1, 0.05, 60.0, 0.03, 14.0, -14.0, 6.0, -4.0, 0.1,
        0.02, 0.8, 4.5, 4.4,
    ),
    "esst4b": (
        0.02, 3.5, 3.0, 1.0, -0.87, 0.03, 1.2, 0.4, 1.0, -0.87, 0.1, 6.0, 0.5, 9.0, 0.1, 0.05, 10.0,
    ),
    "st6b": (
        1, 0.02, 18.0, 45.0, 0.5, 0.05, 4.8, -3.9, 1.0, 1.0, 1.06, 17.3, 4.2, 4.8, -3.8, 1.0, 0.02,
    ),
    "expic1": (
        0.02, 3.0, 1.0, 1.0, -0.87, 0.03, 0.02, 0.05, 0.99, -0.8, 0.02, 0.6, 0.1, 7.4, -2.0, 1.0,
        0.4, 1.5, 0.05, 3.5, 0.4, 5.4, 0.5, 0.08,
    ),
    "scrx": (0.1, 5.0, 60.0, 0.08, -2.0, 5.0, 0, 0.0),
    "ieeet2": (0.02, 40.0, 0.05, 6.0, -5.0, 0.1, 0.5, 0.06, 0.9, 0.4, 1.5, 0.05, 3.5, 0.4),
    "ieeet3": (0.02, 40.0, 0.05, 3.0, -3.0, 0.5, 0.03, 0.8, 3.0, 1.0, 7.0, 1.0),
    "exac4": (0.02, 0.2, -0.15, 0.4, 1.5, 60.0, 0.03, 6.0, -4.0, 0.1),
    "dc4b": (
        1, 1, 0.02, 20.0, 10.0, 2.0, 0.05, 6.0, -5.0, 1.5, 0.03, 0.4, 0.5, 0.03, 0.9, 0.0, 1.5,
        0.05, 3.5, 0.4,
    ),
}  # fmt: skip
EVERY = pytest.mark.parametrize("model", RECORDS)
FREQUENCIES = (0.01j, 0.3j, 2j, 9j, 60j, 0.5 + 1j)


def built_with(model: str, base: float = 100.0, **changes: float) -> gf.DetailedModel:
    return gf.build_model(machine_with({model: named(model, RECORDS[model], **changes)}, base))


@cache
def start_of(model: str) -> gf.DetailedModel:
    return built_with(model)


def alone(model: str, **changes: float) -> Alone:
    return alone_in(built_with(model, **changes) if changes else start_of(model), model)


@EVERY
@pytest.mark.parametrize("base", [100.0, 250.0])
def test_start_is_an_equilibrium_with_the_same_field_voltage_on_any_base(model, base):
    built = built_with(model, base)
    assert residual(built) < 1e-9
    one, other = (alone_in(b, model) for b in (built, start_of(model)))
    field = [e.signals(e.x, e.u)["field_voltage"] for e in (one, other)]
    assert field[0] == pytest.approx(field[1], abs=1e-9)


@EVERY
def test_jacobian_equals_central_differences_off_the_equilibrium(model):
    built = start_of(model)
    x = built.x0 + 0.003 * np.random.default_rng(1).standard_normal(built.n_states)
    assert jacobian_error(built, x) < 1e-6


def expected_gain(model: str, s: complex, exciter: Alone) -> complex:
    """Stabilizer signal to field voltage, from the block diagram."""
    p = named(model, RECORDS[model])
    u = dict(zip(exciter.device.inputs, exciter.u[:, 0], strict=True))
    at_start = exciter.signals(exciter.x, exciter.u)
    if model == "scrx":
        return u["terminal_voltage"] * 60.0 * lead_lag(s, 0.5, 5.0) * lag(s, 0.08)
    if model == "esst1a":
        forward = 60.0 * lag(s, 0.03) * lead_lag(s, 0.4, 1.5) * lead_lag(s, 0.1, 0.05)
        return forward / (1 + forward * s * 0.02 * lag(s, 0.8))
    if model == "esst4b":
        inner, v_b = 1.2 + 0.4 / s, at_start["source_voltage"]
        return (3.5 + 3.0 / s) * lag(s, 0.03) * inner * v_b / (1 + inner * v_b * 0.1)
    if model == "st6b":
        regulator = 18.0 + 45.0 / s + s * 0.5 * lag(s, 0.05)
        v_t = u["terminal_voltage"]
        return v_t * 2.0 * regulator / (1 + v_t * lag(s, 0.02))
    if model == "expic1":
        forward = 3.0 * (1 + s * 1.0) / s * lead_lag(s, 0.02, 0.05) * lag(s, 0.03)
        regulated = forward / (1 + forward * s * 0.02 * lag(s, 0.6) * lag(s, 0.1))
        v_b = at_start["exciter_input"] / at_start["regulated_voltage"]
        return regulated * v_b / (s * 0.4 + 1.0 + saturation_slope(p, at_start["field_voltage"]))
    if model == "exac4":
        return 60.0 * lag(s, 0.03) * lead_lag(s, 0.4, 1.5)
    if model == "dc4b":
        regulator = 20.0 + 10.0 / s + s * 2.0 * lag(s, 0.05)
        slope = saturation_slope(p, at_start["field_voltage"])
        forward = 1.5 * u["terminal_voltage"] * lag(s, 0.03) * regulator / (s * 0.5 + 0.4 + slope)
        return forward / (1 + forward * s * 0.03 * lag(s, 0.9))
    forward = 40.0 * lag(s, 0.05)
    if model == "ieeet2":
        regulated = forward / (1 + forward * s * 0.06 * lag(s, 0.9) * lag(s, 0.4))
        return regulated / (s * 0.5 + 0.1 + saturation_slope(p, at_start["field_voltage"]))
    forward /= 1.0 + s * 0.5
    return forward / (1 + forward * s * 0.03 * lag(s, 0.8))


@EVERY
def test_exciter_has_the_transfer_function_of_its_diagram(model):
    exciter = alone(model)
    for s in FREQUENCIES:
        expected = expected_gain(model, s, exciter)
        assert exciter.gain("stabilizer_signal", s) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize(
    ("model", "push", "changes", "limit", "signal", "value"),
    [
        ("esst1a", 0.5, {}, "regulator_maximum", "field_voltage", None),
        ("esst1a", -0.5, {}, "error_minimum", None, None),
        ("esst4b", 0.5, {}, "regulator_maximum", None, None),
        ("esst4b", 0.5, {}, "inner_maximum", None, None),
        ("st6b", 0.5, {}, "amplifier_maximum", None, None),
        ("st6b", -0.5, {}, "regulator_minimum", None, None),
        ("expic1", 0.5, {}, "amplifier_maximum", "regulated_voltage", 0.99),
        (
            "expic1",
            0.5,
            {"field_voltage_maximum": 3.0},
            "field_voltage_maximum",
            "exciter_input",
            3.0,
        ),
        ("expic1", -0.5, {}, "field_voltage_minimum", "exciter_input", -2.0),
        ("scrx", 0.5, {}, "field_voltage_maximum", "exciter_voltage", 5.0),
        (
            "ieeet2",
            0.5,
            {"feedback_gain": 0.0},
            "regulator_maximum_added",
            "regulator_voltage",
            6.0,
        ),
        ("ieeet3", 0.5, {}, "regulator_maximum", "regulator_voltage", 3.0),
        ("exac4", 0.5, {}, "regulator_maximum", None, None),
        ("exac4", -0.5, {}, "error_minimum", None, None),
        ("dc4b", 0.5, {}, "regulator_maximum_added", None, None),
        ("dc4b", -0.5, {}, "field_voltage_minimum", "field_voltage", 0.0),
        ("ieeet3", 0.5, {"source_maximum": 4.0}, "source_maximum", "field_voltage", 4.0),
    ],
)
def test_a_lasting_push_ends_at_the_limit(model, push, changes, limit, signal, value):
    exciter = alone(model, **changes)
    u = exciter.inputs(stabilizer_signal=push)
    x = exciter.run(u, 5.0, step=2e-3)[-1]
    assert limit in exciter.limits_at(x, u)
    if value is not None:
        assert exciter.signals(x, u)[signal] == pytest.approx(value, abs=5e-3)


def test_ceiling_of_esst1a_follows_the_terminal_voltage_and_falls_with_the_field_current():
    exciter = alone("esst1a", feedback_gain=0.0)
    u = exciter.inputs(stabilizer_signal=0.5, field_current=0.4)
    x = exciter.run(u, 5.0, step=2e-3)[-1]
    v_t, _, i_fd, _ = u[:, 0]
    assert exciter.signals(x, u)["field_voltage"] == pytest.approx(6.0 * v_t - 0.1 * i_fd, abs=1e-9)
    low = exciter.inputs(stabilizer_signal=-0.5)
    x = exciter.run(low, 5.0, step=2e-3)[-1]
    assert exciter.signals(x, low)["field_voltage"] == pytest.approx(-4.0 * v_t, abs=1e-9)


def test_field_current_limiter_of_esst1a_and_st6b_acts_at_once_beyond_its_reference():
    exciter = alone("esst1a", feedback_gain=0.0)
    fields = [
        exciter.signals(exciter.x, exciter.inputs(field_current=more))["field_voltage"]
        for more in (4.4 - exciter.u[2, 0], 4.6 - exciter.u[2, 0])
    ]
    assert fields[1] - fields[0] == pytest.approx(-4.5 * 0.2, rel=1e-9)
    beyond = exciter.inputs(field_current=4.6 - exciter.u[2, 0])
    assert "field_limit" in exciter.limits_at(exciter.x, beyond)
    exciter = alone("st6b")
    u = exciter.inputs(field_current=4.4 - exciter.u[2, 0])
    expected = u[0, 0] * 17.3 * (1.06 * 4.2 - 4.4)
    assert exciter.signals(exciter.x, u)["field_voltage"] == pytest.approx(expected, rel=1e-9)


def test_limits_of_exac4_fall_with_the_field_current_and_do_not_depend_on_the_voltage():
    exciter = alone("exac4")
    for push, limit in ((0.5, 6.0), (-0.5, -4.0)):
        u = exciter.inputs(stabilizer_signal=push, field_current=0.4, terminal_voltage=-0.05)
        x = exciter.run(u, 5.0, step=2e-3)[-1]
        expected = limit - 0.1 * u[2, 0]
        assert exciter.signals(x, u)["field_voltage"] == pytest.approx(expected, abs=1e-9)


def test_regulator_of_dc4b_is_limited_by_the_terminal_voltage_and_its_pid_does_not_wind_up():
    exciter = alone("dc4b")
    u = exciter.inputs(stabilizer_signal=0.5, terminal_voltage=-0.1)
    x = exciter.run(u, 5.0, step=2e-3)[-1]
    found, v_t = exciter.signals(x, u), u[0, 0]
    assert found["regulator_voltage"] == pytest.approx(6.0 * v_t, abs=1e-9)
    assert found["regulator_integral"].real < 6.0 / 1.5
    assert exciter.rates(x, u)["regulator_integral"] == 0.0


@pytest.mark.parametrize(
    ("changes", "highest", "at_start"),
    [
        ({"regulator_maximum": 0.0}, (0.4 + 0.4) * 3.5, None),
        ({"exciter_gain": 0.0}, 6.0, 0.6),
        ({"regulator_maximum": 0.0, "exciter_gain": 0.0}, 0.4 * 3.5, 0.14),
    ],
)
def test_dc4b_has_the_rules_of_dc_commutators(changes, highest, at_start):
    exciter = alone("dc4b", **changes)
    assert exciter.value("regulator_maximum") == pytest.approx(highest, rel=1e-12)
    if at_start is not None:
        regulator = exciter.signals(exciter.x, exciter.u)["regulator_voltage"]
        assert regulator == pytest.approx(at_start, abs=1e-9)


def test_stabilizer_signal_of_esst1a_enters_behind_the_regulator_for_vos_2():
    exciter = alone("esst1a", stabilizer_code=2.0, feedback_gain=0.0)
    for s in FREQUENCIES:
        assert exciter.gain("stabilizer_signal", s) == pytest.approx(1.0, rel=1e-9)


def test_integrals_of_esst4b_stand_while_their_outputs_are_at_a_limit():
    exciter = alone("esst4b")
    u = exciter.inputs(stabilizer_signal=0.5)
    x = exciter.run(u, 5.0, step=2e-3)[-1]
    rates = exciter.rates(x, u)
    assert rates["regulator_integral"] == 0.0
    assert abs(rates["inner_integral"]) < 1e-12
    back = exciter.inputs(stabilizer_signal=-0.05)
    assert exciter.rates(x, back)["regulator_integral"] < 0


@pytest.mark.parametrize("signal", [-0.2, 0.0, 0.1, 0.6])
def test_undelayed_inner_loop_of_st6b_is_solved_with_and_without_its_limits(signal):
    exciter = alone("st6b", inner_feedback_time=0.0, derivative_gain=0.0, inner_gain=3.0)
    u = exciter.inputs(stabilizer_signal=signal)
    field = exciter.signals(exciter.x, u)["field_voltage"]
    v_t = u[0, 0]
    error = exciter.value("voltage_reference") + signal - exciter.x[0, 0]
    v_a = np.clip(18.0 * error + exciter.x[1, 0], -3.9, 4.8)
    wanted = np.clip(v_a + 3.0 * (v_a - 1.0 * field), -3.8, 4.8)
    assert field == pytest.approx(v_t * min(wanted, 17.3 * (1.06 * 4.2 - u[2, 0])), abs=1e-9)


def test_source_of_expic1_is_constant_without_gains_and_a_phasor_sum_with_them():
    exciter = alone("expic1", potential_gain=0.0, current_gain=0.0, regulator_maximum=9.0,
                    amplifier_maximum=9.0)  # fmt: skip
    at_start = exciter.signals(exciter.x, exciter.u)
    assert at_start["exciter_input"] == pytest.approx(at_start["regulated_voltage"], rel=1e-12)
    exciter = alone("expic1", rectifier_loading=0.0)
    at_start = exciter.signals(exciter.x, exciter.u)
    u = dict(zip(exciter.device.inputs, exciter.u[:, 0], strict=True))
    current = np.conj(complex(u["active_power"], u["reactive_power"]) / u["terminal_voltage"])
    source = abs(5.4 * u["terminal_voltage"] + 0.5j * current)
    ratio = at_start["exciter_input"] / at_start["regulated_voltage"]
    assert ratio == pytest.approx(source, rel=1e-12)


def test_expic1_without_an_exciter_time_gives_its_input():
    exciter = alone("expic1", exciter_time=0.0)
    u = exciter.inputs(stabilizer_signal=0.02)
    at_once = exciter.signals(exciter.x, u)
    assert at_once["field_voltage"] == at_once["exciter_input"]


def test_scrx_is_fed_with_a_constant_for_cswitch_1_and_bypasses_a_negative_field_current():
    solid = alone("scrx", source_code=1.0)
    low = solid.inputs(terminal_voltage=-0.5)
    same = solid.signals(solid.x, low)
    assert same["field_voltage"] == pytest.approx(same["exciter_voltage"])
    crowbar = alone("scrx", crowbar_ratio=10.0)
    u = crowbar.inputs(field_current=-0.3 - crowbar.u[2, 0])
    assert crowbar.signals(crowbar.x, u)["field_voltage"] == pytest.approx(3.0)


def test_ieeet3_has_no_source_voltage_left_at_a_high_field_current():
    exciter = alone("ieeet3")
    u = exciter.inputs(field_current=5.0)
    assert exciter.rates(exciter.x, u)["field_voltage"] < -2.0
    assert exciter.signals(exciter.x, u)["source_voltage"] == 0.0


ZERO = [
    ("esst1a", {"measuring_time": 0.0}),
    ("esst1a", {"lag_time": 0.0, "lead_time": 0.0}),
    ("esst1a", {"regulator_time": 0.0, "feedback_gain": 0.0}),
    ("esst4b", {"measuring_time": 0.0, "regulator_time": 0.0}),
    ("st6b", {"measuring_time": 0.0, "inner_feedback_time": 0.0}),
    ("expic1", {"filter_time_1": 0.0}),
    ("expic1", {"filter_time_2": 0.0}),
    ("expic1", {"filter_time_1": 0.0, "filter_time_2": 0.0, "filter_lead_time": 0.0}),
    ("ieeet2", {"second_feedback_time": 0.0}),
    ("ieeet3", {"regulator_time": 0.0}),
]


@pytest.mark.parametrize(("model", "zero"), ZERO)
def test_time_constants_of_zero_act_as_very_small_ones(model, zero):
    without = alone(model, **zero)
    small = Alone(without.device, without.x, without.u, without.p.copy())
    for name, parameter in ((p.name, p) for p in without.device.parameters if p.name in zero):
        if parameter.unit == "s" and "lead" not in name:
            small.p[without.device.parameter_rows.index(name)] = 1e-8
    for s in (0.05j, 1j, 8j):
        expected = small.gain("stabilizer_signal", s)
        assert without.gain("stabilizer_signal", s) == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize(
    ("model", "changes", "fault"),
    [
        ("esst1a", {"stabilizer_code": 3.0}, "VOS 3 is neither"),
        ("esst1a", {"regulator_time": 0.0}, "algebraic loop"),
        (
            "esst4b",
            {"inner_proportional_gain": 0.0, "inner_integral_gain": 0.0},
            "KPM and .* both 0",
        ),
        ("esst4b", {"potential_gain": 0.0, "current_gain": 0.0}, "no source"),
        ("st6b", {"forward_gain": 0.0, "inner_gain": 0.0}, "nothing drives the rectifier"),
        ("expic1", {"second_feedback_time": 0.0}, "TF2 is 0: feedback_gain KF"),
        ("expic1", {"filter_time_1": 0.0, "filter_time_2": 0.0}, "TA3 has to be 0"),
        ("scrx", {"source_code": 2.0}, "CSWITCH 2 is neither"),
        ("ieeet3", {"regulator_minimum": 4.0}, "VRMIN is above"),
        ("exac4", {"lag_time": 0.0}, "TB is 0: lead_time TC"),
        ("dc4b", {"derivative_time": 0.0}, "TD is 0: derivative_gain KD"),
        ("dc4b", {"proportional_gain": 0.0, "integral_gain": 0.0}, "nothing holds the voltage"),
    ],
)
def test_impossible_parameters_are_refused_with_their_symbol(model, changes, fault):
    with pytest.raises(gf.CaseError, match=fault):
        built_with(model, **changes)


def test_records_have_the_length_of_the_psse_data_sheets():
    lengths = {model: len(DEVICES[model].psse_record) for model in RECORDS}
    assert lengths == {
        "esst1a": 20, "esst4b": 17, "st6b": 17, "expic1": 24, "scrx": 8, "ieeet2": 14, "ieeet3": 12,
        "exac4": 10, "dc4b": 20,
    }  # fmt: skip
