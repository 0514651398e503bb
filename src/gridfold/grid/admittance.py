"""The bus admittance matrix.

Branch model: an ideal transformer of ratio t = ratio * exp(j shift) at the first bus, followed by a
pi section (Machowski, Bialek, Bumby, Power System Dynamics, 2nd ed., section 3.4). Admittances to
ground at either end stand at the buses.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csc_array

from gridfold.grid.case import Branch, Case
from gridfold.grid.intact import intact_once

#: Where a case keeps the admittances of its branches.
_KNOWN = "branch_admittances"


@dataclass(frozen=True)
class BranchAdmittances:
    """Entries of the two-port admittance matrices of branches, each of shape (n_branches,)."""

    from_from: NDArray[np.complex128]
    from_to: NDArray[np.complex128]
    to_from: NDArray[np.complex128]
    to_to: NDArray[np.complex128]


def branch_admittances(branches: Collection[Branch]) -> BranchAdmittances:
    """Two-port admittances of branches in per unit, with those at their ends, in service or not.

    Of a branch that joins its buses there is only what stands at its ends.
    """
    impedance = np.array([complex(b.resistance, b.reactance) for b in branches], dtype=complex)
    joins = np.array([b.joins for b in branches], dtype=bool)
    series = np.where(joins, 0.0, 1 / np.where(joins, 1.0, impedance))
    charging = 0.5j * np.array([b.susceptance for b in branches], dtype=float)
    ratio = np.array([b.ratio for b in branches], dtype=float)
    shift = np.deg2rad(np.array([b.shift_deg for b in branches], dtype=float))
    tap = ratio * np.exp(1j * shift)
    at_from = np.array([complex(b.from_conductance, b.from_susceptance) for b in branches])
    at_to = np.array([complex(b.to_conductance, b.to_susceptance) for b in branches])
    return BranchAdmittances(
        from_from=(series + charging) / ratio**2 + at_from,
        from_to=-series / np.conj(tap),
        to_from=-series / tap,
        to_to=series + charging + at_to,
    )


@intact_once
def bus_admittance(case: Case, branches_out: Collection[int]) -> csc_array:
    """Admittance matrix of branches and fixed shunts in per unit, shape (n_buses, n_buses).

    `branches_out` are the positions of open branches; by default those out of service in the case.
    Joined buses have rows of their own: :func:`gridfold.grid.nodes.joined` adds them up.
    """
    kept = np.ones(len(case.branches), dtype=bool)
    kept[sorted(branches_out)] = False
    y, (first, second) = _all_branches(case), case.branch_ends[kept].T
    index = case.bus_index
    shunts = [shunt for shunt in case.shunts if shunt.in_service]
    at = np.array([index[shunt.bus] for shunt in shunts], dtype=np.int64)
    power = np.array([complex(s.conductance_mw, s.susceptance_mvar) for s in shunts], dtype=complex)
    of_branches = (y.from_from, y.from_to, y.to_from, y.to_to)
    values = (*(part[kept] for part in of_branches), power / case.base_mva)
    rows = (first, first, second, second, at)
    columns = (first, second, first, second, at)
    n = len(case.buses)
    entries = (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns)))
    matrix = coo_array(entries, shape=(n, n)).tocsc()
    matrix.data.setflags(write=False)
    return matrix


def _all_branches(case: Case) -> BranchAdmittances:
    """Two-port admittances of all branches of a case, found once."""
    known: BranchAdmittances | None = vars(case).get(_KNOWN)
    if known is None:
        known = vars(case)[_KNOWN] = branch_admittances(case.branches)
    return known


def split_branch(branch: Branch, fraction: float) -> tuple[Branch, Branch]:
    """The two parts of a branch on either side of a point inside it.

    Series impedance and charging are divided in proportion; the transformer stays at the first bus,
    what stands at the ends stays there.
    The bus numbers of both parts are those of the branch: the caller connects the middle.
    """
    near, far = (
        replace(
            branch,
            resistance=branch.resistance * part,
            reactance=branch.reactance * part,
            susceptance=branch.susceptance * part,
        )
        for part in (fraction, 1 - fraction)
    )
    near = replace(near, to_conductance=0.0, to_susceptance=0.0)
    far = replace(far, ratio=1.0, shift_deg=0.0, from_conductance=0.0, from_susceptance=0.0)
    return near, far
