"""The worked examples, run as their readmes say, and the examples in the guide to studies."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path
from shutil import copytree, ignore_patterns

import numpy as np
import pandas as pd
import pytest
from written_commands import blocks, commands, ended

import gridfold as gf
from gridfold.study.study_file import parse_study

EXAMPLES = Path(__file__).resolve().parent.parent / "examples"
GUIDE = EXAMPLES.parent / "docs" / "howto" / "study.md"
EDITING = GUIDE.with_name("editing.md")
NOTEBOOKS = sorted(path.name for path in EXAMPLES.glob("*.ipynb"))
#: The samples have a test of their own, of a smaller plan: tests/sampling/test_example.py.
FOLDERS = sorted({path.parent.name for path in EXAMPLES.glob("*/README.md")} - {"npcc_samples"})
STUDIES = sorted(path.parent.name for path in EXAMPLES.glob("*/study.toml"))


@pytest.fixture(scope="module")
def example(tmp_path_factory):
    """What the commands of an example's readme wrote, which are run once, in a copy of all examples."""
    copy = tmp_path_factory.mktemp("copy") / "examples"
    copytree(EXAMPLES, copy, ignore=ignore_patterns("*.results"))
    found = {}

    def run(name):
        if name not in found:
            with pytest.MonkeyPatch.context() as patch:
                patch.setenv("XDG_STATE_HOME", str(copy.parent / "state"))
                patch.chdir(copy / name)
                text = Path("README.md").read_text(encoding="utf-8")
                found[name] = copy / name, [ended(arguments) for arguments in commands(text)]
        return found[name]

    return run


@pytest.fixture(scope="module")
def results(example):
    """The table of an example's study."""

    def frame(name):
        folder, _ = example(name)
        with gf.StudyStore.read(folder / "study.results") as store:
            return store.frame().set_index("name"), store.identity["settings"]

    return frame


def test_the_examples_are_there():
    assert STUDIES == ["n_minus_1", "npcc_study", "own_exciter_study", "psse_study"]
    assert {"own_exciter_dyr", "reduce_and_decide", "watch_flows"} < set(FOLDERS)


@pytest.mark.parametrize("name", FOLDERS)
def test_commands_of_a_readme_run_as_printed(name, example):
    folder, runs = example(name)
    assert (folder / "README.md").read_text(encoding="utf-8").startswith("# ")
    assert runs
    assert [run.code for run in runs] == [0] * len(runs), "\n".join(run.err for run in runs)


@pytest.mark.parametrize("name", STUDIES)
def test_the_readme_of_a_study_runs_it(name, example):
    _, runs = example(name)
    assert ("run", "study.toml") in [run.arguments[:2] for run in runs]


@pytest.mark.parametrize("name", STUDIES)
def test_every_contingency_of_the_examples_is_stable(name, results):
    frame, _ = results(name)
    assert set(frame["status"]) == {"completed"}


def test_adaptive_runs_of_npcc_stay_within_the_error_that_the_paper_allows(results):
    frame, settings = results("npcc_study")
    assert settings["study_buses"] == "1-36"
    assert (settings["column_norm"], settings["angle_deg"]) == (1.0, 67.0)
    assert set(frame["checked"]) == {"completed"}
    assert frame["error_rms_deg"].max() < 6.0


def test_the_papers_example_uses_all_three_models(results):
    frame, settings = results("npcc_study")
    assert settings["model"] == "paper"
    assert (frame["detailed_s"] > 0).all()
    assert (frame["linear_s"] > 0).all()
    assert (frame["hybrid_s"] > 0).any()


def test_a_machine_is_retained_while_a_fault_is_not_on_and_there_is_an_equilibrium(results):
    frame, settings = results("psse_study")
    assert (settings["model"], settings["model_reason"]) == ("retained", None)
    apart = frame.index.str.startswith(("line 13-14", "line 11-13", "line 12-14"))
    np.testing.assert_allclose(frame["detailed_s"][~apart], 0.1, atol=0.021)
    assert (frame["retained_s"] + frame["detailed_s"]).tolist() == pytest.approx([10.0] * 16)
    # Where a machine is cut off the rest turns at another frequency, and nothing is linear.
    assert (frame["detailed_s"][apart] > 9).all()


def test_psse_files_are_simulated_without_replacements(results):
    frame, settings = results("psse_study")
    assert settings["validated"]
    assert settings["load_model"] == "raw"
    assert (settings["study_buses"], settings["kept"]) == ("11-15", ["22:1"])
    assert settings["order"] < 11
    assert (frame["error_rms_deg"] < 1.0).all()


def test_psse_study_has_faults_at_buses_on_lines_and_one_of_its_own(results):
    frame, _ = results("psse_study")
    assert frame["kind"].value_counts().to_dict() == {
        "line fault": 10,
        "bus fault": 5,
        "events": 1,
    }


def test_flows_and_voltages_of_a_psse_case_are_those_of_the_textbook(example):
    """Anderson and Fouad, Power System Control and Stability, figures 2.18 and 2.19 and example 2.6."""
    folder, _ = example("watch_flows")
    table = pd.read_csv(folder / "run.csv", index_col="time")
    before = table.iloc[0]
    published = {7: 1.026, 8: 1.016, 9: 1.032, 4: 1.026, 5: 0.996, 6: 1.013}
    for bus, voltage in published.items():
        assert before[f"voltage_pu:{bus}"] == pytest.approx(voltage, abs=6e-4)
    for line, power in {"7-8": 76.4, "7-5": 86.6, "9-6": 60.8}.items():
        assert before[f"p_mw:{line}"] == pytest.approx(power, abs=0.06)
    assert before["interface_mw:EXPORT"] == pytest.approx(86.6 + 60.8, abs=0.1)
    model = gf.build_model(gf.load_case(folder / "nine_buses.raw", folder / "nine_buses.dyr"))
    angles = np.rad2deg(
        model.x0[[model.state_names.index(f"rotor_angle:{k}:1") for k in (1, 2, 3)]]
    )
    np.testing.assert_allclose(angles, [2.2717, 19.7315, 13.1752], atol=0.02)


def test_the_watched_case_loses_the_flow_of_the_line_and_stays_stable(example):
    folder, _ = example("watch_flows")
    table = pd.read_csv(folder / "run.csv", index_col="time")
    assert table.index[-1] == 3.0
    assert (table["p_mw:7-5"].loc[0.6:] == 0).all()
    assert table["voltage_pu:7"].loc[0.5] == 0
    assert all((folder / name).stat().st_size > 20_000 for name in ("run.png", "towns.png"))


def test_python_beside_it_gives_the_same_curves(example):
    folder, _ = example("watch_flows")
    names: dict = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        (python,) = blocks((folder / "README.md").read_text(encoding="utf-8"), "python")
        exec(python, names)
    table = pd.read_csv(folder / "run.csv", index_col="time")
    assert list(names["frame"].columns) == ["time", *table.columns]
    np.testing.assert_allclose(names["frame"].set_index("time"), table, atol=0.02)


def test_n_minus_1_of_an_area_leaves_the_frequency_band_where_a_machine_is_lost(results, example):
    frame, _ = results("n_minus_1")
    assert frame["kind"].value_counts().to_dict() == {"line fault": 14, "machine trip": 2}
    assert sum(name.startswith("line 15-25") for name in frame.index) == 4
    lost = (frame["islanded_mw"] > 0) | (frame["kind"] == "machine trip")
    assert 0 < lost.sum() < len(frame)
    assert ((frame["violations"] > 0) == lost).all()
    assert set(frame["violated"][lost]) == {"frequency from 59.3 to 60.7 Hz"}
    folder = example("n_minus_1")[0] / "study.results"
    with gf.StudyStore.read(folder) as store:
        assert "interface_mw:EXPORT" in store.curves(1)["watched_names"]
    assert "EXPORT" in (folder / "report.html").read_text(encoding="utf-8")


def test_a_reduced_model_is_made_once_measured_and_decided_upon(example):
    folder, (_, reduced, compared, _) = example("reduce_and_decide")
    assert "Microseconds a step" in reduced.out
    assert "Rotor-angle errors against the detailed run" in compared.out
    record = json.loads((folder / "decided.json").read_text(encoding="utf-8"))
    assert record["error_estimate_deg"] <= record["tolerance_deg"] == 0.5
    assert record["attempts"]


def test_exciter_of_a_file_outside_the_package_is_part_of_the_model(results):
    frame, settings = results("own_exciter_study")
    assert settings["states"] == 2 * (4 + 3)
    assert (frame["margin"] > 0).all()


@pytest.mark.filterwarnings("ignore:FigureCanvasAgg is non-interactive")
def test_notebook_runs_from_top_to_bottom(tmp_path, monkeypatch):
    """Its code cells are executed in order in one namespace, as Jupyter would, but without it.

    Pictures are drawn without a window (MPLBACKEND=Agg).
    """
    monkeypatch.setenv("MPLBACKEND", "Agg")
    monkeypatch.chdir(tmp_path)
    import matplotlib.pyplot as plt

    plt.switch_backend("Agg")
    names: dict = {}
    for text in _code_cells("study.ipynb"):
        exec(text, names)
    plt.close("all")
    assert names["outcome"].complete
    assert len(names["frame"]) == names["outcome"].total == 6
    assert names["counts"].sum() == 6
    shown = [value for value in names.values() if isinstance(value, pd.DataFrame)]
    assert len(shown) == 2
    assert all(len(frame) for frame in shown)
    assert names["low"]["lowest_voltage"].between(0.5, 0.92).all()


def test_ten_edited_cases_of_the_notebook_run_and_a_heavier_area_swings_more(capsys):
    import matplotlib.pyplot as plt

    plt.switch_backend("Agg")
    names: dict = {}
    for text in _code_cells("edited_cases.ipynb"):
        exec(text, names)
    plt.close("all")
    table = names["table"].set_index(["load_percent", "machines"])
    assert len(table) == 10
    assert set(table["status"]) == {"completed"}
    assert (table["largest_swing_deg"].unstack().diff().dropna() > 0).all(axis=None)
    losses = table["losses_mw"].unstack()
    assert (losses["as they are"] == losses["all H = 20 s"]).all()
    assert names["again"].fingerprint == names["heavy"].fingerprint
    assert "edit 2: branch 29-38: there is no branch" in capsys.readouterr().out


@pytest.mark.parametrize("name", NOTEBOOKS)
def test_notebooks_are_kept_without_output(name):
    notebook = json.loads((EXAMPLES / name).read_text(encoding="utf-8"))
    assert notebook["nbformat"] == 4
    cells = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    assert all(not cell["outputs"] and cell["execution_count"] is None for cell in cells)


def test_study_file_of_the_guide_is_valid():
    study = parse_study(tomllib.loads(_only_block("toml")))
    assert study.contingency[0].events[1]["kind"] == "branch-reclose"


def test_python_of_the_guide_runs_as_printed(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names: dict = {}
    exec(_only_block("python"), names)
    assert names["outcome"].total == 6
    assert len(names["frame"]) == names["outcome"].stable
    assert names["curves"]["units"].size


def test_python_and_files_of_the_guide_to_editing_are_as_printed(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names: dict = {}
    for block in _blocks("python", EDITING):
        exec(block, names)
    edits, study = _blocks("toml", EDITING)
    (tmp_path / "heavy.toml").write_text(edits, encoding="utf-8")
    case = gf.load_case("npcc", edits=gf.load_edits("heavy.toml"))
    editor = names["editor"].set("two_axis 26:1 H=40").switch("branch 29-37", "out")
    assert case.fingerprint == editor.case().fingerprint
    assert parse_study(tomllib.loads(study)).case.edits == "heavy.toml"


def _only_block(language):
    (block,) = _blocks(language, GUIDE)
    return block


def _blocks(language, page):
    return blocks(page.read_text(encoding="utf-8"), language)


def _code_cells(name):
    notebook = json.loads((EXAMPLES / name).read_text(encoding="utf-8"))
    return ["".join(c["source"]) for c in notebook["cells"] if c["cell_type"] == "code"]
