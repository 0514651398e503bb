from __future__ import annotations

import numpy as np
import pytest
from reduction.sparse_systems import random_descriptor

from gridfold.errors import OptionError
from gridfold.reduction.slow_modes import slow_modes


@pytest.mark.parametrize(("n", "modes"), [(30, (0.1,)), (320, (0.1, -0.05 + 2j)), (400, ())])
@pytest.mark.parametrize("decay", [0.02, 0.3])
def test_all_slow_modes_and_no_others_are_found(n, modes, decay):
    full = random_descriptor(n, n, 40, 1, 1, modes)
    values, vectors = slow_modes(full, decay)
    poles = np.linalg.eigvals(full.dense().a)
    expected = poles[(poles.real > -decay) & (poles.imag >= 0)]
    assert len(values) == len(expected)
    for value in expected:
        assert np.abs(values - value).min() < 1e-8
    applied = full.dense().a @ vectors
    np.testing.assert_allclose(applied, vectors * values, atol=1e-7)
    np.testing.assert_allclose(np.linalg.norm(vectors, axis=0), 1.0, rtol=1e-10)


def test_modes_that_are_almost_equal_are_found_each():
    full = random_descriptor(2, 300, 30, 1, 1, (0.1 + 1j, 0.1 + 1.001j))
    values, vectors = slow_modes(full, 0.01)
    np.testing.assert_allclose(values, [0.1 + 1j, 0.1 + 1.001j], atol=1e-8)
    assert np.linalg.matrix_rank(vectors, tol=1e-6) == 2


@pytest.mark.parametrize("decay", [0.0, -1.0, np.inf, np.nan])
def test_decay_must_be_positive(decay):
    with pytest.raises(OptionError, match="positive"):
        slow_modes(random_descriptor(1, 4, 2, 1, 1), decay)
