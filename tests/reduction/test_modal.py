from __future__ import annotations

import numpy as np
import pytest
from linear_systems import (
    FREQUENCIES,
    peak_error,
    random_stable,
    with_integrator_and_unstable_mode,
)

from gridfold.errors import OptionError
from gridfold.numerics.modal_form import modal_form
from gridfold.reduction import ModalTruncation
from gridfold.reduction.modal import contributions
from gridfold.systems import LinearSystem


def reduce(system, order):
    return ModalTruncation(order).reduce(system, np.zeros(system.n))


@pytest.fixture
def pair_and_lags():
    """Poles -0.1 +- 2j (contribution 5), -1 (3), -2 (0.5)."""
    a = np.diag([-0.1, -0.1, -1.0, -2.0])
    a[0, 1], a[1, 0] = 2.0, -2.0
    return LinearSystem(a, np.array([[1.0], [0.0], [3.0], [1.0]]), np.ones((1, 4)) * [1, 0, 1, 1])


def test_contribution_is_the_peak_of_the_term_of_the_mode(pair_and_lags):
    form = modal_form(pair_and_lags.a)
    weights = contributions(form, pair_and_lags)
    order = np.lexsort((form.diagonal, np.abs(form.coupling)))
    np.testing.assert_allclose(weights[order], [0.5, 3.0, 5.0, 5.0], rtol=1e-13)


def test_contributions_are_those_of_complex_eigenvectors():
    full = random_stable(8, 9, 2, 3)
    form = modal_form(full.a)
    values, vectors = np.linalg.eig(full.a)
    rows = np.linalg.inv(vectors) @ full.b
    expected = np.linalg.norm(full.c @ vectors, axis=0) * np.linalg.norm(rows, axis=1)
    expected /= np.abs(values.real)
    np.testing.assert_allclose(contributions(form, full), expected, rtol=1e-10)


@pytest.mark.parametrize(
    ("order", "poles"),
    [
        (1, [-0.1 + 2j, -0.1 - 2j]),
        (2, [-0.1 + 2j, -0.1 - 2j]),
        (3, [-0.1 + 2j, -0.1 - 2j, -1]),
        (4, [-0.1 + 2j, -0.1 - 2j, -1, -2]),
    ],
)
def test_largest_contributions_stay_and_pairs_are_whole(pair_and_lags, order, poles):
    result = reduce(pair_and_lags, order)
    np.testing.assert_allclose(result.system.poles, poles, atol=1e-13)
    assert result.order == len(poles)
    assert result.hankel_values is None
    assert result.bound is None


def test_poles_kept_are_poles_of_the_full_system():
    full = random_stable(9, 12, 2, 2)
    for pole in reduce(full, 5).system.poles:
        assert np.abs(full.poles - pole).min() < 1e-11


def test_full_order_changes_nothing():
    full = random_stable(10, 9, 2, 3)
    assert peak_error(full, reduce(full, 9).system) < 1e-10


def test_integrator_and_unstable_mode_are_kept_exactly():
    full = with_integrator_and_unstable_mode(random_stable(4, 6, 1, 2))
    result = reduce(full, 2)
    assert (result.order, result.kept_exactly) == (2, 2)
    np.testing.assert_allclose(result.system.poles, [0.3, 0.0], atol=1e-12)
    with pytest.raises(OptionError, match="order 1 is below the 2 states"):
        reduce(full, 1)
    assert peak_error(full, reduce(full, 8).system, FREQUENCIES[1:]) < 1e-9


def test_two_integrators_in_series_are_kept_with_modes_beside_them():
    a = np.zeros((4, 4))
    a[0, 1], a[2, 2], a[3, 3] = 1.0, -1.0, -5.0
    full = LinearSystem(a, np.ones((4, 1)), np.ones((1, 4)))
    result = reduce(full, 3)
    np.testing.assert_allclose(result.system.poles, [0, 0, -1], atol=1e-7)
    assert result.kept_exactly == 2


def test_defective_stable_part_is_an_error():
    full = LinearSystem([[-1.0, 1.0], [0.0, -1.0]], np.ones((2, 1)), np.ones((1, 2)))
    with pytest.raises(OptionError, match="use a balanced method"):
        reduce(full, 1)
