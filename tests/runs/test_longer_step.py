"""For many runs a longer step, where trial runs show that its error is small."""

from __future__ import annotations

import numpy as np
import pytest

import gridfold as gf
from gridfold.runs.longer_step import LARGEST_ERROR_DEG, PAYS_FROM, choose_for_many

CENTRE = gf.AngleReference.CENTRE_OF_INERTIA
FAULTS = [(gf.BusFault(bus),) for bus in range(36, 36 + PAYS_FROM)]


def test_many_runs_take_the_longer_step_and_keep_its_promise(npcc: gf.DetailedModel) -> None:
    """The angles of a fault that was not tried, against SciPy's integrator."""
    choice = choose_for_many(npcc, FAULTS, t_end=5.0)
    assert choice.stepper.step == 0.02
    assert "in 4 trial runs" in choice.reason
    events = FAULTS[1]
    runs = [
        gf.simulate(npcc, events, 5.0, rule)
        for rule in (choice.stepper, gf.ScipyReference(step=0.02))
    ]
    ours, exact = (run.rotor_angle_deg(None, CENTRE) for run in runs)
    assert np.sqrt(((ours - exact) ** 2).mean(axis=0)).max() < LARGEST_ERROR_DEG


@pytest.mark.parametrize(
    ("faults", "options"),
    [
        (FAULTS[:-1], {}),
        (FAULTS, {"method": "rk4"}),
        (FAULTS, {"step": 0.01}),
        (FAULTS, {"runs": PAYS_FROM - 1}),
    ],
    ids=["few", "method by name", "step by name", "few runs"],
)
def test_else_nothing_changes(npcc: gf.DetailedModel, faults, options) -> None:
    choice = choose_for_many(npcc, faults, t_end=1.0, **options)
    assert (choice.stepper.name, choice.stepper.step) == ("rk4", 0.01)


def test_nothing_is_concluded_from_runs_that_lose_synchronism(npcc: gf.DetailedModel) -> None:
    long_faults = [(gf.BusFault(bus, duration=1.0),) for bus in range(1, 1 + PAYS_FROM)]
    choice = choose_for_many(npcc, long_faults, t_end=3.0)
    assert choice.stepper.name == "rk4"


def test_an_error_above_the_bound_keeps_the_short_step(
    npcc: gf.DetailedModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("gridfold.runs.longer_step.LARGEST_ERROR_DEG", 1e-9)
    assert choose_for_many(npcc, FAULTS, t_end=2.0).stepper.name == "rk4"


def test_the_cheapest_rule_that_is_exact_enough_is_taken(npcc: gf.DetailedModel) -> None:
    """Behind a weak fault the angles hardly move, so that two evaluations in 0.02 s do."""
    weak = [(gf.BusFault(bus, resistance=0.5),) for bus in range(36, 36 + PAYS_FROM)]
    assert choose_for_many(npcc, weak, t_end=2.0).stepper.name == "abm4"
    assert choose_for_many(npcc, FAULTS, t_end=5.0).stepper.name == "rk4"


def test_a_step_longer_than_one_of_the_faults_is_not_taken(npcc: gf.DetailedModel) -> None:
    weak = [(gf.BusFault(bus, resistance=0.5),) for bus in range(36, 36 + PAYS_FROM)]
    brief = (gf.BusFault(3, duration=0.015, resistance=0.5),)
    assert choose_for_many(npcc, [*weak, brief], t_end=2.0).stepper == gf.RungeKutta4(0.01)
