"""The model of simulate and cct: what is told of one that was chosen, and options of ladders."""

from __future__ import annotations

import json

import numpy as np
import pytest

import gridfold as gf
from gridfold.equivalents.choice import ModelSettings, ReductionSettings, RetainSettings
from gridfold.equivalents.model_kind import ModelKind, Weights
from gridfold.equivalents.ranking import rank_retained

SHORT = ("--fault-bus", 3, "--fault-duration", 0.2, "--t-end", 1)


def record(command, *arguments):
    """The JSON that a command prints."""
    code, out, err = command(*arguments, "--json", "-")
    assert (code, err) == (0, "")
    return json.loads(out)


def plain(text):
    """Text without the line breaks of the terminal."""
    return " ".join(text.split())


@pytest.fixture
def long_steps(monkeypatch, falling_costs):
    """A step of the detailed model is said to take a second, so that a reduction pays."""
    monkeypatch.setattr("gridfold.equivalents.auto.step_seconds", lambda *_: 1.0)


def test_one_run_is_made_on_the_detailed_model_and_that_is_said(command):
    facts = record(command, "simulate", "npcc", *SHORT)
    assert facts["model"] == "detailed"
    assert facts["model_reason"].startswith("1 detailed run takes about ")
    assert "to reduce 351 external states would take about 1.1 s" in facts["model_reason"]
    assert "switches" not in facts
    code, out, _ = command("simulate", "npcc", *SHORT)
    assert code == 0
    assert "Model detailed: 1 detailed run takes about" in plain(out)


def test_errors_of_a_run_that_is_detailed_itself_are_not_told_and_why(command):
    facts = record(command, "simulate", "npcc", *SHORT, "--compare")
    assert facts["model"] == "detailed"
    assert facts["comparison"] is None
    assert facts["comparison_note"] == "No comparison: the run itself is detailed."
    _, out, _ = command("simulate", "npcc", *SHORT, "--compare")
    assert "No comparison: the run itself is detailed." in plain(out)


def test_where_no_study_area_is_known_the_model_is_detailed(command, tmp_path):
    (tmp_path / "case.toml").write_text('name = "mine"\nextends = "npcc"\n')
    facts = record(command, "simulate", tmp_path, *SHORT)
    assert (facts["model"], facts["model_reason"]) == ("detailed", "no study area is given")
    facts = record(command, "simulate", tmp_path, *SHORT, "--study-buses", "1-36")
    assert "to reduce 351 external states" in facts["model_reason"]


@pytest.mark.parametrize("option", [("--study-buses", "1-36"), ("--study-areas", 1)])
def test_a_study_area_beside_the_detailed_model_is_accepted_and_told(command, option):
    facts = record(command, "simulate", "npcc", *SHORT, "--model", "detailed", *option)
    said = f"{option[0]} has no effect on the detailed model"
    assert (facts["model"], facts["model_reason"]) == ("detailed", said)
    _, out, _ = command("simulate", "npcc", *SHORT, "--model", "detailed", *option)
    assert f"Model detailed: {said}" in plain(out)
    plainly = record(command, "simulate", "npcc", *SHORT, "--model", "detailed")
    assert plainly["model_reason"] is None


def test_the_ladder_is_chosen_where_it_pays_with_the_options_given(command, long_steps):
    options = ("--retain", 2, "--order", 20, "--whole-deg", 3)
    facts = record(command, "simulate", "npcc", *SHORT, *options, "--compare")
    assert facts["model"] == "adaptive"
    assert facts["model_reason"].startswith("1 detailed run takes about 1e+02 s; the ladder is")
    settings = facts["model_settings"]
    assert (len(settings["kept"]), settings["whole_deg"]) == (2, 3.0)
    assert settings["reducer"]["order"] == 20
    assert len(facts["comparison"]["units"]) == 9
    _, out, _ = command("simulate", "npcc", *SHORT, *options)
    assert "Model adaptive: 1 detailed run takes about 1e+02 s; the ladder" in plain(out)


def test_clearing_times_are_sought_on_the_model_chosen(command, long_steps, monkeypatch):
    options = ("cct", "npcc", "--buses", "17", "--t-end", 4, "--longest", 0.3)
    row = record(command, *options)
    assert (row["model"], row["clearing_times"][0]["cct_s"]) == ("adaptive", 0.03)
    assert "the ladder is predicted to take" in row["model_reason"]
    monkeypatch.setattr("gridfold.equivalents.auto.FACTOR", 0.0)
    row = record(command, *options)
    assert (row["model"], row["clearing_times"][0]["cct_s"]) == ("detailed", 0.03)
    _, out, _ = command(*options)
    assert "Model detailed: " in plain(out)


@pytest.mark.parametrize(
    ("options", "retain", "reduction"),
    [
        (("--retain", 2), RetainSettings(count=2), ReductionSettings()),
        (
            ("--retain-buses", "50,78"),
            RetainSettings(buses="50,78"),
            ReductionSettings(),
        ),
        (("--column-norm", 3), RetainSettings(3.0), ReductionSettings()),
        (
            ("--weights", "states", "--order", 40),
            RetainSettings(),
            ReductionSettings(order=40, weights=Weights.STATES),
        ),
    ],
    ids=str,
)
def test_retained_machines_and_weights_are_those_of_the_library(
    command, tmp_path, npcc, npcc_parts, options, retain, reduction
):
    file = tmp_path / "run.npz"
    facts = record(
        command, "simulate", "npcc", *SHORT, "--model", "retained", *options, "--npz", file
    )
    settings = ModelSettings(ModelKind.RETAINED, retain, reduction)
    family = settings.build(npcc_parts)
    assert facts["model_settings"]["kept"] == [str(unit) for unit in family.retained]
    assert facts["model_settings"]["order"] == family.areas[0].bases.order
    fault = gf.BusFault(3, duration=0.2)
    expected = gf.simulate_adaptive(npcc, family, settings.rule, [fault], 1.0).trajectory
    with np.load(file) as archive:
        np.testing.assert_allclose(archive["states"], expected.states, rtol=1e-7)


def test_machines_are_retained_in_the_order_of_their_rank(command, npcc_parts, npcc_swings):
    ranked = rank_retained(npcc_parts, npcc_swings).first(4)
    facts = record(command, "reduce", "npcc", "--retain", 4)
    assert sorted(facts["kept"]) == sorted(str(unit) for unit in ranked)
    assert record(command, "reduce", "npcc", "--retain", 0)["kept"] == []


def test_up_to_an_angle_of_its_own_the_ladder_is_linear_throughout(command, falling_costs):
    options = ("simulate", "npcc", *SHORT, "--model", "adaptive", "--retain", 1)
    used = {
        degrees: {s["after"] for s in record(command, *options, "--whole-deg", degrees)["switches"]}
        for degrees in (0, 60)
    }
    assert "linear whole" not in used[0]
    assert "linear whole" in used[60]


def test_a_file_of_one_form_is_refused_by_models_of_the_other(command, falling_costs, tmp_path):
    ladder, paper = tmp_path / "ladder.npz", tmp_path / "paper.npz"
    assert command("reduce", "npcc", "--order", 20, "--out", ladder)[0] == 0
    how = ("--outputs", "states", "--order", 40)
    assert command("reduce", "npcc", *how, "--out", paper)[0] == 0
    for model, file, said in (
        (("adaptive",), paper, "the adaptive model needs a file with outputs 'polar'"),
        (("linear",), paper, "the linear model needs a file with outputs 'polar'"),
        (("paper",), ladder, "the paper model needs a file with outputs 'states'"),
        (("linear", "--outputs", "states"), ladder, "needs a file with outputs 'states'"),
    ):
        code, out, err = command("simulate", "npcc", "--model", *model, "--reduced", file)
        assert (code, out) == (2, "")
        assert said in plain(err)


def test_options_that_contradict_a_file_of_a_ladder_are_refused(command, falling_costs, tmp_path):
    file = tmp_path / "ladder.npz"
    how = ("--order", 20, "--retain-buses", "50,78")
    assert command("reduce", "npcc", *how, "--out", file)[0] == 0
    arguments = ("simulate", "npcc", "--t-end", 0.1, "--model", "adaptive", "--reduced", file)
    for option, said in (
        (("--study-buses", "1-30"), "is for study buses 1-36, not 1-30"),
        (("--order", 30), "is for order 20, not 30"),
        (("--tolerance", 1e-3), "is for tolerance None, not 0.001"),
        (("--retain-buses", "50"), "with --reduced --retain-buses has no effect"),
        (("--retain", 3), "with --reduced --retain has no effect"),
        (("--column-norm", 9), "is for column norm None, not 9.0"),
        (("--weights", "states"), "with --reduced --weights has no effect"),
    ):
        code, _, err = command(*arguments, *option)
        assert code == 2, option
        assert said in plain(err)
    same = ("--study-areas", 1, "--order", 20)
    assert record(command, *arguments, *same)["model_settings"]["kept"] == ["50:1", "78:1"]
