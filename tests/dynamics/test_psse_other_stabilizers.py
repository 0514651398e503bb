"""Stabilizers PSS2A, PSS2B, STAB1 and STAB2A: no signal at rest, transfer functions, limits."""

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

SEXS = (0.1, 5.0, 60.0, 0.08, -4.0, 6.0)
FILTERS = (2.0, 3.0, 0.02, 4.0, 0.0, 2.0, 0.25, 1.0, 0.5, 0.1, 10.0, 0.2, 0.03, 0.3, 0.05)
RECORDS = {
    "pss2a": (1, 0, 3, 0, 5, 1, *FILTERS, 0.1, -0.08),
    "pss2b": (1, 0, 3, 0, 4, 2, *FILTERS, 0.15, 0.04, 2.0, -2.0, 2.0, -2.0, 0.1, -0.08),
    "stab1": (6.0, 1.5, 13.3, 0.0447, 5.0, 0.05, 0.1),
    "stab2a": (1.0, 2.0, 0.5, 0.8, 0.3, 1.2, 0.1, 0.1),
}
EVERY = pytest.mark.parametrize("model", RECORDS)
SIGNAL = "stabilizer_signal"
FREQUENCIES = (0.05j, 0.7j, 5j, 40j, 0.3 + 2j)


def built_with(model: str, base: float = 100.0, **changes: float) -> gf.DetailedModel:
    records = {"sexs": named("sexs", SEXS), model: named(model, RECORDS[model], **changes)}
    return gf.build_model(machine_with(records, base))


@cache
def start_of(model: str) -> gf.DetailedModel:
    return built_with(model)


def alone(model: str, **changes: float) -> Alone:
    return alone_in(built_with(model, **changes) if changes else start_of(model), model)


@EVERY
@pytest.mark.parametrize("base", [100.0, 250.0])
def test_start_is_an_equilibrium_without_a_signal(model, base):
    built = built_with(model, base)
    assert residual(built) < 1e-9
    stabilizer = alone_in(built, model)
    assert stabilizer.signals(stabilizer.x, stabilizer.u)[SIGNAL] == pytest.approx(0, abs=1e-12)


@EVERY
def test_jacobian_equals_central_differences_off_the_equilibrium(model):
    built = start_of(model)
    x = built.x0 + 1e-4 * np.random.default_rng(1).standard_normal(built.n_states)
    assert jacobian_error(built, x) < 1e-6


def washed(s: complex, *times: float) -> complex:
    return complex(np.prod([s * t * lag(s, t) for t in times]))


def expected_gains(model: str, s: complex) -> dict[str, complex]:
    """Gains from the inputs to the signal, from the block diagrams."""
    if model == "stab1":
        return {
            "speed": 9.0 * s * lag(s, 1.5) * lead_lag(s, 0.59451, 0.0447) * lead_lag(s, 0.25, 0.05)
        }
    if model == "stab2a":
        out = (0.5 * lag(s, 0.8) + 0.3) * (1.2 * lag(s, 0.1)) ** 2
        return {"active_power": -washed(s, 2.0, 2.0, 2.0) * out}
    poles, stages = (5, 1) if model == "pss2a" else (4, 2)
    ramp = ((1 + 0.5 * s) * lag(s, 0.1) ** poles) ** stages
    leads = 10.0 * lead_lag(s, 0.2, 0.03) * lead_lag(s, 0.3, 0.05)
    leads *= lead_lag(s, 0.15, 0.04) if model == "pss2b" else 1.0
    first = washed(s, 2.0, 3.0) * lag(s, 0.02)
    second = 0.25 * washed(s, 4.0) * lag(s, 2.0)
    return {"speed": leads * ramp * first, "active_power": leads * (ramp - 1) * second}


@EVERY
def test_stabilizer_has_the_transfer_function_of_its_diagram(model):
    stabilizer = alone(model)
    for s in FREQUENCIES:
        for name, expected in expected_gains(model, s).items():
            assert stabilizer.gain(name, s, SIGNAL) == pytest.approx(expected, rel=1e-8)


@pytest.mark.parametrize(
    "changes",
    [{"ramp_poles": 0.0}, {"ramp_stages": 0.0}, {"ramp_lag_time": 0.0, "ramp_lead_time": 0.0}],
)
def test_ramp_filter_can_be_left_out(changes):
    """Without it the second input cancels: f - v2 = v1 where KS3 is 1."""
    stabilizer = alone("pss2a", **changes)
    for s in FREQUENCIES:
        assert stabilizer.gain("active_power", s, SIGNAL) == pytest.approx(0.0, abs=1e-12)


def test_powers_are_on_the_base_of_the_machine():
    for model in ("pss2a", "stab2a"):
        one, other = (alone_in(built_with(model, base), model) for base in (100.0, 250.0))
        for s in FREQUENCIES:
            ratio = one.gain("active_power", s, SIGNAL) / other.gain("active_power", s, SIGNAL)
            assert ratio == pytest.approx(2.5, rel=1e-9)


@pytest.mark.parametrize(("push", "end"), [(0.02, "highest"), (-0.02, "lowest")])
def test_signal_stays_within_its_limits_and_is_washed_out(push, end):
    for model, low, high in (("pss2a", -0.08, 0.1), ("pss2b", -0.08, 0.1), ("stab1", -0.1, 0.1)):
        stabilizer = alone(model)
        u = stabilizer.inputs(speed=push)
        states = stabilizer.run(u, 1.0, step=2e-3)
        values = np.array([stabilizer.signals(x, u)[SIGNAL] for x in states[::10]])
        assert values.min() >= low
        assert values.max() <= high
        assert (values.max() == high) if end == "highest" else (values.min() == low)
        later = stabilizer.run(u, 60.0, x=states[-1], step=2e-2)[-1]
        assert abs(stabilizer.signals(later, u)[SIGNAL]) < 2e-3


def test_input_limits_of_pss2b_cut_the_slip():
    wide, narrow = alone("pss2b"), alone("pss2b", highest_input_1=0.001, stabilizer_gain=0.1)
    signals = []
    for stabilizer, slip in ((wide, 0.0001), (narrow, 0.05)):
        u = stabilizer.inputs(speed=slip)
        signals.append(stabilizer.signals(stabilizer.run(u, 0.3, step=1e-3)[-1], u)[SIGNAL])
    assert signals[1] == pytest.approx(signals[0] * 10 * 0.01, rel=1e-3)


@pytest.mark.parametrize(
    ("model", "tuned"),
    [
        ("stab1", {"washout_ratio": 6.67, "lead_ratio_1": 5.0, "lag_time_1": 0.03,
                   "lead_ratio_2": 1.0, "lag_time_2": 0.0, "signal_limit": 1.0}),
        ("pss2a", {"lead_time_1": 0.15, "lag_time_1": 0.03, "lead_time_2": 0.05}),
        ("pss2b", {"lead_time_1": 0.15, "lag_time_1": 0.03, "lead_time_2": 0.05,
                   "lead_time_3": 0.04, "ramp_poles": 5.0, "ramp_stages": 1.0}),
    ],
)  # fmt: skip
def test_a_signal_of_the_speed_damps_the_swing(model, tuned):
    exciter = {"sexs": named("sexs", (0.0, 0.0, 80.0, 0.03, -4.0, 6.0))}
    stabilizer = {model: named(model, RECORDS[model], **tuned)}
    bare, built = (gf.build_model(machine_with(exciter | more)) for more in ({}, stabilizer))
    assert _swing_damping(built) > _swing_damping(bare) + 0.02


def _swing_damping(built: gf.DetailedModel) -> float:
    values = np.linalg.eigvals(built.jacobian(built.x0))
    swing = values[(values.imag > np.pi) & (values.imag < 5 * np.pi)]
    return float((-swing.real / np.abs(swing)).min())


@pytest.mark.parametrize(
    ("model", "changes", "fault"),
    [
        ("pss2a", {"input_code_1": 2.0}, "IC1 2 is none"),
        ("pss2a", {"remote_bus_2": 7.0}, "remote bus 7"),
        ("pss2a", {"ramp_poles": 9.0}, "is no number up to 8"),
        ("pss2a", {"lag_time_1": 0.0}, "T2 is 0: lead_time_1 T1"),
        ("pss2b", {"input_code_2": 4.0, "input_time_2": 0.0}, "accelerating power needs a lag"),
        ("pss2b", {"lowest_input_1": 3.0}, "VSI1MIN is above"),
        ("pss2b", {"ramp_lag_time": 0.0}, "T9 is 0: ramp_lead_time T8"),
        ("stab1", {"washout_time": 0.0}, "washout_time must be positive"),
    ],
)
def test_records_that_are_not_modelled_are_refused(model, changes, fault):
    with pytest.raises(gf.CaseError, match=fault):
        built_with(model, **changes)


def test_records_have_the_length_of_the_psse_data_sheets():
    lengths = {model: len(DEVICES[model].psse_record) for model in RECORDS}
    assert lengths == {"pss2a": 23, "pss2b": 29, "stab1": 7, "stab2a": 8}
