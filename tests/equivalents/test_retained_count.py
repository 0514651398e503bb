"""The search for the number of retained machines, on errors and costs that are known."""

from __future__ import annotations

from math import inf

import pytest

from gridfold.equivalents.fit import TriedCount
from gridfold.equivalents.retained_count import AFFORDABLE, MOST_TRIED, best_count, try_counts


def halving(linear_deg: float, cost: float = 0.02):
    """The error halves with each doubling; a machine costs a part of a detailed step."""
    return lambda count: TriedCount(count, linear_deg / count, cost * count)


def stalling(count: int) -> TriedCount:
    return TriedCount(count, 0.5, 0.1)


@pytest.mark.parametrize(
    ("wanted", "counts", "chosen"), [(1.0, (), 0), (0.3, (4,), 4), (0.1, (8, 16), 16)]
)
def test_the_search_begins_where_the_error_should_be_small_enough(wanted, counts, chosen) -> None:
    tried = try_counts(1.0, wanted, 100, halving(1.0))
    assert tuple(item.count for item in tried) == counts
    assert best_count(tried, 1.0, wanted, 10 * wanted) == chosen


def test_more_are_tried_where_the_error_is_still_too_large() -> None:
    tried = try_counts(1.0, 0.5, 100, halving(3.0))
    assert [item.count for item in tried] == [2, 4, 8]
    assert best_count(tried, 1.0, 0.5, 1.0) == 8


def test_the_search_begins_with_few_machines_however_large_the_error_is() -> None:
    tried = try_counts(1.0, 0.01, 100, halving(1.0, cost=0.03))
    assert [item.count for item in tried] == [8, 16, 32]
    assert tried[-1].cost > AFFORDABLE
    assert best_count(tried, 1.0, 0.01, 0.1) == 16
    assert best_count(tried, 1.0, 0.01, 0.05) == 0
    assert try_counts(inf, 0.01, 100, stalling)[0].count == 8


def test_fewer_are_tried_where_a_step_costs_too_much() -> None:
    tried = try_counts(1.0, 0.01, 100, halving(1.0, cost=0.3))
    assert [item.count for item in tried] == [8, 4, 2]
    assert [item.cost > AFFORDABLE for item in tried] == [True, True, False]
    assert best_count(tried, 1.0, 0.01, 1.0) == 2


def test_the_search_ends_where_more_machines_do_not_help() -> None:
    tried = try_counts(1.0, 0.4, 100, stalling)
    assert [item.count for item in tried] == [4, 8]
    assert len(try_counts(inf, 1e-9, 10**6, halving(1.0, cost=0.0))) <= MOST_TRIED


def test_a_rung_that_leaves_most_of_the_error_is_left_out() -> None:
    tried = (TriedCount(2, 0.8, 0.1), TriedCount(4, 0.6, 0.2))
    assert best_count(tried, 1.0, 0.1, 1.0) == 0
    assert best_count((), 1.0, 0.1, 1.0) == 0


@pytest.mark.parametrize("most", [0, 1])
def test_without_machines_to_retain_nothing_is_tried(most) -> None:
    assert try_counts(1.0, 0.1, most, stalling) == ()
