"""What a study says of a GPU that is asked for and cannot be had."""

from __future__ import annotations

from types import SimpleNamespace
from unittest.mock import Mock

import numpy as np
import pytest

from gridfold.dynamics.cuda.precision import Precision
from gridfold.errors import GpuError, OptionError
from gridfold.numerics.steppers import AdamsBashforthMoulton4, RungeKutta4
from gridfold.runs.trajectory import Trajectory
from gridfold.study import on_gpu
from gridfold.study.identity import changed_keys
from gridfold.study.on_gpu import Chosen
from gridfold.study.single_precision import compared
from gridfold.study.study_file import FREE_KEYS, RunsOn, SideBySide, parse_study
from gridfold.systems.status import Status


@pytest.fixture
def no_gpu(monkeypatch):
    monkeypatch.setattr(on_gpu, "why_no_gpu", lambda: "no NVIDIA GPU or driver is found")


def test_a_gpu_that_is_not_there_is_refused_only_if_it_is_asked_for(no_gpu):
    with pytest.raises(OptionError, match="device cuda: no NVIDIA GPU or driver is found"):
        on_gpu.device_asked_for("cuda")
    assert on_gpu.device_asked_for("auto") is RunsOn.AUTO
    assert on_gpu.choose_device(RunsOn.AUTO, None, ()) == Chosen(False)
    assert on_gpu.choose_device(RunsOn.CPU, None, ()) == Chosen(False)
    with pytest.raises(OptionError, match="auto, cpu or cuda, not 'gpu'"):
        on_gpu.device_asked_for("gpu")


def test_a_simulated_gpu_is_taken_only_if_it_is_asked_for(monkeypatch):
    monkeypatch.setattr(on_gpu, "simulated", lambda: True)
    monkeypatch.setattr(on_gpu, "why_no_gpu", lambda: None)
    assert on_gpu.choose_device(RunsOn.AUTO, None, ()) == Chosen(False)
    assert on_gpu.device_asked_for("cuda") is RunsOn.CUDA


def prepared(**changes):
    run = SimpleNamespace(batch=SideBySide.AUTO, precision=Precision.DOUBLE)
    known = {
        "study": SimpleNamespace(run=run), "small": None, "relays": (), "time_limit": None,
        "model": None, "method": SimpleNamespace(stepper=RungeKutta4(0.01)), "criterion": None,
        "intact": {},
    }  # fmt: skip
    return SimpleNamespace(**(known | changes))


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"small": object()}, "reduced models"),
        ({"relays": (object(),)}, "relays watch every run"),
        ({"time_limit": 5.0}, "a time limit of its own"),
        ({"method": SimpleNamespace(stepper=AdamsBashforthMoulton4(0.01))}, "abm4"),
    ],
)
def test_what_is_not_made_for_a_gpu_is_told_and_runs_on_the_cpu(monkeypatch, changes, reason):
    monkeypatch.setattr(on_gpu, "why_no_gpu", lambda: None)
    chosen = on_gpu.choose_device(RunsOn.CUDA, prepared(**changes), ())
    assert not chosen.on_gpu
    (words,) = chosen.words
    assert words.startswith("contingencies run on the CPU, not on a GPU: ")
    assert reason in words


def test_a_gpu_that_does_not_take_a_trial_run_is_told_and_left(monkeypatch):
    def refuse(*given, **options):
        raise GpuError("the GPU did not take 1 runs: CudaAPIError: out of memory")

    monkeypatch.setattr(on_gpu, "why_no_gpu", lambda: None)
    monkeypatch.setattr(on_gpu, "why_not_on_gpu", lambda model, stepper: None)
    monkeypatch.setattr(on_gpu, "simulate_on_gpu", refuse)
    chosen = on_gpu.choose_device(RunsOn.AUTO, prepared(), ())
    assert not chosen.on_gpu
    assert chosen.words[0].endswith("the GPU did not take 1 runs: CudaAPIError: out of memory")
    with pytest.raises(GpuError, match="device cuda: the GPU failed"):
        on_gpu.choose_device(RunsOn.CUDA, prepared(), ())


def test_single_precision_is_refused_elsewhere_than_on_a_gpu():
    for device in (RunsOn.CPU, RunsOn.AUTO):
        with pytest.raises(OptionError, match=f"for the device cuda, not {device.value}"):
            on_gpu.refuse_single_elsewhere(device, Precision.SINGLE)
        on_gpu.refuse_single_elsewhere(device, Precision.DOUBLE)
    on_gpu.refuse_single_elsewhere(RunsOn.CUDA, Precision.SINGLE)


def test_a_precision_that_is_given_is_part_of_the_study():
    study = parse_study({"schema": 1, "case": {"source": "npcc"}})
    assert study.run.precision is Precision.DOUBLE
    assert on_gpu.with_precision(study, None) is study
    single = on_gpu.with_precision(study, "single")
    changed = list(changed_keys(study.content(), single.content(), FREE_KEYS))
    assert changed == [("run.precision", "double", "single")]
    with pytest.raises(OptionError, match="double or single, not 'half'"):
        on_gpu.with_precision(study, "half")


def run_of(angles, status=Status.COMPLETED):
    """A run as far as a comparison looks at it."""
    return Mock(
        spec=Trajectory, times=np.arange(len(angles)), status=status,
        rotor_angle_deg=lambda: np.array(angles),
    )  # fmt: skip


def test_the_error_of_single_precision_is_the_largest_while_both_runs_go_on():
    pairs = [
        (run_of([[0.0, 1.0], [2.0, 3.01]]), run_of([[0.0, 1.0], [2.0, 3.0]])),
        (run_of([[5.0, 5.0]], Status.LOST_SYNCHRONISM), run_of([[5.02, np.nan], [9.0, 9.0]])),
        (OptionError("wrong"), OptionError("wrong")),
    ]
    found = compared(pairs)
    assert (found.runs, found.otherwise) == (2, 1)
    assert found.angle_deg == pytest.approx(0.02)
    assert str(found) == (
        "rotor angles within 0.02 degrees of double precision, in 2 runs that were made in both; "
        "1 ended otherwise"
    )
    assert "no contingency runs on the GPU" in str(compared([]))
