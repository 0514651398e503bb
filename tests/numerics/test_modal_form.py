from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm

from gridfold.numerics.modal_form import modal_form


@pytest.fixture
def matrix():
    """Poles -1, -2, -0.5 +- 3j, -0.1 +- 7j in mixed coordinates."""
    blocks = np.zeros((6, 6))
    blocks[0, 0], blocks[1, 1] = -1, -2
    blocks[2:4, 2:4] = [[-0.5, 3], [-3, -0.5]]
    blocks[4:6, 4:6] = [[-0.1, 7], [-7, -0.1]]
    mix = np.random.default_rng(0).normal(size=(6, 6))
    return mix @ blocks @ np.linalg.inv(mix)


def test_form_gives_the_matrix_back(matrix):
    form = modal_form(matrix)
    np.testing.assert_allclose(form.basis @ form.inverse, np.eye(6), atol=1e-13)
    np.testing.assert_allclose(form.basis @ form.matrix() @ form.inverse, matrix, atol=1e-12)


def test_eigenvalues_stand_in_pairs_of_neighbours(matrix):
    form = modal_form(matrix)
    expected = [-2, -1, -0.5 - 3j, -0.5 + 3j, -0.1 - 7j, -0.1 + 7j]
    found = form.eigenvalues[np.lexsort((form.eigenvalues.imag, form.eigenvalues.real))]
    np.testing.assert_allclose(found, expected, atol=1e-12)
    for i, partner in enumerate(form.partner):
        assert form.partner[partner] == i
        assert abs(partner - i) == (1 if form.coupling[i] else 0)
        assert form.coupling[partner] == -form.coupling[i]


def test_derivative_in_modal_coordinates_is_that_of_the_matrix(matrix):
    form = modal_form(matrix)
    x = np.random.default_rng(1).normal(size=(4, 6))
    rates = form.derivative(x @ form.inverse.T) @ form.basis.T
    np.testing.assert_allclose(rates, x @ matrix.T, atol=1e-12)


def test_pair_turns_as_the_matrix_exponential_says(matrix):
    form = modal_form(matrix)
    expected = form.inverse @ expm(0.3 * matrix) @ form.basis
    damping = np.exp(0.3 * form.diagonal)
    result = np.diag(damping * np.cos(0.3 * form.coupling))
    result[np.arange(6), form.partner] += damping * np.sin(0.3 * form.coupling)
    np.testing.assert_allclose(result, expected, atol=1e-12)


def test_real_and_imaginary_parts_of_an_eigenvector_are_orthogonal(matrix):
    form = modal_form(matrix)
    for i in np.flatnonzero(form.coupling > 0):
        assert abs(form.basis[:, i] @ form.basis[:, i + 1]) < 1e-14


def test_diagonal_matrix_keeps_its_coordinates():
    form = modal_form(np.diag([-3.0, -1.0]))
    np.testing.assert_array_equal(form.basis, np.eye(2))
    np.testing.assert_array_equal(form.diagonal, [-3, -1])
    np.testing.assert_array_equal(form.coupling, [0, 0])


@pytest.mark.parametrize("eigenvalue", [0.0, -1.0])
def test_defective_matrix_has_no_modal_form(eigenvalue):
    assert modal_form(np.array([[eigenvalue, 1.0], [0.0, eigenvalue]])) is None


def test_condition_limit_decides(matrix):
    limit = np.linalg.cond(modal_form(matrix).basis)
    assert modal_form(matrix, condition_limit=1.01 * limit) is not None
    assert modal_form(matrix, condition_limit=0.99 * limit) is None


def test_residual_limit_decides(matrix):
    assert modal_form(matrix, residual_limit=0.0) is None


def test_empty_matrix_has_an_empty_form():
    assert modal_form(np.zeros((0, 0))).diagonal.shape == (0,)
