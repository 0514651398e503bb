"""Control blocks against what they are the approximation or the limit of."""

from __future__ import annotations

import cmath

import numpy as np
import pytest

from gridfold.dynamics import blocks


def test_delay_is_the_exponential_up_to_the_order_of_its_pade_approximation():
    """The error of order five: exp(-z) - R(z) = z^5 / 720 + ... for the diagonal of order two."""
    time = 0.3
    for frequency in (0.5, 1.0, 2.0):
        s = 1j * frequency
        a = np.array([[0.0, 1.0], [-12 / time**2, -6 / time]])
        b = np.array([0.0, 12 / time**2])
        x = np.linalg.solve(s * np.eye(2) - a, b)
        out, rate, slope_rate = blocks.delay.py_func(1.0, x[0], x[1], time)
        np.testing.assert_allclose([rate, slope_rate], s * x, rtol=1e-9)
        assert abs(out - cmath.exp(-s * time)) < 1.1 * abs(s * time) ** 5 / 720
        assert abs(out) == pytest.approx(1.0, abs=1e-12)


def test_delay_of_zero_passes_its_input():
    assert blocks.delay.py_func(0.7, 0.1, 0.2, 0.0)[0] == 0.7


@pytest.mark.parametrize(("value", "expected"), [(0.3, 0.2), (-0.3, -0.2), (0.05, 0.0)])
def test_dead_band_lets_through_what_exceeds_it(value, expected):
    assert blocks.dead_band(value, 0.1) == pytest.approx(expected)
    assert blocks.dead_band(value, 0.0) == value


def test_exponential_saturation_passes_through_both_points_and_has_no_threshold():
    for flux, value in ((1.0, 0.1), (1.2, 0.5)):
        assert blocks.exponential_saturation(flux, 0.1, 0.5) == pytest.approx(value, rel=1e-12)
    assert 0 < blocks.exponential_saturation(0.5, 0.1, 0.5) < 0.001
    assert blocks.exponential_saturation(0.0, 0.1, 0.5) == 0.0


@pytest.mark.parametrize(("low", "high"), [(0.0, 0.0), (0.0, 1.0), (0.2, 0.0)])
def test_a_saturation_point_of_zero_means_that_nothing_saturates(low, high):
    for value in (0.5, 1.0, 1.3):
        assert blocks.quadratic_saturation(value, 1.0, low, 1.2, high) == 0.0
        assert blocks.exponential_saturation(value, low, high) == 0.0


@pytest.mark.parametrize(("low", "high"), [(0.1, 0.5), (0.3, 0.3), (0.3, 0.26)])
def test_quadratic_saturation_passes_through_both_points_in_any_order(low, high):
    """Also where S is equal or falls, as long as E S(E) rises."""
    for pair in ((1.0, low, 1.2, high), (1.2, high, 1.0, low)):
        assert blocks.quadratic_saturation(1.0, *pair) == pytest.approx(low, rel=1e-12)
        assert blocks.quadratic_saturation(1.2, *pair) == pytest.approx(1.2 * high, rel=1e-12)


def test_integral_of_a_limited_pi_stands_at_the_limit_and_turns_back_at_once():
    out, rate = blocks.limited_pi(0.5, 0.9, 2.0, 3.0, -1.0, 1.0)
    assert (out, rate) == (1.0, 0.0)
    assert blocks.limited_pi(-0.05, 1.3, 2.0, 3.0, -1.0, 1.0)[1] == pytest.approx(-0.15)
    assert blocks.limited_pi(0.1, 0.5, 2.0, 3.0, -1.0, 1.0) == pytest.approx((0.7, 0.3))


def test_gates_choose_the_lower_and_the_higher_value():
    assert blocks.lower(1.0, 2.0) == 1.0
    assert blocks.higher(1.0, 2.0) == 2.0
