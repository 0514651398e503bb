from __future__ import annotations

from dataclasses import replace

import pytest
from row_of_areas import row_of_areas

import gridfold as gf
from gridfold.equivalents import auto
from gridfold.equivalents.auto import Work, choose_model
from gridfold.equivalents.choice import ModelSettings, RetainSettings
from gridfold.equivalents.families import Mode
from gridfold.equivalents.ladder import Ladder
from gridfold.equivalents.model_kind import ModelKind

SETTINGS = ModelSettings(ModelKind.ADAPTIVE)
#: A step of each rung costs this part of a detailed one.
PARTS = {Mode.DETAILED: 1.0, Mode.RETAINED: 0.6, Mode.LINEAR: 0.3, Mode.WHOLE: 0.1}


@pytest.fixture(scope="module")
def parts():
    return gf.partition(gf.build_model(row_of_areas()), range(11, 16))


def choose(settings, model, parts, work):
    return choose_model(settings, model, parts, work, gf.RungeKutta4())


@pytest.fixture
def costs(monkeypatch):
    """Steps of the detailed model take a second, those of the rungs what `PARTS` says."""
    monkeypatch.setattr(auto, "step_seconds", lambda *_: 1.0)

    def measured(ladder, stepper):
        return replace(ladder, step_seconds={m: PARTS[m] for m in (Mode.DETAILED, *ladder.rungs)})

    monkeypatch.setattr(Ladder, "measured", measured)


def test_without_a_study_area_the_model_is_detailed(parts):
    found = choose(SETTINGS, parts.model, None, Work(1000, 1600))
    assert (found.kind, found.family) == (ModelKind.DETAILED, None)
    assert found.reason == "no study area is given"


def test_a_reduction_that_cannot_pay_is_not_begun(parts, monkeypatch):
    monkeypatch.setattr(auto, "step_seconds", lambda *_: 1e-5)
    monkeypatch.setattr(ModelSettings, "build", None)
    states = len(parts.states_of(parts.external_units))
    found = choose(SETTINGS, parts.model, parts, Work(1, 1600))
    assert (found.kind, found.family) == (ModelKind.DETAILED, None)
    seconds = f"{auto.SECONDS_PER_STATE[0] * states:.2g}"
    assert found.reason == (
        "1 detailed run takes about 0.016 s; "
        f"to reduce {states} external states would take about {seconds} s"
    )


def test_the_ladder_is_chosen_where_it_is_predicted_to_pay(parts, costs):
    settings = replace(SETTINGS, retain=RetainSettings(count=1))
    found = choose(settings, parts.model, parts, Work(10, 100))
    assert found.kind is ModelKind.ADAPTIVE
    assert found.family.modes == (Mode.RETAINED, Mode.LINEAR, Mode.WHOLE)
    assert found.reason == (
        "10 detailed runs take about 1e+03 s; "
        "the ladder is predicted to take 3.3e+02 s, 0.33 of the detailed model a step"
    )


@pytest.mark.parametrize(("topologies", "kind"), [(1, "adaptive"), (2, "detailed")])
def test_two_detailed_runs_for_each_new_topology_count(parts, costs, topologies, kind):
    # Of 10 runs the ladder takes 3.3, and 2 for each topology; 8 are what it may take.
    settings = replace(SETTINGS, retain=RetainSettings(count=1))
    work = Work(10, 100, topologies=2 * topologies)
    found = choose(settings, parts.model, parts, work)
    expected = 10 * 100 * 1 / 3 + 2 * 2 * topologies * 100
    assert f"predicted to take {expected:.2g} s" in found.reason
    assert found.kind.value == kind
    assert (found.family is None) is (kind == "detailed")


def test_rungs_that_do_not_pay_count_as_those_that_stand_for_them(parts, costs, monkeypatch):
    monkeypatch.setitem(PARTS, Mode.RETAINED, 2.0)
    monkeypatch.setitem(PARTS, Mode.LINEAR, 2.0)
    settings = replace(SETTINGS, retain=RetainSettings(count=1))
    found = choose(settings, parts.model, parts, Work(10, 100))
    assert "predicted to take 7e+02 s, 0.70 of the detailed model" in found.reason
    assert found.family.modes == (Mode.DETAILED, Mode.DETAILED, Mode.WHOLE)


def test_an_area_that_cannot_be_reduced_leaves_the_model_detailed(parts, costs):
    every = ",".join(str(unit.bus) for unit in parts.external_units)
    settings = replace(SETTINGS, retain=RetainSettings(buses=every))
    found = choose(settings, parts.model, parts, Work(10, 100))
    assert (found.kind, found.family) == (ModelKind.DETAILED, None)
    assert found.reason == (
        "the external area cannot be reduced: all external machines are retained: none is left to be "
        "linear"
    )


TOLERANT = replace(SETTINGS, retain=RetainSettings(count=1), tolerance_deg=0.5)


class Tolerant:
    """In the place of a model that keeps a tolerance: it has rungs, and a cost that was measured."""

    told = "why all runs are detailed"

    def __init__(self, share, rules=("a rung",)):
        self.share, self.rules = share, rules

    def __call__(self, family, tolerance):
        assert tolerance == TOLERANT.tolerance_deg
        return self


@pytest.mark.parametrize(("share", "kind"), [(0.5, "adaptive"), (1.2, "detailed")])
def test_estimates_and_attempts_count_within_a_tolerance(parts, costs, monkeypatch, share, kind):
    """Of 10 runs 4 lead to another topology, and are detailed: 6 * share + 4 of 10."""
    monkeypatch.setattr(auto, "TolerantModel", found := Tolerant(share))
    chosen = choose(TOLERANT, parts.model, parts, Work(10, 100, topologies=4))
    assert chosen.kind.value == kind
    assert (chosen.tolerant is found) is (kind == "adaptive")
    assert "the ladder, its estimates and attempts that miss the tolerance" in chosen.reason
    assert f"take {100 * (6 * share + 4):.2g} s, {share:.2f} of the detailed model" in chosen.reason


def test_where_no_rung_keeps_the_tolerance_the_model_is_detailed(parts, costs, monkeypatch):
    monkeypatch.setattr(auto, "TolerantModel", Tolerant(1.0, ()))
    found = choose(TOLERANT, parts.model, parts, Work(10, 100))
    assert (found.kind, found.family) == (ModelKind.DETAILED, None)
    assert found.reason.endswith("; why all runs are detailed")


@pytest.mark.parametrize(
    ("settings", "work", "told"),
    [
        (TOLERANT, Work(10, 100, topologies=10), "all runs lead to another topology"),
        (replace(TOLERANT, tolerance_deg=0.0), Work(10, 100), "with a tolerance of 0 degrees"),
    ],
    ids=["topologies", "zero"],
)
def test_what_is_detailed_anyway_is_not_reduced(parts, monkeypatch, settings, work, told):
    monkeypatch.setattr(ModelSettings, "build", None)
    found = choose(settings, parts.model, parts, work)
    assert found.kind is ModelKind.DETAILED
    assert told in found.reason
