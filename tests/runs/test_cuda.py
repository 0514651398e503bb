"""Runs on a GPU are those on the CPU: Numba's simulator stands for one, with a thread for each unit."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from io import StringIO
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

import gridfold as gf
from gridfold.errors import OptionError
from gridfold.numerics.cuda_device import why_no_gpu
from gridfold.runs.cuda import simulate_on_gpu, why_not_on_gpu

HERE = Path(__file__).parent


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """What the runs in the simulator gave."""
    folder = tmp_path_factory.mktemp("simulated")
    path = os.pathsep.join([str(HERE.parent), os.environ.get("PYTHONPATH", "")])
    done = subprocess.run(
        [sys.executable, str(HERE / "simulated_gpu.py"), str(folder)],
        env=os.environ | {"NUMBA_ENABLE_CUDASIM": "1", "PYTHONPATH": path},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return json.loads((folder / "found.json").read_text(encoding="utf-8"))


def test_every_kind_of_event_gives_the_run_of_the_cpu(found: dict[str, Any]) -> None:
    for run in found["runs"]:
        assert run["same"], run
        assert run["angle_deg"] < 1e-8
        assert run["field_voltage"] < 1e-10
        assert run["voltage"] < 1e-10


def test_runs_move_and_some_lose_synchronism(found: dict[str, Any]) -> None:
    assert {run["status"] for run in found["runs"]} == {"completed", "lost synchronism"}
    assert max(run["moved_deg"] for run in found["runs"]) > 10


def test_a_study_has_the_same_rows_on_both(found: dict[str, Any]) -> None:
    frames = {
        device: pd.read_json(StringIO(rows), orient="split")
        for device, (rows, _, _) in found["studies"].items()
    }
    pd.testing.assert_frame_equal(frames["cpu"], frames["cuda"], rtol=1e-9, atol=1e-9)
    starts = {device: started for device, (_, _, started) in found["studies"].items()}
    assert starts == {"cpu": 0, "cuda": 2}, "a trial, and all contingencies at once"


def test_a_study_says_what_stays_on_the_cpu(found: dict[str, Any]) -> None:
    words = {device: " ".join(said) for device, (_, said, _) in found["studies"].items()}
    assert "contingencies with redispatch run on the CPU, the others on a GPU" in words["cuda"]
    assert "GPU" not in words["cpu"]


@pytest.mark.skipif(why_no_gpu() is None, reason="there is a GPU")
def test_without_a_gpu_runs_on_one_are_refused(npcc: gf.DetailedModel) -> None:
    with pytest.raises(OptionError, match=r"numba-cuda is not installed|no NVIDIA GPU"):
        next(simulate_on_gpu(npcc, [[]], 0.1))


def test_methods_and_loads_that_are_not_made_for_gpus_are_named(npcc: gf.DetailedModel) -> None:
    assert why_not_on_gpu(npcc, gf.RungeKutta4()) is None
    assert "abm4 is not made for GPUs" in str(why_not_on_gpu(npcc, gf.AdamsBashforthMoulton4()))
    assert "solves equations" in str(why_not_on_gpu(npcc, gf.ImplicitTrapezoidal()))
