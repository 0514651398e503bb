"""The a-priori bound (6) on the external area of NPCC, whose outputs are all its states."""

from __future__ import annotations

import numpy as np
import pytest

from gridfold.numerics.blas import one_blas_thread
from gridfold.partition import linearize_external, partition
from gridfold.reduction import BalancedTruncation

#: In rad/s, from far below to far above the modes of the external area.
FREQUENCIES = np.logspace(-3, 3, 60)


@one_blas_thread
def response(system):
    return system.transfer(1j * FREQUENCIES)


@pytest.fixture(scope="module")
def external(npcc):
    return linearize_external(partition(npcc, range(1, 37)), npcc, npcc.x0).system


@pytest.fixture(scope="module")
def full_response(external):
    return response(external)


@pytest.mark.parametrize("order", range(20, 201, 20))
def test_transfer_error_of_the_external_area_obeys_the_bound(external, full_response, order):
    result = BalancedTruncation(order=order).reduce(external, np.zeros(external.n))
    difference = full_response - response(result.system)
    error = np.linalg.norm(difference, 2, axis=(1, 2)).max()
    rounding = 1e-12 * result.hankel_values[0]
    assert result.order == order
    assert 0 < error <= result.bound + rounding
