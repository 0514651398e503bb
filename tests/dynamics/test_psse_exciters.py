"""Excitation systems of PSS/E: start, linear response, limits, zero time constants."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from device_alone import Alone, alone_in, jacobian_error, lag, lead_lag, machine_with

import gridfold as gf
from gridfold.dynamics.assemble import assemble
from gridfold.dynamics.device import Device
from gridfold.dynamics.exciters import esdc1a, esdc2a, esst3a, exdc2, exst1, ieeet1, ieeex1, sexs
from gridfold.dynamics.exciters.rectifier import rectified
from gridfold.dynamics.initialize import OnLimit, initialize
from gridfold.dynamics.layout import build_layout
from gridfold.dynamics.machines.genrou import GENROU
from gridfold.dynamics.registry import DEVICES

EXCITERS: dict[str, Device] = {
    "ieeet1": ieeet1.IEEET1,
    "ieeex1": ieeex1.IEEEX1,
    "exdc2": exdc2.EXDC2,
    "esdc1a": esdc1a.ESDC1A,
    "esdc2a": esdc2a.ESDC2A,
    "exst1": exst1.EXST1,
    "esst3a": esst3a.ESST3A,
    "sexs": sexs.SEXS,
}
KNOWN = {**DEVICES, **EXCITERS, "genrou": GENROU}

PLAIN = (0.02, 40.0, 0.05)
DC = (6.0, -5.0, 0.1, 0.5, 0.06, 0.9, None, 2.5, 0.06, 3.3, 0.3)
RECORDS = {
    "ieeet1": PLAIN + DC,
    "ieeex1": (*PLAIN, 0.3, 0.1, *DC),
    "exdc2": (*PLAIN, 0.3, 0.1, *DC),
    "esdc1a": (*PLAIN, 0.3, 0.1, *DC),
    "esdc2a": (*PLAIN, 0.3, 0.1, *DC),
    "exst1": (0.02, 0.2, -0.15, 0.4, 1.5, 60.0, 0.03, 6.0, -4.0, 0.1, 0.02, 0.8),
    "esst3a": (
        *(0.02, 0.2, -0.15, 6.0, 0.6, 2.0, 30.0, 0.05, 12.0, -10.0),
        *(0.9, 4.0, 3.0, 9.0, 0.3, 0.08, 6.0, 20.0, 0.1, 1.2, -0.5),
    ),
    "sexs": (0.1, 5.0, 60.0, 0.08, -2.0, 5.0),
}
DYR = {
    module.__name__.rpartition(".")[2]: module.DYR_COLUMNS
    for module in (ieeet1, ieeex1, exdc2, esdc1a, esdc2a, exst1, esst3a, sexs)
}
DC_MODELS = ("ieeet1", "ieeex1", "exdc2", "esdc1a", "esdc2a")
EVERY = pytest.mark.parametrize("model", EXCITERS)


def parameters(model: str, **changes: float) -> dict[str, float]:
    named = zip(DYR[model], RECORDS[model], strict=True)
    return {name: value for name, value in named if name is not None} | changes


def case_with(model: str, machine_base: float = 100.0, **changes: float) -> gf.Case:
    """A GENROU with this exciter at an infinite bus; the machine is the same on any base."""
    return machine_with({model: parameters(model, **changes)}, machine_base)


def start_of(case: gf.Case, on_limit: OnLimit = OnLimit.ERROR):
    return initialize(build_layout(assemble(case, KNOWN)), gf.solve_power_flow(case), on_limit)


def alone(model: str, machine_base: float = 100.0, **changes: float) -> Alone:
    built = gf.build_model(case_with(model, machine_base, **changes), devices=KNOWN)
    return alone_in(built, model)


def compensator(s: complex, p: dict[str, float]) -> complex:
    return lead_lag(s, p.get("lead_time", 0.0), p.get("lag_time", 0.0))


# --- records and checks -----------------------------------------------------------------------------


@EVERY
def test_record_names_all_parameters_in_order(model):
    named = [name for name in DYR[model] if name is not None]
    assert [p.name for p in EXCITERS[model].parameters][: len(named)] == named
    assert all(p.default is not None for p in EXCITERS[model].parameters[len(named) :])


@pytest.mark.parametrize(
    ("model", "changes", "fault"),
    [
        ("ieeet1", {"regulator_maximum": 0.0, "saturation_voltage_2": 0.0}, "VRMAX is 0"),
        ("ieeex1", {"lag_time": 0.0}, "TB is 0"),
        ("exdc2", {"feedback_time": 0.0}, "TF is 0"),
        ("esdc2a", {"saturation_1": 0.5}, "no quadratic saturation"),
        ("exst1", {"regulator_minimum": 7.0}, "VRMIN is above"),
        ("exst1", {"lag_time": 0.0}, "TB is 0"),
        ("esst3a", {"potential_gain": 0.0, "current_gain": 0.0}, "no source"),
        ("esst3a", {"inner_minimum": 2.0}, "VMMIN is above"),
        ("sexs", {"field_voltage_minimum": 6.0}, "EMIN is above"),
    ],
)
def test_impossible_parameters_are_refused_with_their_symbol(model, changes, fault):
    with pytest.raises(gf.CaseError, match=fault):
        assemble(case_with(model, **changes), KNOWN)


# --- start ------------------------------------------------------------------------------------------


@EVERY
@pytest.mark.parametrize("base", [100.0, 250.0])
def test_start_is_an_equilibrium_with_the_field_voltage_of_the_machine(model, base):
    built = gf.build_model(case_with(model, base), devices=KNOWN)
    assert np.abs(built.compiled(built.x0)).max() < 1e-9
    bare = case_with(model, base)
    bare = replace(bare, devices=tuple(d for d in bare.devices if d.model != model))
    fixed = gf.build_model(bare, devices=KNOWN)
    field, demand = (
        m.signals(m.x0[None, :])[0][m.slots("field_voltage", m.machines)] for m in (built, fixed)
    )
    np.testing.assert_allclose(field, demand, atol=1e-10)


@EVERY
def test_jacobian_equals_central_differences_off_the_equilibrium(model):
    built = gf.build_model(case_with(model), devices=KNOWN)
    x = built.x0 + 0.003 * np.random.default_rng(1).standard_normal(built.n_states)
    assert jacobian_error(built, x) < 1e-6


@pytest.mark.parametrize("model", DC_MODELS)
@pytest.mark.parametrize("given", [0.1, 1.0, -0.05])
def test_a_given_exciter_gain_is_kept(model, given):
    exciter = alone(model, exciter_gain=given)
    assert exciter.value("effective_exciter_gain") == pytest.approx(given, abs=1e-12)


@pytest.mark.parametrize("model", DC_MODELS)
def test_exciter_gain_zero_starts_the_regulator_at_a_tenth_of_its_maximum(model):
    exciter = alone(model, exciter_gain=0.0)
    at_start = exciter.signals(exciter.x, exciter.u)
    assert at_start["regulator_voltage"] == pytest.approx(0.6, abs=1e-10)
    field = at_start["field_voltage"]
    root = np.sqrt(0.06 * 2.5 / (0.3 * 3.3))
    knee = (2.5 - root * 3.3) / (1 - root)
    saturation = 0.3 * 3.3 * (max(field - knee, 0.0) / (3.3 - knee)) ** 2
    expected = (0.6 - saturation) / field
    assert exciter.value("effective_exciter_gain") == pytest.approx(expected, abs=1e-10)


@pytest.mark.parametrize("model", DC_MODELS)
@pytest.mark.parametrize(
    ("gain", "highest"), [(0.7, (0.7 + 0.3) * 3.3), (-0.05, 0.3 * 3.3), (0.0, 0.99)]
)
def test_a_regulator_maximum_of_zero_is_what_holds_the_second_saturation_voltage(
    model, gain, highest
):
    """VRMAX = (KE + SE2) E2 = -VRMIN; a KE that is not positive does not count."""
    exciter = alone(model, regulator_maximum=0.0, regulator_minimum=-99.0, exciter_gain=gain)
    assert exciter.value("regulator_maximum") == pytest.approx(highest, rel=1e-12)
    assert exciter.value("regulator_minimum") == pytest.approx(-highest, rel=1e-12)
    if gain == 0.0:
        regulator = exciter.signals(exciter.x, exciter.u)["regulator_voltage"]
        assert regulator == pytest.approx(highest / 10, abs=1e-9)


@pytest.mark.parametrize("points", [(0.0, 0.3), (0.06, 0.0), (0.0, 0.0)])
@pytest.mark.parametrize("model", DC_MODELS)
def test_an_exciter_saturation_of_zero_at_a_point_means_none(model, points):
    exciter = alone(model, saturation_1=points[0], saturation_2=points[1])
    at_start = exciter.signals(exciter.x, exciter.u)
    assert at_start["regulator_voltage"] == pytest.approx(0.1 * at_start["field_voltage"], rel=1e-9)


@pytest.mark.parametrize(
    ("model", "limit", "state"),
    [
        ("ieeet1", {"regulator_maximum": 0.1}, "regulator_maximum_added"),
        ("exdc2", {"regulator_maximum": 0.1}, "regulator_maximum_added"),
        ("exst1", {"regulator_maximum": 0.5}, "regulator_maximum"),
        ("esst3a", {"inner_maximum": 0.1}, "inner_maximum"),
        ("esst3a", {"source_maximum": 0.5}, "source_maximum"),
        ("sexs", {"field_voltage_maximum": 1.0}, "field_voltage_maximum"),
    ],
)
def test_a_limit_below_the_operating_point_is_named_and_can_be_moved_there(model, limit, state):
    case = case_with(model, **limit)
    layout, flow = build_layout(assemble(case, KNOWN)), gf.solve_power_flow(case)
    with pytest.raises(gf.InitializationError, match=rf"{model} 1:1.*\({state}\)"):
        initialize(layout, flow)
    moved = initialize(layout, flow, OnLimit.ADJUST)
    assert len(moved.adjusted) == 1
    assert state in moved.adjusted[0]


# --- linear response --------------------------------------------------------------------------------

FREQUENCIES = (0.01j, 0.3j, 2j, 9j, 60j, 0.5 + 1j)


@pytest.mark.parametrize("model", DC_MODELS)
def test_dc_exciter_has_the_transfer_function_of_its_diagram(model):
    exciter, p = alone(model), parameters(model)
    field = exciter.signals(exciter.x, exciter.u)["field_voltage"]
    root = np.sqrt(0.06 * 2.5 / (0.3 * 3.3))
    knee = (2.5 - root * 3.3) / (1 - root)
    slope = 2 * 0.3 * 3.3 * max(field - knee, 0.0) / (3.3 - knee) ** 2
    for s in FREQUENCIES:
        forward = p["regulator_gain"] * lag(s, p["regulator_time"]) * compensator(s, p)
        forward /= s * p["exciter_time"] + p["exciter_gain"] + slope
        feedback = s * p["feedback_gain"] * lag(s, p["feedback_time"])
        expected = forward / (1 + forward * feedback)
        assert exciter.gain("stabilizer_signal", s) == pytest.approx(expected, rel=1e-9)
        measured = -lag(s, p["measuring_time"]) * expected
        assert exciter.gain("terminal_voltage", s) == pytest.approx(measured, rel=1e-9)


def test_exst1_has_the_transfer_function_of_its_diagram():
    exciter, p = alone("exst1"), parameters("exst1")
    for s in FREQUENCIES:
        forward = p["regulator_gain"] * lag(s, p["regulator_time"]) * compensator(s, p)
        feedback = s * p["feedback_gain"] * lag(s, p["feedback_time"])
        expected = forward / (1 + forward * feedback)
        assert exciter.gain("stabilizer_signal", s) == pytest.approx(expected, rel=1e-9)
        measured = -lag(s, p["measuring_time"]) * expected
        assert exciter.gain("terminal_voltage", s) == pytest.approx(measured, rel=1e-9)
        assert exciter.gain("field_current", s) == 0


def test_esst3a_has_the_transfer_function_of_its_diagram():
    exciter, p = alone("esst3a"), parameters("esst3a")
    at_start = exciter.signals(exciter.x, exciter.u)
    source, inner = at_start["source_voltage"], at_start["inner_voltage"]
    for s in FREQUENCIES:
        m = p["inner_gain"] * lag(s, p["inner_time"])
        regulator = p["regulator_gain"] * lag(s, p["regulator_time"]) * compensator(s, p)
        loop = 1 + m * source * p["inner_feedback_gain"]
        expected = regulator * m * source / loop
        assert exciter.gain("stabilizer_signal", s) == pytest.approx(expected, rel=1e-9)
        # The rectifier is in its first mode here: one p.u. of field current takes 0.577 KC of VB.
        loaded = -0.577 * p["rectifier_loading"] * inner / loop
        assert exciter.gain("field_current", s) == pytest.approx(loaded, rel=1e-9)


def test_sexs_has_the_transfer_function_of_its_diagram():
    exciter = alone("sexs")
    for s in FREQUENCIES:
        expected = 60.0 * (1 + 0.5 * s) / (1 + 5.0 * s) / (1 + 0.08 * s)
        assert exciter.gain("stabilizer_signal", s) == pytest.approx(expected, rel=1e-9)
        assert exciter.gain("terminal_voltage", s) == pytest.approx(-expected, rel=1e-9)


# --- source of the rectifiers -----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("loading", "factor"),
    [
        (-0.2, 1.0),
        (0.0, 1.0),
        (0.2, 1 - 0.577 * 0.2),
        (0.6, np.sqrt(0.75 - 0.36)),
        (0.9, 1.732 * 0.1),
        (1.3, 0.0),
    ],
)
def test_loaded_rectifier_follows_the_three_modes_of_the_standard(loading, factor):
    assert rectified(2.0, 2.0 * loading) == pytest.approx(2.0 * factor, abs=1e-12)
    assert rectified(0.0, max(loading, 0.0)) == 0.0


@pytest.mark.parametrize("base", [100.0, 250.0])
def test_compound_source_is_the_phasor_sum_of_voltage_and_current(base):
    exciter = alone("esst3a", base, rectifier_loading=0.0)
    u = dict(zip(exciter.device.inputs, exciter.u[:, 0], strict=True))
    ratio = base / 100.0
    power = complex(u["active_power"], u["reactive_power"]) / ratio
    current = np.conj(power / u["terminal_voltage"])
    k_p = 4.0 * np.exp(1j * np.deg2rad(20.0))
    expected = abs(k_p * u["terminal_voltage"] + 1j * (3.0 + k_p * 0.08) * current)
    at_start = exciter.signals(exciter.x, exciter.u)
    assert at_start["source_voltage"] == pytest.approx(expected, rel=1e-12)


def test_compound_source_has_a_value_without_voltage():
    found = esst3a.compound_voltage(0.0, 0.0, 0.0, 4.0, 4.0, 20.0, 3.0, 0.08)
    k_p = 4.0 * np.exp(1j * np.deg2rad(20.0))
    assert found == pytest.approx(2.0 * abs(3.0 + k_p * 0.08), rel=1e-12)
    assert esst3a.compound_voltage(0.0, 0.0, 0.0, 0.0, 4.0, 20.0, 3.0, 0.08) == 0.0


# --- limits -----------------------------------------------------------------------------------------


def bound(exciter: Alone, name: str, highest: bool) -> float:
    """Limit of the signal `name` at the inputs of the start."""
    u = dict(zip(exciter.device.inputs, exciter.u[:, 0], strict=True))
    side = "maximum" if highest else "minimum"
    value = exciter.value(f"{name}_{side}")
    if exciter.device.model in ("exdc2", "esdc2a", "exst1"):
        value *= u["terminal_voltage"]
    if exciter.device.model == "exst1":
        value -= exciter.value("rectifier_loading") * u["field_current"]
    return value


LIMITED = {
    "ieeet1": ("regulator", "regulator_voltage"),
    "ieeex1": ("regulator", "regulator_voltage"),
    "exdc2": ("regulator", "regulator_voltage"),
    "esdc1a": ("regulator", "regulator_voltage"),
    "esdc2a": ("regulator", "regulator_voltage"),
    "exst1": ("regulator", "field_voltage"),
    "esst3a": ("regulator", "regulated_voltage"),
    "sexs": ("field_voltage", "field_voltage"),
}


@EVERY
@pytest.mark.parametrize("push", [0.6, -0.6])
def test_a_pushed_regulator_stops_at_its_limit_and_leaves_it_at_once(model, push):
    alike = {"lag_time": 0.0, "lead_time": 0.0, "feedback_gain": 0.0}
    wide = {"error_maximum": 1.0, "error_minimum": -1.0}
    known = parameters(model)
    exciter = alone(model, **{k: v for k, v in (alike | wide).items() if k in known})
    name, signal = LIMITED[model]
    limit, away = bound(exciter, name, push > 0), np.sign(push)
    u = exciter.inputs(stabilizer_signal=push)
    states = exciter.run(u, 2.0, step=2e-3)
    values = np.array([exciter.signals(x, u)[signal] for x in states[::20]])
    if signal == "regulator_voltage":
        # What the exciter sees; the state passes the limit by no more than it moves in a step.
        assert (away * (values - limit)).max() < 2e-3 * 40.0 * 0.7 / 0.05
        values = away * np.minimum(away * values, away * limit)
    assert (away * (values - limit)).max() < 1e-12
    assert values[-1] == pytest.approx(limit, abs=1e-9)
    states_of = {"regulated_voltage": "regulator_voltage", "field_voltage": "exciter_voltage"}
    state = states_of.get(signal, signal)
    if state in exciter.device.states:
        back = exciter.inputs(stabilizer_signal=-push)
        assert away * exciter.rates(states[-1], back)[state] < 0


def test_windup_of_exst1_is_that_of_its_lag_and_not_of_its_limit():
    """The lag behind the error limit runs to KA VIMAX = 12, and needs time to come back to VRMAX."""
    exciter = alone("exst1", feedback_gain=0.0)
    u = exciter.inputs(stabilizer_signal=0.6)
    state = exciter.run(u, 15.0, step=5e-3)[-1]
    assert state[2, 0] == pytest.approx(60.0 * 0.2, rel=1e-3)


@pytest.mark.parametrize("model", ["exdc2", "esdc2a"])
def test_limits_of_type_dc2_follow_the_terminal_voltage(model):
    exciter = alone(model, feedback_gain=0.0, regulator_time=0.0, measuring_time=0.0)
    u = exciter.inputs(stabilizer_signal=2.0, terminal_voltage=-0.5)
    v_t = u[0, 0]
    rate = exciter.rates(exciter.x, u)
    field = exciter.signals(exciter.x, u)["field_voltage"]
    slack = alone(model, feedback_gain=0.0)
    at_rest = slack.signals(slack.x, slack.u)["regulator_voltage"]
    name = "exciter_voltage" if model == "esdc2a" else "field_voltage"
    assert rate[name] == pytest.approx((6.0 * v_t - at_rest) / 0.5, rel=1e-9)
    assert field == pytest.approx(slack.signals(slack.x, slack.u)["field_voltage"])


def test_field_voltage_of_esdc2a_is_never_negative_and_that_of_exdc2_may_be():
    lowest = {}
    for model in ("esdc2a", "exdc2"):
        exciter = alone(model)
        u = exciter.inputs(stabilizer_signal=-0.6)
        states = exciter.run(u, 2.0, step=2e-3)
        lowest[model] = min(exciter.signals(x, u)["field_voltage"] for x in states)
    assert lowest["esdc2a"] == pytest.approx(0.0, abs=1e-12)
    assert lowest["exdc2"] < -0.5


def test_inner_feedback_of_esst3a_is_cut_at_its_maximum():
    changes = {"inner_feedback_maximum": 2.5, "regulator_maximum": 2.7, "inner_maximum": 9.0}
    exciter = alone("esst3a", **changes)
    u = exciter.inputs(stabilizer_signal=0.15)
    at_end = exciter.signals(exciter.run(u, 4.0, step=2e-3)[-1], u)
    assert at_end["regulated_voltage"] == pytest.approx(2.7)
    assert 0.9 * at_end["field_voltage"] > 2.5
    assert at_end["inner_voltage"] == pytest.approx(6.0 * (2.7 - 2.5), abs=1e-6)


# --- zero time constants ----------------------------------------------------------------------------

TIMES = ("measuring_time", "regulator_time", "lag_time", "exciter_time", "inner_time")


@EVERY
def test_time_constants_of_zero_act_as_very_small_ones(model):
    own = [name for name in TIMES if name in parameters(model)]
    if model in DC_MODELS:
        own.remove("exciter_time")
    for chosen in [*([name] for name in own), own]:
        zero = dict.fromkeys(chosen, 0.0)
        if "lag_time" in chosen:
            zero["lead_lag_ratio" if model == "sexs" else "lead_time"] = float(model == "sexs")
        without = alone(model, **zero)
        with_small = replace(without, p=without.p.copy())
        for name in chosen:
            with_small.p[without.device.parameter_rows.index(name)] = 1e-8
        assert np.abs(with_small.stages(without.x, without.u)[1]).max() < 1e-2
        for name in ("stabilizer_signal", "terminal_voltage"):
            for s in (0.05j, 1j, 8j):
                expected = with_small.gain(name, s)
                assert without.gain(name, s) == pytest.approx(expected, rel=1e-5)


def test_undelayed_exst1_solves_its_rate_feedback_with_and_without_an_error_limit():
    exciter = alone("exst1", regulator_time=0.0)
    rng = np.random.default_rng(3)
    for push in (0.0, 0.05, 2.0, -2.0):
        x = exciter.x + 0.02 * rng.standard_normal(exciter.x.shape)
        u = exciter.inputs(stabilizer_signal=push)
        v_a = exciter.signals(x, u)["amplified_voltage"]
        error = exciter.value("voltage_reference") + push - x[0, 0]
        v_i = np.clip(error - 0.02 / 0.8 * (v_a - x[3, 0]), -0.15, 0.2)
        assert v_a == pytest.approx(60.0 * (x[1, 0] + 0.4 / 1.5 * (v_i - x[1, 0])), abs=1e-10)


@pytest.mark.parametrize("cut", [6.0, 1.0])
def test_undelayed_inner_loop_of_esst3a_is_solved_with_and_without_its_limits(cut):
    exciter = alone("esst3a", inner_time=0.0)
    exciter.p[exciter.device.parameter_rows.index("inner_feedback_maximum")] = cut
    for v_r in (-8.0, -1.0, 0.5, 2.0, 4.0, 11.0):
        x = exciter.x.copy()
        x[2, 0] = v_r
        found = exciter.signals(x, exciter.u)
        v_g = min(0.9 * found["field_voltage"], cut)
        expected = np.clip(6.0 * (v_r - v_g), -0.5, 1.2) * found["source_voltage"]
        assert found["field_voltage"] == pytest.approx(expected, abs=1e-10)


# --- in the system ----------------------------------------------------------------------------------


@EVERY
def test_machine_returns_to_its_terminal_voltage_after_a_disturbance(model):
    built = gf.build_model(case_with(model), devices=KNOWN)
    assert np.linalg.eigvals(built.jacobian(built.x0)).real.max() < 0
    x = built.x0.copy()
    x[built.slots("speed", built.machines)] += 0.002
    times = np.linspace(0.0, 8.0, 1601)
    states = gf.RungeKutta4(0.005).integrate(built.compiled, times, x).states
    voltage = built.signals(states)[:, built.slots("terminal_voltage", built.machines)]
    assert np.abs(voltage - 1.02).max() > 1e-3
    assert np.abs(voltage[-1] - 1.02).max() < 0.2 * np.abs(voltage - 1.02).max()
