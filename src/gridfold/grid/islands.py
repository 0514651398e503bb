"""Connected parts of the network."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from gridfold.grid.case import Case
from gridfold.grid.intact import intact_once


@intact_once
def island_labels(case: Case, branches_out: Collection[int]) -> NDArray[np.int64]:
    """Number of the island of each bus, shape (n_buses,), counted from 0.

    `branches_out` are the positions of open branches; by default those out of service in the case.
    """
    ends = np.delete(case.branch_ends, sorted(branches_out), axis=0)
    n = len(case.buses)
    graph = coo_array((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), shape=(n, n))
    _, labels = connected_components(graph.tocsr(), directed=False)
    labels = labels.astype(np.int64)
    labels.setflags(write=False)
    return np.asarray(labels)


@dataclass(frozen=True)
class Islands:
    """Islands of the network in one state.

    Parameters
    ----------
    labels : ndarray of int, shape (n_buses,)
        Island of each bus.
    energized : ndarray of bool, shape (n_buses,)
        False where no source is left in the bus's island.
    """

    labels: NDArray[np.int64]
    energized: NDArray[np.bool_]

    @property
    def count(self) -> int:
        """Islands that have a source."""
        return len(np.unique(self.labels[self.energized]))

    @property
    def main(self) -> int:
        """Label of the island with a source that has the most buses; -1 if there is none."""
        if not self.energized.any():
            return -1
        return int(np.bincount(self.labels[self.energized]).argmax())

    def members(self, case: Case) -> dict[int, list[int]]:
        """Bus numbers of each island."""
        result: dict[int, list[int]] = {}
        for bus, label in zip(case.buses, self.labels, strict=True):
            result.setdefault(int(label), []).append(bus.number)
        return result


def find_islands(case: Case, branches_out: Collection[int], sources: Iterable[int]) -> Islands:
    """Islands with `branches_out` open; `sources` are the bus numbers that have a machine."""
    labels = island_labels(case, branches_out)
    powered = {int(labels[case.bus_index[number]]) for number in sources}
    return Islands(labels, np.isin(labels, list(powered)))
