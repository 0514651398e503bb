"""Differences of two runs, worked out by hand."""

import numpy as np
import pytest

from gridfold.runs.monitor.differences import at_times, differences
from gridfold.runs.monitor.extremes import extremes

TIMES = np.array([0.0, 1.0, 2.0, 3.0])


def test_the_largest_difference_of_each_column_with_its_time_and_values():
    first = {"a:1": np.array([1.0, 2.0, 3.0, 4.0]), "a:2": np.zeros(4), "b:1": np.ones(4)}
    second = {"a:1": np.array([1.0, 2.5, 3.0, 3.0]), "a:2": np.full(4, 2.0), "b:1": np.ones(4)}
    most, less, same = differences(TIMES, first, second)
    assert (most.name, most.largest, most.at, most.values) == ("a:2", 2.0, 0.0, (0.0, 2.0))
    assert (less.name, less.largest, less.at, less.values) == ("a:1", -1.0, 3.0, (4.0, 3.0))
    assert less.root_mean_square == pytest.approx(np.sqrt((0.25 + 1) / 4))
    assert (same.name, same.largest) == ("b:1", 0.0)


def test_values_that_one_run_alone_has_are_gaps():
    first = {"a": np.array([1.0, np.nan, 3.0, np.nan])}
    (found,) = differences(TIMES, first, {"a": np.array([1.0, 2.0, 5.0, np.nan])})
    assert (found.largest, found.at, found.gaps) == (2.0, 2.0, 1)
    (none,) = differences(TIMES, {"a": np.full(4, np.nan)}, first)
    assert np.isnan(none.largest)
    assert none.gaps == 2


def test_curves_at_other_times_run_straight_and_end_where_they_end():
    times = np.array([0.0, 2.0])
    found = at_times(np.array([-1.0, 0.0, 0.5, 2.0, 3.0]), times, np.array([0.0, 4.0]))
    np.testing.assert_allclose(found, [np.nan, 0.0, 1.0, 4.0, np.nan])
    values = np.array([1.0, np.nan])
    assert at_times(times, times, values) is values


def test_extremes_leave_out_what_is_missing():
    table = np.column_stack([TIMES, [np.nan, 5.0, -1.0, 2.0], np.full(4, np.nan)])
    some, none = extremes(("x", "y"), table)
    assert (some.start, some.lowest, some.lowest_at) == (5.0, -1.0, 2.0)
    assert (some.highest, some.highest_at, some.end) == (5.0, 1.0, 2.0)
    assert np.isnan(none.lowest)
