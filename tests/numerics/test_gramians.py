from __future__ import annotations

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gridfold.errors import OptionError
from gridfold.numerics.gramians import (
    controllability_factor,
    gramian_factors,
    observability_factor,
)


def random_stable_matrix(rng, n):
    a = rng.normal(size=(n, n))
    return a - (np.linalg.eigvals(a).real.max() + 0.2) * np.eye(n)


def hankel_values(a, b, c):
    reachable, observable = gramian_factors(a, b, c)
    return np.linalg.svd(observable.T @ reachable, compute_uv=False)


def hankel_values_by_gramians(a, b, c):
    """The naive route: eigenvalues of the product of computed Gramians."""
    reachable, observable = gramian_factors(a, b, c)
    product = (reachable @ reachable.T) @ (observable @ observable.T)
    return np.sqrt(np.sort(np.abs(np.linalg.eigvals(product)))[::-1])


def hankel_values_in_50_digits(a, b, c):
    """Lyapunov equations as linear systems, then eigenvalues, all in 50 digits."""
    n = len(a)
    with mpmath.workdps(50):

        def gramian(matrix, right):
            x, g = mpmath.matrix(matrix.tolist()), mpmath.matrix(right.tolist())
            q = g * g.T
            operator = mpmath.matrix(n * n, n * n)
            for i in range(n):
                for j in range(n):
                    for k in range(n):
                        operator[i * n + j, k * n + j] += x[i, k]
                        operator[i * n + j, i * n + k] += x[j, k]
            flat = mpmath.matrix([-q[i, j] for i in range(n) for j in range(n)])
            solution = mpmath.lu_solve(operator, flat)
            return mpmath.matrix([[solution[i * n + j] for j in range(n)] for i in range(n)])

        product = gramian(a, b) * gramian(a.T, c.T)
        values = mpmath.eig(product, left=False, right=False)
        return np.array(sorted((float(mpmath.sqrt(abs(v))) for v in values), reverse=True))


def test_factor_of_a_first_order_lag_is_known():
    # W = b^2 / (2 |a|)
    np.testing.assert_allclose(
        controllability_factor(np.array([[-2.0]]), np.array([[3.0]])), [[1.5]], rtol=1e-15
    )
    np.testing.assert_allclose(
        observability_factor(np.array([[-2.0]]), np.array([[5.0]])), [[2.5]], rtol=1e-15
    )


def test_gramian_of_a_damped_oscillator_is_known():
    # x'' + 2 d w x' + w^2 x = u: W = diag(1 / (4 d w^3), 1 / (4 d w))
    w, d = 3.0, 0.1
    a = np.array([[0.0, 1.0], [-(w**2), -2 * d * w]])
    factor = controllability_factor(a, np.array([[0.0], [1.0]]))
    expected = np.diag([1 / (4 * d * w**3), 1 / (4 * d * w)])
    np.testing.assert_allclose(factor @ factor.T, expected, atol=1e-15)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 20), st.integers(1, 5), st.integers(1, 25))
def test_factors_are_triangular_and_solve_the_lyapunov_equations(seed, n, m, p):
    rng = np.random.default_rng(seed)
    a, b, c = random_stable_matrix(rng, n), rng.normal(size=(n, m)), rng.normal(size=(p, n))
    reachable, observable = controllability_factor(a, b), observability_factor(a, c)
    for factor, matrix, right in ((reachable, a, b), (observable, a.T, c.T)):
        assert (factor == np.tril(factor)).all()
        assert (np.diag(factor) >= 0).all()
        gramian = factor @ factor.T
        residual = matrix @ gramian + gramian @ matrix.T + right @ right.T
        scale = np.linalg.norm(matrix) * np.linalg.norm(gramian)
        assert np.linalg.norm(residual) <= 1e-13 * scale


def test_both_factors_at_once_are_those_computed_apart():
    rng = np.random.default_rng(0)
    a, b, c = random_stable_matrix(rng, 9), rng.normal(size=(9, 2)), rng.normal(size=(3, 9))
    reachable, observable = gramian_factors(a, b, c)
    np.testing.assert_array_equal(reachable, controllability_factor(a, b))
    np.testing.assert_array_equal(observable, observability_factor(a, c))


def test_states_that_no_input_reaches_have_zero_rows():
    a = np.array([[-1.0, 1.0, 0.0], [0.0, -2.0, 0.0], [0.0, 0.0, -3.0]])
    factor = controllability_factor(a, np.array([[1.0], [0.0], [0.0]]))
    np.testing.assert_allclose(factor @ factor.T, np.diag([0.5, 0.0, 0.0]), atol=1e-16)


def test_no_input_gives_a_zero_factor():
    assert not controllability_factor(np.diag([-1.0, -2.0]), np.zeros((2, 1))).any()


@pytest.mark.parametrize("rightmost", [0.0, 0.75])
def test_an_eigenvalue_that_is_not_stable_is_named(rightmost):
    a = np.array([[-1.0, 4.0], [0.0, rightmost]])
    with pytest.raises(OptionError, match=rf"rightmost eigenvalue is {rightmost:.6g}\+0j"):
        controllability_factor(a, np.ones((2, 1)))


def test_hankel_values_of_a_dense_system_agree_with_50_digits():
    rng = np.random.default_rng(7)
    a, b, c = random_stable_matrix(rng, 7), rng.normal(size=(7, 2)), rng.normal(size=(3, 7))
    exact = hankel_values_in_50_digits(a, b, c)
    np.testing.assert_allclose(hankel_values(a, b, c), exact, atol=1e-13 * exact[0], rtol=0)


def test_hankel_values_over_16_decades_are_right_where_computed_gramians_fail():
    # Poles at -1 ... -12, all inputs and outputs one: both Gramians are 1 / (i + j).
    n = 12
    a, ones = -np.diag(np.arange(1.0, n + 1)), np.ones((n, 1))
    with mpmath.workdps(50):
        gramian = mpmath.matrix(n, n)
        for i in range(n):
            for j in range(n):
                gramian[i, j] = mpmath.mpf(1) / (i + j + 2)
        eigenvalues = mpmath.eigsy(gramian, eigvals_only=True)
        exact = np.array(sorted((float(v) for v in eigenvalues), reverse=True))
    assert exact[0] > 1e15 * exact[-1]
    by_factors = hankel_values(a, ones, ones.T)
    assert np.abs(by_factors - exact).max() < 1e-15 * exact[0]
    naive = hankel_values_by_gramians(a, ones, ones.T)
    assert np.abs(naive - exact).max() > 1e-10 * exact[0]
    assert np.log10(naive[-1] / exact[-1]) > 5


def test_hankel_values_agree_with_slicot():
    slycot = pytest.importorskip("slycot", reason="slycot is the reference; extra 'reduction'")
    rng = np.random.default_rng(3)
    n, m, p = 60, 3, 60
    a, b, c = random_stable_matrix(rng, n), rng.normal(size=(n, m)), np.eye(n)
    expected = slycot.ab09ad("C", "B", "N", n, m, p, a, b, c, nr=None, tol=0.0)[-1]
    np.testing.assert_allclose(hankel_values(a, b, c), expected, atol=1e-12 * expected[0], rtol=0)


def test_factor_agrees_with_slicot():
    slycot = pytest.importorskip("slycot", reason="slycot is the reference; extra 'reduction'")
    rng = np.random.default_rng(4)
    a, c = random_stable_matrix(rng, 8), rng.normal(size=(8, 8))
    upper, scale, _ = slycot.sb03od(8, 8, a.copy(), np.eye(8), c.copy(), "C")
    ours = observability_factor(a, c)
    np.testing.assert_allclose(ours @ ours.T, upper.T @ upper / scale**2, rtol=1e-10)
