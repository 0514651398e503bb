"""Flows of lines that PSS/E computed; skipped where the folder of public cases is not at hand."""

import os
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import gridfold as gf
from gridfold.runs.loading import load_psse

ROOT = Path(__file__).resolve().parents[3]
CASES = Path(os.environ.get("GRIDFOLD_CASES", ROOT / ".." / "shared" / "data")) / "psse"


@pytest.mark.parametrize("name", ["sexs", "sexs_te_zero"])
def test_flows_at_both_ends_of_a_line_are_those_of_psse(name):
    """A line trips at 1 s; samples beside that lie on either side of it."""
    if not (CASES / name / "reference.csv").is_file():
        pytest.skip(f"{CASES / name} is absent; GRIDFOLD_CASES names the folder of public cases")
    reference = pd.read_csv(CASES / name / "reference.csv")
    case = load_psse(CASES / name / "case.raw", CASES / name / "case.dyr").case
    trip = gf.BranchTrip("101-102", time=1.0)
    t_end = float(min(reference["time"].iloc[-1], 10.0))
    run = gf.simulate(gf.build_model(case), [trip], t_end, gf.RungeKutta4(0.005), criterion=None)
    ours = run.frame("flow 101-103, 103-101")
    kept = (np.abs(reference["time"] - 1.0) > 0.0151) & (reference["time"] <= t_end)
    for column in ("p_mw:101-103", "q_mvar:101-103", "p_mw:103-101", "q_mvar:103-101"):
        expected = reference.loc[kept, column]
        found = np.interp(reference.loc[kept, "time"], ours["time"], ours[column])
        assert np.abs(found - expected).max() < 0.01 * np.ptp(expected), column
