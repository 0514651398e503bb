"""Why no GPU can be used, in words."""

from __future__ import annotations

import sys
from types import SimpleNamespace

import numba
import pytest

from gridfold.numerics import cuda_device
from gridfold.numerics.cuda_device import simulated, why_no_gpu

pytestmark = pytest.mark.skipif(simulated(), reason="the simulator stands for a GPU")


def offered(monkeypatch, available=True, gpus=(), error=None):
    """numba-cuda as if it found this."""
    cuda = SimpleNamespace(
        is_available=lambda: available, gpus=list(gpus), cuda_error=lambda: error
    )
    monkeypatch.setattr(cuda_device, "find_spec", lambda name: object())
    monkeypatch.setattr(numba, "cuda", cuda, raising=False)
    return cuda


def test_the_package_that_is_missing_is_named(monkeypatch):
    monkeypatch.setattr(cuda_device, "find_spec", lambda name: None)
    assert "numba-cuda is not installed (pip install 'gridfold[cuda]')" in str(why_no_gpu())


def test_a_package_that_cannot_be_imported_is_told_with_its_reason(monkeypatch):
    offered(monkeypatch)
    monkeypatch.delattr(numba, "cuda")
    monkeypatch.setitem(sys.modules, "numba.cuda", None)
    assert str(why_no_gpu()).startswith("numba-cuda cannot be imported: ")


def test_a_gpu_that_is_there_can_be_used(monkeypatch):
    offered(monkeypatch, gpus=["one"])
    assert why_no_gpu() is None


def test_no_gpu_no_driver_and_no_compiler_are_told_apart(monkeypatch):
    offered(monkeypatch)
    assert why_no_gpu() == "no NVIDIA GPU or driver is found"
    offered(
        monkeypatch, available=False, error="CUDA driver library\n cannot be found. " + 999 * "x"
    )
    assert str(why_no_gpu()).startswith(
        "no NVIDIA GPU or driver is found: CUDA driver library cannot be found. x"
    )
    assert len(str(why_no_gpu())) < 400
    offered(monkeypatch, available=False)
    assert why_no_gpu() == "NVIDIA's compiler is not found (pip install 'gridfold[cuda]')"


def test_a_driver_that_fails_is_told(monkeypatch):
    cuda = offered(monkeypatch)

    def fail():
        raise RuntimeError("unknown error (999)")

    cuda.is_available = fail
    assert why_no_gpu() == "no NVIDIA GPU or driver is found: unknown error (999)"
