from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import linalg

from gridfold.numerics.schur import complex_schur, real_schur


def assert_schur_form(a, triangle, basis):
    scale = 1.0 + np.abs(a).max(initial=0.0)
    np.testing.assert_allclose(basis @ triangle @ basis.conj().T, a, atol=1e-12 * scale)
    np.testing.assert_allclose(basis.conj().T @ basis, np.eye(len(a)), atol=1e-13)


@given(n=st.integers(0, 25), seed=st.integers(0, 2**32 - 1))
@settings(max_examples=60, deadline=None)
def test_complex_form_is_triangular_and_gives_the_matrix_back(n, seed):
    a = np.random.default_rng(seed).normal(size=(n, n))
    triangle, basis = complex_schur(a)
    assert_schur_form(a, triangle, basis)
    assert not np.tril(triangle, -1).any()


def test_real_form_is_that_of_scipy(npcc):
    a = npcc.jacobian(npcc.x0)
    triangle, basis = real_schur(a)
    assert_schur_form(a, triangle, basis)
    expected, other = linalg.schur(a)
    np.testing.assert_array_equal(triangle, expected)
    np.testing.assert_array_equal(basis, other)


def test_a_defective_matrix_has_a_form_too():
    a = np.array([[1.0, 1.0, 0.0], [0.0, 1.0, 1.0], [0.0, 0.0, 1.0]])
    turned = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    assert_schur_form(turned @ a @ turned.T, *complex_schur(turned @ a @ turned.T))


def test_what_is_not_finite_is_refused():
    with pytest.raises(np.linalg.LinAlgError, match="not finite"):
        complex_schur(np.array([[np.nan]]))
