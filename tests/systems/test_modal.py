from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm

from gridfold.numerics.modal_form import modal_form
from gridfold.numerics.steppers import RungeKutta4, time_grid
from gridfold.systems.modal import ModalSystem
from gridfold.systems.protocol import has_closed_form

#: Real and imaginary parts of the modes: two pairs, three real ones, and the common angle.
PAIRS, REAL = [(-0.4, 7.0), (-0.05, 1.3)], [-30.0, -2.0, -0.1, 0.0]


@pytest.fixture(scope="module")
def matrix() -> np.ndarray:
    blocks = np.diag([*(alpha for alpha, _ in PAIRS for _ in range(2)), *REAL])
    for k, (_, beta) in enumerate(PAIRS):
        blocks[2 * k, 2 * k + 1], blocks[2 * k + 1, 2 * k] = beta, -beta
    mix = np.eye(len(blocks)) + 0.1 * np.random.default_rng(3).normal(size=blocks.shape)
    return mix @ blocks @ np.linalg.inv(mix)


@pytest.fixture(scope="module")
def offset() -> np.ndarray:
    return np.random.default_rng(4).normal(size=2 * len(PAIRS) + len(REAL))


@pytest.fixture(scope="module")
def system(matrix, offset) -> ModalSystem:
    form = modal_form(matrix)
    return ModalSystem(form, form.inverse @ offset)


START = np.random.default_rng(5).normal(size=2 * len(PAIRS) + len(REAL))


def exact(matrix, offset, x0, t):
    """Solution of x' = A x + c from the exponential of [[A, c], [0, 0]]."""
    n = len(x0)
    larger = np.zeros((n + 1, n + 1))
    larger[:n, :n], larger[:n, n] = matrix, offset
    return (expm(larger * t) @ np.append(x0, 1.0))[:n]


@pytest.mark.parametrize(
    "elapsed",
    [
        time_grid(0.137, 8.0037, 0.02) - 0.137,
        time_grid(1.0, 3.0, 1 / 60) - 1.0,
        np.sort(np.random.default_rng(6).uniform(0, 10, 40)),
        np.array([0.0]),
        np.array([0.3, 0.4]),
        np.zeros(0),
    ],
    ids=["odd ends", "rounded times", "no grid", "start", "two", "none"],
)
def test_closed_form_is_what_the_matrix_exponential_says(system, matrix, offset, elapsed):
    form = system.form
    found = system.states_after(form.inverse @ START, elapsed) @ form.basis.T
    expected = np.array([exact(matrix, offset, START, t) for t in elapsed]).reshape(found.shape)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-10)


def test_every_row_is_the_one_that_its_time_alone_gives(system):
    elapsed = time_grid(0.0, 300.0, 0.01)
    along = system.states_after(START, elapsed)
    alone = np.array([system.states_after(START, elapsed[k : k + 1])[0] for k in (7, 3000, 30000)])
    np.testing.assert_allclose(along[[7, 3000, 30000]], alone, rtol=1e-9, atol=1e-10)


def test_a_mode_that_hardly_moves_has_the_solution_of_one_that_does_not():
    elapsed = np.linspace(0.0, 10.0, 11)
    still, slow = (
        ModalSystem(modal_form(np.diag([rate, -1.0])), np.array([0.2, 0.0])).states_after(
            np.array([1.0, 1.0]), elapsed
        )
        for rate in (0.0, 1e-13)
    )
    np.testing.assert_allclose(still[:, 0], 1 + 0.2 * elapsed, rtol=1e-14)
    np.testing.assert_allclose(slow, still, rtol=1e-11)


def test_runge_kutta_converges_to_the_closed_form_with_order_four(system):
    def error(step):
        times = time_grid(0.0, 4.0, step)
        stepped = RungeKutta4(step).integrate(system.compiled, times, START).states
        return np.abs(stepped - system.states_after(START, times)).max()

    errors = [error(step) for step in (0.01, 0.005, 0.0025)]
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    assert np.all(np.abs(orders - 4) < 0.3), orders


def test_states_are_written_where_they_are_asked_for(system):
    elapsed, out = np.linspace(0.1, 1.0, 10), np.empty((10, len(START)))
    assert system.states_after(START, elapsed, out) is out
    np.testing.assert_array_equal(out, system.states_after(START, elapsed))


def test_a_modal_system_has_a_closed_form_and_a_detailed_model_has_none(system, npcc):
    assert has_closed_form(system)
    assert not has_closed_form(npcc)
