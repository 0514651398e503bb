"""The error of an approximate solution, against the difference of exact solutions."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from gridfold.errors import OptionError
from gridfold.numerics.compiled import compile_callback
from gridfold.numerics.defect import Carried, carry_error
from gridfold.numerics.error_modes import Modes, Way
from gridfold.numerics.modal_form import modal_form
from gridfold.numerics.rhs import RHS_SIGNATURE, CompiledRhs

#: Damping (1/s) and squared frequency (1/s^2) of a pendulum.
DAMPING, STIFFNESS = 0.3, 9.0
MATRIX = np.array([[0.0, 1.0], [-STIFFNESS, -DAMPING]])
#: Rows of the outputs by state: the angle.
ANGLE = np.array([[1.0, 0.0]])
EXACT = {"rtol": 1e-11, "atol": 1e-12, "method": "DOP853"}


def _pendulum(integers, reals, work, x, dx):
    dx[0] = x[1]
    dx[1] = -DAMPING * x[1] - STIFFNESS * np.sin(x[0])


def _straight(integers, reals, work, x, dx):
    dx[0] = x[1]
    dx[1] = -DAMPING * x[1] - STIFFNESS * x[0]


def _still(integers, reals, work, x, dx):
    dx[:] = 0.0


def compiled(function) -> CompiledRhs:
    address = compile_callback(function, RHS_SIGNATURE).address
    return CompiledRhs(address, np.zeros(0, dtype=np.int64), np.zeros(0), 0, 2)


@pytest.fixture(scope="module")
def pendulum() -> CompiledRhs:
    return compiled(_pendulum)


@pytest.fixture(scope="module")
def straight() -> CompiledRhs:
    return compiled(_straight)


@pytest.fixture(scope="module")
def modes() -> Modes:
    """Those of the linear pendulum, with both states exact."""
    form = modal_form(MATRIX)
    assert form is not None
    nothing = np.zeros((0, 2))
    return Modes(form, form.basis, form.inverse, np.arange(2), nothing, nothing)


def along(solution, span: float, step: float = 0.01) -> tuple[np.ndarray, np.ndarray]:
    times = np.linspace(0, span, round(span / step) + 1)
    return times, np.ascontiguousarray(solution(times).T)


def solve(rhs, start, span: float):
    return solve_ivp(lambda t, x: rhs(x), (0, span), start, dense_output=True, **EXACT).sol


def carried(rhs, modes, own, times, states, start, steps=(0.05, 0.4), least=1e-6) -> Carried:
    outputs = ANGLE @ modes.into
    start = modes.project(np.asarray(start, dtype=float))
    way = Way.itself(modes)
    return carry_error(rhs, modes, outputs, way, own, times, states, start, steps, least)


def in_sequence(rhs, form, times, states, rates):
    """Cox & Matthews' ETD2RK one step after the other, in plain Python."""
    matrix, w = form.matrix(), np.zeros(2)
    errors, before = [w], None
    for k, y in enumerate(states):
        if k:
            h = times[k] - times[k - 1]
            one = np.eye(2)
            power = np.linalg.matrix_power
            terms = [power(matrix * h, j) for j in range(25)]
            factorial = np.cumprod([1.0, *range(1, 30)])
            phi = [sum(t / factorial[j + m] for j, t in enumerate(terms)) for m in range(3)]
            w = phi[0] @ w + h * phi[1] @ before
        g = form.inverse @ (rhs(y + form.basis @ w) - rates[k]) - matrix @ w
        if k:
            w = w + h * phi[2] @ one @ (g - before)
            errors.append(w)
        before = g
    return np.array(errors)


@pytest.mark.parametrize("swing", [0.1, 1.5], ids=["small", "large"])
def test_the_error_of_a_linear_pendulum_is_that_of_exact_solutions(
    pendulum, straight, modes, swing
) -> None:
    """The linear pendulum is the approximation; SciPy's solutions of both tell the error."""
    start = [swing, 0.0]
    times, states = along(solve(straight, start, 6), 6)
    found = carried(pendulum, modes, straight, times, states, [0, 0])
    true = solve(pendulum, start, 6)(times[found.rows])[0] - states[found.rows, 0]
    errors = modes.lift(found.errors)[:, 0]
    assert np.abs(errors - true).max() < 0.05 * np.abs(true).max()
    assert len(found.rows) < len(times) / 4


@pytest.mark.parametrize("swing", [0.1, 1.0], ids=["small", "large"])
def test_windows_come_to_what_steps_in_sequence_do(pendulum, straight, modes, swing) -> None:
    start = [swing, 0.0]
    times, states = along(solve(straight, start, 6), 6)
    rates = states @ MATRIX.T
    sequence = in_sequence(pendulum, modes.form, times, states, rates) @ modes.into.T
    found = carried(pendulum, modes, straight, times, states, [0, 0])
    apart = np.abs(modes.lift(found.errors) - sequence[found.rows])[:, 0]
    assert apart.max() < 0.03 * np.abs(sequence[:, 0]).max()


def test_a_jump_decays_as_the_exact_solution_says(pendulum, modes) -> None:
    """About rest, an error at the start moves as a free swing."""
    times = np.linspace(0, 2, 201)
    states = np.zeros((201, 2))
    found = carried(pendulum, modes, compiled(_still), times, states, [0.2, 0.0])
    free = solve(pendulum, [0.2, 0.0], 2)(times).T
    np.testing.assert_allclose(modes.lift(found.errors), free[found.rows], atol=4e-3)
    every = modes.lift(found.between(modes.form, times))
    np.testing.assert_allclose(every[:, 0], free[:, 0], atol=4e-3)


def test_steps_grow_where_the_error_moves_as_the_modes_do(straight, modes) -> None:
    """Without a defect only exponentials are left, which are exact with any step."""
    times = np.linspace(0, 16, 1601)
    found = carried(straight, modes, compiled(_still), times, np.zeros((1601, 2)), [0.2, 0.0])
    assert len(found.rows) < 16 / 0.05 / 2
    free = solve(straight, [0.2, 0.0], 16)(times[found.rows]).T
    np.testing.assert_allclose(modes.lift(found.errors), free, atol=1e-9)


def test_a_smaller_system_s_states_are_lifted_on_the_way(pendulum, straight, modes) -> None:
    """Its coordinates: the angle in degrees, and the speed itself."""
    slopes = np.array([[np.deg2rad(1.0), 0.0], [0.0, 1.0]])
    way = Way.between(modes, np.zeros(2), slopes)
    assert (way.exact.tolist(), way.places.tolist(), way.linear.tolist()) == ([1], [1], [0])
    start = [0.8, 0.0]
    times, states = along(solve(straight, start, 3), 3)
    scaled = np.ascontiguousarray(states @ np.linalg.inv(slopes))

    def in_degrees(integers, reals, work, x, dx):
        dx[0] = np.rad2deg(x[1])
        dx[1] = -DAMPING * x[1] - STIFFNESS * np.deg2rad(x[0])

    own, outputs, still = compiled(in_degrees), ANGLE @ modes.into, np.zeros(2)
    found = carry_error(pendulum, modes, outputs, way, own, times, scaled, still, (0.05, 0.4), 1e-6)
    plain = carried(pendulum, modes, straight, times, states, [0, 0])
    np.testing.assert_array_equal(found.rows, plain.rows)
    np.testing.assert_allclose(found.errors, plain.errors, atol=1e-12)


def test_linear_coordinates_of_the_modes_count_as_the_states_they_stand_for(
    pendulum, straight, modes
) -> None:
    form, nothing = modes.form, np.zeros(0, dtype=np.int64)
    turned = Modes(form, form.basis, form.inverse, nothing, np.eye(2), np.eye(2))
    times, states = along(solve(straight, [0.8, 0.0], 3), 3)
    plain = carried(pendulum, modes, straight, times, states, [0.1, 0])
    other = carried(pendulum, turned, straight, times, states, [0.1, 0])
    np.testing.assert_allclose(other.errors, plain.errors, atol=1e-12)
    np.testing.assert_allclose(turned.rows(np.array([1])), modes.rows(np.array([1])))


def test_an_array_of_another_shape_is_refused(pendulum, straight, modes) -> None:
    times = np.linspace(0, 1, 11)
    with pytest.raises(OptionError, match=r"states has shape \(10, 2\), expected \(11, 2\)"):
        carried(pendulum, modes, straight, times, np.zeros((10, 2)), [0, 0])


def test_an_error_that_becomes_too_large_is_not_followed(straight, modes) -> None:
    """The approximation stands still beside a swing of 1 rad; from row to row nothing else is asked."""
    times = np.linspace(0, 3, 301)
    states = np.ascontiguousarray(np.tile([1.0, 0.0], (301, 1)))
    still = compiled(_still)
    outputs, way = ANGLE @ modes.into, Way.itself(modes)
    full, cut = (
        carry_error(
            straight,
            modes,
            outputs,
            way,
            still,
            times,
            states,
            np.zeros(2),
            (0.05, 0.4),
            1e-6,
            most,
        )
        for most in (10.0, 1.0)
    )
    assert full.rows[-1] == 300
    assert 0 < cut.rows[-1] < 300
    np.testing.assert_array_equal(cut.errors[:-1], full.errors[: len(cut.rows) - 1])
    errors = np.abs(modes.lift(full.errors)[:, 0])
    assert errors[full.rows <= cut.rows[-1]].max() > 1.0
