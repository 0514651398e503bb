"""Tables of curves, looked at once, say what NumPy says of them."""

import numpy as np

from gridfold.numerics.rows import column_range, extreme_rows, less_reference, widest_row

CURVES = np.random.default_rng(3).normal(size=(90, 7))
#: A view with gaps, as curves stand among others.
SOME = np.random.default_rng(4).normal(size=(90, 12))[:, 3:8]


def test_extremes_are_in_the_rows_where_numpy_finds_them_first():
    for curves in (CURVES, SOME, np.round(CURVES)):
        highest, lowest = extreme_rows(curves)
        np.testing.assert_array_equal(highest, curves.argmax(axis=0))
        np.testing.assert_array_equal(lowest, curves.argmin(axis=0))
        low, high = column_range(curves)
        np.testing.assert_array_equal(low, curves.min(axis=0))
        np.testing.assert_array_equal(high, curves.max(axis=0))


def test_what_is_not_a_number_does_not_count():
    curves = CURVES.copy()
    curves[:, 2] = np.nan
    curves[5, 4] = np.nan
    low, high = column_range(curves)
    np.testing.assert_array_equal(low, np.where(np.arange(7) == 2, np.nan, np.fmin.reduce(curves)))
    np.testing.assert_array_equal(high, np.where(np.arange(7) == 2, np.nan, np.fmax.reduce(curves)))
    assert extreme_rows(curves)[0][4] == np.nanargmax(curves[:, 4])
    apart, row = widest_row(curves[:, 3:])
    spread = np.ptp(curves[:, 3:], axis=1)
    assert (apart, row) == (np.nanmax(spread), np.nanargmax(spread))


def test_the_widest_row_is_the_first_of_the_largest_distance():
    assert widest_row(np.array([[0.0, 1.0], [3.0, 1.0], [5.0, 7.0]])) == (2.0, 1)
    assert widest_row(np.zeros((0, 3))) == (-1.0, -1)


def test_each_row_loses_its_own_reference():
    reference = np.arange(90.0)
    np.testing.assert_array_equal(less_reference(SOME, reference), SOME - reference[:, None])
