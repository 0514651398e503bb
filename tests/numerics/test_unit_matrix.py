"""Matrices inside flat vectors, as kernels see them."""

import numpy as np
import pytest
from numba import njit, types

from gridfold.numerics.compiled import compile_callback, invoke
from gridfold.numerics.unit_matrix import ROLES, UnitMatrix, unit_matrix


def kernel(x, u, p, y, dx):
    for i in range(x.shape[1]):
        y[0, i] = x[0, i] * u[0, i]
        dx[1, i] = p[-1, i] + y[0, i]
        dx[0, i] = x.shape[0]


@njit
def call(address, units, x, u, p, y, dx):
    invoke(
        address,
        (
            unit_matrix(x, 1, 2, units),
            unit_matrix(u, 0, 1, units),
            unit_matrix(p, 0, 3, units),
            unit_matrix(y, 0, 1, units),
            unit_matrix(dx, 0, 2, units),
        ),
    )


@pytest.mark.parametrize("number", [types.float64, types.complex128])
@pytest.mark.parametrize("units", [1, 4, 9, 40])
def test_a_kernel_reads_and_writes_its_matrices(number, units):
    dtype = np.dtype(str(number))
    random = np.random.default_rng(units)
    x, u, p = (random.normal(size=n).astype(dtype) for n in (1 + 2 * units, units, 3 * units))
    y, dx = np.zeros(units, dtype), np.zeros(2 * units, dtype)
    compiled = compile_callback(kernel, types.void(*(UnitMatrix(number, role) for role in ROLES)))
    call(compiled.address, units, x, u, p, y, dx)
    np.testing.assert_allclose(y, x[1 : 1 + units] * u, rtol=1e-14)
    np.testing.assert_array_equal(dx[:units], 2)
    np.testing.assert_allclose(dx[units:], p[2 * units :] + y, rtol=1e-14)
