"""The example that trains a classifier: its plan, and the classifier where scikit-learn is there."""

import importlib.util
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import gridfold as gf
from gridfold.sampling.draw import filling
from gridfold.sampling.rows import data_columns

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "npcc_samples"
GUIDE = EXAMPLE.parent.parent / "docs" / "howto" / "samples.md"


def test_the_readme_says_what_it_is():
    text = (EXAMPLE / "README.md").read_text(encoding="utf-8")
    assert text.startswith("# ")
    assert "gridfold sample plan.toml" in text


def test_the_plan_draws_all_that_the_classifier_takes():
    plan = gf.load_plan(EXAMPLE / "plan.toml")
    columns = data_columns(plan.names)
    script = (EXAMPLE / "train.py").read_text(encoding="utf-8")
    numbers = re.search(r"NUMBERS = \[(.*?)\]", script, re.DOTALL)[1]
    assert set(re.findall(r'"(\w+)"', numbers)) <= set(columns)
    assert filling(plan).shape == (400, 6)


def test_the_plan_of_the_guide_is_one(tmp_path):
    text = GUIDE.read_text(encoding="utf-8")
    block = re.search(r"```toml\n(.*?)```", text, re.DOTALL)[1]
    (tmp_path / "plan.toml").write_text(block)
    plan = gf.load_plan(tmp_path / "plan.toml")
    assert plan.names == ("load_west", "generation_1", "parameter_1")


def test_the_classifier_learns_a_rule_that_the_data_hold(tmp_path):
    """The guide's way from Parquet to a verdict, on data whose rule is known."""
    pytest.importorskip("sklearn")
    spec = importlib.util.spec_from_file_location("train", EXAMPLE / "train.py")
    train = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(train)
    rng = np.random.default_rng(1)
    frame = pd.DataFrame({name: rng.random(400) for name in train.NUMBERS})
    frame["contingency"] = rng.choice(["bus 1", "bus 2"], 400)
    frame["stable"] = (frame["clearing_time"] < 0.5).astype("boolean")
    frame.loc[:9, "stable"] = pd.NA
    (tmp_path / "samples").mkdir()
    frame.to_parquet(tmp_path / "samples" / "part-000000.parquet")
    inputs, stable = train.read(tmp_path)
    assert inputs.shape == (390, len(train.NUMBERS) + 2)
    right, constant = train.train(inputs, stable)
    assert right > 0.95 > constant
