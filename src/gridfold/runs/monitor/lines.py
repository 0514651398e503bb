"""Quantities of lines and of what lines join. What flows into an open line is zero."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gridfold.dynamics.network.flows import BranchEnds
from gridfold.runs.monitor.view import Reader, View, power_names


@dataclass(frozen=True)
class Flows:
    """Powers into lines at the end named first: ``p_mw:101-103`` and ``q_mvar:101-103``."""

    labels: tuple[str, ...]
    ends: BranchEnds

    @property
    def names(self) -> tuple[str, ...]:
        """Active powers, then reactive ones."""
        return power_names("p_mw", "q_mvar", self.labels)

    @property
    def buses(self) -> tuple[tuple[int, ...], ...]:
        """Both buses of each line."""
        return 2 * _buses_of(self.ends)

    def reader(self) -> Reader:
        """Their values."""
        return self._values

    def _values(self, view: View) -> NDArray[np.float64]:
        power = self.ends.powers(view.state, view.voltages) * self.ends.case.base_mva
        return np.hstack([power.real, power.imag])


@dataclass(frozen=True)
class Currents:
    """Magnitudes of currents into lines at the end named first, in p.u.: ``current_pu:101-103``."""

    labels: tuple[str, ...]
    ends: BranchEnds

    @property
    def names(self) -> tuple[str, ...]:
        """``current_pu:LINE``."""
        return tuple(f"current_pu:{label}" for label in self.labels)

    @property
    def buses(self) -> tuple[tuple[int, ...], ...]:
        """Both buses of each line."""
        return _buses_of(self.ends)

    def reader(self) -> Reader:
        """Their values."""
        return lambda view: np.abs(self.ends.currents(view.state, view.voltages))


@dataclass(frozen=True)
class Interface:
    """Sum of the powers into several lines: ``interface_mw:NAME`` and ``interface_mvar:NAME``."""

    label: str
    ends: BranchEnds

    @property
    def names(self) -> tuple[str, ...]:
        """Active and reactive power."""
        return power_names("interface_mw", "interface_mvar", (self.label,))

    @property
    def buses(self) -> tuple[tuple[int, ...], ...]:
        """All buses of its lines."""
        return 2 * (tuple(dict.fromkeys(bus for ends in _buses_of(self.ends) for bus in ends)),)

    def reader(self) -> Reader:
        """Their values."""
        return self._values

    def _values(self, view: View) -> NDArray[np.float64]:
        power = self.ends.powers(view.state, view.voltages).sum(axis=1)
        power = power * self.ends.case.base_mva
        return np.stack([power.real, power.imag], axis=1)


@dataclass(frozen=True)
class GroupSums:
    """Sums over the buses of an area, a zone or an owner, in MW.

    ``area_generation_mw:1``, ``area_load_mw:1`` and ``area_interchange_mw:1``, what flows out of it.
    """

    kind: str
    number: int
    members: tuple[int, ...]
    load_columns: NDArray[np.int64]
    unit_columns: NDArray[np.int64]
    ties: BranchEnds

    @property
    def names(self) -> tuple[str, ...]:
        """Generation, load, interchange."""
        return tuple(
            f"{self.kind}_{what}_mw:{self.number}" for what in ("generation", "load", "interchange")
        )

    @property
    def buses(self) -> tuple[tuple[int, ...], ...]:
        """All buses of the group."""
        return 3 * (self.members,)

    def reader(self) -> Reader:
        """Their values."""
        return self._values

    def _values(self, view: View) -> NDArray[np.float64]:
        powers = (
            view.generation[:, self.unit_columns],
            view.loads[:, self.load_columns],
            self.ties.powers(view.state, view.voltages),
        )
        sums = [power.real.sum(axis=1) for power in powers]
        return np.stack(sums, axis=1) * self.ties.case.base_mva


def _buses_of(ends: BranchEnds) -> tuple[tuple[int, ...], ...]:
    branches = (ends.case.branches[end.branch] for end in ends.ends)
    return tuple((branch.from_bus, branch.to_bus) for branch in branches)
