"""The worked examples of studies, run as they are, and the examples in the guide to studies."""

from __future__ import annotations

import json
import re
import tomllib
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import gridfold as gf
from gridfold.study.study_file import parse_study

EXAMPLES = Path(__file__).resolve().parent.parent / "examples"
GUIDE = EXAMPLES.parent / "docs" / "howto" / "study.md"
STUDIES = sorted(path.parent.name for path in EXAMPLES.glob("*/study.toml"))


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """The table of an example's study, which is run once."""
    found = {}

    def frame(name):
        if name not in found:
            folder = tmp_path_factory.mktemp(name) / "results"
            study = EXAMPLES / name / "study.toml"
            outcome = gf.run_study(study, folder, trust_devices=True)
            assert outcome.complete
            with gf.StudyStore.read(folder) as store:
                found[name] = store.frame().set_index("name"), store.identity["settings"]
        return found[name]

    return frame


def test_the_three_examples_are_there():
    assert STUDIES == ["npcc_study", "own_exciter_study", "psse_study"]


@pytest.mark.parametrize("name", STUDIES)
def test_every_example_says_what_it_is(name):
    readme = (EXAMPLES / name / "README.md").read_text(encoding="utf-8")
    assert readme.startswith("# ")
    assert "gridfold run study.toml" in readme


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
    for text in _code_cells():
        exec(text, names)
    plt.close("all")
    assert names["outcome"].complete
    assert len(names["frame"]) == names["outcome"].total == 6
    assert names["counts"].sum() == 6
    shown = [value for value in names.values() if isinstance(value, pd.DataFrame)]
    assert len(shown) == 2
    assert all(len(frame) for frame in shown)
    assert names["low"]["lowest_voltage"].between(0.5, 0.92).all()


def test_notebook_is_kept_without_output():
    notebook = json.loads((EXAMPLES / "study.ipynb").read_text(encoding="utf-8"))
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


def _only_block(language):
    blocks = re.findall(rf"```{language}\n(.*?)```", GUIDE.read_text(encoding="utf-8"), re.DOTALL)
    assert len(blocks) == 1
    return blocks[0]


def _code_cells():
    notebook = json.loads((EXAMPLES / "study.ipynb").read_text(encoding="utf-8"))
    return ["".join(c["source"]) for c in notebook["cells"] if c["cell_type"] == "code"]
