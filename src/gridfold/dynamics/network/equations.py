"""The network equations of one network state.

Loads are constant admittances at the initial voltage, machines are Norton equivalents, faulted buses
are shunted by the fault admittance or, if bolted, held at zero voltage. What an event leaves without a
machine is de-energized: its voltages are zero and its load is lost.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csc_array
from scipy.sparse.linalg import SuperLU, splu

from gridfold.dynamics.network.loads import NonlinearLoads
from gridfold.errors import NetworkError
from gridfold.grid.admittance import branch_admittances, bus_admittance, split_branch
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
        Norton admittance of each machine, by unit.
    nonlinear : NonlinearLoads, optional
        Parts of loads and ends of dc lines that are no impedances; `load` has their equivalents.
    whole : Injections, optional
        Those with all dc lines, where some are left out in a network state.
    """

    load: NDArray[np.complex128]
    negative_load: Mapping[UnitKey, complex]
    machine: Mapping[UnitKey, complex]
    nonlinear: NonlinearLoads | None = None
    whole: Injections | None = None


@dataclass(frozen=True)
class NetworkEquations:
    """Y V = I over the live buses of one network state.

    Parameters
    ----------
    matrix : sparse array, shape (n_live, n_live)
        Admittances, of which all nodes that are dead or at zero voltage have been removed.
    live : ndarray of int, shape (n_live,)
        Position of each row among the buses, of the first one where some are joined; nodes inside
        branches come after the last bus.
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

    def bus_voltages(self, currents: NDArray[np.complex128]) -> NDArray[np.complex128]:
        """Voltage of every bus, (n_buses, k), from currents at the terminals, (n_terminals, k)."""
        count = len(self.terminals)
        if currents.shape[1] > count and self.n_buses * count <= _DENSE_MAP:
            return self.voltage_map @ currents
        return self._solved(currents)

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
    nodes = node_of_buses(case, state.branches_out)
    faulted = {p.branch for p in state.branch_faults if not case.branches[p.branch].joins}
    machines = {u: y for u, y in injections.machine.items() if u not in state.units_out}
    islands = find_islands(case, state.branches_out, (unit.bus for unit in machines))
    shunt = injections.load.copy()
    for unit, admittance in (*injections.negative_load.items(), *machines.items()):
        if unit not in state.units_out:
            shunt[index[unit.bus]] += admittance
    for bus, power in state.load_steps:
        squared = abs(power_flow.voltage[index[bus]]) ** 2
        shunt[index[bus]] += np.conj(power) / case.base_mva / squared
    extra, grounded, size = _fault_entries(case, state, shunt)
    matrix = bus_admittance(case, state.branches_out | faulted)
    rows, columns, values = extra
    diagonal = np.arange(n)
    place = np.concatenate([nodes, np.arange(n, size)])
    entries = coo_array(
        (
            np.concatenate([matrix.tocoo().data, shunt, values]),
            (
                place[np.concatenate([matrix.tocoo().row, diagonal, rows])],
                place[np.concatenate([matrix.tocoo().col, diagonal, columns])],
            ),
        ),
        shape=(size, size),
    ).tocsc()
    alive = np.ones(size, dtype=bool)
    alive[:n] = islands.energized
    alive[:n] &= nodes == diagonal
    alive[place[np.array(sorted(grounded), dtype=np.int64)]] = False
    live = np.flatnonzero(alive)
    at = np.array([index[bus] for bus in terminal_buses], dtype=np.int64)
    rows = _bus_rows(live, nodes)
    return NetworkEquations(entries[live][:, live], live, rows[at], n, islands, nodes)


def _bus_rows(live: NDArray[np.int64], nodes: NDArray[np.int64]) -> NDArray[np.int64]:
    """Row of each bus among the live nodes, shape (n_buses,); -1 where there is none."""
    rows = np.full(len(nodes), -1)
    real_buses = live < len(nodes)
    rows[live[real_buses]] = np.flatnonzero(real_buses)
    return np.asarray(rows[nodes])


def _fault_entries(
    case: Case, state: NetworkState, shunt: NDArray[np.complex128]
) -> tuple[tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.complex128]], set[int], int]:
    """Matrix entries that faults add, nodes at zero voltage, and the number of nodes."""
    index = case.bus_index
    grounded: set[int] = set()
    rows: list[int] = []
    columns: list[int] = []
    values: list[complex] = []

    def ground(bus: int, impedance: complex) -> None:
        if impedance == 0:
            grounded.add(index[bus])
        else:
            shunt[index[bus]] += 1 / impedance

    for bus, impedance in state.bus_faults:
        ground(bus, impedance)
    node = len(case.buses)
    for point in sorted(state.branch_faults, key=lambda point: point[:2]):
        branch = case.branches[point.branch]
        if branch.joins:
            ground(branch.from_bus, point.impedance)
            continue
        parts, middle = branch_admittances(split_branch(branch, point.fraction)), node
        first, second = index[branch.from_bus], index[branch.to_bus]
        for part, (start, end) in enumerate(((first, middle), (middle, second))):
            rows += [start, start, end, end]
            columns += [start, end, start, end]
            values += [
                parts.from_from[part],
                parts.from_to[part],
                parts.to_from[part],
                parts.to_to[part],
            ]
        if point.impedance == 0:
            grounded.add(node)
        else:
            rows.append(node)
            columns.append(node)
            values.append(1 / point.impedance)
        node += 1
    entries = (
        np.array(rows, dtype=np.int64),
        np.array(columns, dtype=np.int64),
        np.array(values, dtype=np.complex128),
    )
    return entries, grounded, node
