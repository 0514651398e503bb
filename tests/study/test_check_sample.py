"""Which runs of a study are checked in detail."""

from __future__ import annotations

import pandas as pd
import pytest

from gridfold.study.check_sample import checked_runs


def rows(**changes: dict[int, object]) -> pd.DataFrame:
    """Twelve stable runs whose machines are a little further apart each."""
    numbers = range(1, 13)
    columns = {
        "number": dict.fromkeys(numbers) | {n: n for n in numbers},
        "stable": dict.fromkeys(numbers, True),
        "ended_at": dict.fromkeys(numbers, 10.0),
        "largest_separation_deg": {n: 10.0 * n for n in numbers},
        "error_estimate_deg": dict.fromkeys(numbers),
    }
    for name, values in changes.items():
        columns[name] |= values
    return pd.DataFrame({name: list(values.values()) for name, values in columns.items()})


def test_unstable_ones_the_nearest_to_the_limit_and_the_largest_estimates_come_first():
    frame = rows(
        stable={4: False, 7: False},
        ended_at={4: 1.0, 7: 3.0},
        error_estimate_deg={2: 0.4, 3: 0.9},
    )
    assert checked_runs(frame, 3) == [7, 12, 3]
    assert {4, 11, 2} <= set(checked_runs(frame, 8))


def test_without_estimates_and_unstable_ones_half_is_chance():
    found = checked_runs(rows(), 6)
    assert found[0::2][:2] == [12, 11]
    assert len(set(found)) == 6


@pytest.mark.parametrize("size", [0, 1, 5, 12, 40])
def test_none_is_checked_twice_and_none_more_than_wanted(size):
    found = checked_runs(rows(stable={1: False}), size)
    assert len(found) == len(set(found)) == min(size, 12)


def test_failed_ones_have_nothing_to_check_and_the_choice_repeats():
    frame = rows(stable={5: None, 6: None})
    found = checked_runs(frame, 12)
    assert set(found) == set(range(1, 13)) - {5, 6}
    assert checked_runs(frame, 12) == found
