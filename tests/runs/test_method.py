"""Fastest modes, and the integration rule that suits them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np
import pytest
from cases import one_machine_infinite_bus

import gridfold as gf
from gridfold.dynamics.fast_modes import find_fast_modes
from gridfold.runs.method import Method, choose_stepper

AMPLIFIER_TIME = 0.0008
TWO_AXIS = {
    "inertia": 3.0, "damping": 2.0, "resistance": 0.0, "d_reactance": 1.8, "q_reactance": 1.7,
    "d_transient_reactance": 0.3, "q_transient_reactance": 0.3, "d_open_circuit_time": 6.0,
    "q_open_circuit_time": 0.5,
}  # fmt: skip
SEXS = {
    "lead_lag_ratio": 0.1, "lag_time": 5.0, "regulator_gain": 20.0, "exciter_time": 0.0008,
    "field_voltage_minimum": -4.0, "field_voltage_maximum": 6.0,
}  # fmt: skip
IEEET1 = {
    "measuring_time": 0.001, "regulator_gain": 200.0, "regulator_time": 0.02,
    "regulator_maximum": 9.0, "regulator_minimum": -9.0, "exciter_gain": 1.0, "exciter_time": 0.3,
    "feedback_gain": 0.03, "feedback_time": 1.0, "saturation_voltage_1": 0.0, "saturation_1": 0.0,
    "saturation_voltage_2": 0.0, "saturation_2": 0.0,
}  # fmt: skip


def changed(
    case: gf.Case, model: str, units: Iterable[str], values: Mapping[str, float]
) -> gf.Case:
    """The case with other parameters of some units."""
    chosen = set(units)
    devices = tuple(
        replace(record, parameters={**record.parameters, **values})
        if record.model == model and str(record.key) in chosen
        else record
        for record in case.devices
    )
    return replace(case, devices=devices)


def one_machine(exciter: gf.DeviceRecord) -> gf.DetailedModel:
    """A machine with an exciter on an infinite bus."""
    case = one_machine_infinite_bus()
    machine = gf.DeviceRecord("two_axis", 1, "1", TWO_AXIS)
    return gf.build_model(replace(case, devices=(machine, exciter, case.devices[1])))


@pytest.fixture(scope="module")
def stiff() -> gf.DetailedModel:
    """The NPCC system with one amplifier that is far too fast for explicit rules."""
    case = changed(gf.load_case("npcc"), "ieee_type1", ["23:1"], {"regulator_time": AMPLIFIER_TIME})
    return gf.build_model(case)


@pytest.fixture(scope="module")
def small() -> gf.DetailedModel:
    """One machine on an infinite bus with a fast exciter."""
    return one_machine(gf.DeviceRecord("sexs", 1, "1", SEXS))


def test_the_fastest_modes_are_those_of_the_whole_spectrum(npcc, stiff, small):
    for model in (npcc, stiff, small):
        everything = gf.small_signal(model).eigenvalues
        largest = np.sort(np.abs(everything))[::-1]
        modes = model.fast_modes.modes
        np.testing.assert_allclose(abs(modes[0].eigenvalue), largest[0], rtol=1e-5)
        for mode in modes:
            nearest = np.abs(everything - mode.eigenvalue).min()
            assert nearest < 1e-4 * abs(mode.eigenvalue)
        sizes = [abs(mode.eigenvalue) for mode in modes]
        assert sizes == sorted(sizes, reverse=True)


def test_a_mode_is_at_home_where_its_participation_factor_is_largest(stiff, small):
    for model in (stiff, small):
        analysis = gf.small_signal(model)
        for mode in model.fast_modes.modes[:2]:
            column = int(np.argmin(np.abs(analysis.eigenvalues - mode.eigenvalue)))
            factor = analysis.participation[model.state_names.index(mode.state), column]
            assert factor > 0.99


def test_a_fast_transducer_is_not_mistaken_for_the_regulator_behind_it():
    """The regulator swings more than the transducer, but it is not what makes the mode fast."""
    model = one_machine(gf.DeviceRecord("ieeet1", 1, "1", IEEET1))
    values, vectors = np.linalg.eig(model.jacobian(model.x0))
    fastest = int(np.argmax(np.abs(values)))
    assert values[fastest] == pytest.approx(-1000, rel=1e-2)
    largest = model.state_names[int(np.argmax(np.abs(vectors[:, fastest])))]
    assert largest == "regulator_voltage:1:1"
    assert model.fast_modes.modes[0].state == "measured_voltage:1:1"


def test_modes_that_nearly_coincide_are_found_as_well():
    """All 48 amplifiers alike: their modes differ by a part in a million."""
    case = gf.load_case("npcc")
    units = [str(record.key) for record in case.devices]
    model = gf.build_model(changed(case, "ieee_type1", units, {"regulator_time": 0.003}))
    fastest = gf.small_signal(model).eigenvalues
    for mode in model.fast_modes.modes:
        assert mode.eigenvalue == pytest.approx(fastest[np.argmax(np.abs(fastest))], rel=1e-4)
        assert mode.eigenvalue.imag == 0
        assert mode.state.startswith("regulator_voltage:")
    assert choose_stepper(model).stepper.name == "trapezoidal"


def test_the_same_model_gives_the_same_modes_every_time(npcc):
    assert npcc.fast_modes.modes == npcc.fast_modes.modes


def test_a_model_without_states_gets_the_default():
    case = one_machine_infinite_bus()
    grid = gf.DeviceRecord("infinite_bus", 1, "1", {"reactance": 0.3})
    model = gf.build_model(replace(case, devices=(grid, case.devices[1])))
    assert model.fast_modes.modes == ()
    assert choose_stepper(model).stepper == gf.RungeKutta4()


def test_automatic_choice_is_runge_kutta_where_that_is_stable(npcc):
    choice = choose_stepper(npcc)
    assert choice.stepper == gf.RungeKutta4(0.01)
    assert choice.reason.startswith("rk4: fastest mode -1.07 ± 18.4j 1/s (")
    assert choice.reason.endswith(":26:1) is stable at 0.01 s")


def test_automatic_choice_is_the_trapezoidal_rule_where_it_is_not(stiff):
    choice = choose_stepper(stiff)
    assert choice.stepper == gf.ImplicitTrapezoidal(0.01)
    assert choice.reason == (
        "trapezoidal: rk4 at 0.01 s would be unstable, mode -1240 1/s in regulator_voltage of "
        "ieee_type1 23:1 needs at most 0.0022 s"
    )
    assert choose_stepper(stiff, Method.AUTO, 0.002).stepper == gf.RungeKutta4(0.002)


@pytest.mark.parametrize(("method", "step"), [("rk4", None), ("abm4", None), ("rk4", 0.005)])
def test_an_unstable_method_asked_for_by_name_is_refused_with_the_device(small, method, step):
    with pytest.raises(gf.OptionError) as error:
        choose_stepper(small, method, step)
    text = str(error.value)
    assert f"{method} at " in text
    assert "exciter_voltage of sexs 1:1" in text
    assert "trapezoidal" in text


@pytest.mark.parametrize("method", ["rk4", "abm4"])
def test_the_step_named_in_the_refusal_is_the_largest_one_that_is_accepted(small, method):
    with pytest.raises(gf.OptionError) as error:
        choose_stepper(small, method)
    step = float(str(error.value).partition("needs at most ")[2].partition(" s;")[0])
    assert choose_stepper(small, method, step).stepper.step == step
    with pytest.raises(gf.OptionError):
        choose_stepper(small, method, 1.1 * step)


def test_the_verdict_is_that_of_the_run(stiff):
    """Runge-Kutta just above the limit amplifies a disturbance a millionfold, below it does not."""
    limit = 2.785 * AMPLIFIER_TIME
    start = stiff.x0.copy()
    state = stiff.state_names.index("regulator_voltage:23:1")
    start[state] += 1e-6
    sizes = []
    for step in (0.97 * limit, 1.03 * limit):
        times = step * np.arange(201)
        states = gf.RungeKutta4(step).integrate(stiff.compiled, times, start).states
        sizes.append(abs(states[-1, state] - stiff.x0[state]))
    assert sizes[0] < 1e-6
    assert sizes[1] > 1e-2
    assert isinstance(choose_stepper(stiff, step=0.97 * limit).stepper, gf.RungeKutta4)
    assert isinstance(choose_stepper(stiff, step=1.03 * limit).stepper, gf.ImplicitTrapezoidal)


def test_the_trapezoidal_rule_is_taken_as_asked_for(stiff):
    assert choose_stepper(stiff, "trapezoidal").stepper == gf.ImplicitTrapezoidal()
    assert choose_stepper(stiff, "trapezoidal", 0.1).stepper == gf.ImplicitTrapezoidal(0.1)


def test_an_instability_of_the_system_itself_is_no_reason_against_a_method():
    """A strong, slow regulator: the machine's own swing grows, whatever the rule."""
    exciter = SEXS | {"regulator_gain": 400.0, "exciter_time": 0.2, "lead_lag_ratio": 1.0}
    model = one_machine(gf.DeviceRecord("sexs", 1, "1", exciter))
    assert gf.small_signal(model).rightmost.real > 0.5
    for method, name in (("auto", "rk4"), ("rk4", "rk4"), ("abm4", "abm4")):
        assert choose_stepper(model, method).stepper.name == name


def test_unknown_methods_and_steps_are_refused(npcc):
    with pytest.raises(gf.OptionError, match="no method 'euler'"):
        choose_stepper(npcc, "euler")
    for method in Method:
        with pytest.raises(gf.OptionError, match="time step"):
            choose_stepper(npcc, method, -1.0)


def test_of_a_large_system_each_unit_is_looked_at_alone(stiff: gf.DetailedModel) -> None:
    """At constant voltage the amplifier of NPCC's unit 23:1 is the fastest there too."""
    found = find_fast_modes(stiff.partials(stiff.x0), None, stiff.layout)
    exact = np.linalg.eigvals(stiff.partials(stiff.x0).states.toarray())
    sizes = np.sort(np.abs(exact))[::-1]
    assert abs(found.modes[0].eigenvalue) == pytest.approx(sizes[0], rel=1e-9)
    assert abs(found.modes[0].eigenvalue) == pytest.approx(1 / AMPLIFIER_TIME, rel=0.01)
    assert "ieee_type1 23:1" in str(found.modes[0])
    assert found.swing_period == np.inf
