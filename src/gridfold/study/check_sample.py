"""Which runs of a reduced model are run again in detail: those whose errors would matter."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import zip_longest
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import pandas as pd

_SEED = 1


def checked_runs(frame: pd.DataFrame, size: int) -> list[int]:
    """Numbers of the contingencies that are checked, at most `size` of them.

    One in turn of those that lost synchronism, the latest first; of stable ones, those whose machines
    were furthest apart first; of those with the largest estimated errors; and of all by chance.

    Parameters
    ----------
    frame : DataFrame
        The rows of a study, whether they have been checked or not.
    size : int
        How many are wanted.
    """
    rows = frame[frame["stable"].notna()]
    stable = rows["stable"].astype(bool)
    chance = np.random.default_rng(_SEED).permutation(rows["number"].to_numpy())
    queues = (
        _by(rows[~stable], "ended_at"),
        _by(rows[stable], "largest_separation_deg"),
        _by(rows[rows["error_estimate_deg"].notna()], "error_estimate_deg"),
        chance.tolist(),
    )
    return list(dict.fromkeys(_in_turn(queues)))[:size]


def _by(rows: pd.DataFrame, column: str) -> list[int]:
    """Numbers, the largest value first."""
    ordered = rows.sort_values([column, "number"], ascending=[False, True])
    return [int(number) for number in ordered["number"]]


def _in_turn(queues: tuple[list[int], ...]) -> Iterator[int]:
    """The first of each, then the second of each; those taken from one queue still count in others."""
    for row in zip_longest(*queues):
        yield from (int(number) for number in row if number is not None)
