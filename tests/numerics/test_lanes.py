"""Eight numbers at once give what eight numbers give one by one."""

import numpy as np

from gridfold.numerics.compiled import jit
from gridfold.numerics.lanes import (
    WIDTH,
    aligned,
    all_lanes,
    beyond_lanes,
    load_lanes,
    size_lanes,
    store_lanes,
    where_less,
)


@jit()
def arithmetic(a, b, result):
    x, y = load_lanes(a, 1), load_lanes(b, 0)
    store_lanes(result, 0, 2.0 * x + y * x - all_lanes(3.0))
    store_lanes(result, WIDTH, size_lanes(x - y))
    store_lanes(result, 2 * WIDTH, beyond_lanes(x, y))
    store_lanes(result, 3 * WIDTH, where_less(x, y, x, y))


def test_lanes_follow_numpy():
    rng = np.random.default_rng(2)
    a, b = rng.standard_normal(WIDTH + 1), rng.standard_normal(WIDTH)
    a[3] = np.nan
    result = np.zeros(4 * WIDTH)
    arithmetic(a, b, result)
    x = a[1:]
    found = result.reshape(4, WIDTH)
    np.testing.assert_allclose(found[0], 2 * x + b * x - 3, rtol=1e-14)
    np.testing.assert_allclose(found[1], np.abs(x - b), rtol=1e-14)
    assert np.array_equal(found[2], ~(x <= b))
    assert np.array_equal(found[3], np.where(x < b, x, b))


def test_aligned_numbers_begin_at_a_line_of_the_cache():
    for size in (8, 24, 4096):
        copy = aligned(np.arange(float(size)).reshape(2, -1))
        assert copy.ctypes.data % 64 == 0
        assert copy.flags.c_contiguous
        assert copy.ravel().tolist() == list(range(size))
