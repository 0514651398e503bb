from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gridfold.errors import OptionError
from gridfold.numerics.band_watch import BandWatch
from gridfold.numerics.compiled import compile_callback
from gridfold.numerics.rhs import RHS_SIGNATURE, CompiledRhs
from gridfold.numerics.steppers import (
    AdamsBashforthMoulton4,
    ImplicitTrapezoidal,
    RungeKutta4,
    ScipyReference,
    time_grid,
)
from gridfold.numerics.watch import SpreadWatch


def _pendulum(integers, reals, work, x, dx):
    dx[0] = x[1]
    dx[1] = -reals[0] * np.sin(x[0])


@pytest.fixture(scope="module")
def pendulum() -> CompiledRhs:
    address = compile_callback(_pendulum, RHS_SIGNATURE).address
    return CompiledRhs(address, np.zeros(0, dtype=np.int64), np.array([4.0]), 0, 2)


def _spiral(integers, reals, work, x, dx):
    """y' = lambda y for a complex y, in real numbers."""
    dx[0] = reals[0] * x[0] - reals[1] * x[1]
    dx[1] = reals[1] * x[0] + reals[0] * x[1]


def _spiral_states(stepper, eigenvalue: complex, steps: int) -> np.ndarray:
    address = compile_callback(_spiral, RHS_SIGNATURE).address
    reals = np.array([eigenvalue.real, eigenvalue.imag])
    rhs = CompiledRhs(address, np.zeros(0, dtype=np.int64), reals, 0, 2)
    return stepper.integrate(rhs, stepper.step * np.arange(steps + 1), START).states


def _observed_growth(stepper, eigenvalue: complex, first: int, last: int) -> float:
    """Factor by which a step changes the size of y between two steps."""
    sizes = np.linalg.norm(_spiral_states(stepper, eigenvalue, last), axis=1)
    return float((sizes[last] / sizes[first]) ** (1 / (last - first)))


START = np.array([1.0, 0.3])
STEPPERS = (RungeKutta4, AdamsBashforthMoulton4)


def _end(stepper, rhs: CompiledRhs, t_end: float) -> np.ndarray:
    times = time_grid(0.0, t_end, stepper.step)
    return stepper.integrate(rhs, times, START).states[-1]


@pytest.mark.parametrize(("kind", "order"), [(RungeKutta4, 4), (AdamsBashforthMoulton4, 4.5)])
def test_observed_order_is_four_and_local_extrapolation_adds_to_it(kind, order, pendulum):
    exact = _end(
        ScipyReference(1.0, relative_tolerance=1e-13, absolute_tolerance=1e-13), pendulum, 4.0
    )
    steps = np.array([0.08, 0.04, 0.02, 0.01])
    errors = [np.abs(_end(kind(step), pendulum, 4.0) - exact).max() for step in steps]
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    assert np.all(np.abs(orders[1:] - order) < 0.6), orders


@pytest.mark.parametrize("kind", STEPPERS)
def test_order_holds_when_the_interval_is_no_multiple_of_the_step(kind, pendulum):
    t_end = 4.0037
    exact = _end(
        ScipyReference(1.0, relative_tolerance=1e-13, absolute_tolerance=1e-13), pendulum, t_end
    )
    errors = [np.abs(_end(kind(step), pendulum, t_end) - exact).max() for step in (0.04, 0.01)]
    assert errors[1] < errors[0] / 4**3.5


def test_runge_kutta_step_is_the_textbook_one(pendulum):
    h = 0.1
    k1 = pendulum(START)
    k2 = pendulum(START + h / 2 * k1)
    k3 = pendulum(START + h / 2 * k2)
    k4 = pendulum(START + h * k3)
    expected = START + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    np.testing.assert_allclose(_end(RungeKutta4(h), pendulum, h), expected, rtol=0, atol=1e-15)


@pytest.mark.parametrize("kind", [*STEPPERS, ScipyReference])
def test_watch_ends_the_run_at_the_first_sample_beyond_the_limit(kind, pendulum):
    everything = kind(0.01).integrate(pendulum, time_grid(0, 2, 0.01), START)
    watch = SpreadWatch(np.array([0]), np.array([0]), np.array([1.0]), np.array([0.0]), limit=1.01)
    never = BandWatch(np.eye(2), np.zeros(2), limit=np.inf)
    watched = kind(0.01).integrate(pendulum, time_grid(0, 2, 0.01), START, (never, watch))
    first = int(np.argmax(np.abs(everything.states[:, 0]) > 1.01))
    assert first > 1
    assert watched.fired == 2
    assert len(watched.states) == first + 1


@pytest.mark.parametrize("kind", [*STEPPERS, ScipyReference])
@pytest.mark.parametrize("step", [0.0, -0.01, np.nan, np.inf])
def test_step_must_be_positive_and_finite(kind, step):
    with pytest.raises(OptionError, match="time step"):
        kind(step)


@settings(deadline=None)
@given(
    start=st.floats(0, 20),
    length=st.floats(1e-3, 5),
    step=st.floats(1e-3, 0.1),
)
def test_time_grid_holds_both_ends_and_all_multiples_of_the_step(start, length, step):
    end = start + length
    grid = time_grid(start, end, step)
    assert grid[0] == start
    assert grid[-1] == end
    assert np.all(np.diff(grid) > 0)
    assert np.diff(grid).max() <= step * (1 + 1e-5)
    np.testing.assert_allclose(grid[1:-1] / step, np.round(grid[1:-1] / step), atol=1e-6)


def test_runs_with_and_without_events_share_sampling_times():
    whole = time_grid(0.0, 1.0, 0.01)
    parts = np.concatenate([time_grid(0.0, 0.135, 0.01)[:-1], time_grid(0.135, 1.0, 0.01)])
    assert set(np.round(whole, 12)) <= set(np.round(parts, 12))
    assert len(parts) == len(whole) + 1


def test_watch_measures_from_the_weighted_mean_of_each_group_or_from_its_fixed_reference():
    watch = SpreadWatch(
        index=np.array([0, 1, 3]),
        group=np.array([0, 0, 1]),
        weight=np.array([1.0, 3.0, 1.0]),
        reference=np.array([np.nan, 0.5]),
        limit=np.inf,
    )
    distances = watch.distances(np.array([4.0, 8.0, 99.0, -1.0]))
    np.testing.assert_allclose(distances, [3.0, 1.0, 1.5])


@pytest.mark.parametrize("kind", [*STEPPERS, ScipyReference])
def test_band_watch_fires_when_all_quantities_have_come_inside(kind, pendulum):
    times = time_grid(0, 2, 0.01)
    states = kind(0.01).integrate(pendulum, times, START).states
    watch = BandWatch(np.array([[1.0, 0.0], [2.0, 0.0]]), np.zeros(2), limit=0.4, inside=True)
    result = kind(0.01).integrate(pendulum, times, START, (watch,))
    first = int(np.argmax(np.abs(2 * states[:, 0]) <= 0.4))
    assert first > 1
    assert result.fired == 1
    assert len(result.states) == first + 1


def test_watches_hold_where_a_quantity_is_not_finite():
    bad = np.array([np.nan, 0.0])
    spread = SpreadWatch(np.array([0]), np.array([0]), np.ones(1), np.zeros(1), 1.0)
    band = BandWatch(np.eye(2), np.zeros(2), 1.0)
    assert spread.holds(bad)
    assert band.holds(bad)


@pytest.mark.parametrize("kind", [RungeKutta4, ImplicitTrapezoidal])
@pytest.mark.parametrize("z", [-0.3 + 0.4j, -2.0 + 1.0j, 2.9j, -3.5 + 0j, 0.2 - 1.1j])
def test_growth_of_a_one_step_rule_is_that_of_every_step(kind, z):
    stepper = kind(0.02)
    assert _observed_growth(stepper, z / 0.02, 0, 5) == pytest.approx(stepper.growth(z), rel=1e-7)


@pytest.mark.parametrize("z", [-0.2 + 0j, 0.3 + 0j, -0.5 + 0.6j, -0.2 + 1.2j, 0.1 + 0.8j])
def test_growth_of_adams_bashforth_moulton_is_that_of_its_steps_in_the_long_run(z):
    stepper = AdamsBashforthMoulton4(0.02)
    observed = _observed_growth(stepper, z / 0.02, 200, 260)
    assert observed == pytest.approx(stepper.growth(z), rel=1e-6)


@pytest.mark.parametrize("z", [-1.0, -1.3, -1.6])
def test_growth_holds_where_a_decay_becomes_an_oscillation_of_the_rule(z):
    """y = Re(c r^n) has y_n^2 - y_(n+1) y_(n-1) in proportion to |r|^(2n)."""
    stepper = AdamsBashforthMoulton4(0.02)
    y = _spiral_states(stepper, complex(z / 0.02), 122)[:, 0]
    d = y[1:-1] ** 2 - y[2:] * y[:-2]
    assert np.sqrt(d[-1] / d[-2]) == pytest.approx(stepper.growth(z), rel=1e-6)


def test_runge_kutta_is_stable_on_the_axes_as_far_as_in_the_textbook():
    """Hairer & Wanner II, section IV.2: -2.785 on the real axis, 2.828 on the imaginary one."""
    growth = RungeKutta4().growth
    assert growth(-2.785) < 1 < growth(-2.786)
    assert growth(1j * (np.sqrt(8) - 1e-6)) < 1 < growth(1j * (np.sqrt(8) + 1e-6))


def test_growth_agrees_with_the_exponential_to_the_order_of_each_rule():
    for stepper, order in (
        (RungeKutta4(), 4),
        (AdamsBashforthMoulton4(), 4),
        (ImplicitTrapezoidal(), 2),
    ):
        errors = [abs(stepper.growth(-z) - np.exp(-z)) for z in (0.1, 0.05)]
        assert np.log2(errors[0] / errors[1]) > order + 0.8
    assert ScipyReference().growth(-1e6) == 1


def test_the_trapezoidal_rule_is_stable_exactly_where_the_system_is():
    growth = ImplicitTrapezoidal().growth
    for real, imag in ((-1e6, 0.0), (-1e-3, 50.0), (-2.0, 7.0)):
        assert growth(complex(real, imag)) < 1 < growth(complex(-real, imag))
    assert growth(30j) == pytest.approx(1)
    assert growth(2) == np.inf
