"""The error of the time step, and the step that is right within an error."""

from __future__ import annotations

import pytest

import gridfold as gf
from gridfold.runs.longer_step import difference_deg
from gridfold.runs.step_error import STEPS, choose_step, step_error_deg

EVENTS, T_END = [gf.BusFault(30, duration=0.05)], 3.0


@pytest.fixture(scope="module")
def exact(npcc):
    return gf.simulate(npcc, EVENTS, T_END, gf.RungeKutta4(0.00125))


@pytest.mark.parametrize("stepper", [gf.RungeKutta4, gf.ImplicitTrapezoidal])
def test_the_estimate_is_the_error(npcc, exact, stepper):
    coarse, fine = (gf.simulate(npcc, EVENTS, T_END, stepper(h)) for h in (0.02, 0.01))
    error = difference_deg(exact, coarse)
    assert 0 < error < 5.0
    assert step_error_deg(coarse, fine) == pytest.approx(error, rel=0.15)


@pytest.mark.parametrize("allowed", [0.5, 0.02, 1e-4])
def test_the_step_is_the_longest_within_what_is_allowed(npcc, exact, allowed):
    choice = choose_step(npcc, EVENTS, "rk4", allowed_deg=allowed, t_end=T_END)
    step = choice.stepper.step
    error = difference_deg(exact, gf.simulate(npcc, EVENTS, T_END, choice.stepper))
    assert error <= 1.1 * allowed
    if step < STEPS[0]:
        longer = gf.choose_stepper(npcc, "rk4", 2 * step)
        if not longer.doubts:
            run = gf.simulate(npcc, EVENTS, T_END, longer.stepper)
            assert difference_deg(exact, run) > 0.9 * allowed


def test_a_step_longer_than_the_fault_is_not_tried(npcc):
    events = [gf.BusFault(30, duration=0.004)]
    assert choose_step(npcc, events, allowed_deg=10.0, t_end=1.0).stepper.step <= 0.004


def test_what_no_step_can_do_is_said(npcc):
    with pytest.raises(gf.OptionError, match=r"right within 1e-12 degrees: the smallest error was"):
        choose_step(npcc, EVENTS, allowed_deg=1e-12, t_end=1.0)


def test_a_run_that_loses_synchronism_has_a_step_too(npcc):
    lost = [gf.BusFault(30, duration=0.3)]
    choice = choose_step(npcc, lost, allowed_deg=0.05, t_end=T_END)
    assert gf.simulate(npcc, lost, T_END, choice.stepper).status is gf.Status.LOST_SYNCHRONISM
