"""The bisection of a clearing time, and what it may ask for next."""

from __future__ import annotations

import random

import pytest

import gridfold as gf
from gridfold.runs.clearing.search import Search, TimeGrid
from gridfold.runs.clearing.trials import Trial, Trials, Verdict

STABLE, LOST = gf.Status.COMPLETED, gf.Status.LOST_SYNCHRONISM
GRID = TimeGrid(resolution=0.01, longest=0.4, t_end=1.0)


def asked(search: Search, stable: dict[int, bool]) -> tuple[Search, list[int]]:
    """The bisection with these verdicts, and the trials that it asks for."""
    trials = []
    while (steps := search.trial) is not None:
        trials.append(steps)
        search = search.after(stable[steps])
    return search, trials


@pytest.mark.parametrize("critical", [0, 1, 15, 16, 17, 39, 40])
def test_a_bisection_finds_the_last_stable_step_of_the_grid(critical):
    found, trials = asked(GRID.search, {steps: steps <= critical for steps in range(1, 41)})
    assert (found.low, found.lost) == (critical, critical < 40)
    assert len(trials) == len(set(trials)) <= 7


def test_all_that_a_bisection_may_ask_for_is_ahead_and_nothing_twice():
    ahead = list(GRID.search.ahead({}))
    assert len(ahead) == len(set(ahead)) == 40
    assert ahead[0] == GRID.search.trial
    assert next(GRID.search.ahead({16: False})) == 8
    assert (
        list(GRID.search.ahead({16: True, 32: False, 24: True, 28: True, 30: True, 31: True})) == []
    )


def test_trials_in_any_order_give_the_time_of_the_bisection_though_stability_is_not_monotonous():
    draw = random.Random(4)
    for _ in range(60):
        verdicts = [{steps: draw.random() < 0.6 for steps in range(1, 41)} for _ in range(3)]
        alone = [asked(GRID.search, stable)[0] for stable in verdicts]
        trials = Trials([gf.BusFault(bus) for bus in range(3)], GRID)
        flying, handed_out = [], []
        while True:
            while len(flying) < 8 and (trial := trials.due() or trials.ahead()):
                flying.append(trial)
                handed_out.append(trial)
            if not flying:
                break
            trial = flying.pop(draw.randrange(len(flying)))
            trials.take(trial, Verdict(STABLE if verdicts[trial.place][trial.steps] else LOST))
        assert len(handed_out) == len(set(handed_out))
        found = [(item.seconds, item.bounded) for item in trials.found]
        assert found == [(GRID.seconds(end.low), end.lost) for end in alone]
        assert sum(item.runs for item in trials.found) <= len(handed_out)


def test_a_trial_without_a_run_ends_its_place_only_if_the_bisection_asks_for_it():
    trials = Trials([gf.BusFault(1), gf.BusFault(2)], GRID)
    wrong = Verdict(None, reason="the network is singular")
    for place in (0, 1):
        assert trials.due() == (place, 16)
    later = [trials.ahead(), trials.ahead()]
    assert later == [(0, 32), (1, 32)]
    assert not any(trials.take(trial, wrong) for trial in later)
    assert trials.take(Trial(0, 16), Verdict(STABLE))
    assert trials.found[0].reason == "the network is singular"
    assert not trials.take(Trial(1, 16), Verdict(LOST))
    while (trial := trials.due()) is not None:
        trials.take(trial, Verdict(LOST))
    assert (trials.found[1].seconds, trials.found[1].lost_at) == (0.0, 0.01)
