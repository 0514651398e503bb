from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from linear_systems import peak_error
from reduction.external_area import external_descriptor
from reduction.sparse_systems import random_descriptor

from gridfold import build_model, load_case
from gridfold.errors import OptionError
from gridfold.partition import partition
from gridfold.reduction import BalancedTruncation, SingularPerturbation
from gridfold.reduction.krylov import compress
from gridfold.reduction.petrov import Bases

FREQUENCIES = 1j * np.geomspace(1e-3, 1e3, 90)


def size_of(system):
    return np.linalg.norm(system.transfer(FREQUENCIES), 2, axis=(1, 2)).max()


def reduce(system, include=None, **options):
    return BalancedTruncation(**options).reduce(system, np.zeros(system.n), include)


@pytest.fixture(scope="module")
def area():
    """The external area of NPCC (study area: buses 1 to 36)."""
    return external_descriptor(partition(build_model(load_case("npcc")), range(1, 37)))


@settings(max_examples=25, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    n=st.integers(1, 60),
    k=st.integers(0, 20),
    m=st.integers(1, 3),
    p=st.integers(1, 3),
)
def test_compressed_system_answers_like_the_full_one(seed, n, k, m, p):
    full = random_descriptor(seed, n, k, m, p)
    found = compress(full)
    assert peak_error(full.dense(), found.system, FREQUENCIES) <= 1e-8 * size_of(full.dense())
    np.testing.assert_allclose(found.restrict @ found.lift, np.eye(found.system.n), atol=1e-9)
    assert found.system.n <= n
    assert (found.system.poles.real < 0).all()


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(5, 80))
def test_hankel_values_are_those_of_the_full_system(seed, n):
    full = random_descriptor(seed, n, 12, 2, 2)
    found, expected = (reduce(system, order=1).hankel_values for system in (full, full.dense()))
    padded = np.zeros(n)
    padded[: len(found)] = found
    np.testing.assert_allclose(padded, expected, rtol=0, atol=1e-8 * expected[0])


@pytest.mark.parametrize("modes", [(0.3,), (0.0,), (0.2 + 2j,), (0.0, 0.1 + 1j, 0.1 + 1.02j)])
def test_modes_that_grow_or_stay_are_kept_exactly(modes):
    full = random_descriptor(7, 60, 15, 3, 3, modes)
    found = compress(full)
    values = np.linalg.eigvals(found.unstable.matrix)
    expected = np.array([z for mode in modes for z in {mode, np.conj(mode)}])
    assert len(values) == len(expected)
    for value in expected:
        assert np.abs(values - value).min() < 1e-9
    lift = found.unstable.lift
    np.testing.assert_allclose(full.apply(lift), lift @ found.unstable.matrix, atol=1e-8)
    np.testing.assert_allclose(found.restrict @ found.lift, np.eye(found.system.n), atol=1e-9)
    assert np.sum(found.system.poles.real > -1e-6) == len(expected)
    error = peak_error(full.dense(), found.system, FREQUENCIES)
    assert error <= 1e-8 * size_of(full.dense())


def test_growing_mode_that_no_input_reaches_is_left_out():
    full = random_descriptor(3, 30, 8, 2, 2, (0.4,))
    full.b1[-1] = 0.0
    assert compress(full).unstable.order == 0


def test_inputs_that_act_alike_cost_nothing():
    full = random_descriptor(4, 90, 20, 1, 2)
    twice = type(full)(
        full.a11, full.a12, full.a21, full.a22,
        np.hstack([full.b1, 2 * full.b1]), np.hstack([full.b2, 2 * full.b2]), full.c,
    )  # fmt: skip
    found = compress(twice).system.transfer(FREQUENCIES)
    np.testing.assert_allclose(found[:, :, 1], 2 * found[:, :, 0], rtol=1e-8, atol=1e-12)
    assert Bases.empty(twice).b.shape[1] == 1


def test_system_without_effect_is_compressed_to_nothing():
    full = random_descriptor(5, 20, 6, 2, 2)
    idle = type(full)(full.a11, full.a12, full.a21, full.a22, full.b1, full.b2, 0 * full.c)
    assert compress(idle).system.n == 0


def test_bases_that_do_not_meet_are_united():
    full = random_descriptor(6, 12, 4, 1, 1)
    unit = np.eye(12)
    empty = Bases.empty(full)
    assert empty.extended(unit[:, :2], unit[:, 2:4]).k == 0
    found = empty.united(unit[:, :2], unit[:, 2:4])
    assert found.k == 4
    np.testing.assert_allclose(found.w.T @ found.v, np.eye(4), atol=1e-14)
    expected = np.linalg.eigvals(full.dense().a[:4, :4])
    np.testing.assert_allclose(
        np.sort_complex(np.linalg.eigvals(found.middle)), np.sort_complex(expected), atol=1e-12
    )


@pytest.mark.parametrize("tolerance", [0.0, 1.0, -1e-3, np.nan])
def test_tolerance_out_of_range_is_an_error(tolerance):
    with pytest.raises(OptionError, match="between 0 and 1"):
        compress(random_descriptor(1, 4, 2, 1, 1), tolerance)


def test_area_of_npcc_is_compressed_without_loss(area):
    found, dense = compress(area), area.dense()
    points = 1j * np.geomspace(1e-3, 100, 150)
    size = np.linalg.norm(dense.transfer(points), 2, axis=(1, 2)).max()
    assert peak_error(dense, found.system, points) <= 3e-10 * size
    assert found.unstable.order == 0
    assert found.system.n < area.n / 2


def test_reduction_of_the_area_is_that_of_the_dense_matrices(area):
    tolerance = 1e-5
    found, expected = (reduce(system, tolerance=tolerance) for system in (area, area.dense()))
    assert (found.order, found.kept_exactly) == (expected.order, 0)
    scale = expected.hankel_values[0]
    np.testing.assert_allclose(found.bound, expected.bound, rtol=0, atol=1e-8 * scale)
    count = len(found.hankel_values)
    np.testing.assert_allclose(
        found.hankel_values, expected.hankel_values[:count], rtol=0, atol=1e-8 * scale
    )
    points = 1j * np.geomspace(1e-2, 50, 60)
    assert peak_error(area.dense(), found.system, points) <= tolerance
    states = found.state_map
    np.testing.assert_allclose(
        states.restrict_matrix @ states.lift_matrix, np.eye(found.order), atol=1e-8
    )


def test_states_to_be_included_are_in_the_range_of_the_lift(area):
    include = np.random.default_rng(0).normal(size=(area.n, 3))
    plain, found = reduce(area, order=40), reduce(area, include, order=40)
    lift, restrict = found.state_map.lift_matrix, found.state_map.restrict_matrix
    np.testing.assert_allclose(lift @ (restrict @ include), include, atol=1e-7)
    np.testing.assert_allclose(restrict @ lift, np.eye(found.order), atol=1e-8)
    assert plain.order <= found.order <= plain.order + 3
    # What the compressed system lacks of a state, no output sees but at the very first moment.
    np.testing.assert_allclose(area.c @ lift, found.system.c, atol=2e-5)


def test_both_balanced_methods_reduce_an_unstable_system_as_the_dense_one():
    full = random_descriptor(8, 70, 10, 2, 2, (0.05 + 2j,))
    for reducer in (BalancedTruncation(order=20), SingularPerturbation(order=20)):
        found, expected = (reducer.reduce(s, np.zeros(full.n)) for s in (full, full.dense()))
        assert found.kept_exactly == expected.kept_exactly == 2
        np.testing.assert_allclose(found.system.poles[0], 0.05 + 2j, atol=1e-9)
        assert found.order == expected.order
        gap = peak_error(found.system, expected.system, FREQUENCIES)
        assert gap <= 1e-6 * size_of(full.dense())
