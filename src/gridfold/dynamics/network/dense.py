"""Dense backend: V = Z I with the impedance matrix seen from the terminals."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gridfold.dynamics.network.backend import NETWORK_SIGNATURE, CompiledNetwork
from gridfold.numerics.compiled import compile_callback, matrix_view

#: Rows are padded with zeros to a multiple of this, so that vector instructions leave no rest.
_PADDING = 16


def dense_network(impedance: NDArray[np.complex128]) -> CompiledNetwork:
    """Compile an impedance matrix, (n_terminals, n_terminals), into one matrix-vector product."""
    n = len(impedance)
    width = -(-n // _PADDING) * _PADDING
    padded = np.zeros((2, n, width))
    padded[:, :, :n] = impedance.real, impedance.imag
    size = np.array([n, width], dtype=np.int64)
    return CompiledNetwork(_compiled().address, size, padded.ravel(), 2 * width)


def real_dense_network(network: NDArray[np.float64]) -> CompiledNetwork:
    """Compile a real matrix, (2 n_terminals, 2 n_terminals), from currents to voltages."""
    n = len(network)
    width = -(-n // _PADDING) * _PADDING
    padded = np.zeros((n, width))
    padded[:, :n] = network
    size = np.array([n, width], dtype=np.int64)
    return CompiledNetwork(_compiled_real().address, size, padded.ravel(), width)


def _solve_real(integers, reals, currents, voltages, scratch):
    n, width = integers[0], integers[1]
    matrix = matrix_view(reals, 0, n, width)
    padded = scratch[:width]
    for j in range(n):
        padded[j] = currents[j]
    for j in range(n, width):
        padded[j] = 0.0
    for i in range(n):
        total = 0.0
        for j in range(width):
            total += matrix[i, j] * padded[j]
        voltages[i] = total


def _solve(integers, reals, currents, voltages, scratch):
    n, width = integers[0], integers[1]
    z_r = matrix_view(reals, 0, n, width)
    z_i = matrix_view(reals, n * width, n, width)
    i_r = scratch[:width]
    i_i = scratch[width : 2 * width]
    for j in range(n):
        i_r[j] = currents[j]
        i_i[j] = currents[n + j]
    for j in range(n, width):
        i_r[j] = 0.0
        i_i[j] = 0.0
    for i in range(n):
        v_r = 0.0
        v_i = 0.0
        for j in range(width):
            v_r += z_r[i, j] * i_r[j] - z_i[i, j] * i_i[j]
            v_i += z_r[i, j] * i_i[j] + z_i[i, j] * i_r[j]
        voltages[i] = v_r
        voltages[n + i] = v_i


@cache
def _compiled_real() -> Any:
    return compile_callback(_solve_real, NETWORK_SIGNATURE)


@cache
def _compiled() -> Any:
    return compile_callback(_solve, NETWORK_SIGNATURE)
