"""Steps that do not suit a model or a fault: chosen by default, warned of, or refused."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace

import numpy as np
import pytest
from cases import POWER_MW, X_GRID, X_LINE, X_MACHINE, H, one_machine_infinite_bus
from row_of_areas import row_of_areas

import gridfold as gf
from gridfold.dynamics import model as model_module
from gridfold.equivalents.calibrate import ThresholdKind
from gridfold.runs.method import LONGEST_STEP, SHORTEST_STEP, STEPS_A_SWING
from gridfold.study.study_file import parse_study

FAULT = gf.BusFault(15, duration=0.1)
EXPLICIT = gf.RungeKutta4()


@pytest.fixture(scope="module")
def stiff() -> gf.DetailedModel:
    """Two areas whose voltages are measured within 2 ms: Runge-Kutta at 10 ms is lost at once."""
    return gf.build_model(row_of_areas(2, measuring_time=0.002))


@pytest.fixture(scope="module")
def parts(stiff: gf.DetailedModel) -> gf.Partition:
    return gf.partition(stiff, range(11, 16))


@pytest.fixture(scope="module")
def reduced(parts: gf.Partition):
    return gf.reduce(parts)


@pytest.fixture(scope="module")
def swinging() -> gf.DetailedModel:
    """A classical machine on an infinite bus, which swings every 0.7 s."""
    return gf.build_model(one_machine_infinite_bus())


def test_a_run_without_a_stepper_takes_the_one_that_suits(stiff):
    run = gf.simulate(stiff, [FAULT], 2.0)
    fine = gf.simulate(stiff, [FAULT], 2.0, stepper=gf.RungeKutta4(0.001))
    assert run.stepper == gf.choose_stepper(stiff).stepper == gf.ImplicitTrapezoidal(0.01)
    assert run.metadata()["method_reason"] == gf.choose_stepper(stiff).reason
    assert np.abs(run.rotor_angle_deg()[-1] - fine.rotor_angle_deg()[-1]).max() < 0.1


def test_a_clearing_time_without_a_stepper_is_that_of_a_fine_one(stiff):
    found = gf.critical_clearing_time(stiff, FAULT, 0.02, t_end=3.0)
    fine = gf.critical_clearing_time(stiff, FAULT, 0.02, t_end=3.0, stepper=gf.RungeKutta4(0.002))
    assert found.seconds == pytest.approx(fine.seconds, abs=0.021)
    assert found.seconds > 0.1


CALLS: dict[str, Callable[..., object]] = {
    "simulate": lambda parts, family, **way: gf.simulate(parts.model, [FAULT], 0.3, **way),
    "clearing time": lambda parts, family, **way: gf.critical_clearing_time(
        parts.model, FAULT, 0.05, 0.1, 0.3, **way
    ),
    "clearing times": lambda parts, family, **way: gf.critical_clearing_times(
        parts.model, [FAULT], 1, resolution=0.05, longest=0.1, t_end=0.3, **way
    ),
    "adaptive": lambda parts, family, **way: gf.simulate_adaptive(
        parts.model, family, gf.SwitchingRule(0.0), [FAULT], 0.3, **way
    ),
    "error budget": lambda parts, family, **way: gf.error_budget(
        family, gf.SwitchingRule(0.0), [FAULT], 0.12, **way
    ),
    "calibrate": lambda parts, family, **way: gf.calibrate(
        parts, [FAULT], 0.6, what=[ThresholdKind.COLUMN_NORM], limit_deg=1e3, workers=1, **way
    ),
}


@pytest.mark.parametrize("name", CALLS)
def test_every_function_with_a_stepper_is_silent_without_and_warns_of_one_that_is_unstable(
    parts, reduced, name
):
    CALLS[name](parts, reduced)  # warnings are errors here
    message = r"mode -\d+ 1/s in measured_voltage of exdc2"
    # The unstable rule may leave no contingency that is stable.
    with pytest.warns(gf.StepWarning, match=message), suppress(gf.OptionError):
        CALLS[name](parts, reduced, stepper=EXPLICIT)


def test_sample_swings_take_the_stepper_that_suits(parts):
    ladder = gf.Ladder((gf.fold(parts),))
    assert all(np.isfinite(list(ladder.measured().step_seconds.values())))
    with pytest.warns(gf.StepWarning, match="measured_voltage"):
        ladder.measured(EXPLICIT)


def test_a_run_with_a_stepper_that_does_not_suit_has_a_notice_of_it(stiff):
    with pytest.warns(gf.StepWarning) as told:
        run = gf.simulate(stiff, [FAULT], 0.3, stepper=EXPLICIT)
    assert told[0].filename == __file__
    assert run.notices[0].text == str(told[0].message)
    assert "needs at most 0.0055 s" in run.notices[0].text


def test_the_model_is_looked_at_once(stiff, monkeypatch):
    looks = []
    find = model_module.find_fast_modes
    monkeypatch.setattr(
        model_module, "find_fast_modes", lambda *args: looks.append(1) or find(*args)
    )
    model = replace(stiff)
    for _ in range(3):
        gf.simulate(model, [FAULT], 0.2)
    assert len(looks) == 1


def test_the_fastest_swing_of_one_machine_is_that_of_the_textbook(swinging):
    """omega^2 = omega_0 E V cos(delta) / (X 2 H), with delta between E and the infinite bus."""
    flow = swinging.power_flow
    current = np.conj(POWER_MW / 100 + 1j * flow.unit_power[0].imag) / np.conj(flow.voltage[0])
    inner = flow.voltage[0] + 1j * X_MACHINE * current
    other = flow.voltage[0] - 1j * (X_LINE + X_GRID) * current
    stiffness = abs(inner) * abs(other) * np.cos(np.angle(inner / other))
    stiffness /= X_MACHINE + X_LINE + X_GRID
    omega = math.sqrt(2 * math.pi * 60 * stiffness / (2 * H))
    assert swinging.fast_modes.swing_period == pytest.approx(2 * math.pi / omega, rel=1e-9)


def test_the_fastest_swing_of_many_machines_is_the_largest_eigenvalue_of_their_torques(npcc):
    angles = npcc.slots("rotor_angle", npcc.machines)
    speeds = npcc.slots("speed", npcc.machines)
    torques = 2 * math.pi * 60 * npcc.jacobian(npcc.x0)[np.ix_(speeds, angles)]
    largest = np.abs(np.linalg.eigvals(torques)).max()
    period = npcc.fast_modes.swing_period
    assert period == pytest.approx(2 * math.pi / math.sqrt(largest), rel=0.05)
    assert period >= 2 * math.pi / math.sqrt(largest) * 0.999


@pytest.mark.parametrize("kind", [gf.RungeKutta4, gf.ImplicitTrapezoidal])
def test_a_step_longer_than_a_tenth_of_the_fastest_swing_is_coarse(swinging, kind):
    longest = swinging.fast_modes.swing_period / STEPS_A_SWING
    gf.simulate(swinging, [], 1.0, stepper=kind(0.99 * longest))
    with pytest.warns(gf.StepWarning, match=r"is coarse: .* take at most 0\.0\d+ s"):
        run = gf.simulate(swinging, [], 1.0, stepper=kind(1.01 * longest))
    assert "coarse" in run.notices[0].text


def test_the_choice_tells_of_a_coarse_step_that_was_asked_for(swinging):
    assert gf.choose_stepper(swinging).doubts == ()
    (doubt,) = gf.choose_stepper(swinging, "trapezoidal", 0.5).doubts
    assert doubt.startswith("trapezoidal at 0.5 s is coarse")


def test_a_step_longer_than_the_shortest_fault_is_told(swinging):
    faults = [gf.BusFault(1, duration=0.1), gf.BusFault(1, start=0.5, duration=0.02)]
    gf.simulate(swinging, faults, 1.0, stepper=gf.RungeKutta4(0.02))
    with pytest.warns(gf.StepWarning, match="longer than the shortest fault of 0.02 s"):
        run = gf.simulate(swinging, faults, 1.0, stepper=gf.RungeKutta4(0.03))
    assert "shortest fault" in run.notices[0].text


@pytest.mark.parametrize("stepper", [gf.ImplicitTrapezoidal(0.5, 1e-4), gf.ScipyReference(0.5)])
def test_a_stepper_that_finds_its_own_steps_may_have_samples_far_apart(swinging, stepper):
    run = gf.simulate(swinging, [gf.BusFault(1, duration=0.05)], 1.0, stepper=stepper)
    assert not any("step" in notice.text for notice in run.notices)


@pytest.mark.parametrize("step", [1e300, 1e-300, 1.001, 9e-7])
def test_steps_that_make_no_sense_are_refused_from_python_and_in_study_files(swinging, step):
    limits = f"between {SHORTEST_STEP:g} and {LONGEST_STEP:g} s"
    for kind in (gf.RungeKutta4, gf.ImplicitTrapezoidal, gf.ScipyReference):
        with pytest.raises(gf.OptionError, match=limits):
            gf.simulate(swinging, [], 1.0, stepper=kind(step))
    for method in ("auto", "trapezoidal"):
        with pytest.raises(gf.OptionError, match=limits):
            gf.choose_stepper(swinging, method, step)
    with pytest.raises(gf.CaseFileError, match=r"run\.step"):
        parse_study({"run": {"step": step}})


@pytest.mark.parametrize("step", [0, -0.01, math.nan, math.inf, "0.01", None, True])
def test_what_is_no_step_at_all_is_refused_where_it_is_given(step):
    with pytest.raises(gf.OptionError, match="positive number of seconds"):
        gf.RungeKutta4(step)


@pytest.mark.parametrize("stepper", ["rk4", 0.01])
def test_what_is_no_stepper_is_refused_with_one_that_is(swinging, stepper):
    with pytest.raises(gf.OptionError, match=r"such as RungeKutta4\(step=0.01\)"):
        gf.simulate(swinging, [], 1.0, stepper=stepper)
