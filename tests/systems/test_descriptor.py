from __future__ import annotations

import numpy as np
import pytest
from reduction.sparse_systems import random_descriptor

from gridfold.errors import OptionError
from gridfold.systems import DescriptorSystem, LinearSystem

POINTS = np.array([0.3j, 2.0 - 1j, 0.0, 15j])


def eliminated(system):
    """The same with the algebraic unknowns eliminated by dense matrices."""
    a11, a12, a21, a22 = (
        block.toarray() for block in (system.a11, system.a12, system.a21, system.a22)
    )
    follow = a12 @ np.linalg.inv(a22)
    return LinearSystem(a11 - follow @ a21, system.b1 - follow @ system.b2, system.c)


@pytest.mark.parametrize("algebraic", [0, 7])
def test_algebraic_unknowns_are_eliminated(algebraic):
    system = random_descriptor(1, 12, algebraic, 2, 3)
    dense, expected = system.dense(), eliminated(system)
    np.testing.assert_allclose(dense.a, expected.a, atol=1e-12)
    np.testing.assert_allclose(dense.b, expected.b, atol=1e-12)
    np.testing.assert_array_equal(dense.c, expected.c)
    np.testing.assert_allclose(system.transfer(POINTS), expected.transfer(POINTS), atol=1e-11)


def test_resolvent_and_its_adjoint():
    system, rng = random_descriptor(2, 15, 9, 2, 2), np.random.default_rng(0)
    a, rhs = eliminated(system).a, rng.normal(size=(15, 4)) + 1j * rng.normal(size=(15, 4))
    for s in POINTS:
        shifted, resolvent = s * np.eye(15) - a, system.at(s)
        np.testing.assert_allclose(shifted @ resolvent.solve(rhs), rhs, atol=1e-11)
        np.testing.assert_allclose(shifted.conj().T @ resolvent.solve_adjoint(rhs), rhs, atol=1e-11)


@pytest.mark.parametrize("n", [10, 150])
def test_radius_is_that_of_the_largest_eigenvalue(n):
    system = random_descriptor(3, n, 5, 1, 1)
    expected = np.abs(np.linalg.eigvals(eliminated(system).a)).max()
    np.testing.assert_allclose(system.radius, expected, rtol=1e-2)


def test_weights_of_the_first_inputs_leave_the_others_as_they_are():
    system = random_descriptor(4, 12, 7, 5, 2)
    weights = np.random.default_rng(1).normal(size=(3, 3))
    plain, weighed = (s.transfer(POINTS) for s in (system, system.with_input_weights(weights)))
    np.testing.assert_allclose(weighed[:, :, :3], plain[:, :, :3] @ weights, atol=1e-11)
    np.testing.assert_allclose(weighed[:, :, 3:], plain[:, :, 3:], atol=1e-12)


def test_an_eigenvalue_has_no_resolvent():
    integrator = DescriptorSystem(
        np.zeros((1, 1)), np.zeros((1, 0)), np.zeros((0, 1)), np.zeros((0, 0)),
        np.ones((1, 1)), np.zeros((0, 1)), np.ones((1, 1)),
    )  # fmt: skip
    with pytest.raises(OptionError, match="eigenvalue"):
        integrator.at(0.0)


def test_blocks_that_do_not_fit_are_named():
    with pytest.raises(OptionError, match=r"block A22 has shape \(1, 1\), expected \(2, 2\)"):
        DescriptorSystem(
            np.eye(3), np.ones((3, 2)), np.ones((2, 3)), np.eye(1),
            np.ones((3, 1)), np.ones((2, 1)), np.ones((1, 3)),
        )  # fmt: skip
