"""Run the stages of the device kernels from Python, on complex numbers."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gridfold.dynamics.device import Device, run_kernel

Complex = NDArray[np.complex128]


def source_stage(device: Device, x: Complex, p: Complex) -> Complex:
    """Outputs y with the source rows filled, shape (n_outputs, units)."""
    units = p.shape[1]
    y = np.zeros((len(device.signal_rows), units), dtype=np.complex128)
    empty = np.zeros((0, units), dtype=np.complex128)
    run_kernel(device.source, x, empty, p, y, empty)
    return y


def output_stage(device: Device, x: Complex, u: Complex, p: Complex, y: Complex) -> Complex:
    """A copy of `y` with the output rows filled too."""
    result = y.copy()
    empty = np.zeros((0, p.shape[1]), dtype=np.complex128)
    run_kernel(device.output, x, u, p, result, empty)
    return result


def derivative_stage(device: Device, x: Complex, u: Complex, p: Complex, y: Complex) -> Complex:
    """Derivatives of the states, shape (n_states, units)."""
    dx = np.zeros((len(device.states), p.shape[1]), dtype=np.complex128)
    run_kernel(device.derivative, x, u, p, y, dx)
    return dx
