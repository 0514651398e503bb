"""Bus angles and the phase shifts of transformers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order, connected_components, minimum_spanning_tree

from gridfold.grid.case import Case
from gridfold.grid.nodes import node_of_buses


@dataclass(frozen=True)
class ShiftedBranches:
    """Branches in service between two buses: their ends by position, impedance and shift.

    Parameters
    ----------
    first, second : ndarray of int, shape (n,)
        Positions of the buses.
    impedance : ndarray, shape (n,)
        Magnitude of the series impedance, per unit.
    shift : ndarray, shape (n,)
        By how much the angle at the first bus leads without a load, in rad.
    """

    first: NDArray[np.int64]
    second: NDArray[np.int64]
    impedance: NDArray[np.float64]
    shift: NDArray[np.float64]

    def among(self, members: NDArray[np.int64]) -> ShiftedBranches:
        """Those between these buses, by positions within `members`, which ascend."""
        inside = np.isin(self.first, members) & np.isin(self.second, members)
        first, second = (np.searchsorted(members, end[inside]) for end in (self.first, self.second))
        return ShiftedBranches(first, second, self.impedance[inside], self.shift[inside])

    def largest_angle(self, voltage: NDArray[np.complex128]) -> float:
        """The largest angle across a series impedance, in rad."""
        across = voltage[self.first] * np.conj(voltage[self.second]) * np.exp(-1j * self.shift)
        return float(np.abs(np.angle(across)).max(initial=0.0))

    def idle_angles(self, n: int) -> NDArray[np.float64]:
        """Angles of `n` buses in rad that follow the shifts, shape (n,); 0 at one bus of each island.

        Along a tree of the branches with the least impedance no angle is left across an impedance.
        """
        angle = np.zeros(n)
        if not self.shift.any():
            return angle
        by_impedance = np.argsort(self.impedance, kind="stable")
        low, high = np.minimum(self.first, self.second), np.maximum(self.first, self.second)
        _, strongest = np.unique((low * n + high)[by_impedance], return_index=True)
        kept = by_impedance[strongest]
        # SciPy before 1.17 searches trees by places of 32 bits alone.
        ends = low[kept].astype(np.int32), high[kept].astype(np.int32)
        graph = coo_array((self.impedance[kept], ends), shape=(n, n)).tocsr()
        tree = minimum_spanning_tree(graph)
        lead = np.where(self.first < self.second, self.shift, -self.shift)[kept]
        step = dict(
            zip(zip(low[kept].tolist(), high[kept].tolist(), strict=True), lead, strict=True)
        )
        _, labels = connected_components(tree, directed=False)
        for root in np.unique(labels, return_index=True)[1]:
            order, before = breadth_first_order(tree, root, directed=False)
            for bus in order[1:].tolist():
                known = int(before[bus])
                fall = step[known, bus] if known < bus else -step[bus, known]
                angle[bus] = angle[known] - fall
        return angle


def shifted_branches(case: Case) -> ShiftedBranches:
    """The branches in service between two nodes of a case, by positions of the nodes' first buses."""
    nodes = node_of_buses(case).tolist()
    node = {bus.number: at for bus, at in zip(case.buses, nodes, strict=True)}
    live = [b for b in case.branches if b.in_service and node[b.from_bus] != node[b.to_bus]]
    return ShiftedBranches(
        np.array([node[b.from_bus] for b in live], dtype=np.int64),
        np.array([node[b.to_bus] for b in live], dtype=np.int64),
        np.abs(np.array([complex(b.resistance, b.reactance) for b in live], dtype=complex)),
        np.deg2rad(np.array([b.shift_deg for b in live], dtype=float)),
    )
