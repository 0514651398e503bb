"""A branch as its two buses see it, whatever happens inside: faults, open ends.

Nodes that are no buses are eliminated: of the admittances Y between kept nodes k and eliminated ones e,

    Y_port = Y_kk - Y_ke Y_ee^-1 Y_ek

is left (G. Kron; Grainger, Stevenson, Power System Analysis, section 7.2). A node with a bolted fault
is at zero voltage and simply goes.
"""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
from numpy.typing import NDArray

from gridfold.errors import NetworkError
from gridfold.grid.admittance import branch_admittances, split_branch
from gridfold.grid.case import Branch, Case
from gridfold.grid.network_state import BranchFaultPoint, NetworkState


def two_port(
    branch: Branch, fault: BranchFaultPoint | None = None, open_ends: Collection[int] = ()
) -> NDArray[np.complex128]:
    """Admittances in per unit between the two buses of a branch, shape (2, 2).

    Parameters
    ----------
    branch : Branch
        The branch, with its transformer and what stands at its ends.
    fault : BranchFaultPoint, optional
        A short circuit inside, or at an end that is open; one at a closed end is that of a bus.
    open_ends : collection of int
        Ends that are open, 0 or 1: their rows and columns are zero.

    Raises
    ------
    NetworkError
        An open end resonates: no voltage there is finite.
    """
    inside = fault is not None and fault.at_end is None
    if fault is not None and inside:
        chain = branch_admittances(split_branch(branch, fault.fraction))
        nodes = [(0, 2), (2, 1)]
    else:
        chain, nodes = branch_admittances([branch]), [(0, 1)]
    matrix = np.zeros((3, 3), dtype=np.complex128)
    for part, (first, second) in enumerate(nodes):
        matrix[first, first] += chain.from_from[part]
        matrix[first, second] += chain.from_to[part]
        matrix[second, first] += chain.to_from[part]
        matrix[second, second] += chain.to_to[part]
    kept = [end for end in (0, 1) if end not in open_ends]
    gone = [*(end for end in (0, 1) if end in open_ends), *([2] if inside else [])]
    at = None if fault is None else (2 if fault.at_end is None else fault.at_end)
    if fault is not None and at in gone:
        if fault.impedance == 0:
            gone.remove(at)
        else:
            matrix[at, at] += 1 / fault.impedance
    port = np.zeros((2, 2), dtype=np.complex128)
    seen = matrix[np.ix_(kept, kept)]
    if gone and kept:
        inner = matrix[np.ix_(gone, gone)]
        if np.abs(np.linalg.det(inner)) <= np.finfo(float).eps * np.abs(inner).max() ** len(gone):
            raise NetworkError(f"{branch}: its open end resonates, there is no voltage there")
        seen = seen - matrix[np.ix_(kept, gone)] @ np.linalg.solve(
            inner, matrix[np.ix_(gone, kept)]
        )
    port[np.ix_(kept, kept)] = seen
    return port


def state_port(case: Case, state: NetworkState, position: int) -> NDArray[np.complex128]:
    """The same of the branch at `position` in a network state, (2, 2); zero where it is out."""
    if position in state.branches_out:
        return np.zeros((2, 2), dtype=np.complex128)
    fault = next((point for point in state.branch_faults if point.branch == position), None)
    ends = [end.end for end in state.open_ends if end.branch == position]
    return two_port(case.branches[position], fault, ends)
