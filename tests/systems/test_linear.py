from __future__ import annotations

import numpy as np
import pytest

from gridfold.errors import OptionError
from gridfold.systems import LinearSystem


@pytest.fixture
def oscillator():
    """y = 2 x1 with x'' + 0.4 x' + 4 x = u: transfer 2 / (s^2 + 0.4 s + 4)."""
    return LinearSystem([[0, 1], [-4, -0.4]], [[0], [1]], [[2, 0]])


def test_transfer_function_of_an_oscillator_is_known(oscillator):
    s = np.array([0.0, 1j, 2j, 1 + 3j])
    expected = 2 / (s**2 + 0.4 * s + 4)
    np.testing.assert_allclose(oscillator.transfer(s)[:, 0, 0], expected, rtol=1e-13)


def test_transfer_of_many_inputs_and_outputs_is_that_of_a_direct_solution():
    rng = np.random.default_rng(0)
    a, b, c, d = (rng.normal(size=shape) for shape in [(7, 7), (7, 2), (3, 7), (3, 2)])
    s = 1j * np.array([0.1, 1.0, 20.0])
    result = LinearSystem(a, b, c, d).transfer(s)
    assert result.shape == (3, 3, 2)
    expected = [c @ np.linalg.solve(x * np.eye(7) - a, b) + d for x in s]
    np.testing.assert_allclose(result, expected, atol=1e-12)


def test_transfer_takes_one_frequency(oscillator):
    assert oscillator.transfer(1j).shape == (1, 1, 1)


def test_transfer_is_not_finite_at_a_pole():
    assert not np.isfinite(LinearSystem([[-1]], [[1]], [[1]]).transfer(-1.0)).any()


def test_dc_gain_is_the_transfer_at_zero(oscillator):
    np.testing.assert_allclose(oscillator.dc_gain, [[0.5]], rtol=1e-15)


def test_integrator_has_no_dc_gain():
    with pytest.raises(OptionError, match="pole at zero"):
        _ = LinearSystem([[0.0]], [[1.0]], [[1.0]]).dc_gain


def test_poles_stand_from_right_to_left():
    a = np.diag([-3.0, -1.0, 0.0, 0.0])
    a[2, 3], a[3, 2] = 2, -2
    system = LinearSystem(a, np.ones((4, 1)), np.ones((1, 4)))
    np.testing.assert_allclose(system.poles, [2j, -2j, -1, -3], atol=1e-14)


def test_system_without_states_is_its_feed_through():
    system = LinearSystem(np.zeros((0, 0)), np.zeros((0, 2)), np.zeros((1, 0)), [[1, 2]])
    np.testing.assert_array_equal(system.transfer([0, 1j]), [[[1, 2]], [[1, 2]]])
    assert system.poles.shape == (0,)


def test_feed_through_is_zero_if_left_out(oscillator):
    np.testing.assert_array_equal(oscillator.d, [[0.0]])
    assert (oscillator.n, oscillator.m, oscillator.p) == (2, 1, 1)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"a": np.ones((2, 3))}, "matrix A has shape"),
        ({"b": np.ones((3, 1))}, "matrix B has shape"),
        ({"c": np.ones((1, 3))}, "matrix C has shape"),
        ({"d": np.ones((2, 2))}, "matrix D has shape"),
        ({"b": np.ones(2)}, "must be matrices"),
        ({"a": np.full((2, 2), np.nan)}, "matrix A of a linear system is not finite"),
        ({"state_names": ("x",)}, "1 state names for 2 states"),
        ({"input_names": ("u", "v")}, "2 input names for 1 inputs"),
    ],
)
def test_what_does_not_fit_is_an_error(changes, message):
    data = {"a": np.eye(2), "b": np.ones((2, 1)), "c": np.ones((1, 2))} | changes
    with pytest.raises(OptionError, match=message):
        LinearSystem(**data)
