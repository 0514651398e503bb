"""Distributions: quantiles by independent formulas, and bounds that hold everywhere."""

from statistics import NormalDist

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from gridfold.sampling.distribution import Distribution, value_of

PARTS = st.floats(0.0, 1.0)
NUMBERS = st.floats(-1e6, 1e6)


@given(NUMBERS, st.floats(1e-3, 1e6), PARTS)
def test_a_uniform_value_lies_in_its_range_at_its_part(low, width, u):
    high = low + width
    value = Distribution(uniform=(low, high)).value(u)
    assert low <= value <= high
    assert value == pytest.approx(low + u * (high - low), abs=1e-9 * (1 + abs(low) + width))


@given(NUMBERS, st.floats(1e-3, 1e3), st.floats(0.01, 0.99))
def test_a_normal_value_is_the_quantile(mean, deviation, u):
    value = Distribution(normal=(mean, deviation)).value(u)
    expected = NormalDist(mean, deviation).inv_cdf(u)
    assert value == pytest.approx(expected, abs=1e-9 * (1 + abs(mean) + deviation))


@given(st.floats(-3.0, 2.0), st.floats(0.1, 4.0), PARTS)
def test_a_cut_normal_distribution_stays_within_its_bounds_and_keeps_its_shape(low, width, u):
    high = low + width
    value = Distribution(normal=(0.5, 1.0), within=(low, high)).value(u)
    assert low <= value <= high
    cdf = NormalDist(0.5, 1.0).cdf
    part = (cdf(value) - cdf(low)) / (cdf(high) - cdf(low))
    assert part == pytest.approx(u, abs=1e-6)


@given(st.lists(st.tuples(NUMBERS, st.floats(0.1, 10.0)), min_size=1, max_size=6), PARTS)
def test_a_choice_is_one_of_the_values(pairs, u):
    values, weights = zip(*pairs, strict=True)
    assert Distribution(choice=values, weights=weights).value(u) in values


def test_values_of_a_choice_come_as_often_as_their_weights_say():
    found = [Distribution(choice=(1, 2, 5), weights=(1, 2, 1)).value(u) for u in _even(4000)]
    assert [found.count(value) for value in (1, 2, 5)] == [1000, 2000, 1000]


def test_a_number_stands_for_itself():
    assert value_of(0.3, 0.9) == 0.3


@pytest.mark.parametrize(
    ("given", "fault"),
    [
        ({}, "give one of uniform, normal and choice, not none"),
        ({"uniform": (0, 1), "choice": (1,)}, "not uniform and choice"),
        ({"uniform": (1, 1)}, "the first number must be below the second"),
        ({"normal": (0, 0)}, "greater than 0"),
        ({"uniform": (0, 1), "within": (0, 1)}, "within is for a normal distribution"),
        ({"normal": (0, 1), "within": (50, 60)}, "has nothing within its bounds"),
        ({"choice": ()}, "at least 1"),
        ({"choice": (1, 2), "weights": (1,)}, "weights are as many"),
        ({"choice": (1, float("inf"))}, "finite"),
    ],
)
def test_what_is_no_distribution_is_refused(given, fault):
    with pytest.raises(ValidationError, match=fault):
        Distribution(**given)


def _even(n):
    return (np.arange(n) + 0.5) / n
