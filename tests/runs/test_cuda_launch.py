"""What a GPU answers when it is started, where it does not do what it is asked for."""

from __future__ import annotations

from types import SimpleNamespace

import numba
import numpy as np
import pytest

from gridfold.errors import GpuError
from gridfold.numerics.cuda_device import simulated
from gridfold.runs import cuda_launch

pytestmark = pytest.mark.skipif(simulated(), reason="the simulator stands for a GPU")


def start(kernel: object) -> None:
    cuda_launch._call(
        {(5, 32, 0, 64): kernel}, (5, 32, 0, 64), ("times",), {"times": np.zeros(3)}, {}
    )


def fails(text: str) -> object:
    def fail(*given: object) -> None:
        raise RuntimeError(text)

    return fail


def test_a_gpu_without_room_is_told_with_the_number_of_runs(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    full = SimpleNamespace(to_device=fails("[CUresult.CUDA_ERROR_OUT_OF_MEMORY]\n out of memory"))
    monkeypatch.setattr(numba, "cuda", full, raising=False)
    with pytest.raises(
        GpuError, match=r"the GPU did not take 5 runs: RuntimeError: .* out of memory"
    ):
        start(print)


def test_a_kernel_that_fails_is_told_and_not_at_full_length(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(numba, "cuda", SimpleNamespace(to_device=np.array), raising=False)
    with pytest.raises(GpuError, match="illegal memory access") as found:
        start(fails("illegal memory access " + 9999 * "x"))
    assert len(str(found.value)) < 400
