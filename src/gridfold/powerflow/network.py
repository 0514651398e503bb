"""What a power flow needs of the network, whatever is drawn and generated there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array

from gridfold.grid.admittance import bus_admittance
from gridfold.grid.case import Case
from gridfold.grid.islands import island_labels
from gridfold.grid.nodes import joined, node_of_buses
from gridfold.grid.validation import require_valid
from gridfold.powerflow.angles import ShiftedBranches, shifted_branches


@dataclass(frozen=True)
class IslandNetwork:
    """The network of one island.

    Parameters
    ----------
    members : ndarray of int, shape (n_members,)
        Positions of the first buses of its nodes in the case.
    admittance : sparse array, shape (n_members, n_members)
        Admittances of the nodes in per unit.
    branches : ShiftedBranches
        Branches between them.
    """

    members: NDArray[np.int64]
    admittance: csc_array
    branches: ShiftedBranches


@dataclass(frozen=True)
class FlowNetwork:
    """The network of a valid case, ready for power flows of any loads and units on it.

    Parameters
    ----------
    nodes : ndarray of int, shape (n_buses,)
        The node of each bus: the position of the first bus that is joined to it.
    admittance : sparse array, shape (n_buses, n_buses)
        Admittances of the nodes in per unit.
    islands : tuple of IslandNetwork
        Its islands.
    """

    nodes: NDArray[np.int64]
    admittance: csc_array
    islands: tuple[IslandNetwork, ...]

    @classmethod
    def of(cls, case: Case) -> FlowNetwork:
        """The network of a case, which is checked; raises a CaseError with every fault."""
        require_valid(case)
        nodes = node_of_buses(case)
        admittance = joined(bus_admittance(case), nodes)
        labels, branches = island_labels(case), shifted_branches(case)
        firsts = np.unique(nodes)
        members = [firsts[labels[firsts] == label] for label in np.unique(labels)]
        islands = (
            IslandNetwork(here, admittance[np.ix_(here, here)], branches.among(here))
            for here in members
        )
        return cls(nodes, admittance, tuple(islands))
