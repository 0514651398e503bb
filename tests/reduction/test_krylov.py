from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from linear_systems import peak_error
from reduction.external_area import external_descriptor
from reduction.sparse_systems import random_descriptor
from scipy.sparse import block_diag, hstack, vstack

from gridfold import build_model, load_case
from gridfold.errors import OptionError
from gridfold.partition import partition
from gridfold.reduction import BalancedTruncation, SingularPerturbation
from gridfold.reduction.krylov import compress
from gridfold.reduction.petrov import Bases, Directions, reals
from gridfold.reduction.true_modes import no_part

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
    assert Bases.empty(twice, no_part(twice.n)).b.shape[1] == 1


def test_system_without_effect_is_compressed_to_nothing():
    full = random_descriptor(5, 20, 6, 2, 2)
    idle = type(full)(full.a11, full.a12, full.a21, full.a22, full.b1, full.b2, 0 * full.c)
    assert compress(idle).system.n == 0


def sampled_bases(system, points, level=0.0):
    """Bases of all that samples at j `points` give, and X and Y formed."""
    bases = Bases.empty(system, no_part(system.n))
    b, c = bases.b, bases.c
    for s in 1j * np.array(points):
        x, y = system.at(s).solve(b), system.at(s).solve_adjoint(c.T)
        u, z = np.eye(len(c)) + 0j, np.eye(b.shape[1]) + 0j
        bases = bases.extended(Directions.at(s, c @ x, u, z), x, y, level)
    return bases, *(np.hstack([reals(block) for block in found]) for found in (bases.x, bases.y))


def test_overlaps_of_samples_follow_from_the_transfer_matrix():
    full = random_descriptor(6, 30, 8, 2, 2)
    bases, x, y = sampled_bases(full, [0.3, 1.0, 4.0])
    assert x.shape == (30, 12)
    np.testing.assert_allclose(bases.overlap, y.T @ x, rtol=0, atol=1e-13 * abs(y.T @ x).max())
    v, w = (basis.times(np.eye(bases.k)) for basis in (bases.v, bases.w))
    np.testing.assert_allclose(w.T @ v, np.eye(bases.k), atol=1e-9)
    np.testing.assert_allclose(bases.v.inner(y), v.T @ y, atol=1e-12)
    a = np.linalg.solve(w.T @ v, w.T @ full.apply(v))
    np.testing.assert_allclose(bases.reduced.a, a, atol=1e-7 * abs(a).max())
    np.testing.assert_allclose(bases.reduced.b, w.T @ bases.b, atol=1e-9 * abs(w).max())
    np.testing.assert_allclose(bases.reduced.c, bases.c @ v, atol=1e-9 * abs(v).max())


def test_projection_onto_samples_has_their_transfer_matrix():
    full = random_descriptor(9, 40, 8, 2, 2)
    points = [0.2, 0.9, 3.0]
    bases, _, _ = sampled_bases(full, points)
    expected = np.array([bases.c @ full.at(1j * p).solve(bases.b) for p in points])
    found = bases.reduced.transfer(1j * np.array(points))
    np.testing.assert_allclose(found, expected, atol=1e-9 * abs(expected).max())


def test_directions_below_the_level_wait_for_others():
    full = random_descriptor(9, 40, 8, 2, 2)
    every, _, _ = sampled_bases(full, [0.2, 0.9, 3.0])
    few, _, _ = sampled_bases(full, [0.2, 0.9, 3.0], level=0.05 * every.values[0])
    assert 0 < few.k < every.k
    np.testing.assert_allclose(few.values[: few.k], every.values[: few.k], rtol=0.05)


def test_random_combinations_stand_for_many_inputs_and_outputs():
    full = random_descriptor(4, 60, 20, 9, 8)
    bases = Bases.empty(full, no_part(full.n), most=5)
    assert (bases.b.shape, bases.c.shape) == ((60, 5), (5, 60))
    assert np.linalg.matrix_rank(np.hstack([full.b, bases.b])) == 9


def test_slow_mode_far_below_the_fastest_is_not_missed():
    fast = random_descriptor(2, 200, 10, 1, 1)
    scale = 1e-7 * fast.radius
    a11 = block_diag([fast.a11, [[-scale]]])
    slow = type(fast)(
        a11,
        vstack([fast.a12, np.zeros((1, 10))]),
        hstack([fast.a21, np.zeros((10, 1))]),
        fast.a22,
        np.vstack([fast.b1, [[scale]]]),
        fast.b2,
        np.hstack([fast.c, [[1e-6]]]),
    )
    found = compress(slow, 2e-9).system.transfer(1j * np.geomspace(1e-2, 1e2, 30) * scale)
    expected = slow.dense().transfer(1j * np.geomspace(1e-2, 1e2, 30) * scale)
    np.testing.assert_allclose(found, expected, atol=1e-8 * size_of(slow.dense()))


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
