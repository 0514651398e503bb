from __future__ import annotations

import numpy as np
import pytest

from gridfold.numerics.newton import complex_step_jacobian, newton_batch


def test_complex_step_jacobian_is_exact_to_rounding():
    def function(z):
        return np.array([np.exp(z[0]) * np.sin(z[1]), z[0] ** 3])

    z = np.array([[0.3, 1.1], [0.7, -0.4]])
    jacobian = complex_step_jacobian(function, z)
    a, b = z
    expected = [
        [np.exp(a) * np.sin(b), np.exp(a) * np.cos(b)],
        [3 * a**2, np.zeros(2)],
    ]
    np.testing.assert_allclose(jacobian, expected, rtol=1e-15)


def test_newton_solves_every_column_of_the_batch():
    targets = np.array([2.0, 3.0, 10.0])

    def function(z):
        return np.array([z[0] ** 2 - targets, z[1] - z[0]])

    solution = newton_batch(function, np.ones((2, 3)))
    np.testing.assert_allclose(solution, [np.sqrt(targets)] * 2, rtol=1e-14)


def test_a_column_is_the_same_whatever_stands_beside_it():
    def solved(targets):
        return newton_batch(lambda z: np.array([z[0] ** 3 - targets]), np.ones((1, len(targets))))

    targets = np.array([2.0, 1e9, 1e-6, 40.0])
    together = solved(targets)[0]
    assert together.tolist() == [float(solved(targets[k : k + 1])[0, 0]) for k in range(4)]


def test_a_column_that_leaves_the_numbers_holds_up_no_other():
    with np.errstate(all="ignore"):
        found = newton_batch(
            lambda z: np.array([np.where([True, False], z[0] - 3, np.exp(-z[0]) - 1e-300)]),
            np.array([[1.0, -5e2]]),
        )
    assert found[0, 0] == 3.0


def test_newton_returns_the_best_point_where_there_is_no_root():
    solution = newton_batch(lambda z: z**2 + 1, np.array([[0.5]]))
    assert np.isfinite(solution).all()


def test_it_ends_where_rounding_lets_no_correction_help():
    calls = []

    def function(z):
        calls.append(z)
        return z**2 - 2 + 3e-13 * (1 + len(calls) % 2)

    solution = newton_batch(function, np.array([[1.0]]))
    assert abs(solution[0, 0] - np.sqrt(2)) < 1e-12
    assert len(calls) < 25


def test_a_jacobian_of_the_callers_own_is_taken():
    taken = []

    def slopes(z):
        taken.append(z)
        return 2 * z[None]

    solution = newton_batch(lambda z: z**2 - 9, np.array([[4.0]]), jacobian=slopes)
    assert taken
    assert solution[0, 0] == pytest.approx(3.0)
