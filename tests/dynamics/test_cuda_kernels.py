"""Every device computes on a GPU what it computes on the CPU: its kernels there are copies of these."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from gridfold.dynamics.device import Device
from gridfold.dynamics.own_kernels import interpreted_kernels
from gridfold.dynamics.registry import DEVICES
from gridfold.numerics.cuda_code import device_code

UNITS = 3


def computed(
    device: Device, kernels: Mapping[str, Any], number: type[np.floating[Any]]
) -> NDArray[Any]:
    """Outputs and derivatives at some values, unit after unit as threads do."""
    x, u, p = (
        np.random.default_rng(seed).uniform(0.2, 1.2, (len(names), UNITS)).astype(number)
        for seed, names in enumerate((device.states, device.inputs, device.parameter_rows))
    )
    y, dx = np.zeros((len(device.signal_rows), UNITS), number), np.zeros(x.shape, number)
    for kernel in kernels.values():
        for unit in range(UNITS):
            kernel(*(matrix[:, unit : unit + 1] for matrix in (x, u, p, y, dx)))
    return np.concatenate([y, dx])


@pytest.mark.parametrize("model", sorted(DEVICES))
def test_copies_for_a_gpu_compute_the_same_in_either_precision(model: str) -> None:
    device = DEVICES[model]
    right = computed(device, interpreted_kernels(device), np.float64)
    scale = 1.0 + np.abs(right).max()
    for number, digits in ((np.float64, 1e-14), (np.float32, 1e-5)):
        copies = {
            stage: device_code(kernel, number, compiled=lambda function: function)
            for stage, kernel in device.kernels.items()
        }
        found = computed(device, copies, number)
        np.testing.assert_allclose(found, right, rtol=10 * digits, atol=digits * scale)
