"""The ports of a linear area: the fewest buses through which its machines act on the rest.

A set of buses separates the linear machines from the study area and from the machines that are kept.
The smallest such set is a minimum vertex cut (Menger's theorem); it is found as a maximum flow
through a graph in which every bus is an edge of capacity one (L. R. Ford, D. R. Fulkerson, Flows in
Networks, 1962, section I.11). Of all smallest sets, that nearest to the linear machines is taken, so
that as much of the network as possible stays as it is and may be faulted or switched.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import breadth_first_order, connected_components, maximum_flow

from gridfold.dynamics.descriptor import node_currents
from gridfold.dynamics.model import DetailedModel
from gridfold.errors import OptionError
from gridfold.grid.case import UnitKey

#: Current in p.u. that is none.
_NO_CURRENT = 1e-9


@dataclass(frozen=True)
class Ports:
    """Where a linear area meets the rest.

    Parameters
    ----------
    buses : tuple of int
        Bus numbers of the ports, in order of the case.
    inside : frozenset of int
        Bus numbers behind the ports, which only linear machines share.
    units : tuple of UnitKey
        The linear machines, in order of the case's generators; they stand inside or at ports. What
        gives no current at the start, such as a load that follows the frequency, stands inside.
    study : frozenset of int
        Bus numbers of the study area, where loads stay as they are.
    """

    buses: tuple[int, ...]
    inside: frozenset[int]
    units: tuple[UnitKey, ...]
    study: frozenset[int]


def find_ports(model: DetailedModel, linear: Collection[UnitKey], study: Collection[int]) -> Ports:
    """The ports between the `linear` machines and the rest, of which the `study` buses are a part.

    Raises
    ------
    OptionError
        There is no linear machine, or none of them is joined to the rest.
    """
    case = model.case
    wanted = set(linear)
    feeding = feeding_units(model)
    far = {case.bus_index[unit.bus] for unit in wanted & feeding}
    near = {case.bus_index[bus] for bus in study}
    near |= {case.bus_index[u.bus] for u in model.units if u not in wanted}
    if not far or not near:
        raise OptionError("a linear area needs machines of its own, and others beside it")
    cut = _vertex_cut(_branches(model), near, far)
    if not cut.any():
        raise OptionError("nothing joins the linear machines to the rest of the system")
    inside = _behind(_branches(model), cut, far)
    numbers = [bus.number for bus in case.buses]
    behind = frozenset(numbers[k] for k in np.flatnonzero(inside))
    return Ports(
        tuple(numbers[k] for k in np.flatnonzero(cut)),
        behind,
        tuple(u for u in model.units if u in wanted and (u in feeding or u.bus in behind)),
        frozenset(study),
    )


def feeding_units(model: DetailedModel) -> set[UnitKey]:
    """Units that give a current at the start, by which ports are measured: machines, not all loads."""
    currents = np.abs(node_currents(model, model.x0)).max(axis=0).toarray().ravel()
    live = np.flatnonzero(currents > _NO_CURRENT)
    return {model.layout.source_units[k] for k in live}


def _branches(model: DetailedModel) -> csr_array:
    """Which buses a branch in service joins, as a symmetric matrix of ones."""
    case, n = model.case, len(model.case.buses)
    ends = np.array(
        [
            (case.bus_index[branch.from_bus], case.bus_index[branch.to_bus])
            for position, branch in enumerate(case.branches)
            if position not in model.state.branches_out
        ],
        dtype=np.int32,
    ).reshape(-1, 2)
    both = np.vstack([ends, ends[:, ::-1]])
    joined = csr_array((np.ones(len(both), dtype=np.int32), (both[:, 0], both[:, 1])), (n, n))
    joined.data[:] = 1
    return joined


def _vertex_cut(joined: csr_array, near: set[int], far: set[int]) -> NDArray[np.bool_]:
    """The smallest set of buses between `near` and `far`, as near to `far` as possible, (n,).

    Bus k is the edge from node k to node n + k; the source is node 2 n, the sink node 2 n + 1.
    """
    n = joined.shape[0]
    source, sink, every = 2 * n, 2 * n + 1, np.arange(n)
    start, end = joined.nonzero()
    near_at, far_at = np.array(sorted(near)), np.array(sorted(far))
    rows = np.concatenate([every, n + start, np.full(len(near_at), source), n + far_at])
    columns = np.concatenate([n + every, end, near_at, np.full(len(far_at), sink)])
    capacity = np.full(len(rows), n, dtype=np.int32)
    capacity[:n] = 1
    places = rows.astype(np.int32), columns.astype(np.int32)
    graph = csr_array((capacity, places), (2 * n + 2, 2 * n + 2))
    flow = maximum_flow(graph, source, sink).flow
    residual = csr_array(graph - flow)
    residual.data[residual.data < 0] = 0
    residual.eliminate_zeros()
    reached = np.zeros(2 * n + 2, dtype=bool)
    reached[breadth_first_order(csr_array(residual.T), sink, return_predecessors=False)] = True
    cut: NDArray[np.bool_] = reached[n : 2 * n] & ~reached[:n]
    return cut


def _behind(joined: csr_array, cut: NDArray[np.bool_], far: set[int]) -> NDArray[np.bool_]:
    """Buses that are joined to those of `far` without passing the cut, (n,)."""
    open_buses = np.flatnonzero(~cut)
    _, label = connected_components(joined[open_buses][:, open_buses], directed=False)
    part = np.full(joined.shape[0], -1)
    part[open_buses] = label
    hidden = [k for k in sorted(far) if not cut[k]]
    return np.asarray((part >= 0) & np.isin(part, part[hidden]))
