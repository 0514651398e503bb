"""The two ways in which a GPU solves the network: by full matrices, or by sparse factors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from gridfold.dynamics.cuda.levels import LevelFactors, level_factors
from gridfold.dynamics.cuda.network_text import NetworkText, full_network, sparse_network
from gridfold.dynamics.cuda.tables import Arrays, NetworkTable, factor_arrays, impedance_arrays
from gridfold.dynamics.model import DetailedModel

#: Buses with machines up to which full matrices are right.
FULL_TERMINALS = 300


class GpuNetwork(Protocol):
    """A way to solve the network of a model for many runs."""

    @property
    def room(self) -> int:
        """Numbers of a run that are in shared memory if they fit."""

    def text(self, in_shared: bool) -> NetworkText:
        """What a kernel does."""

    def arrays(self) -> Arrays:
        """What all runs share."""

    def changed(self, table: NetworkTable) -> Arrays:
        """What the network states of some runs change."""

    def scratch(self, runs: int, in_shared: bool) -> Arrays:
        """Room of each run that is not in shared memory."""

    def change_size(self, rank: int) -> int:
        """Numbers that a change of so many buses takes."""


@dataclass(frozen=True)
class FullNetwork:
    """Matrices of impedances: each voltage from all currents at once."""

    model: DetailedModel

    @property
    def room(self) -> int:
        return 2 * len(self.model.layout.terminals) ** 2

    def text(self, in_shared: bool) -> NetworkText:
        return full_network(in_shared)

    def arrays(self) -> Arrays:
        return impedance_arrays(self.model)

    def changed(self, table: NetworkTable) -> Arrays:
        return table.caused_arrays()

    def scratch(self, runs: int, in_shared: bool) -> Arrays:
        return {}

    def change_size(self, rank: int) -> int:
        n_buses = int(np.count_nonzero(self.model.equations.islands.energized))
        return rank * (4 * len(self.model.layout.terminals) + 2 * n_buses)


@dataclass(frozen=True)
class SparseNetwork:
    """Sparse factors, taken level by level."""

    model: DetailedModel
    factors: LevelFactors

    @property
    def room(self) -> int:
        return self.factors.vector_size

    def text(self, in_shared: bool) -> NetworkText:
        return sparse_network(in_shared)

    def arrays(self) -> Arrays:
        return factor_arrays(self.model, self.factors)

    def changed(self, table: NetworkTable) -> Arrays:
        return table.row_arrays(self.factors)

    def scratch(self, runs: int, in_shared: bool) -> Arrays:
        return {"vectors": np.zeros((1, 1) if in_shared else (runs, self.room))}

    def change_size(self, rank: int) -> int:
        return rank * (2 * len(self.model.layout.terminals) + 1)


def gpu_network(model: DetailedModel, full_terminals: int = FULL_TERMINALS) -> GpuNetwork:
    """The way that suits a model: full up to so many buses with machines.

    Raises
    ------
    NetworkError
        The sparse factors had to be pivoted.
    """
    if len(model.layout.terminals) <= full_terminals:
        return FullNetwork(model)
    return SparseNetwork(model, level_factors(model.equations))
