"""What is looked at of a run, and what a column of a table is."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from gridfold.dynamics.model import DetailedModel
from gridfold.dynamics.network.flows import load_powers
from gridfold.grid.network_state import NetworkState
from gridfold.runs.parts import Part


@dataclass(frozen=True)
class View:
    """Rows of a run, with what several quantities need of them.

    Parameters
    ----------
    part : Part
        The rows.
    wanted : ndarray of int
        Positions in the signal vector of all signals that quantities ask for, ascending.
    """

    part: Part
    wanted: NDArray[np.int64]

    def signals(self, slots: NDArray[np.int64]) -> NDArray[np.float64]:
        """Entries `slots` (m,) of the signal vector, all of them `wanted`, shape (n, m)."""
        return self._signals[:, np.searchsorted(self.wanted, slots)]

    @cached_property
    def _signals(self) -> NDArray[np.float64]:
        return self.part.signals(self.wanted)

    @property
    def model(self) -> DetailedModel:
        """The detailed model of their network."""
        return self.part.model

    @property
    def state(self) -> NetworkState:
        """The state of their network."""
        return self.part.model.state

    @cached_property
    def voltages(self) -> NDArray[np.complex128]:
        """Voltages of all buses in p.u., shape (n, n_buses)."""
        return self.part.bus_voltages()

    @cached_property
    def loads(self) -> NDArray[np.complex128]:
        """Powers of the loads of all buses in p.u., shape (n, n_buses)."""
        model = self.model
        return load_powers(model.power_flow, model.injections, self.state, self.voltages)

    @cached_property
    def generation(self) -> NDArray[np.complex128]:
        """Powers of all generators of the case in p.u., zero where out of service: (n, n_units)."""
        return unit_powers(self)

    @cached_property
    def references(self) -> NDArray[np.float64]:
        """Angle in rad of the centre of inertia of each machine's island, (n, n_machines)."""
        return self.part.centres_of_inertia()


Reader = Callable[[View], NDArray[np.float64]]


class Quantity(Protocol):
    """Columns of a table: their names, and what reads them along a run."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the columns, each with its unit and what it is of."""

    @property
    def buses(self) -> tuple[tuple[int, ...], ...]:
        """Bus numbers that each column is about."""

    def reader(self) -> Reader:
        """What gives the values (n, n_columns) of the parts of one run, in order of time."""


def power_names(active: str, reactive: str, labels: Iterable[str]) -> tuple[str, ...]:
    """Names of the columns of active and reactive powers of what has these labels."""
    names = tuple(labels)
    return tuple(f"{kind}:{name}" for kind in (active, reactive) for name in names)


def unit_powers(view: View) -> NDArray[np.complex128]:
    """Powers of all generators of the case in p.u., (n, n_generators).

    A unit injects its Norton current less what flows into its own admittance; generators without
    dynamic data are negative loads.
    """
    model, case = view.model, view.model.case
    column = {unit.key: k for k, unit in enumerate(case.generators)}
    power = np.zeros((len(view.part), len(case.generators)), dtype=np.complex128)
    injections, out = model.injections, view.state.units_out
    live = [unit not in out for unit in model.layout.source_units]
    real, imag, _ = model.layout.sources[live].T
    units = [unit for unit in model.layout.source_units if unit not in out]
    sources = view.part.signals(real) + 1j * view.part.signals(imag)
    for unit, source in zip(units, sources.T, strict=True):
        at = view.voltages[:, case.bus_index[unit.bus]]
        power[:, column[unit]] = at * np.conj(source - injections.machine.get(unit, 0j) * at)
    for unit, admittance in injections.negative_load.items():
        if unit not in out:
            at = view.voltages[:, case.bus_index[unit.bus]]
            power[:, column[unit]] = -(np.abs(at) ** 2) * np.conj(admittance)
    return power
