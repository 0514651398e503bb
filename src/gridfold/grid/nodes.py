"""Buses that branches without impedance join into one node."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csc_array
from scipy.sparse.csgraph import connected_components

from gridfold.grid.case import Case
from gridfold.grid.intact import intact_once


@intact_once
def node_of_buses(case: Case, branches_out: Collection[int]) -> NDArray[np.int64]:
    """The node of each bus: the position of the first bus that is joined to it, shape (n_buses,).

    `branches_out` are the positions of open branches; by default those out of service in the case.
    """
    nodes = _first_of_joined(case, branches_out)
    nodes.setflags(write=False)
    return nodes


def _first_of_joined(case: Case, branches_out: Collection[int]) -> NDArray[np.int64]:
    n = len(case.buses)
    ends = [
        (case.bus_index[branch.from_bus], case.bus_index[branch.to_bus])
        for position, branch in enumerate(case.branches)
        if branch.joins and position not in branches_out
    ]
    if not ends:
        return np.arange(n)
    first, second = np.array(ends, dtype=np.int64).T
    graph = coo_array((np.ones(len(ends)), (first, second)), shape=(n, n))
    _, labels = connected_components(graph.tocsr(), directed=False)
    _, firsts = np.unique(labels, return_index=True)
    return np.array(firsts[labels], dtype=np.int64)


def joined(matrix: csc_array, nodes: NDArray[np.int64]) -> csc_array:
    """The matrix of the nodes: rows and columns of joined buses added up at the first of each node.

    Parameters
    ----------
    matrix : csc_array, shape (n_buses, n_buses)
        A matrix of buses.
    nodes : ndarray of int, shape (n_buses,)
        From :func:`node_of_buses`.
    """
    if np.array_equal(nodes, np.arange(len(nodes))):
        return matrix
    entries = matrix.tocoo()
    places = (nodes[entries.row], nodes[entries.col])
    return coo_array((entries.data, places), shape=matrix.shape).tocsc()
