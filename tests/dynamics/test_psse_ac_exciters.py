"""Exciters with an alternator: ESAC1A, ESAC6A, ESAC8B, AC8B, EXAC1, EXAC2."""

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
from gridfold.dynamics.exciters.rectifier import rectified, unloaded
from gridfold.dynamics.registry import DEVICES

SATURATION = (1.5, 0.05, 3.5, 0.4)
RECORDS = {
    "esac1a": (
        0.02, 1.2, 0.4, 60.0, 0.05, 8.0, -8.0, 0.8, 0.03, 1.0, 0.2, 0.3, 1.0, *SATURATION, 6.5, -6.0,
    ),
    "exac1": (0.02, 1.2, 0.4, 60.0, 0.05, 9.0, -9.0, 0.8, 0.03, 1.0, 0.2, 0.3, 1.0, *SATURATION),
    "exac2": (
        0.02, 1.2, 0.4, 60.0, 0.05, 12.0, -9.0, 2.0, 27.0, -27.0, 0.9, 4.0, 0.1, 0.05, 1.0, 0.1,
        0.8, 1.0, 14.0, *SATURATION,
    ),
    "esac6a": (
        0.02, 60.0, 0.3, 0.1, 0.9, 0.2, 30.0, -30.0, 25.0, -25.0, 1.0, 10.0, 2.0, 8.0, 0.1, 0.3,
        0.1, 0.5, 1.0, *SATURATION,
    ),
    "ac8b": (
        0.02, 40.0, 20.0, 8.0, 0.05, 35.0, -35.0, 1.1, 0.03, 30.0, -25.0, 0.1, 0.4, 1.0, 0.9,
        12.0, 0.0, *SATURATION,
    ),
    "esac8b": (0.02, 40.0, 20.0, 8.0, 0.05, 1.1, 0.03, 30.0, -25.0, 0.9, 1.0, *SATURATION),
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
def test_start_is_an_equilibrium(model, base):
    assert residual(built_with(model, base)) < 1e-9


@EVERY
def test_jacobian_equals_central_differences_off_the_equilibrium(model):
    built = start_of(model)
    x = built.x0 + 0.003 * np.random.default_rng(1).standard_normal(built.n_states)
    assert jacobian_error(built, x) < 1e-6


@pytest.mark.parametrize("drop", [-0.3, 0.0, 0.4, 1.0, 2.4, 9.0])
@pytest.mark.parametrize("field", [0.3, 2.0])
def test_unloaded_source_gives_the_field_voltage_behind_the_rectifier(field, drop):
    source = unloaded(np.array([field]), np.array([drop]))[0]
    assert rectified(source, drop) == pytest.approx(field, rel=1e-3)


@EVERY
def test_regulator_holds_what_the_alternator_and_the_rectifier_take(model):
    """VR = KD IFD + (KE + SE) VE, and the field voltage is VE less 0.577 KC IFD in the first mode."""
    exciter, p = alone(model), named(model, RECORDS[model])
    at_start = exciter.signals(exciter.x, exciter.u)
    v_e = at_start["exciter_voltage"]
    i_fd = exciter.u[2, 0] if "field_current" in exciter.device.inputs else 0.0
    field = v_e - 0.577 * p.get("rectifier_loading", 0.0) * i_fd
    assert at_start["field_voltage"] == pytest.approx(field, rel=1e-10)
    low, high = np.sqrt(1.5 * 0.05), np.sqrt(3.5 * 0.4)
    excess = (low + (high - low) / 2.0 * (v_e - 1.5)) ** 2
    demand = v_e + excess + p.get("demagnetization", 0.0) * i_fd
    if "exciter_demand" in at_start:
        assert at_start["exciter_demand"] == pytest.approx(demand, rel=1e-10)
    else:
        assert at_start["regulator_voltage"] == pytest.approx(demand, rel=1e-10)


def pid(s: complex, p: dict[str, float]) -> complex:
    derivative = s * p["derivative_gain"] * lag(s, p["derivative_time"])
    return p["proportional_gain"] + p["integral_gain"] / s + derivative


def expected_gain(model: str, s: complex, own: float) -> complex:
    """Stabilizer signal to field voltage; `own` is the slope of (KE + SE) VE."""
    p = named(model, RECORDS[model])
    exciter = s * p["exciter_time"] + own
    if model in ("ac8b", "esac8b"):
        return pid(s, p) * p["regulator_gain"] * lag(s, p["regulator_time"]) / exciter
    forward = p["regulator_gain"] * lead_lag(s, p["lead_time"], p["lag_time"])
    if model == "esac6a":
        return forward * lead_lag(s, p["regulator_lead_time"], p["regulator_time"]) / exciter
    forward *= lag(s, p["regulator_time"])
    feedback = s * p["feedback_gain"] * lag(s, p["feedback_time"])
    second, inner = p.get("second_gain", 1.0), p.get("field_feedback_gain", 0.0)
    return second * forward / (exciter + second * (forward * feedback + inner) * own)


@EVERY
def test_exciter_has_the_transfer_function_of_its_diagram(model):
    exciter, p = alone(model), named(model, RECORDS[model])
    v_e = exciter.signals(exciter.x, exciter.u)["exciter_voltage"]
    own = p["exciter_gain"] + saturation_slope(p, v_e)
    for s in FREQUENCIES:
        expected = expected_gain(model, s, own)
        assert exciter.gain("stabilizer_signal", s) == pytest.approx(expected, rel=1e-9)
        measured = -lag(s, p["measuring_time"]) * expected
        assert exciter.gain("terminal_voltage", s) == pytest.approx(measured, rel=1e-9)


@pytest.mark.parametrize("model", ["ac8b", "esac6a"])
def test_field_current_takes_from_the_rectifier_at_once_and_from_the_alternator_late(model):
    exciter, p = alone(model), named(model, RECORDS[model])
    v_e = exciter.signals(exciter.x, exciter.u)["exciter_voltage"]
    own = p["exciter_gain"] + saturation_slope(p, v_e)
    for s in FREQUENCIES:
        late = p["demagnetization"] / (s * p["exciter_time"] + own)
        expected = -0.577 * p["rectifier_loading"] - late
        assert exciter.gain("field_current", s) == pytest.approx(expected, rel=1e-9)


PUSHED = [
    ("esac1a", 0.4, {}, "amplifier_maximum", "exciter_demand", 6.5),
    ("esac1a", 0.4, {"regulator_maximum": 9.0}, "amplifier_maximum", "exciter_demand", 8.0),
    ("exac1", 0.4, {}, "regulator_maximum", "exciter_demand", 9.0),
    ("exac2", 0.4, {"field_limit": 6.0}, "field_limit", "exciter_demand", 8.0 * 6.0 / 9.0),
    ("ac8b", 0.4, {}, "field_limit", "exciter_demand", 12.0),
    ("ac8b", 0.4, {"field_limit": 99.0, "regulator_maximum": 8.0}, "regulator_maximum",
     "exciter_demand", 8.0),
    ("esac8b", 0.4, {"regulator_maximum": 8.0}, "regulator_maximum", "regulator_voltage", 8.0),
    ("esac1a", -0.4, {}, "exciter_voltage_minimum", "field_voltage", 0.0),
    ("exac1", -0.4, {}, "exciter_voltage_minimum", "field_voltage", 0.0),
    ("exac2", -0.4, {}, "exciter_voltage_minimum", "field_voltage", 0.0),
    ("esac6a", -0.4, {}, "exciter_voltage_minimum", "field_voltage", 0.0),
    ("ac8b", -0.4, {}, "exciter_voltage_minimum", "field_voltage", 0.0),
    ("esac8b", -0.4, {}, "field_voltage_minimum", "field_voltage", 0.0),
]  # fmt: skip


@pytest.mark.parametrize(("model", "push", "changes", "limit", "signal", "value"), PUSHED)
def test_a_lasting_push_ends_at_the_limit(model, push, changes, limit, signal, value):
    """EXAC2: KB KL (VLR - VFE) = VFE at its limit of field current, with KB = 2 and KL = 4."""
    exciter = alone(model, **changes)
    u = exciter.inputs(stabilizer_signal=push)
    x = exciter.run(u, 12.0, step=4e-3)[-1]
    assert limit in exciter.limits_at(x, u)
    assert exciter.signals(x, u)[signal] == pytest.approx(value, abs=2e-3)


def test_a_regulator_that_was_pushed_leaves_its_limit_at_once():
    exciter = alone("exac1", feedback_gain=0.0, lead_time=0.0, lag_time=0.0)
    u = exciter.inputs(stabilizer_signal=0.4)
    x = exciter.run(u, 6.0, step=2e-3)[-1]
    back = exciter.inputs(stabilizer_signal=-0.4)
    after = exciter.run(back, 0.1, x=x, step=2e-3)[-1]
    assert after[2, 0] < 9.0 - 1.0


def test_field_limiter_of_esac6a_takes_from_the_regulator_what_is_too_much():
    """VH = KH (VFE - VFELIM), so VFE = (VA + KH VFELIM) / (1 + KH) in steady state."""
    exciter = alone("esac6a", field_limit=4.0, amplifier_maximum=9.0)
    u = exciter.inputs(stabilizer_signal=0.4)
    x = exciter.run(u, 12.0, step=4e-3)[-1]
    demand = exciter.signals(x, u)["exciter_demand"]
    assert demand == pytest.approx((9.0 + 2.0 * 4.0) / 3.0, abs=2e-3)


TIMES = {
    "esac1a": ("measuring_time", "regulator_time", "lag_time"),
    "exac1": ("measuring_time", "regulator_time", "lag_time"),
    "exac2": ("measuring_time", "regulator_time", "lag_time"),
    "esac6a": ("measuring_time", "regulator_time", "lag_time", "field_limiter_lag_time"),
    "ac8b": ("measuring_time", "regulator_time"),
    "esac8b": ("measuring_time", "regulator_time"),
}
LEADS = {
    "lag_time": "lead_time",
    "field_limiter_lag_time": "field_limiter_lead_time",
    "regulator_time": "regulator_lead_time",
}


@EVERY
def test_time_constants_of_zero_act_as_very_small_ones(model):
    known = named(model, RECORDS[model])
    for name in TIMES[model]:
        zero = {name: 0.0} | {lead: 0.0 for lead in (LEADS.get(name),) if lead in known}
        without = alone(model, **zero)
        small = Alone(without.device, without.x, without.u, without.p.copy())
        small.p[without.device.parameter_rows.index(name)] = 1e-8
        for s in (0.05j, 1j, 8j):
            expected = small.gain("stabilizer_signal", s)
            assert without.gain("stabilizer_signal", s) == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize(
    ("model", "changes", "fault"),
    [
        ("esac1a", {"lag_time": 0.0}, "TB is 0: lead_time TC"),
        ("esac1a", {"amplifier_minimum": 9.0}, "VAMIN is above"),
        ("exac1", {"feedback_time": 0.0}, "TF is 0: feedback_gain KF"),
        ("exac2", {"saturation_2": 0.01}, "no quadratic saturation"),
        ("esac6a", {"regulator_time": 0.0}, "TA is 0: regulator_lead_time TK"),
        ("ac8b", {"proportional_gain": 0.0, "integral_gain": 0.0}, "nothing holds the voltage"),
        ("esac8b", {"derivative_time": 0.0}, "TD is 0: derivative_gain KD"),
    ],
)
def test_impossible_parameters_are_refused_with_their_symbol(model, changes, fault):
    with pytest.raises(gf.CaseError, match=fault):
        built_with(model, **changes)


def test_a_limit_that_another_one_hides_is_named_too():
    """Only behind a higher VAMAX does VRMAX become the lowest."""
    with pytest.raises(gf.InitializationError) as error:
        built_with("esac1a", amplifier_maximum=1.0, regulator_maximum=2.0)
    assert "VAMAX" in str(error.value)
    assert "VRMAX" in str(error.value)
    moved = gf.build_model(
        machine_with({"esac1a": named("esac1a", RECORDS["esac1a"], amplifier_maximum=1.0,
                                      regulator_maximum=2.0)}),
        on_limit=gf.OnLimit.ADJUST,
    )  # fmt: skip
    assert residual(moved) < 1e-8


def test_records_have_the_length_of_the_psse_data_sheets():
    lengths = {model: len(DEVICES[model].psse_record) for model in RECORDS}
    assert lengths == {
        "esac1a": 19, "exac1": 17, "exac2": 23, "esac6a": 23, "ac8b": 21, "esac8b": 15,
    }  # fmt: skip
