"""What a study says of a GPU that is asked for and cannot be had."""

from __future__ import annotations

import pytest

from gridfold.errors import OptionError
from gridfold.numerics import cuda_device
from gridfold.study import on_gpu
from gridfold.study.on_gpu import Chosen
from gridfold.study.study_file import RunsOn


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


def test_the_package_that_is_missing_is_named(monkeypatch):
    monkeypatch.setattr(cuda_device, "find_spec", lambda name: None)
    assert "pip install 'gridfold[cuda]'" in cuda_device.why_no_gpu()
