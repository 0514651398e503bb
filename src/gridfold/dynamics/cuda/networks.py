"""The two ways in which a GPU solves the network: by full matrices, or by sparse factors."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from gridfold.dynamics.cuda.levels import level_factors
from gridfold.dynamics.cuda.network_text import NetworkText, full_network, sparse_network
from gridfold.dynamics.cuda.tables import (
    Arrays,
    NetworkTable,
    energized,
    factor_arrays,
    impedance_arrays,
)
from gridfold.dynamics.model import DetailedModel

#: Buses with machines up to which full matrices are right.
FULL_TERMINALS = 300


@dataclass(frozen=True)
class GpuNetwork:
    """How the network of a model is solved for many runs.

    Parameters
    ----------
    text : callable
        What a kernel does, and whether the room is in its shared memory.
    arrays : mapping
        What all runs share.
    changed : callable
        What the network states of some runs change.
    room : int
        Numbers that are in shared memory if they fit.
    own : bool
        Whether the room is of each run by itself: it is in global memory then if it does not fit.
    change_size : callable
        Numbers that a change of so many buses takes.
    """

    text: Callable[[bool], NetworkText]
    arrays: Arrays
    changed: Callable[[NetworkTable], Arrays]
    room: int
    own: bool
    change_size: Callable[[int], int]

    def vectors(self, runs: int, in_shared: bool) -> Arrays:
        """Rooms of runs that are in global memory."""
        return {"vectors": np.zeros((1, 1) if in_shared else (runs, self.room))} if self.own else {}


def gpu_network(model: DetailedModel, full_terminals: int = FULL_TERMINALS) -> GpuNetwork:
    """The way that suits a model: full up to so many buses with machines.

    Raises
    ------
    NetworkError
        The sparse factors had to be pivoted.
    """
    n = len(model.layout.terminals)
    if n <= full_terminals:
        return GpuNetwork(
            full_network,
            impedance_arrays(model),
            NetworkTable.caused_arrays,
            room=2 * n * n,
            own=False,
            change_size=lambda rank: rank * (4 * n + 2 * len(energized(model))),
        )
    factors = level_factors(model.equations)
    return GpuNetwork(
        sparse_network,
        factor_arrays(model, factors),
        lambda table: table.row_arrays(factors),
        room=factors.vector_size,
        own=True,
        change_size=lambda rank: rank * (2 * n + 1),
    )
