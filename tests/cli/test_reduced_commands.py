"""Commands about reduced models, as a user runs them."""

from __future__ import annotations

import json

import numpy as np
import pandas as pd
import pytest

import gridfold as gf
from gridfold.dynamics.area_model import BoundaryCoupling
from gridfold.equivalents.saved import save_reduced

FAULT = ("--fault-bus", 3, "--fault-duration", 0.39)


@pytest.fixture(scope="module")
def parts(npcc_parts):
    return npcc_parts


def record(command, *arguments):
    """The JSON that a command prints."""
    code, out, err = command(*arguments, "--json", "-")
    assert (code, err) == (0, "")
    return json.loads(out)


def test_partition_tells_the_areas_and_counts_of_the_paper(command):
    facts = record(command, "partition", "npcc", "--study-buses", "1-36", "--column-norm", 1.0)
    assert (len(facts["study"]["machines"]), facts["study"]["states"]) == (9, 81)
    assert (len(facts["external"]["machines"]), facts["external"]["states"]) == (39, 351)
    ties = {(tie["study_bus"], tie["external_bus"]) for tie in facts["tie_lines"]}
    assert ties == {(29, 37), (35, 73)}
    assert sorted(facts["boundary_buses"]) == [29, 35]
    assert facts["threshold"] == {"per_unit": 1.0, "siemens_at_20_kv": 0.25}
    assert [row["unit"] for row in facts["column_norms"] if row["kept"]] == [
        "78:1", "42:1", "50:1", "134:1", "51:1",
    ]  # fmt: skip
    assert facts["reference"] == facts["column_norms"][-1]["unit"] == "123:1"
    assert facts["functions"] == {
        "per_generator": 4, "external": 156, "kept": 20, "linearized": 136, "whole": 192,
    }  # fmt: skip


def test_partition_prints_the_same_facts_as_tables(command):
    code, out, _ = command("partition", "npcc")
    assert code == 0
    text = " ".join(out.split())
    assert "buses 1-36 (36), 9 machines, 81 states" in text
    assert "136 of 156 functions, or of 192 without partition" in text
    assert "0.25 S at 20 kV" in text
    assert out.count("linearized") == 34


def test_a_study_area_is_given_by_buses_or_areas_and_is_area_1_of_npcc_by_default(command):
    by_buses = record(command, "partition", "npcc", "--study-buses", "1-36")
    assert record(command, "partition", "npcc", "--study-areas", "1") == by_buses
    assert record(command, "partition", "npcc") == by_buses
    both = record(command, "partition", "npcc", "--study-areas", "1", "--study-buses", "37")
    assert both["study"]["buses"] == list(range(1, 38))


def test_another_case_has_no_study_area_of_its_own(command, tmp_path):
    (tmp_path / "case.toml").write_text('name = "mine"\nextends = "npcc"\n')
    code, out, err = command("partition", tmp_path)
    assert (code, out) == (2, "")
    assert "case mine has no study area of its own" in " ".join(err.split())
    assert "--study-buses" in err
    facts = record(command, "partition", tmp_path, "--study-areas", "1")
    assert facts["study"]["states"] == 81


# Of the paper's models the linear one misses most, that with all functions nonlinear least: what is
# left is truncation alone. Ports gain most where the external area is linear.
@pytest.mark.parametrize(
    ("options", "lowest", "highest"),
    [
        (("linear",), 1.5, 4.0),
        (("retained",), 0.5, 2.0),
        (("adaptive",), 0.5, 2.0),
        (("whole",), 0.5, 2.0),
        (("linear", "--outputs", "states"), 8.0, 14.0),
        (("projected",), 0.0, 0.3),
        (("hybrid",), 0.3, 1.2),
        (("paper",), 1.2, 3.5),
        (("paper-whole",), 1.2, 3.5),
    ],
)
def test_each_model_has_its_error_for_the_fault_at_bus_3(
    command, falling_costs, options, lowest, highest
):
    facts = record(command, "simulate", "npcc", *FAULT, "--model", *options, "--compare")
    assert facts["model"] == options[0]
    assert facts["model_reason"] is None
    errors = facts["comparison"]["units"]
    assert len(errors) == 9
    assert lowest < errors[0]["rms_deg"] < highest
    assert errors[0]["rms_deg"] == max(error["rms_deg"] for error in errors)
    assert facts["switches"][0]["after"] == "detailed"
    assert facts["switches"][0]["reason"] == "fault on"


def test_the_command_runs_what_the_library_runs(command, tmp_path, npcc, parts):
    options = ("--model", "paper", "--angle-deg", 20, "--longest-above", 1, "--order", 60)
    facts = record(
        command, "simulate", "npcc", *FAULT, "--t-end", 4, *options, "--npz", tmp_path / "a.npz"
    )
    family = gf.reduce(parts, gf.BalancedTruncation(order=60))
    rule = gf.SwitchingRule(20.0, longest_above=1.0)
    expected = gf.simulate_adaptive(npcc, family, rule, [gf.BusFault(3, duration=0.39)], 4.0)
    with np.load(tmp_path / "a.npz") as archive:
        np.testing.assert_allclose(archive["states"], expected.trajectory.states, rtol=1e-7)
    times = [switch.time for switch in expected.switches]
    assert [switch["time"] for switch in facts["switches"]] == times
    assert facts["model_settings"] == {
        "study_buses": "1-36",
        "column_norm": 1.0,
        "kept": ["42:1", "50:1", "51:1", "78:1", "134:1"],
        "angle_deg": 20.0,
        "longest_above": 1.0,
        "coupling": "exact",
        "outputs": "states",
        "reducer": {
            "name": "BalancedTruncation",
            "tolerance": None,
            "order": 60,
            "slow_modes": None,
        },
        "order": 60,
        "bound": pytest.approx(family.reduction.bound),
    }


def test_result_files_name_the_model(command, tmp_path):
    csv, picture = tmp_path / "a.csv", tmp_path / "a.png"
    code, out, _ = command(
        "simulate", "npcc", *FAULT, "--t-end", 2, "--model", "paper-whole", "--compare",
        "--csv", csv, "--plot", picture,
    )  # fmt: skip
    assert code == 0
    assert "largest angle deviation" in out
    assert "Rotor-angle errors against the detailed run" in out
    notes = json.loads((tmp_path / "a.csv.meta.json").read_text())
    assert notes["model"] == "paper-whole"
    assert notes["model_settings"]["angle_deg"] == 6.0
    assert pd.read_csv(csv).shape[0] == 201
    assert picture.exists()


def test_a_run_of_the_library_is_not_called_detailed_where_it_was_not(npcc, parts):
    rule = gf.SwitchingRule(np.inf)
    run = gf.simulate_adaptive(npcc, gf.whole_system(parts), rule, t_end=0.1).trajectory
    assert run.metadata()["model"] == "reduced"
    assert gf.simulate(npcc, t_end=0.1).metadata()["model"] == "detailed"


def test_a_run_that_ends_early_cannot_be_compared_and_keeps_its_exit_code(command):
    options = ("--fault-bus", 3, "--fault-duration", 0.6, "--model", "paper-whole", "--compare")
    code, out, _ = command("simulate", "npcc", *options, "--json", "-")
    facts = json.loads(out)
    assert code == 3
    assert facts["comparison"] is None
    assert facts["comparison_note"].startswith("No comparison: the reduced run ended at 0.6")
    code, out, _ = command("simulate", "npcc", *options)
    assert code == 3
    assert "No comparison: the reduced run ended" in out


def test_a_machine_that_is_never_in_service_is_left_out_of_the_comparison(command):
    facts = record(
        command, "simulate", "npcc", "--event", "machine-trip bus=27 id=1 time=0", "--t-end", 1,
        "--model", "hybrid", "--compare",
    )  # fmt: skip
    assert "27:1" not in [error["unit"] for error in facts["comparison"]["units"]]
    assert len(facts["comparison"]["units"]) == 8


def test_critical_clearing_times_come_from_the_model_asked_for(command, falling_costs):
    options = ("cct", "npcc", "--buses", "17", "--t-end", 4, "--longest", 0.3)
    found = {
        model: record(command, *options, "--model", model)
        for model in ("detailed", "linear", "retained", "adaptive", "whole", "paper", "paper-whole")
    }
    assert [row["model"] for row in found.values()] == list(found)
    assert {row["clearing_times"][0]["cct_s"] for row in found.values()} == {0.03}
    assert {row["model_reason"] for row in found.values()} == {None}
    frozen = record(command, *options, "--model", "paper-whole", "--angle-deg", 180)
    assert frozen["clearing_times"][0]["cct_s"] > 0.03


def test_reduce_tells_order_bound_and_singular_values_of_the_papers_form(command):
    facts = record(command, "reduce", "npcc", "--outputs", "states")
    assert (facts["states"], facts["order"]) == (351, 149)
    assert facts["bound"] <= 1e-5
    values = np.array(facts["hankel_singular_values"])
    assert len(values) == 351
    assert (np.diff(values) <= 0).all()
    assert facts["bound"] == pytest.approx(2 * values[149:].sum())
    assert facts["kept"] == ["42:1", "50:1", "51:1", "78:1", "134:1"]
    assert facts["seconds"] > 0
    options = ("--outputs", "states", "--tolerance", 1e-2, "--column-norm", 3)
    _, out, _ = command("reduce", "npcc", *options)
    assert "78:1 (column norm from 3 p.u.)" in " ".join(out.split())


def test_reduce_makes_a_ladder_of_areas_by_default(command, falling_costs):
    facts = record(command, "reduce", "npcc")
    near, far = facts["areas"]
    assert (near["states"], far["states"]) == (306, 351)
    assert near["retained"] == facts["kept"] == ["42:1", "50:1", "51:1", "78:1", "134:1"]
    assert far["retained"] == []
    assert near["ports"] == [37, 41, 50, 51, 78, 124, 134]
    assert far["ports"] == [37, 74]
    for area in facts["areas"]:
        values = np.array(area["hankel_singular_values"])
        # The common turn of all angles stays exact besides.
        assert area["bound"] == pytest.approx(2 * values[area["order"] - 1 :].sum())
        assert area["bound"] <= 1e-3
        assert (np.diff(values) <= 0).all()
    for key in ("ports", "order", "bound", "states", "hankel_singular_values"):
        assert facts[key] == near[key]
    rungs = [(rung["model"], rung["used"]) for rung in facts["rungs"]]
    assert rungs == [("retained", True), ("linear", True), ("linear whole", True)]
    assert facts["outputs"] == "polar"
    moved = [mode for mode in facts["swing_modes"] if mode["moved"]]
    _, out, _ = command("reduce", "npcc")
    text = " ".join(out.split())
    assert "linear whole" in text
    assert (
        f"{len(facts['swing_modes']) - len(moved)} of {len(facts['swing_modes'])} within 1%" in text
    )
    for area in facts["areas"]:
        assert str(area["order"]) in text


def runs_of(command, tmp_path, *choices):
    """States, switches and settings of a short run for each of `choices`."""
    for more in choices:
        options = ("simulate", "npcc", *FAULT, "--t-end", 3)
        facts = record(command, *options, *more, "--npz", tmp_path / "run.npz")
        with np.load(tmp_path / "run.npz") as archive:
            yield archive["states"], facts["switches"], facts["model_settings"]


@pytest.mark.parametrize(
    "options",
    [
        ("linear", "--outputs", "states"), ("projected",), ("hybrid",), ("paper",),
    ],
    ids=lambda options: options[0],
)  # fmt: skip
def test_a_saved_model_gives_the_same_run_to_the_last_bit(command, tmp_path, options):
    file = tmp_path / "reduced.npz"
    how = ("reduce", "npcc", "--outputs", "states", "--order", 60)
    assert command(*how, "--out", file)[0] == 0
    made, loaded = runs_of(
        command, tmp_path, ("--model", *options, "--order", 60),
        ("--model", *options, "--reduced", file),
    )  # fmt: skip
    np.testing.assert_array_equal(made[0], loaded[0])
    assert made[1:] == loaded[1:]


def test_a_saved_ladder_gives_the_same_runs_to_the_last_bit(command, falling_costs, tmp_path):
    file, how = tmp_path / "reduced.npz", ("--order", 30)
    assert command("reduce", "npcc", *how, "--out", file)[0] == 0
    for model in ("linear", "retained", "adaptive", "whole"):
        made, loaded = runs_of(
            command, tmp_path, ("--model", model, *how), ("--model", model, "--reduced", file)
        )
        np.testing.assert_array_equal(made[0], loaded[0])
        assert made[1:] == loaded[1:]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--study-buses", "1-30"), "is for study buses 1-36, not 1-30"),
        (("--column-norm", 2), "is for column norm 1.0, not 2.0"),
        (("--order", 70), "is for order 60, not 70"),
        (("--tolerance", 1e-3), "is for tolerance None, not 0.001"),
        (("--slow-modes", 0.1), "is for slow modes None, not 0.1"),
    ],
)
def test_options_that_contradict_the_file_are_refused(command, tmp_path, options, message):
    file = tmp_path / "reduced.npz"
    command("reduce", "npcc", "--outputs", "states", "--order", 60, "--out", file)
    arguments = ("simulate", "npcc", "--model", "paper", "--reduced", file, "--t-end", 0.1)
    code, _, err = command(*arguments, *options)
    assert code == 2
    assert message in " ".join(err.split())
    same = ("--study-areas", 1, "--column-norm", 1.0, "--order", 60)
    assert command(*arguments, *same)[0] == 0


def test_a_file_of_another_case_ends_with_exit_code_2_and_its_name(command, tmp_path):
    file = tmp_path / "reduced.npz"
    command("reduce", "npcc", "--order", 30, "--out", file)
    code, _, err = command("cct", "npcc-pst", "--buses", 3, "--model", "linear", "--reduced", file)
    assert code == 2
    assert str(file) in err.replace("\n", "")
    assert "belongs to case npcc with" in " ".join(err.split())


@pytest.mark.parametrize(
    "arguments",
    [
        ("partition", "npcc", "--study-buses", "900"),
        ("partition", "npcc", "--study-buses", "1-140"),
        ("partition", "npcc", "--study-areas", "one"),
        ("partition", "npcc", "--study-zones", "99"),
        ("partition", "npcc", "--column-norm", "-1"),
        ("reduce", "npcc", "--order", "60", "--tolerance", "1e-5"),
        ("reduce", "npcc", "--order", "0"),
        ("reduce", "npcc", "--outputs", "states", "--order", "352"),
        ("reduce", "npcc", "--order", "353"),
        ("reduce", "npcc", "--tolerance", "nan"),
        ("simulate", "npcc", "--model", "quadratic"),
        ("simulate", "npcc", "--model", "detailed", "--compare"),
        ("simulate", "npcc", "--model", "detailed", "--column-norm", "1"),
        ("simulate", "npcc", "--budget"),
        ("simulate", "npcc", "--model", "linear", "--angle-deg", "67"),
        ("simulate", "npcc", "--model", "hybrid", "--longest-above", "5"),
        ("simulate", "npcc", "--model", "adaptive", "--angle-deg", "-1"),
        ("simulate", "npcc", "--model", "adaptive", "--angle-deg", "nan"),
        ("simulate", "npcc", "--model", "paper-whole", "--order", "60"),
        ("simulate", "npcc", "--model", "paper-whole", "--reduced", "x.npz"),
        ("simulate", "npcc", "--model", "linear", "--reduced", "no-such-file.npz"),
        ("cct", "npcc", "--buses", "3", "--model", "detailed", "--angle-deg", "67"),
        ("cct", "npcc", "--buses", "3", "--reduced", "x.npz"),
    ],
)
def test_bad_options_end_with_exit_code_2_and_leave_nothing(
    command, tmp_path, monkeypatch, arguments
):
    monkeypatch.chdir(tmp_path)
    code, out, err = command(*arguments)
    assert (code, out) == (2, "")
    assert err
    assert "Traceback" not in err
    assert list(tmp_path.iterdir()) == []


def states(command, tmp_path, *arguments):
    """States of a short run with a reduced model, and its settings."""
    facts = record(
        command, "simulate", "npcc", *FAULT, "--t-end", 2, *arguments, "--npz", tmp_path / "run.npz"
    )
    with np.load(tmp_path / "run.npz") as archive:
        return archive["states"], facts["model_settings"]


@pytest.mark.parametrize(
    ("options", "choices", "angle"),
    [
        (
            ("--model", "linear", "--coupling", "lagged"),
            {"coupling": BoundaryCoupling.LAGGED},
            np.inf,
        ),
        (("--model", "linear", "--outputs", "states"), {}, np.inf),
        (("--model", "hybrid", "--column-norm-siemens", 0.5), {"column_norm": 2.0}, 0.0),
        (
            ("--model", "hybrid", "--reducer", "modal", "--order", 80),
            {"reducer": gf.ModalTruncation(80)},
            0.0,
        ),
    ],
)
def test_coupling_norm_and_reducer_are_those_of_the_library(
    command, tmp_path, npcc, parts, options, choices, angle
):
    found, settings = states(command, tmp_path, *options)
    family = gf.reduce(parts, **choices)
    fault, rule = gf.BusFault(3, duration=0.39), gf.SwitchingRule(angle)
    expected = gf.simulate_adaptive(npcc, family, rule, [fault], 2.0)
    np.testing.assert_allclose(found, expected.trajectory.states, rtol=1e-7)
    assert settings["coupling"] == family.boundary.value
    assert settings["outputs"] == "states"
    assert settings["order"] == family.reduction.order
    assert settings["reducer"]["name"] == type(family.reducer).__name__
    assert settings.get("column_norm", 1.0) == choices.get("column_norm", 1.0)


def test_a_projected_model_has_all_functions_with_the_lag_too(command, tmp_path):
    exact, _ = states(command, tmp_path, "--model", "projected", "--order", 60)
    late, settings = states(
        command, tmp_path, "--model", "projected", "--order", 60, "--coupling", "lagged"
    )
    assert len(settings["kept"]) == 39
    assert 0 < np.abs(late - exact).max() < 0.5


def test_clearing_times_take_coupling_outputs_and_reducer(command):
    options = ("cct", "npcc", "--buses", "17", "--t-end", 4, "--longest", 0.3, "--model", "linear")
    for more in (
        ("--coupling", "lagged"),
        ("--outputs", "states"),
        ("--outputs", "states", "--reducer", "modal", "--order", 80),
    ):
        assert record(command, *options, *more)["clearing_times"][0]["cct_s"] == 0.03


def test_a_threshold_in_siemens_is_that_in_per_unit(command):
    same = record(command, "partition", "npcc", "--column-norm-siemens", 0.75)
    assert same == record(command, "partition", "npcc", "--column-norm", 3)
    assert same["threshold"] == {"per_unit": 3.0, "siemens_at_20_kv": 0.75}
    norm = ("--column-norm-siemens", 0.75)
    facts = record(command, "reduce", "npcc", "--outputs", "states", *norm)
    assert (facts["column_norm"], facts["kept"]) == (3.0, ["78:1"])
    assert record(command, "reduce", "npcc", *norm)["kept"] == ["78:1"]


def test_modal_truncation_has_an_order_but_no_bound(command):
    options = ("--outputs", "states", "--reducer", "modal", "--order", 60)
    facts = record(command, "reduce", "npcc", *options)
    assert facts["reducer"] == {"name": "ModalTruncation", "order": 60}
    assert facts["order"] in (60, 61)
    assert facts["bound"] is facts["hankel_singular_values"] is None


def test_slow_modes_are_kept_besides_the_order_and_in_the_file(command, tmp_path):
    file, options = tmp_path / "reduced.npz", ("--order", 30, "--slow-modes", 0.246)
    paper = ("--outputs", "states")
    facts = record(command, "reduce", "npcc", *options, *paper, "--out", file)
    assert (facts["order"], facts["bound"]) == (33, None)
    assert facts["reducer"]["slow_modes"] == 0.246
    expected = states(command, tmp_path, "--model", "linear", *paper, *options)
    found = states(command, tmp_path, "--model", "linear", *paper, "--reduced", file)
    np.testing.assert_array_equal(found[0], expected[0])


@pytest.mark.parametrize("reducer", ["balanced", "modal"])
def test_a_saved_model_runs_with_the_coupling_asked_for(command, tmp_path, reducer):
    file = tmp_path / "reduced.npz"
    how = ("--reducer", reducer, "--order", 60)
    assert command("reduce", "npcc", "--outputs", "states", *how, "--out", file)[0] == 0
    for choice in (("--coupling", "lagged"), ("--coupling", "exact")):
        expected = states(command, tmp_path, "--model", "hybrid", *how, *choice)
        found = states(command, tmp_path, "--model", "hybrid", "--reduced", file, *choice)
        np.testing.assert_array_equal(found[0], expected[0])
        assert found[1] == expected[1]
    agreeing = ("--reducer", reducer, "--column-norm-siemens", 0.25)
    assert states(command, tmp_path, "--model", "hybrid", "--reduced", file, *agreeing)


def test_a_file_keeps_its_coupling_until_another_is_given(command, tmp_path, parts):
    options = ("--model", "hybrid", "--reduced", tmp_path / "reduced.npz")
    late = gf.reduce(parts, coupling=BoundaryCoupling.LAGGED)
    save_reduced(tmp_path / "reduced.npz", late)
    assert states(command, tmp_path, *options)[1]["coupling"] == "lagged"
    given = states(command, tmp_path, *options, "--coupling", "exact")[1]
    assert given["coupling"] == "exact"
    code, _, err = command("simulate", "npcc", *options, "--outputs", "polar")
    assert code == 2
    assert "the hybrid model forms states: outputs 'polar' is not its" in " ".join(err.split())


def test_the_budget_ends_with_the_error_of_the_comparison(command):
    linear = ("--model", "linear", "--outputs", "states")
    options = ("simulate", "npcc", *FAULT, "--t-end", 2, *linear, "--budget")
    facts = record(command, *options)
    rows = {row["source"]: row for row in facts["error_budget"]}
    assert list(rows) == ["time step", "coupling", "linearization", "truncation", "all"]
    assert all(row["status"] == "completed" for row in rows.values())
    worst = facts["comparison"]["units"][0]
    assert rows["all"]["error"] == pytest.approx(worst)
    assert rows["time step"]["error"]["rms_deg"] < rows["linearization"]["error"]["rms_deg"]
    _, out, _ = command(*options)
    table = out[out.index("Error budget") :]
    assert worst["unit"] in table
    assert f"{worst['rms_deg']:.3g}" in table


def test_the_budget_of_a_ladder_has_no_lag(command):
    options = ("simulate", "npcc", *FAULT, "--t-end", 2, "--model", "retained", "--budget")
    facts = record(command, *options)
    rows = {row["source"]: row["error"] for row in facts["error_budget"]}
    assert list(rows) == ["time step", "linearization", "truncation", "all"]
    assert rows["all"] == pytest.approx(facts["comparison"]["units"][0])
    assert rows["truncation"]["rms_deg"] < rows["linearization"]["rms_deg"]


def test_a_budget_of_runs_that_end_early_tells_how_they_ended(command):
    options = ("--fault-bus", 3, "--fault-duration", 0.7, "--t-end", 1, "--model", "linear")
    code, out, _ = command("simulate", "npcc", *options, "--budget", "--json", "-")
    assert code == 3
    row = json.loads(out)["error_budget"][-1]
    assert (row["source"], row["error"], row["status"]) == ("all", None, "lost synchronism")
    _, out, _ = command("simulate", "npcc", *options, "--budget")
    table = out[out.index("Error budget") :]
    assert "none" in table


def test_without_budget_there_is_none_in_the_record(command):
    facts = record(command, "simulate", "npcc", "--t-end", 0.1, "--model", "linear", "--compare")
    assert "error_budget" not in facts


REDUCED = ("simulate", "npcc", "--t-end", 0.1, "--model")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((*REDUCED, "detailed", "--coupling", "exact"), "--coupling has no effect on the detailed"),
        ((*REDUCED, "detailed", "--outputs", "polar"), "--outputs has no effect on the detailed"),
        ((*REDUCED, "detailed", "--reducer", "modal"), "--reducer has no effect on the detailed"),
        (
            (*REDUCED, "detailed", "--column-norm-siemens", 0.25),
            "--column-norm-siemens has no effect on the detailed",
        ),
        (
            (*REDUCED, "projected", "--outputs", "polar"),
            "the projected model forms states: outputs 'polar' is not its",
        ),
        (
            (*REDUCED, "retained", "--outputs", "states"),
            "outputs 'states' has no effect on the retained model",
        ),
        (
            (*REDUCED, "whole", "--coupling", "lagged"),
            "the lagged coupling has no effect on the whole model",
        ),
        (
            (*REDUCED, "linear", "--coupling", "lagged", "--outputs", "polar"),
            "the lagged coupling needs outputs 'states'",
        ),
        (
            (*REDUCED, "paper-whole", "--coupling", "lagged"),
            "--coupling has no effect on the paper-whole",
        ),
        (
            (*REDUCED, "paper-whole", "--outputs", "states"),
            "--outputs has no effect on the paper-whole",
        ),
        (
            (*REDUCED, "paper-whole", "--reducer", "balanced"),
            "--reducer has no effect on the paper-whole",
        ),
        (
            (*REDUCED, "paper-whole", "--weights", "states"),
            "--weights has no effect on the paper-whole",
        ),
        ((*REDUCED, "auto", "--coupling", "exact"), "--coupling has no effect on the auto"),
        ((*REDUCED, "auto", "--outputs", "polar"), "--outputs has no effect on the auto"),
        ((*REDUCED, "auto", "--reduced", "x.npz"), "--reduced has no effect on the auto"),
        ((*REDUCED, "auto", "--budget"), "--budget needs a model with a reduced external area"),
        ((*REDUCED, "detailed", "--retain", 3), "--retain has no effect on the detailed"),
        ((*REDUCED, "detailed", "--whole-deg", 3), "--whole-deg has no effect on the detailed"),
        ((*REDUCED, "linear", "--retain", 3), "--retain has no effect on the linear"),
        ((*REDUCED, "linear", "--retain-buses", 42), "--retain-buses has no effect on the linear"),
        ((*REDUCED, "linear", "--column-norm", 1), "--column-norm has no effect on the linear"),
        (
            (*REDUCED, "linear", "--outputs", "states", "--whole-deg", 3),
            "--whole-deg has no effect on the linear",
        ),
        ((*REDUCED, "retained", "--whole-deg", 3), "--whole-deg has no effect on the retained"),
        ((*REDUCED, "retained", "--angle-deg", 3), "--angle-deg has no effect on the retained"),
        ((*REDUCED, "whole", "--whole-deg", 3), "--whole-deg has no effect on the whole"),
        ((*REDUCED, "paper", "--whole-deg", 3), "--whole-deg has no effect on the paper"),
        ((*REDUCED, "adaptive", "--whole-deg", -1), "whole_deg must be 0 degrees or more"),
        ((*REDUCED, "retained", "--retain", -1), "greater than or equal to 0"),
        ((*REDUCED, "retained", "--retain", 40), "of 39 external machines 40 cannot be taken"),
        (
            (*REDUCED, "retained", "--retain-buses", "42,23"),
            "to be retained: there is no machine at bus 23",
        ),
        (
            (*REDUCED, "retained", "--retain-buses", 42, "--retain", 1),
            "give one of the column norm, the buses and the number of retained machines",
        ),
        ((*REDUCED, "paper", "--retain", 3), "the paper model keeps machines by their column norm"),
        (
            (*REDUCED, "hybrid", "--retain-buses", 42),
            "the hybrid model keeps machines by their column norm",
        ),
        (
            (*REDUCED, "hybrid", "--column-norm", 1, "--column-norm-siemens", 0.25),
            "give --column-norm or --column-norm-siemens, not both",
        ),
        (
            ("partition", "npcc", "--column-norm", 1, "--column-norm-siemens", 0.25),
            "give --column-norm or --column-norm-siemens, not both",
        ),
        (("partition", "npcc", "--column-norm-siemens", -1), "must be 0 or more"),
        (("reduce", "npcc", "--reducer", "modal"), "the modal reducer needs an order"),
        (
            ("reduce", "npcc", "--reducer", "modal", "--order", 60, "--tolerance", 1e-5),
            "a tolerance has no effect on the modal reducer",
        ),
        (
            ("reduce", "npcc", "--reducer", "modal", "--order", 60, "--slow-modes", 0.1),
            "slow modes have no effect on the modal reducer",
        ),
        (("reduce", "npcc", "--order", 60, "--slow-modes", -1), "must be a positive number of 1/s"),
        (("reduce", "npcc", "--reducer", "modal", "--order", 0), "must be at least 1"),
        (("reduce", "npcc", "--coupling", "lagged"), "No such option"),
        (("calibrate", "npcc", "--outputs", "polar"), "No such option"),
        (("calibrate", "npcc", "--retain", 3), "No such option"),
        (
            ("calibrate", "npcc", "--weights", "interface"),
            "--weights has no effect on the models of the paper",
        ),
        (("partition", "npcc", "--order", 60), "No such option"),
        ((*REDUCED, "detailed", "--budget"), "--budget needs a model with a reduced external area"),
        (
            (*REDUCED, "paper-whole", "--budget"),
            "--budget needs a model with a reduced external area",
        ),
        (
            ("cct", "npcc", "--buses", 3, "--model", "detailed", "--coupling", "lagged"),
            "--coupling has no effect on the detailed",
        ),
        (
            ("calibrate", "npcc", "--threshold", "whole", "--coupling", "lagged"),
            "--coupling has no effect on the threshold of the whole system",
        ),
        (
            ("calibrate", "npcc", "--threshold", "whole", "--order", 60),
            "--order has no effect on the threshold of the whole system",
        ),
        (("calibrate", "npcc", "--reducer", "modal"), "the modal reducer needs an order"),
    ],
)
def test_choices_that_contradict_each_other_are_refused_by_name(command, arguments, message):
    code, out, err = command(*arguments)
    assert (code, out) == (2, "")
    assert message in " ".join(err.split())


def test_options_that_contradict_the_reducer_of_the_file_are_refused(command, tmp_path):
    file = tmp_path / "reduced.npz"
    how = ("--reducer", "modal", "--order", 60)
    command("reduce", "npcc", "--outputs", "states", *how, "--out", file)
    arguments = (*REDUCED, "hybrid", "--reduced", file)
    for options, message in (
        (("--reducer", "balanced"), "is for reducer modal, not balanced"),
        (("--tolerance", 1e-3), "is for tolerance None, not 0.001"),
        (("--column-norm-siemens", 0.5), "is for column norm 1.0, not 2.0"),
    ):
        code, _, err = command(*arguments, *options)
        assert code == 2
        assert message in " ".join(err.split())


def test_help_shows_options_by_group(command):
    _, out, _ = command("simulate", "--help")
    groups = ("Disturbance", "Runs", "Model", "Study area", "Reduction", "Switching", "Results")
    at = [out.index(f"─ {name} ─") for name in groups]
    assert at == sorted(at)
    assert at[4] < out.index("--column-norm-siemens") < at[5]
