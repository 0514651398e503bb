"""Dense backend: V = Z I with the impedance matrix seen from the terminals."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from gridfold.dynamics.network.backend import NETWORK_SIGNATURE, CompiledNetwork
from gridfold.dynamics.network.equations import NetworkEquations
from gridfold.numerics.compiled import compile_callback, matrix_view


def dense_network(equations: NetworkEquations) -> CompiledNetwork:
    """Compile the equations into one dense matrix-vector product."""
    impedance = equations.terminal_impedance()
    reals = np.concatenate([impedance.real.ravel(), impedance.imag.ravel()])
    size = np.array([len(impedance)], dtype=np.int64)
    return CompiledNetwork(_compiled().address, size, reals, 0)


def _solve(integers, reals, currents, voltages, scratch):
    n = integers[0]
    z_r = matrix_view(reals, 0, n, n)
    z_i = matrix_view(reals, n * n, n, n)
    for i in range(n):
        v_r = 0.0
        v_i = 0.0
        for j in range(n):
            v_r += z_r[i, j] * currents[j] - z_i[i, j] * currents[n + j]
            v_i += z_r[i, j] * currents[n + j] + z_i[i, j] * currents[j]
        voltages[i] = v_r
        voltages[n + i] = v_i


@cache
def _compiled() -> Any:
    return compile_callback(_solve, NETWORK_SIGNATURE)
