"""Runs on a GPU are those on the CPU: Numba's simulator stands for one, with a thread for each unit."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import replace
from io import StringIO
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
from cases import one_machine_infinite_bus
from device_families import FAMILIES

import gridfold as gf
from gridfold.dynamics.registry import DEVICES
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
        assert run["state"] < 1e-10
        assert run["voltage"] < 1e-10


def test_sparse_factors_by_levels_give_the_same_runs(found: dict[str, Any]) -> None:
    assert len(found["by_levels"]) == len(found["runs"]) - 1
    for run in found["by_levels"]:
        assert run["same"], run
        assert run["angle_deg"] < 1e-8
        assert run["state"] < 1e-10
        assert run["voltage"] < 1e-10


def test_single_precision_keeps_angles_to_a_twentieth_of_a_degree(found: dict[str, Any]) -> None:
    for run in found["in_single"]:
        assert run["same"], run
        assert 1e-9 < run["angle_deg"] < 0.05
        assert run["voltage"] < 1e-5


def test_runs_move_and_some_lose_synchronism(found: dict[str, Any]) -> None:
    for kind in ("runs", "by_levels"):
        assert {run["status"] for run in found[kind]} == {"completed", "lost synchronism"}
        assert max(run["moved_deg"] for run in found[kind]) > 10


@pytest.mark.parametrize("name", FAMILIES)
def test_devices_of_every_role_run_on_a_gpu(found: dict[str, Any], name: str) -> None:
    run = found["families"][name]
    assert run["moved"] > 1e-3
    assert run["apart"]["double"] < 1e-11
    assert run["apart"]["single"] < 1e-5


def test_the_families_hold_devices_of_every_role_that_runs_there(found: dict[str, Any]) -> None:
    names = {name for run in found["families"].values() for name in run["devices"]}
    roles = {DEVICES[name].role for name in names if name in DEVICES}
    assert roles == {device.role for device in DEVICES.values()}


def test_a_study_has_the_same_rows_on_both(found: dict[str, Any]) -> None:
    cpu, cuda = (rows_of(found["studies"][device]) for device in ("cpu", "cuda"))
    # Voltages that stand still before an event are equal but for rounding, and so at any of its times.
    when = ["lowest_voltage_at", "highest_voltage_at"]
    apart = (cpu[when] - cuda[when]).abs().max(axis=1)
    assert (apart[cpu["name"] != "redispatched"] < 1e-9).all()
    pd.testing.assert_frame_equal(
        cpu.drop(columns=when), cuda.drop(columns=when), rtol=1e-9, atol=1e-9
    )
    starts = {device: study["started"] for device, study in found["studies"].items()}
    assert starts == {"cpu": 0, "cuda": 2}, "a trial, and all contingencies at once"


def test_a_study_says_what_stays_on_the_cpu(found: dict[str, Any]) -> None:
    words = {device: " ".join(study["words"]) for device, study in found["studies"].items()}
    assert "contingencies with redispatch run on the CPU, the others on a GPU" in words["cuda"]
    assert "GPU" not in words["cpu"]


def test_a_study_in_single_precision_tells_its_error(found: dict[str, Any]) -> None:
    study = found["single"]
    assert study["single"]["runs"] == 4
    assert study["single"]["otherwise"] == 0
    assert 1e-9 < study["single"]["angle_deg"] < 0.05
    told = study["facts"]["Single precision"]
    assert "of double precision, in 4 runs that were made in both" in told
    assert f"single precision: {told}" in study["words"]
    assert all("Single precision" not in other["facts"] for other in found["studies"].values())
    assert set(rows_of(study)["status"]) == {"completed"}


def rows_of(study: dict[str, Any]) -> pd.DataFrame:
    return pd.read_json(StringIO(study["rows"]), orient="split")


@pytest.mark.skipif(why_no_gpu() is None, reason="there is a GPU")
def test_without_a_gpu_runs_on_one_are_refused(npcc: gf.DetailedModel) -> None:
    with pytest.raises(OptionError, match=r"numba-cuda is not installed|no NVIDIA GPU"):
        next(simulate_on_gpu(npcc, [[]], 0.1))


def test_methods_and_loads_that_are_not_made_for_gpus_are_named(npcc: gf.DetailedModel) -> None:
    assert why_not_on_gpu(npcc, gf.RungeKutta4()) is None
    assert "abm4 is not made for GPUs" in str(why_not_on_gpu(npcc, gf.AdamsBashforthMoulton4()))
    assert "trapezoidal is not made for GPUs" in str(why_not_on_gpu(npcc, gf.ImplicitTrapezoidal()))
    loads = (gf.Load(1, "1", 40.0, 15.0), gf.Load(2, "1", 10.0))
    for count, place in ((1, "bus 1"), (2, "buses 1, 2")):
        case = replace(one_machine_infinite_bus(), loads=loads[:count])
        model = gf.build_model(case, loads=gf.LoadModel((0.5, 0.0, 0.5)))
        words = why_not_on_gpu(model, gf.RungeKutta4())
        assert f"loads that are no impedances, at {place}, need iterations" in str(words)
