"""The error of an approximate solution, against the difference of exact solutions."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from gridfold.numerics.compiled import compile_callback
from gridfold.numerics.defect import carry_error
from gridfold.numerics.modal_form import modal_form
from gridfold.numerics.rhs import RHS_SIGNATURE, CompiledRhs

#: Damping (1/s) and squared frequency (1/s^2) of a pendulum.
DAMPING, STIFFNESS = 0.3, 9.0


def _pendulum(integers, reals, work, x, dx):
    dx[0] = x[1]
    dx[1] = -DAMPING * x[1] - STIFFNESS * np.sin(x[0])


@pytest.fixture(scope="module")
def pendulum() -> CompiledRhs:
    address = compile_callback(_pendulum, RHS_SIGNATURE).address
    return CompiledRhs(address, np.zeros(0, dtype=np.int64), np.zeros(0), 0, 2)


@pytest.mark.parametrize("swing", [0.1, 1.5], ids=["small", "large"])
def test_the_error_of_a_linear_pendulum_is_found_to_second_order(
    pendulum: CompiledRhs, swing: float
) -> None:
    """The linear pendulum is the approximation; SciPy's solutions of both tell the error."""
    matrix = np.array([[0.0, 1.0], [-STIFFNESS, -DAMPING]])
    form = modal_form(matrix)
    assert form is not None
    options = {"rtol": 1e-11, "atol": 1e-12, "method": "DOP853"}
    start = np.array([swing, 0.0])
    exact = solve_ivp(lambda t, x: pendulum(x), (0, 3), start, dense_output=True, **options).sol
    linear = solve_ivp(lambda t, x: matrix @ x, (0, 3), start, dense_output=True, **options).sol
    misses = []
    for step in (0.05, 0.025):
        times = np.arange(0, 3 + step / 2, step)
        states = linear(times).T
        errors = carry_error(
            pendulum, form, form.basis.T, form.inverse, times, states, states @ matrix.T,
            np.zeros(2),
        )  # fmt: skip
        true = exact(times).T - states
        misses.append(np.abs(errors @ form.basis.T - true).max() / np.abs(true).max())
    assert misses[0] < 0.03
    assert 3 < misses[0] / misses[1] < 6


def test_a_jump_decays_as_the_exact_solution_says(pendulum: CompiledRhs) -> None:
    """About rest, an error at the start moves as a free swing."""
    form = modal_form(np.array([[0.0, 1.0], [-STIFFNESS, -DAMPING]]))
    assert form is not None
    times = np.linspace(0, 2, 81)
    still = np.zeros((81, 2))
    errors = carry_error(
        pendulum, form, form.basis.T, form.inverse, times, still, still,
        form.inverse @ [0.2, 0.0],
    )  # fmt: skip
    free = solve_ivp(
        lambda t, x: pendulum(x), (0, 2), [0.2, 0.0], rtol=1e-10, atol=1e-12, t_eval=times
    )
    np.testing.assert_allclose(errors @ form.basis.T, free.y.T, atol=2e-3)
