from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from linear_systems import (
    FREQUENCIES,
    peak_error,
    random_stable,
    resistor_capacitor_line,
    stable_systems,
    with_integrator_and_unstable_mode,
)
from scipy.linalg import solve_continuous_lyapunov

from gridfold.errors import OptionError
from gridfold.reduction import BalancedTruncation, SingularPerturbation
from gridfold.systems import LinearSystem

METHODS = [BalancedTruncation, SingularPerturbation]
both_methods = pytest.mark.parametrize("method", METHODS)


def reduce(method, system, **options):
    return method(**options).reduce(system, np.zeros(system.n))


def test_first_order_lag_has_half_its_dc_gain_as_hankel_value():
    result = reduce(BalancedTruncation, LinearSystem([[-4.0]], [[2.0]], [[6.0]]), order=1)
    np.testing.assert_allclose(result.hankel_values, [1.5], rtol=1e-15)
    assert result.bound == 0.0


def test_hankel_values_of_a_parallel_pair_of_lags_are_known():
    # Poles -1, -2 with b = c = 1: both Gramians [[1/2, 1/3], [1/3, 1/4]], eigenvalues of it.
    system = LinearSystem(np.diag([-1.0, -2.0]), np.ones((2, 1)), np.ones((1, 2)))
    result = reduce(BalancedTruncation, system, order=1)
    root = np.sqrt(1 / 64 + 1 / 9)
    np.testing.assert_allclose(result.hankel_values, [3 / 8 + root, 3 / 8 - root], rtol=1e-13)
    # Of a symmetric system truncated to one state the error is largest at zero, and is the bound.
    gap = np.abs(system.dc_gain - result.system.dc_gain).item()
    np.testing.assert_allclose(gap, result.bound, rtol=1e-12)


@both_methods
@settings(max_examples=60, deadline=None)
@given(system=stable_systems, data=st.data())
def test_transfer_error_obeys_the_bound(method, system, data):
    order = data.draw(st.integers(1, system.n))
    try:
        result = reduce(method, system, order=order)
    except OptionError as error:
        assert "above rounding" in str(error)  # noqa: PT017 - drawn systems may be nearly deficient
        return
    slack = 1e-11 * result.hankel_values[0]
    assert peak_error(system, result.system) <= result.bound * (1 + 1e-9) + slack
    assert (result.system.poles.real < 0).all()


@both_methods
def test_error_stays_below_the_bound_at_every_order(method):
    system = random_stable(3, 12, 2, 12)
    errors = []
    for order in range(1, 13):
        result = reduce(method, system, order=order)
        assert result.order == order
        errors.append(peak_error(system, result.system))
        assert errors[-1] <= result.bound + 1e-12 * result.hankel_values[0]
    assert errors[-1] < 1e-12 * result.hankel_values[0]


@pytest.mark.parametrize("order", [1, 2, 3, 5])
def test_dc_gain_of_singular_perturbation_is_exact(order):
    system = resistor_capacitor_line(12)
    exact = reduce(SingularPerturbation, system, order=order).system.dc_gain
    np.testing.assert_allclose(exact, system.dc_gain, rtol=1e-12)
    truncated = reduce(BalancedTruncation, system, order=order).system.dc_gain
    assert np.abs(truncated - system.dc_gain).max() > 1e-8


def test_feed_through_of_the_full_system_stays():
    full = random_stable(0, 6, 2, 3)
    fed = LinearSystem(full.a, full.b, full.c, np.arange(6.0).reshape(3, 2))
    for method in METHODS:
        difference = reduce(method, fed, order=3).system.d - reduce(method, full, order=3).system.d
        np.testing.assert_allclose(difference, fed.d, atol=1e-14)


@both_methods
def test_reduced_system_is_the_full_one_seen_through_the_state_map(method):
    full = random_stable(1, 9, 2, 9)
    result = reduce(method, full, order=4)
    lift, restrict = result.state_map.lift_matrix, result.state_map.restrict_matrix
    np.testing.assert_allclose(result.system.c, full.c @ lift, atol=1e-13)
    np.testing.assert_allclose(result.system.a, restrict @ full.a @ lift, atol=1e-12)


def test_lift_matrix_of_balanced_truncation_is_orthonormal():
    lift = reduce(BalancedTruncation, random_stable(1, 9, 2, 9), order=4).state_map.lift_matrix
    np.testing.assert_allclose(lift.T @ lift, np.eye(4), atol=1e-14)


@both_methods
def test_reference_is_the_origin_of_the_state_map(method):
    reference = np.arange(5.0)
    result = method(order=2).reduce(random_stable(2, 5, 1, 1), reference)
    np.testing.assert_array_equal(result.state_map.lift(np.zeros(2)), reference)


@both_methods
def test_names_of_inputs_and_outputs_stay(method):
    full = random_stable(2, 3, 1, 1)
    full = LinearSystem(full.a, full.b, full.c, full.d, ("a", "b", "c"), ("u",), ("y",))
    reduced = reduce(method, full, order=2).system
    assert (reduced.state_names, reduced.input_names) == (("z1", "z2"), ("u",))
    assert reduced.output_names == ("y",)


@both_methods
@pytest.mark.parametrize("order", [3, 5, 8])
def test_integrator_and_unstable_mode_are_kept_exactly(method, order):
    full = with_integrator_and_unstable_mode(random_stable(4, 10, 2, 3))
    result = reduce(method, full, order=order)
    assert (result.order, result.kept_exactly) == (order, 2)
    np.testing.assert_allclose(result.system.poles[:2], [0.3, 0.0], atol=1e-12)
    assert len(result.hankel_values) == 10
    error = peak_error(full, result.system, FREQUENCIES[1:])
    assert error <= result.bound + 1e-10
    np.testing.assert_array_equal(result.system.a[:2, 2:], 0)
    np.testing.assert_array_equal(result.system.a[2:, :2], 0)


@both_methods
def test_unstable_modes_alone_can_be_what_is_left(method):
    full = with_integrator_and_unstable_mode(random_stable(4, 3, 1, 1))
    assert reduce(method, full, order=2).order == 2
    assert reduce(method, full, tolerance=1e6).order == 2
    with pytest.raises(OptionError, match="order 1 is below the 2 states of unstable"):
        reduce(method, full, order=1)


@both_methods
def test_system_without_a_stable_part_is_kept_whole(method):
    full = LinearSystem([[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]], [[1.0, 0.0]])
    result = reduce(method, full, tolerance=1e-3)
    assert (result.order, result.kept_exactly, result.bound) == (2, 2, 0.0)
    np.testing.assert_allclose(result.system.transfer(2j), [[[-0.25]]], rtol=1e-14)


@both_methods
def test_tolerance_above_all_hankel_values_leaves_no_state(method):
    system = resistor_capacitor_line(4)
    result = reduce(method, system, tolerance=1e3)
    assert result.order == 0
    assert peak_error(system, result.system) <= result.bound * (1 + 1e-12)


def test_states_that_do_nothing_can_not_be_asked_for():
    system = LinearSystem(np.diag([-1.0, -2.0, -3.0]), [[1], [1], [0]], [[1, 1, 1]])
    assert reduce(BalancedTruncation, system, tolerance=1e-12).order == 2
    with pytest.raises(OptionError, match="order 3 asks for more than the 2 states that stand"):
        reduce(BalancedTruncation, system, order=3)


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), order=st.integers(1, 6), count=st.integers(1, 3))
def test_states_to_be_included_are_and_the_system_stays_stable(seed, order, count):
    full = random_stable(seed, 10, 2, 10)
    include = np.random.default_rng(seed).normal(size=(10, count))
    plain = reduce(BalancedTruncation, full, order=order)
    result = BalancedTruncation(order=order).reduce(full, np.zeros(10), include)
    assert result.order == order + count
    assert result.bound is None
    lift, restrict = result.state_map.lift_matrix, result.state_map.restrict_matrix
    np.testing.assert_allclose(restrict @ lift, np.eye(order + count), atol=1e-8)
    np.testing.assert_allclose(lift @ (restrict @ include), include, atol=1e-8)
    np.testing.assert_array_equal(lift[:, :order], plain.state_map.lift_matrix)
    # Orthogonal in x^T Wo x: the projection is symmetric in that product.
    energy = solve_continuous_lyapunov(full.a.T, -full.c.T @ full.c)
    product = energy @ lift @ restrict
    np.testing.assert_allclose(product, product.T, atol=1e-7 * np.abs(energy).max())
    assert (result.system.poles.real < 0).all()


def test_what_the_reduced_system_has_already_adds_no_state():
    full = random_stable(3, 8, 2, 8)
    plain = reduce(BalancedTruncation, full, order=4)
    there = plain.state_map.lift_matrix @ np.array([[1.0], [2.0], [-1.0], [0.5]])
    again = BalancedTruncation(order=4).reduce(full, np.zeros(8), np.hstack([there, 0 * there]))
    assert (again.order, again.bound) == (4, plain.bound)


def test_a_state_that_no_output_sees_cannot_be_included():
    blind = LinearSystem(np.diag([-1.0, -2.0]), np.ones((2, 1)), np.array([[1.0, 0.0]]))
    with pytest.raises(OptionError, match="no effect on any output"):
        BalancedTruncation(order=1).reduce(blind, np.zeros(2), np.array([[0.0], [1.0]]))


def test_the_steady_state_that_is_included_makes_its_gain_exact():
    full = random_stable(5, 12, 3, 12)
    steady = -np.linalg.solve(full.a, full.b[:, :1])
    result = BalancedTruncation(order=3).reduce(full, np.zeros(12), steady)
    np.testing.assert_allclose(result.system.dc_gain[:, 0], full.dc_gain[:, 0], atol=1e-10)
    assert np.abs(result.system.dc_gain - full.dc_gain)[:, 1:].max() > 1e-4


def test_tolerance_below_rounding_is_an_error():
    with pytest.raises(OptionError, match="tolerance 1e-30 asks for more than"):
        reduce(BalancedTruncation, resistor_capacitor_line(40), tolerance=1e-30)


def test_hankel_values_and_transfer_agree_with_slicot():
    slycot = pytest.importorskip("slycot", reason="slycot is the reference; extra 'reduction'")
    full = random_stable(11, 20, 2, 20)
    result = reduce(BalancedTruncation, full, order=6)
    found = slycot.ab09ad("C", "B", "N", 20, 2, 20, full.a, full.b, full.c, nr=6)
    order, a, b, c, values = found[:5]
    assert order == 6
    scale = values[0]
    np.testing.assert_allclose(result.hankel_values, values, atol=1e-12 * scale, rtol=0)
    reference = LinearSystem(a, b, c)
    assert peak_error(reference, result.system) < 1e-11 * scale


@pytest.mark.filterwarnings("ignore")
def test_truncation_agrees_with_pymor():
    pytest.importorskip("pymor", reason="pyMOR is the reference; extra 'interop'")
    from pymor.reductors.bt import BTReductor

    from gridfold.reduction.interop import to_pymor

    full = random_stable(12, 10, 2, 3)
    ours = reduce(BalancedTruncation, full, order=4).system
    found = BTReductor(to_pymor(full)).reduce(4).transfer_function
    difference = [ours.transfer(s)[0] - found.eval_tf(s) for s in FREQUENCIES]
    assert np.abs(difference).max() < 1e-10
