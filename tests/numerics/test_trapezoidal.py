"""The implicit trapezoidal rule: order, stiffness, its solvers, its step control."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import gridfold as gf
from gridfold.dynamics.network.closed import ClosedNetworks
from gridfold.errors import OptionError
from gridfold.grid.network_state import NetworkState
from gridfold.numerics.band_watch import BandWatch
from gridfold.numerics.compiled import compile_callback
from gridfold.numerics.implicit import CompiledSolver, dense_solver, numerical_jacobian
from gridfold.numerics.rhs import RHS_SIGNATURE, CompiledRhs, call_rhs
from gridfold.numerics.steppers import ImplicitTrapezoidal, ScipyReference, time_grid
from gridfold.numerics.watch import SpreadWatch


def _pendulum(integers, reals, work, x, dx):
    dx[0] = x[1]
    dx[1] = -reals[0] * np.sin(x[0])


def _decay(integers, reals, work, x, dx):
    for i in range(len(x)):
        dx[i] = reals[i] * x[i]


def _van_der_pol(integers, reals, work, x, dx):
    dx[0] = x[1]
    dx[1] = reals[0] * (1.0 - x[0] * x[0]) * x[1] - x[0]


def _robertson(integers, reals, work, x, dx):
    """Three reactions with rates from 0.04 to 3e7 (Hairer & Wanner II, section IV.10)."""
    first, third = 0.04 * x[0] - 1e4 * x[1] * x[2], 3e7 * x[1] * x[1]
    dx[0] = -first
    dx[1] = first - third
    dx[2] = third


def _contact(integers, reals, work, x, dx):
    """A mass that falls on a stiff spring, with which it is in contact below zero."""
    dx[0] = x[1]
    dx[1] = -1.0 - reals[0] * min(x[0], 0.0) - 0.1 * x[1]


def _system(function, n_states: int, *reals: float) -> CompiledRhs:
    address = compile_callback(function, RHS_SIGNATURE).address
    return CompiledRhs(address, np.zeros(0, dtype=np.int64), np.array(reals), 0, n_states)


START = np.array([1.0, 0.3])


@pytest.fixture(scope="module")
def pendulum() -> CompiledRhs:
    return _system(_pendulum, 2, 4.0)


def _end(stepper, rhs: CompiledRhs, x0: np.ndarray, t_end: float) -> np.ndarray:
    return stepper.integrate(rhs, time_grid(0.0, t_end, stepper.step), x0).states[-1]


def _solution(solver: CompiledSolver, b: np.ndarray) -> np.ndarray:
    y = np.empty(len(b))
    scratch = np.zeros(solver.scratch_size)
    call_rhs(solver.address, solver.integers, solver.reals, b, y, scratch)
    return y


def test_observed_order_is_two(pendulum):
    exact = _end(ScipyReference(1.0), pendulum, START, 4.0)
    steps = (0.04, 0.02, 0.01, 0.005)
    errors = [
        np.abs(_end(ImplicitTrapezoidal(h), pendulum, START, 4.0) - exact).max() for h in steps
    ]
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    assert np.all(np.abs(orders - 2) < 0.02), orders


def test_a_step_solves_the_equation_of_the_rule(pendulum):
    h = 0.1
    end = _end(ImplicitTrapezoidal(h), pendulum, START, h)
    residual = START + h / 2 * (pendulum(START) + pendulum(end)) - end
    np.testing.assert_allclose(residual, 0.0, atol=1e-8)


@pytest.mark.parametrize(
    ("function", "stiffness", "start"),
    [(_pendulum, 4.0, (1.0, 0.3)), (_contact, 1e5, (0.5, 0.0)), (_van_der_pol, 20.0, (2.0, 0.0))],
)
def test_every_step_of_a_run_solves_the_equation_of_the_rule(function, stiffness, start):
    rhs, h = _system(function, 2, stiffness), 0.01
    states = ImplicitTrapezoidal(h).integrate(rhs, h * np.arange(1001), np.array(start)).states
    f = np.array([rhs(x) for x in states])
    correction = np.array([
        np.linalg.solve(
            np.eye(2) - h / 2 * numerical_jacobian(rhs, after),
            before + h / 2 * (slope + slope_after) - after,
        )
        for before, after, slope, slope_after in zip(
            states[:-1], states[1:], f[:-1], f[1:], strict=True
        )
    ])  # fmt: skip
    assert np.abs(correction / np.maximum(1.0, np.abs(states[1:]))).max() < 1e-7


@pytest.mark.parametrize("eigenvalue", [-1e6, -1e3, -200.0, -1.0, 3.0])
def test_a_linear_system_is_amplified_by_the_rational_function_of_the_rule(eigenvalue):
    h, steps = 0.01, 6
    stepper = ImplicitTrapezoidal(h)
    rhs = _system(_decay, 2, eigenvalue, -0.5)
    states = stepper.integrate(rhs, h * np.arange(steps + 1), np.array([1.0, 1.0])).states
    for column, rate in enumerate((eigenvalue, -0.5)):
        z = h * rate
        expected = ((1 + z / 2) / (1 - z / 2)) ** np.arange(steps + 1)
        np.testing.assert_allclose(states[:, column], expected, atol=1e-8)


def test_an_infinitely_fast_mode_decays_and_the_slow_one_beside_it_is_exact_to_the_order():
    rhs = _system(_decay, 2, -1e6, -0.5)
    states = (
        ImplicitTrapezoidal(0.01)
        .integrate(rhs, time_grid(0, 200, 0.01), np.array([1.0, 1.0]))
        .states
    )
    sizes = np.abs(states[:, 0])
    assert np.all(np.diff(sizes) < 1e-9)
    assert sizes[-1] < 0.01
    assert states[-1, 1] == pytest.approx(np.exp(-100), rel=1e-3)


def test_robertson_reactions_end_at_the_published_values():
    """Values at t = 40 with 1e-10, as in many codes' examples: Hindmarsh 1983, LSODE."""
    rhs = _system(_robertson, 3)
    stepper = ImplicitTrapezoidal(0.5, tolerance=1e-7)
    end = _end(stepper, rhs, np.array([1.0, 0.0, 0.0]), 40.0)
    np.testing.assert_allclose(end, [0.7158270688, 9.185534765e-6, 0.2841637457], rtol=2e-5)
    assert end.sum() == pytest.approx(1.0, abs=1e-7)


def test_van_der_pol_at_a_hundred_agrees_with_radau_across_the_jump():
    rhs = _system(_van_der_pol, 2, 100.0)
    x0 = np.array([2.0, 0.0])
    radau = ScipyReference(10.0, method="Radau", relative_tolerance=1e-8, absolute_tolerance=1e-8)
    times = time_grid(0.0, 120.0, 10.0)
    expected = radau.integrate(rhs, times, x0).states
    found = (
        ImplicitTrapezoidal(0.1, tolerance=1e-6)
        .integrate(rhs, time_grid(0.0, 120.0, 0.1), x0)
        .states[::100]
    )
    assert expected[0, 0] > 1
    assert expected[-1, 0] < -1
    np.testing.assert_allclose(found, expected, atol=2e-3)


def test_error_shrinks_with_the_tolerance(pendulum):
    exact = _end(ScipyReference(1.0), pendulum, START, 4.0)
    errors = [
        np.abs(_end(ImplicitTrapezoidal(0.1, tolerance), pendulum, START, 4.0) - exact).max()
        for tolerance in (1e-3, 1e-5, 1e-7)
    ]
    assert errors[0] > 5 * errors[1] > 25 * errors[2]
    assert errors[2] < 1e-4


@pytest.mark.parametrize("tolerance", [0.0, 1.0, -1e-3, np.nan])
def test_tolerance_must_lie_between_0_and_1(tolerance):
    with pytest.raises(OptionError, match="tolerance"):
        ImplicitTrapezoidal(0.01, tolerance)


@pytest.mark.parametrize("step", [0.0, -0.01, np.nan, np.inf])
def test_step_must_be_positive_and_finite(step):
    with pytest.raises(OptionError, match="time step"):
        ImplicitTrapezoidal(step)


@pytest.mark.parametrize("tolerance", [None, 1e-4])
def test_watches_fire_at_the_first_sample_at_which_they_hold(pendulum, tolerance):
    stepper = ImplicitTrapezoidal(0.01, tolerance)
    times = time_grid(0, 2, 0.01)
    everything = stepper.integrate(pendulum, times, START)
    never = BandWatch(np.eye(2), np.zeros(2), limit=np.inf)
    watch = SpreadWatch(np.array([0]), np.array([0]), np.array([1.0]), np.array([0.0]), limit=1.01)
    watched = stepper.integrate(pendulum, times, START, (never, watch))
    first = int(np.argmax(np.abs(everything.states[:, 0]) > 1.01))
    assert first > 1
    assert everything.fired == 0
    assert len(everything.states) == len(times)
    assert watched.fired == 2
    np.testing.assert_array_equal(watched.states, everything.states[: first + 1])


def test_solver_of_the_detailed_model_is_that_of_its_full_jacobian(npcc):
    generator = np.random.default_rng(1)
    x = npcc.x0 + 0.05 * generator.standard_normal(npcc.n_states)
    for state, gamma in ((npcc.x0, 0.005), (x, 0.005), (x, 0.1)):
        own = npcc.compiled.solver(state, gamma)
        full = dense_solver(npcc.jacobian(state), gamma)
        for _ in range(3):
            b = generator.standard_normal(npcc.n_states)
            np.testing.assert_allclose(
                _solution(own, b), _solution(full, b), atol=1e-10, rtol=1e-10
            )


@pytest.mark.parametrize("network", [NetworkState(), NetworkState(bus_faults=((30, 0j),))])
def test_the_factored_network_is_the_closed_impedance_matrix(npcc, network):
    equations = npcc.for_state(network).equations
    n = len(equations.terminals)
    generator = np.random.default_rng(4)
    slopes, currents = generator.standard_normal((n, 2, 2)), generator.standard_normal(2 * n)
    dense, factored = (
        ClosedNetworks(equations, factored_from=start)(slopes) for start in (n + 1, 0)
    )
    expected, found = (
        _solution(CompiledSolver(k.address, k.integers, k.reals, k.scratch_size), currents)
        for k in (dense, factored)
    )
    np.testing.assert_allclose(found, expected, atol=1e-11)


def test_solver_holds_with_a_bolted_fault_and_a_unit_out(npcc):
    unit = npcc.machines[2]
    for network in (
        NetworkState(bus_faults=((3, 0j),)),
        NetworkState(units_out=frozenset({unit})),
    ):
        model = npcc.for_state(network)
        own = model.compiled.solver(model.x0, 0.005)
        full = dense_solver(model.jacobian(model.x0), 0.005)
        b = np.random.default_rng(2).standard_normal(model.n_states)
        np.testing.assert_allclose(_solution(own, b), _solution(full, b), atol=1e-10, rtol=1e-10)


def test_numerical_jacobian_is_the_exact_one(npcc):
    found = numerical_jacobian(npcc.compiled, npcc.x0)
    exact = npcc.jacobian(npcc.x0)
    np.testing.assert_allclose(found, exact, atol=1e-6 * np.abs(exact).max())


def test_without_a_solver_of_its_own_a_system_is_integrated_all_the_same(npcc):
    x0 = npcc.x0 + 1e-2 * np.random.default_rng(3).standard_normal(npcc.n_states)
    times = time_grid(0, 0.1, 0.01)
    bare = replace(npcc.compiled, solver=None)
    stepper = ImplicitTrapezoidal(0.01)
    own = stepper.integrate(npcc.compiled, times, x0).states
    np.testing.assert_allclose(stepper.integrate(bare, times, x0).states, own, atol=1e-7)


def test_a_fault_on_the_npcc_system_is_that_of_runge_kutta(npcc):
    fault = [gf.BusFault(3, start=0.0, duration=0.2)]
    expected = gf.simulate(npcc, fault, 16.0, gf.RungeKutta4(0.005))
    found = gf.simulate(npcc, fault, 16.0, ImplicitTrapezoidal(0.005))
    assert found.status is expected.status is gf.Status.COMPLETED
    np.testing.assert_array_equal(found.times, expected.times)
    difference = np.abs(found.rotor_angle_deg() - expected.rotor_angle_deg())
    assert difference.max() < 0.15
