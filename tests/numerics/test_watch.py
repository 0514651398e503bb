from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gridfold.numerics.band_watch import BandWatch
from gridfold.numerics.common_row import split_rows
from gridfold.numerics.watch import (
    BoxWatch,
    SpreadWatch,
    first_fired,
    first_watch,
    pack_watches,
)

N_STATES = 12


def walk(seed: int, rows: int = 400, size: float = 0.1) -> np.ndarray:
    """States that wander away from 0 and back."""
    rng = np.random.default_rng(seed)
    phases = np.arange(rows)[:, None] * rng.uniform(0.01, 0.1, N_STATES) + rng.uniform(0, 6)
    return size * np.sin(phases) * np.linspace(0.2, 1.0, rows)[:, None]


def band(limit: float, inside: bool = False, seed: int = 1) -> BandWatch:
    rng = np.random.default_rng(seed)
    return BandWatch(rng.normal(size=(20, N_STATES)), 0.1 * rng.normal(size=20), limit, inside)


def spread(limit: float) -> SpreadWatch:
    group, index = np.array([0, 0, 1]), np.array([0, 3, 5])
    return SpreadWatch(index, group, np.ones(3), np.array([np.nan, 0.0]), limit)


def box(size: float, seed: int = 1) -> BoxWatch:
    """Ranges of different size about different middles, some of them open on one side."""
    rng = np.random.default_rng(seed)
    lower, upper = -size * rng.uniform(0.5, 1.5, 20), size * rng.uniform(0.5, 1.5, 20)
    lower[:5], upper[5:9] = -np.inf, np.inf
    return BoxWatch(rng.normal(size=(20, N_STATES)), lower, upper)


def verdicts(watch, states) -> list[bool]:
    """What the compiled condition says of the rows, one after the other as in an integration."""
    data, verdict = pack_watches([watch], N_STATES), np.zeros(1)
    return [bool(first_watch(*data, state, verdict)) for state in states]


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("inside", [False, True])
@pytest.mark.parametrize("limit", [0.0, 0.4, 0.7, np.inf])
def test_a_compiled_band_says_of_every_state_what_the_quantities_say(seed, inside, limit):
    watch, states = band(limit, inside, seed), walk(seed)
    expected = [watch.holds(state) for state in states]
    assert verdicts(watch, states) == expected
    jumps = np.random.default_rng(seed).permutation(len(states))
    assert verdicts(watch, states[jumps]) == [expected[k] for k in jumps]


@pytest.mark.parametrize("inside", [False, True])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_compiled_band_forgets_a_state_that_is_not_finite(inside, value):
    states = walk(0, rows=3)
    states[1, 4] = value
    assert verdicts(band(5.0, inside), states) == [inside, not inside, inside]


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("size", [0.0, 0.2, 0.4, 0.6, 5.0])
def test_a_compiled_box_says_of_every_state_what_the_quantities_say(seed, size):
    watch, states = box(size, seed), walk(seed)
    values = states @ watch.matrix.T
    expected = ((values > watch.upper) | (values < watch.lower)).any(axis=1).tolist()
    assert [watch.holds(state) for state in states] == expected
    assert verdicts(watch, states) == expected
    jumps = np.random.default_rng(seed).permutation(len(states))
    assert verdicts(watch, states[jumps]) == [expected[k] for k in jumps]
    if 0.2 <= size <= 0.6:
        assert len(set(expected)) == 2


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_compiled_box_forgets_a_state_that_is_not_finite(value):
    states = walk(0, rows=3)
    states[1, 4] = value
    assert verdicts(box(5.0), states) == [False, True, False]


def test_distances_from_a_box_are_negative_inside():
    watch = BoxWatch(np.eye(2), np.array([-1.0, -np.inf]), np.array([2.0, 0.5]))
    np.testing.assert_array_equal(watch.distances(np.array([1.5, -3.0])), [-0.5, -3.5])
    np.testing.assert_array_equal(watch.distances(np.array([-1.5, 1.0])), [0.5, 0.5])


@pytest.mark.parametrize("limit", [0.0, 0.3, 0.5, 0.7, 5.0, np.inf])
@pytest.mark.parametrize("kind", [band, lambda limit: band(limit, True), spread, box])
def test_first_is_the_first_row_that_holds(kind, limit):
    watch = kind(limit)
    for states in (walk(2), walk(2)[::-1], walk(2)[:1], walk(2)[:0]):
        rows = [row for row, state in enumerate(states) if watch.holds(state)]
        assert watch.first(states) == (rows[0] if rows else None)


@pytest.mark.parametrize("limit", [5.0, np.inf])
@pytest.mark.parametrize("kind", [band, spread, box])
def test_first_is_a_row_that_is_not_a_number(kind, limit):
    states = walk(2)
    states[17] = np.nan
    assert kind(limit).first(states) == 17


def test_the_earliest_row_counts_and_in_one_row_the_first_watch():
    states = np.linspace(0, 1, 11)[:, None]
    late, early = BandWatch(np.eye(1), np.zeros(1), 0.75), BandWatch(np.eye(1), np.zeros(1), 0.25)
    assert first_fired((late, early), states) == (3, 2)
    assert first_fired((early, early), states) == (3, 1)
    assert first_fired((late,), states[:8]) is None
    assert first_fired((), states) is None


def test_reach_bounds_how_far_any_quantity_moves():
    watch, states = band(1.0), walk(3)
    moved = np.abs(np.diff(states, axis=0))
    quantities = states @ watch.matrix.T
    assert np.all(np.abs(np.diff(quantities, axis=0)).max(axis=1) <= moved @ watch.reach + 1e-15)


def against_the_mean(n_exact: int, n_linear: int, n_modes: int) -> np.ndarray:
    """Angles of exact machines, and of others linear in modes, against their weighted mean."""
    rng = np.random.default_rng(n_exact)
    angles = np.zeros((n_exact + n_linear, n_exact + n_modes))
    angles[:n_exact, :n_exact] = np.eye(n_exact)
    angles[n_exact:, n_exact:] = rng.normal(size=(n_linear, n_modes))
    weights = rng.uniform(0.5, 2.0, len(angles))
    return angles - weights / weights.sum() @ angles


def test_of_angles_against_their_mean_only_those_of_linear_machines_are_dense():
    matrix = against_the_mean(4, 9, 8)
    parts = split_rows(matrix)
    assert parts.few.tolist() == [0, 1, 2, 3]
    assert parts.columns.tolist() == list(range(4, 12))
    again = np.tile(parts.common, (13, 1))
    for row, first, last in zip(parts.few, parts.starts[:-1], parts.starts[1:], strict=True):
        again[row, parts.places[first:last]] += parts.entries[first:last]
    again[np.ix_(parts.many, parts.columns)] += parts.dense
    np.testing.assert_allclose(again, matrix, rtol=0, atol=1e-15)


@pytest.mark.parametrize(("n_exact", "n_linear"), [(4, 9), (6, 7), (12, 0), (3, 20)])
@pytest.mark.parametrize("inside", [False, True])
@pytest.mark.parametrize("share", [0.1, 0.5, 0.9])
def test_a_compiled_band_of_angles_against_their_mean(n_exact, n_linear, inside, share):
    matrix, states = against_the_mean(n_exact, n_linear, N_STATES - n_exact), walk(n_exact)
    watch = BandWatch(matrix, np.linspace(-0.04, 0.04, len(matrix)), 0.0, inside)
    limit = float(np.quantile([watch.distances(state).max() for state in states], share))
    watch = replace(watch, limit=limit)
    expected = [watch.holds(state) for state in states]
    assert len(set(expected)) == 2
    assert verdicts(watch, states) == expected
    spoilt = states.copy()
    spoilt[100:110, 1] = np.nan
    assert verdicts(watch, spoilt) == [
        found and not 100 <= k < 110 if inside else found or 100 <= k < 110
        for k, found in enumerate(expected)
    ]
