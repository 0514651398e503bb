from __future__ import annotations

import numpy as np
import pytest

from gridfold.numerics.spectral_split import split_spectrum


def mixed(diagonal_blocks, seed=0):
    n = len(diagonal_blocks)
    mix = np.random.default_rng(seed).normal(size=(n, n))
    return mix @ diagonal_blocks @ np.linalg.inv(mix)


def test_stable_matrix_is_left_alone():
    a = mixed(np.diag([-1.0, -2.0, -5.0]))
    unstable, stable = split_spectrum(a)
    assert unstable.order == 0
    assert stable.matrix is a
    np.testing.assert_array_equal(stable.lift, np.eye(3))


def test_parts_are_invariant_and_complete():
    blocks = np.diag([-1.0, -2.0, 0.0, 0.4, -0.3, -0.3])
    blocks[4, 5], blocks[5, 4] = 2.0, -2.0
    a = mixed(blocks)
    parts = split_spectrum(a)
    assert [part.order for part in parts] == [2, 4]
    for part in parts:
        np.testing.assert_allclose(a @ part.lift, part.lift @ part.matrix, atol=1e-12)
        np.testing.assert_allclose(part.restrict @ part.lift, np.eye(part.order), atol=1e-13)
    whole = sum(part.lift @ part.restrict for part in parts)
    np.testing.assert_allclose(whole, np.eye(6), atol=1e-13)
    unstable = np.sort(np.linalg.eigvals(parts[0].matrix).real)
    np.testing.assert_allclose(unstable, [0.0, 0.4], atol=1e-12)


def test_two_integrators_in_series_are_split_off_together():
    blocks = np.diag([0.0, 0.0, -1.0, -3.0])
    blocks[0, 1] = 1.0
    unstable, stable = split_spectrum(mixed(blocks))
    assert (unstable.order, stable.order) == (2, 2)
    np.testing.assert_allclose(unstable.matrix @ unstable.matrix, np.zeros((2, 2)), atol=1e-12)


@pytest.mark.parametrize(("pole", "count"), [(-0.9e-5, 1), (-1.1e-5, 0)])
def test_limit_is_a_millionth_of_the_spectral_radius(pole, count):
    unstable, _ = split_spectrum(np.diag([-10.0, pole, -1.0]))
    assert unstable.order == count


def test_nothing_stable_leaves_an_empty_part():
    unstable, stable = split_spectrum(np.array([[1.0, 2.0], [0.0, 0.0]]))
    assert (unstable.order, stable.order) == (2, 0)
    assert stable.lift.shape == (2, 0)
