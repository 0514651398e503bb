"""Curves of what is watched of a contingency, for the report."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gridfold.runs.monitor import Columns
from gridfold.runs.trajectory import Trajectory

#: Curves of one kind of quantity that are kept: those that move most.
KEPT = 12


def watched_curves(
    run: Trajectory, columns: Columns, rows: NDArray[np.int64]
) -> dict[str, NDArray[Any]]:
    """Curves at some `rows` of a run: of each kind of quantity those whose values range furthest.

    Returns
    -------
    dict
        ``watched_names`` (m,), ``watched_values`` (m, n_rows), ``watched_times`` (n_rows,) in s, and
        ``watched_left_out``, how many curves there are besides.
    """
    table = run.table(replace(columns, every=1))
    ranges = np.array([_range(values) for values in table.T[1:]])
    kept: dict[str, list[int]] = {}
    for k in np.argsort(-ranges, kind="stable"):
        found = kept.setdefault(columns.names[k].partition(":")[0], [])
        if len(found) < KEPT:
            found.append(int(k))
    places = sorted(place for found in kept.values() for place in found)
    return {
        "watched_names": np.array([columns.names[k] for k in places]),
        "watched_values": table[rows][:, [1 + k for k in places]].T.astype(np.float32),
        "watched_times": run.times[rows].astype(np.float32),
        "watched_left_out": np.array(len(columns.names) - len(places)),
    }


def _range(values: NDArray[np.float64]) -> float:
    there = values[np.isfinite(values)]
    return float(np.ptp(there)) if len(there) else -1.0
