"""Currents of branches, and powers of loads and units, from the voltages of all buses.

They follow from the network state alone: nothing of them is kept while a run is stepped.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gridfold.dynamics.network.equations import Injections, load_admittance
from gridfold.grid.admittance import branch_admittances
from gridfold.grid.branch_port import state_port
from gridfold.grid.case import Case
from gridfold.grid.network_state import NetworkState
from gridfold.powerflow.result import PowerFlowResult


class End(NamedTuple):
    """An end of a branch: the position of the branch in the case, and whether it is its second."""

    branch: int
    second: bool


@dataclass(frozen=True)
class BranchEnds:
    """Ends of branches, with what their currents follow from.

    Parameters
    ----------
    case : Case
        The case.
    ends : tuple of End
        The ends, m of them.
    """

    case: Case
    ends: tuple[End, ...]

    def currents(
        self, state: NetworkState, voltages: NDArray[np.complex128]
    ) -> NDArray[np.complex128]:
        """Currents in p.u. that flow into the branches at these ends, shape (n, m).

        Parameters
        ----------
        state : NetworkState
            Which branches are open, at one end or both, and which have a fault inside.
        voltages : ndarray of complex, shape (n, n_buses)
            Voltages of all buses in p.u.
        """
        own, other, at_own, at_other = self._parts
        result = own * voltages[:, at_own] + other * voltages[:, at_other]
        altered = state.severed | {point.branch for point in state.branch_faults}
        for k, end in enumerate(self.ends):
            if end.branch in altered:
                seen = state_port(self.case, state, end.branch)[int(end.second)]
                by_own, by_other = seen[::-1] if end.second else seen
                both = by_own * voltages[:, at_own[k]], by_other * voltages[:, at_other[k]]
                result[:, k] = sum(both)
        return result

    def powers(
        self, state: NetworkState, voltages: NDArray[np.complex128]
    ) -> NDArray[np.complex128]:
        """Powers in p.u. that flow into the branches at these ends, shape (n, m)."""
        _, _, at_own, _ = self._parts
        return np.asarray(voltages[:, at_own] * np.conj(self.currents(state, voltages)))

    @property
    def _parts(self) -> tuple[NDArray[np.complex128], ...]:
        branches = [self.case.branches[end.branch] for end in self.ends]
        second = np.array([end.second for end in self.ends], dtype=bool)
        y = branch_admittances(branches)
        index = self.case.bus_index
        first_at = np.array([index[b.from_bus] for b in branches], dtype=np.int64)
        second_at = np.array([index[b.to_bus] for b in branches], dtype=np.int64)
        return (
            np.where(second, y.to_to, y.from_from),
            np.where(second, y.to_from, y.from_to),
            np.where(second, second_at, first_at),
            np.where(second, first_at, second_at),
        )


def load_powers(
    power_flow: PowerFlowResult,
    injections: Injections,
    state: NetworkState,
    voltages: NDArray[np.complex128],
) -> NDArray[np.complex128]:
    """Powers in p.u. that the loads of all buses draw at `voltages`, both of shape (n, n_buses)."""
    currents = voltages * load_admittance(power_flow, injections, state)
    loads = injections.nonlinear
    if loads is not None:
        at = [power_flow.case.bus_index[bus] for bus in loads.buses]
        currents[:, at] -= loads.currents(voltages[:, at])
    return np.asarray(voltages * np.conj(currents))


def joined(case: Case, inside: Sequence[int]) -> tuple[End, ...]:
    """Ends at buses of a set of the branches that lead out of it."""
    buses = set(inside)
    return tuple(
        End(k, branch.to_bus in buses)
        for k, branch in enumerate(case.branches)
        if (branch.from_bus in buses) != (branch.to_bus in buses)
    )
