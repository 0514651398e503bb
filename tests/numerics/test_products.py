"""Kernels that multiply by inverses give what they gave by dividing."""

import numpy as np
import pytest

from gridfold.dynamics.exciters.ieee_type1 import IEEE_TYPE1
from gridfold.dynamics.governors.ggov1 import GGOV1
from gridfold.dynamics.machines.two_axis import TWO_AXIS
from gridfold.numerics.products import with_products

UNITS = 5


@pytest.mark.parametrize(
    ("device", "divisors"),
    [(TWO_AXIS, 3), (IEEE_TYPE1, 3), (GGOV1, 4)],
    ids=["two_axis", "ieee_type1", "ggov1"],
)
def test_products_with_the_inverses_are_the_divisions(device, divisors):
    rng = np.random.default_rng(1)
    sizes = (
        len(device.states), len(device.inputs), len(device.parameter_rows), len(device.signal_rows)
    )  # fmt: skip
    x, u, p, y = (rng.uniform(0.5, 2.0, (rows, UNITS)) for rows in sizes)
    found = with_products(device.derivative)
    further = np.concatenate([p, found.inverses(p)])
    assert len(further) == len(p) + divisors
    by_division, by_product = np.zeros_like(x), np.zeros_like(x)
    device.derivative(x, u, p, y, by_division)
    found.function(x, u, further, y, by_product)
    np.testing.assert_allclose(by_product, by_division, rtol=1e-13, atol=1e-13)


def test_no_division_by_a_time_constant_is_left():
    x, u, y, dx = (np.ones((rows, 1)) for rows in (3, 2, 0, 3))
    p = np.ones((len(IEEE_TYPE1.parameter_rows), 1))
    found = with_products(IEEE_TYPE1.derivative)
    further = np.concatenate([p, np.zeros((len(found.divisors), 1))])
    found.function(x, u, further, y, dx)
    assert not dx.any()


def test_a_kernel_from_elsewhere_stays_as_it_is():
    def derivative(x, u, p, y, dx):
        for i in range(x.shape[1]):
            dx[0, i] = x[0, i] / p[0, i]

    found = with_products(derivative)
    assert found.function is derivative
    assert found.inverses(np.ones((1, 4))).shape == (0, 4)
