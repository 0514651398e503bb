"""What is out, faulted or changed in the network and its devices at one time."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

from gridfold.grid.case import Case, UnitKey


class BranchFaultPoint(NamedTuple):
    """A short circuit of a branch: position in the case's list, fraction from its first bus.

    At 0 and 1 it is at the bus, as long as the branch is closed there.
    """

    branch: int
    fraction: float
    impedance: complex

    @property
    def at_end(self) -> int | None:
        """The end, 0 or 1, at which it is; None inside."""
        return int(self.fraction) if self.fraction in (0.0, 1.0) else None


class OpenEnd(NamedTuple):
    """A branch that is open at one end: position in the case's list, and the end, 0 or 1."""

    branch: int
    end: int


class Setting(NamedTuple):
    """A parameter or set point that is not as at the start.

    It is `value`, or the start's where that is None, and `change` besides. `model` is empty where the
    name alone tells which device of the unit is meant.
    """

    unit: UnitKey
    model: str
    name: str
    value: float | None
    change: float


@dataclass(frozen=True)
class NetworkState:
    """Differences of the grid from the case as it was loaded; hashable.

    Parameters
    ----------
    branches_out : frozenset of int
        Positions of branches that are out of service.
    units_out : frozenset of UnitKey
        Machines that are disconnected.
    bus_faults : frozenset of (int, complex)
        Bus number and fault impedance in per unit; 0 is a bolted fault.
    branch_faults : frozenset of BranchFaultPoint
        Faults of branches, which go out with them.
    load_steps : tuple of (int, complex)
        Bus number and all load added there (MW + j Mvar) at the bus's initial voltage, each bus once.
    open_ends : frozenset of OpenEnd
        Branches that are open at one of their ends alone.
    load_shed : tuple of (int, float)
        Bus number and the part of the case's load there that is shed, each bus once.
    shunts_switched : frozenset of int
        Positions of fixed shunts that are out though the case has them in, or the other way round.
    shunt_steps : tuple of (int, complex)
        Bus number and the shunts added there: MW drawn + j Mvar generated at 1 p.u., each bus once.
    settings : tuple of Setting
        Parameters of devices, each once.
    dispatch : tuple of (UnitKey, float)
        Units and the MW that they give more from the start on, each unit once.
    """

    branches_out: frozenset[int] = frozenset()
    units_out: frozenset[UnitKey] = frozenset()
    bus_faults: frozenset[tuple[int, complex]] = frozenset()
    branch_faults: frozenset[BranchFaultPoint] = frozenset()
    load_steps: tuple[tuple[int, complex], ...] = ()
    open_ends: frozenset[OpenEnd] = frozenset()
    load_shed: tuple[tuple[int, float], ...] = ()
    shunts_switched: frozenset[int] = frozenset()
    shunt_steps: tuple[tuple[int, complex], ...] = ()
    settings: tuple[Setting, ...] = ()
    dispatch: tuple[tuple[UnitKey, float], ...] = ()

    @cached_property
    def faulted(self) -> bool:
        """True while a short circuit is on."""
        return bool(self.bus_faults or self.branch_faults)

    @cached_property
    def healthy(self) -> NetworkState:
        """The same without short circuits."""
        if not self.faulted:
            return self
        return replace(self, bus_faults=frozenset(), branch_faults=frozenset())

    def bus_shorts(self, case: Case) -> Iterator[tuple[int, complex]]:
        """Bus number and impedance of all faults at buses, also those at closed ends of branches.

        A fault anywhere in a branch without impedance is one at its buses.
        """
        yield from self.bus_faults
        for point in self.branch_faults:
            branch = case.branches[point.branch]
            ends = (0, 1) if branch.joins else () if point.at_end is None else (point.at_end,)
            closed = [end for end in ends if OpenEnd(point.branch, end) not in self.open_ends]
            for end in closed[:1]:
                yield (branch.to_bus if end else branch.from_bus), point.impedance

    @property
    def severed(self) -> frozenset[int]:
        """Positions of branches that join nothing: out of service, or open at an end."""
        return self.branches_out | {end.branch for end in self.open_ends}
