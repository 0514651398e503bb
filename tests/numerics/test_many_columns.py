from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse import csc_array, random_array
from scipy.sparse.linalg import splu

from gridfold.numerics.many_columns import solve_rows


@pytest.mark.parametrize("columns", [0, 1, 7])
@pytest.mark.parametrize("order", ["NATURAL", "COLAMD"])
def test_rows_of_the_solution_are_those_of_the_dense_inverse(order, columns):
    rng = np.random.default_rng(3)
    real, imag = (random_array((40, 40), density=0.1, rng=rng).toarray() for _ in range(2))
    # Without a large diagonal, so that rows change places.
    matrix = real + 1j * imag + np.roll(np.diag(2 + 1j * rng.normal(size=40)), 3, axis=0)
    factors = splu(csc_array(matrix), permc_spec=order)
    assert (factors.perm_r != np.arange(40)).any()
    rows = rng.permutation(40)[:25]
    rhs = rng.normal(size=(25, columns)) + 1j * rng.normal(size=(25, columns))
    whole = np.zeros((40, columns), dtype=complex)
    whole[rows] = rhs
    for adjoint, inverse in ((False, matrix), (True, matrix.conj().T)):
        found = solve_rows(factors, rows, rhs, adjoint)
        np.testing.assert_allclose(found, np.linalg.solve(inverse, whole)[rows], atol=1e-11)


def test_real_right_hand_sides_will_do():
    matrix = np.array([[2.0, 1j], [0.0, 1 + 1j]])
    factors = splu(csc_array(matrix))
    found = solve_rows(factors, np.array([0, 1]), np.eye(2))
    np.testing.assert_allclose(found, np.linalg.inv(matrix), atol=1e-15)
