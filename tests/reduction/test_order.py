from __future__ import annotations

import numpy as np
import pytest

from gridfold.errors import OptionError
from gridfold.reduction import BalancedTruncation, ModalTruncation, SingularPerturbation
from gridfold.reduction.order import numerical_rank, smallest_order
from gridfold.systems import LinearSystem

VALUES = np.array([4.0, 2.0, 1.0, 0.5])
both_methods = pytest.mark.parametrize("method", [BalancedTruncation, SingularPerturbation])


@pytest.mark.parametrize(
    ("tolerance", "order"),
    [(0.99, 4), (1.0, 3), (2.99, 3), (3.0, 2), (7.0, 1), (14.99, 1), (15.0, 0), (1e9, 0)],
)
def test_order_is_the_smallest_whose_tail_meets_the_tolerance(tolerance, order):
    assert smallest_order(VALUES, tolerance) == order


def test_order_of_nothing_is_zero():
    assert smallest_order(np.zeros(0), 1e-5) == 0
    assert numerical_rank(np.zeros(0)) == 0


def test_rank_counts_what_stands_above_rounding():
    assert numerical_rank(np.array([1.0, 1e-12, 1e-17, 0.0])) == 2
    assert numerical_rank(np.zeros(3)) == 0


@both_methods
@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({}, "either the tolerance or the order"),
        ({"tolerance": 1e-5, "order": 3}, "either the tolerance or the order"),
        ({"tolerance": 0.0}, "must be positive: 0.0"),
        ({"tolerance": -1e-5}, "must be positive: -1e-05"),
        ({"tolerance": np.nan}, "must be positive: nan"),
        ({"order": 0}, "must be at least 1: 0"),
    ],
)
def test_options_out_of_range_are_an_error_at_once(method, options, message):
    with pytest.raises(OptionError, match=message):
        method(**options)


def test_modal_order_must_be_positive():
    with pytest.raises(OptionError, match="must be at least 1: 0"):
        ModalTruncation(0)


@pytest.mark.parametrize(
    "reducer", [BalancedTruncation(order=3), SingularPerturbation(order=3), ModalTruncation(3)]
)
def test_order_beyond_the_number_of_states_is_an_error(reducer):
    system = LinearSystem(np.diag([-1.0, -2.0]), np.ones((2, 1)), np.ones((1, 2)))
    with pytest.raises(OptionError, match="order 3 of the reduced system exceeds the 2 states"):
        reducer.reduce(system, np.zeros(2))
