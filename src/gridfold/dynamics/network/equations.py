"""The network equations of one network state.

Loads are constant admittances at the initial voltage, machines are Norton equivalents, faulted buses
are shunted by the fault admittance or, if bolted, held at zero voltage. What an event leaves without a
machine is de-energized: its voltages are zero and its load is lost.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csc_array
from scipy.sparse.linalg import SuperLU, splu

from gridfold.dynamics.network.loads import NonlinearLoads
from gridfold.errors import NetworkError
from gridfold.grid.admittance import bus_admittance
from gridfold.grid.branch_port import state_port
from gridfold.grid.case import Case, UnitKey
from gridfold.grid.islands import Islands, find_islands
from gridfold.grid.network_state import NetworkState
from gridfold.grid.nodes import node_of_buses
from gridfold.powerflow.result import PowerFlowResult

#: Entries of a map from currents to voltages up to which it is made: a product with it is faster than
#: to solve for many columns, and threads do it side by side.
_DENSE_MAP = 200_000
#: Right-hand sides that are solved for together: more do not stay in the processor's cache.
_TOGETHER = 64


@dataclass(frozen=True)
class Injections:
    """What stands at the buses, whatever the network state.

    Parameters
    ----------
    load : ndarray of complex, shape (n_buses,)
        Admittance of loads in per unit.
    negative_load : mapping
        Admittance of each generator that is a negative load, by unit.
    machine : mapping
        Norton admittance of each machine and device of a load, by unit.
    norton : mapping
        Their Norton currents at the operating point, by unit.
    leading : frozenset of UnitKey
        Those that keep an island alive: machines with a rotor, and infinite buses.
    nonlinear : NonlinearLoads, optional
        Parts of loads and ends of dc lines that are no impedances; `load` has their equivalents.
    """

    load: NDArray[np.complex128]
    negative_load: Mapping[UnitKey, complex]
    machine: Mapping[UnitKey, complex]
    norton: Mapping[UnitKey, complex]
    leading: frozenset[UnitKey]
    nonlinear: NonlinearLoads | None = None


@dataclass(frozen=True)
class NetworkEquations:
    """Y V = I over the live buses of one network state.

    Parameters
    ----------
    matrix : sparse array, shape (n_live, n_live)
        Admittances, of which all nodes that are dead or at zero voltage have been removed.
    live : ndarray of int, shape (n_live,)
        Position of each row among the buses, of the first one where some are joined.
    terminals : ndarray of int, shape (n_terminals,)
        Row of each machine terminal; -1 where its voltage is zero.
    n_buses : int
        Number of buses.
    islands : Islands
        Islands of this network state.
    nodes : ndarray of int, shape (n_buses,)
        The node of each bus: the position of the first bus that is joined to it.
    """

    matrix: csc_array
    live: NDArray[np.int64]
    terminals: NDArray[np.int64]
    n_buses: int
    islands: Islands
    nodes: NDArray[np.int64]

    @cached_property
    def bus_rows(self) -> NDArray[np.int64]:
        """Row of each bus, shape (n_buses,); -1 where its voltage is zero."""
        return _bus_rows(self.live, self.nodes)

    @cached_property
    def factors(self) -> SuperLU:
        """Sparse factors of the matrix, in a symmetric ordering without pivoting."""
        try:
            return splu(
                self.matrix,
                permc_spec="MMD_AT_PLUS_A",
                diag_pivot_thresh=0.0,
                options={"SymmetricMode": True},
            )
        except RuntimeError as error:
            raise NetworkError(f"the admittance matrix cannot be factored: {error}") from None

    def has_places_of(self, other: NetworkEquations) -> bool:
        """Whether buses, terminals, admittances and factors stand where those of the other one do."""
        if self is other:
            return True
        return all(
            np.array_equal(here, there)
            for here, there in zip(self._places(), other._places(), strict=True)
        )

    def _places(self) -> tuple[NDArray[Any], ...]:
        matrix, factors = self.matrix, self.factors
        where = (self.live, self.terminals, self.nodes, self.islands.energized)
        return *where, matrix.indptr, matrix.indices, factors.perm_r, factors.perm_c

    def seen_from(self, positions: Sequence[int]) -> NetworkEquations:
        """The same network, and its factors, with terminals at the `positions` of buses in the case."""
        at = np.array(positions, dtype=np.int64)
        seen = replace(self, terminals=self.bus_rows[at])
        vars(seen)["factors"] = self.factors
        return seen

    @cached_property
    def voltage_map(self) -> NDArray[np.complex128]:
        """Voltages of all buses caused by unit currents at the terminals, (n_buses, n_terminals)."""
        return self._solved(np.eye(len(self.terminals), dtype=np.complex128))

    def bus_voltages(
        self, currents: NDArray[np.complex128], at: NDArray[np.int64] | None = None
    ) -> NDArray[np.complex128]:
        """Voltage of every bus, (n_buses, k), from currents at the terminals, (n_terminals, k).

        With `at` (m,) those of the buses at these positions alone, (m, k).
        """
        count = len(self.terminals)
        if currents.shape[1] > count and self.n_buses * count <= _DENSE_MAP:
            return (self.voltage_map if at is None else self.voltage_map[at]) @ currents
        return self._solved(currents) if at is None else self._solved(currents)[at]

    def _solved(self, currents: NDArray[np.complex128]) -> NDArray[np.complex128]:
        present = self.terminals >= 0
        injected = np.zeros((len(self.live), currents.shape[1]), dtype=np.complex128)
        np.add.at(injected, self.terminals[present], currents[present])
        voltage = np.zeros((self.n_buses, currents.shape[1]), dtype=np.complex128)
        rows = self.bus_rows
        places = np.flatnonzero(rows >= 0)
        for first in range(0, injected.shape[1], _TOGETHER):
            few = slice(first, first + _TOGETHER)
            solved = self.factors.solve(np.ascontiguousarray(injected[:, few]))
            voltage[places, few] = solved[rows[places]]
        return voltage

    def terminal_impedance(self) -> NDArray[np.complex128]:
        """Impedance matrix seen from the terminals, shape (n_terminals, n_terminals)."""
        present = np.flatnonzero(self.terminals >= 0)
        units = np.zeros((len(self.live), len(present)), dtype=np.complex128)
        units[self.terminals[present], np.arange(len(present))] = 1.0
        impedance = np.zeros((len(self.terminals),) * 2, dtype=np.complex128)
        if len(present):
            solution = self.factors.solve(units)[self.terminals[present]]
            impedance[np.ix_(present, present)] = solution
        return impedance


def build_equations(
    power_flow: PowerFlowResult,
    injections: Injections,
    terminal_buses: tuple[int, ...],
    state: NetworkState,
) -> NetworkEquations:
    """Network equations of `state`."""
    case = power_flow.case
    index = case.bus_index
    n = len(case.buses)
    nodes = node_of_buses(case, state.severed)
    inside = {point.branch for point in state.branch_faults if point.at_end is None}
    altered = state.severed | inside
    machines = {u: y for u, y in injections.machine.items() if u not in state.units_out}
    leading = (unit.bus for unit in injections.leading if unit not in state.units_out)
    islands = find_islands(case, state.severed, leading)
    shunt = load_admittance(power_flow, injections, state)
    for unit, admittance in (*injections.negative_load.items(), *machines.items()):
        if unit not in state.units_out:
            shunt[index[unit.bus]] += admittance
    for bus, admittance in _shunt_changes(case, state):
        shunt[index[bus]] += admittance
    alive = islands.energized.copy()
    for bus, impedance in state.bus_shorts(case):
        if impedance == 0:
            alive[nodes[index[bus]]] = False
        else:
            shunt[index[bus]] += 1 / impedance
    matrix = bus_admittance(case, altered).tocoo()
    rows, columns, values = _altered_branches(case, state, altered - state.branches_out)
    live = np.flatnonzero(alive & (nodes == np.arange(n)))
    row_of = _bus_rows(live, nodes)
    data = np.concatenate([matrix.data, shunt, values])
    rows = row_of[np.concatenate([matrix.row, np.arange(n), rows])]
    columns = row_of[np.concatenate([matrix.col, np.arange(n), columns])]
    kept = (rows >= 0) & (columns >= 0)
    shape = (len(live),) * 2
    entries = coo_array((data[kept], (rows[kept], columns[kept])), shape=shape).tocsc()
    at = np.array([index[bus] for bus in terminal_buses], dtype=np.int64)
    return NetworkEquations(entries, live, row_of[at], n, islands, nodes)


def _bus_rows(live: NDArray[np.int64], nodes: NDArray[np.int64]) -> NDArray[np.int64]:
    """Row of each bus among the live nodes, shape (n_buses,); -1 where there is none."""
    rows = np.full(len(nodes), -1)
    rows[live] = np.arange(len(live))
    return np.asarray(rows[nodes], dtype=np.int64)


def load_admittance(
    power_flow: PowerFlowResult, injections: Injections, state: NetworkState
) -> NDArray[np.complex128]:
    """Admittance of the loads at each bus in p.u. in a network state, shape (n_buses,)."""
    case = power_flow.case
    result = injections.load.copy()
    for bus, power in state.load_steps:
        at = case.bus_index[bus]
        result[at] += np.conj(power) / case.base_mva / abs(power_flow.voltage[at]) ** 2
    return result


def _shunt_changes(case: Case, state: NetworkState) -> Iterator[tuple[int, complex]]:
    """Admittance in per unit that shunts add to buses."""
    for position in state.shunts_switched:
        shunt = case.shunts[position]
        size = complex(shunt.conductance_mw, shunt.susceptance_mvar) / case.base_mva
        yield shunt.bus, -size if shunt.in_service else size
    for bus, power in state.shunt_steps:
        yield bus, power / case.base_mva


def _altered_branches(
    case: Case, state: NetworkState, positions: Collection[int]
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.complex128]]:
    """Matrix entries of branches with a fault inside or an open end.

    Those without impedance have none.
    """
    order = sorted(k for k in positions if not case.branches[k].joins)
    ports = np.array([state_port(case, state, k) for k in order]).reshape(-1, 2, 2)
    index, branches = case.bus_index, [case.branches[k] for k in order]
    ends = np.array([(index[b.from_bus], index[b.to_bus]) for b in branches], dtype=np.int64)
    ends = ends.reshape(-1, 2)
    return np.repeat(ends, 2, axis=1).ravel(), np.tile(ends, (1, 2)).ravel(), ports.ravel()
