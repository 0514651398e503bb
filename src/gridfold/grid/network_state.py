"""What is out, faulted or changed in the network at one time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from gridfold.grid.case import UnitKey


class BranchFaultPoint(NamedTuple):
    """A short circuit inside a branch: position in the case's list, fraction from its first bus."""

    branch: int
    fraction: float
    impedance: complex


@dataclass(frozen=True)
class NetworkState:
    """Differences of the network from the case as it was loaded; hashable.

    Parameters
    ----------
    branches_out : frozenset of int
        Positions of branches that are out of service.
    units_out : frozenset of UnitKey
        Machines that are disconnected.
    bus_faults : frozenset of (int, complex)
        Bus number and fault impedance in per unit; 0 is a bolted fault.
    branch_faults : frozenset of BranchFaultPoint
        Faults inside branches.
    load_steps : tuple of (int, complex)
        Bus number and all load added there (MW + j Mvar) at the bus's initial voltage, each bus once.
    """

    branches_out: frozenset[int] = frozenset()
    units_out: frozenset[UnitKey] = frozenset()
    bus_faults: frozenset[tuple[int, complex]] = frozenset()
    branch_faults: frozenset[BranchFaultPoint] = frozenset()
    load_steps: tuple[tuple[int, complex], ...] = ()

    @property
    def faulted(self) -> bool:
        """True while a short circuit is on."""
        return bool(self.bus_faults or self.branch_faults)
