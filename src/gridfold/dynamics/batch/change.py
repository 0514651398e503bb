"""What a network state changes about the intact network, as a matrix of low rank.

With the currents I at the terminals, the impedances Z of the intact network and compensating
currents J at the few buses S that an event touches,

    V = Z I + Z_S J.

J makes the difference of admittances D act, J = -D V_S, and holds the voltage of a bus at zero that
is faulted or de-energized (Woodbury's formula; Alsac, Stott & Tinney, Sparsity-oriented
compensation methods for modified network solutions, IEEE Trans. PAS-102, 1983):

    J = -W I.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from gridfold.dynamics.network.equations import NetworkEquations

#: Part of an admittance that is put down to the order in which its parts were added up.
_ROUNDING = 1e-13


@dataclass(frozen=True)
class NetworkChange:
    """Compensating currents J = -W I, and the voltages Z_S J that they cause.

    Parameters
    ----------
    buses : ndarray of int, shape (r,)
        Positions of the buses S in the case.
    drawn : ndarray of complex, shape (r, n_terminals)
        W.
    caused : ndarray of complex, shape (n_terminals, r)
        Z_S at the terminals.
    zero : ndarray of int
        Positions of the buses that a fault holds at zero voltage.
    dead : ndarray of int
        Positions of the buses that are de-energized, and are not in the intact network.
    difference : ndarray of complex, shape (k, k)
        D between the last k buses of S; the first ones are those that are held.
    """

    buses: NDArray[np.int64]
    drawn: NDArray[np.complex128]
    caused: NDArray[np.complex128]
    zero: NDArray[np.int64]
    dead: NDArray[np.int64]
    difference: NDArray[np.complex128]


@dataclass
class NetworkChanges:
    """Changes of one intact network; what a bus does to all others is found once."""

    intact: NetworkEquations
    _columns: dict[int, NDArray[np.complex128]] = field(default_factory=dict)
    _rows: dict[int, NDArray[np.complex128]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._row_of = np.full(self.intact.n_buses, -1)
        self._row_of[self.intact.live] = np.arange(len(self.intact.live))
        self._entries = _entries(self.intact)

    def change(self, equations: NetworkEquations, injecting: Sequence[int]) -> NetworkChange | None:
        """What the network of `equations` changes; None where that cannot be said of the intact one.

        `injecting` are the positions of the buses of machines in service. It cannot be said where a
        bus is energized that was not, where other buses are joined, or where what is left is singular.
        """
        if not np.array_equal(equations.nodes, self.intact.nodes):
            return None
        n = self.intact.n_buses
        there = np.zeros(n, dtype=bool)
        there[equations.live] = True
        if (self._row_of[there] < 0).any():
            return None
        gone = self.intact.live[~there[self.intact.live]]
        held = gone[:0]
        if len(gone):
            rows, columns, _ = self._entries
            near = np.zeros(n, dtype=bool)
            near[columns[there[rows]]] = True
            near[equations.nodes[np.asarray(injecting, dtype=np.int64)]] = True
            held = gone[near[gone]]
        touched, difference = self._difference(equations, there)
        energized = equations.islands.energized
        zero = gone[energized[gone]]
        dead = np.flatnonzero(self.intact.islands.energized & ~energized)
        return self._compensated(held, touched, difference, zero, dead)

    def caused_at(
        self, change: NetworkChange, positions: NDArray[np.int64]
    ) -> NDArray[np.complex128]:
        """Voltages of energized buses at `positions` for unit currents at those of a change, (m, r)."""
        rows = self.intact.bus_rows[positions]
        columns = [self._column(bus)[rows] for bus in change.buses.tolist()]
        return np.array(columns).reshape(len(columns), len(rows)).T

    def _difference(
        self, equations: NetworkEquations, there: NDArray[np.bool_]
    ) -> tuple[NDArray[np.int64], NDArray[np.complex128]]:
        """Buses (k,) that are there whose admittances have changed, and by how much (k, k)."""
        size = self.intact.n_buses
        rows, columns, values = _entries(equations)
        before_rows, before_columns, before = self._entries
        kept = there[before_rows] & there[before_columns]
        known = (before_columns * size + before_rows)[kept]
        before = before[kept]
        found = columns * size + rows
        at = np.minimum(np.searchsorted(known, found), max(len(known) - 1, 0))
        same = known[at] == found if len(known) else np.zeros(len(found), dtype=bool)
        change = values.copy()
        change[same] -= before[at[same]]
        lost = np.ones(len(known), dtype=bool)
        lost[at[same]] = False
        change = np.concatenate([change, -before[lost]])
        found = np.concatenate([found, known[lost]])
        size_there = np.concatenate([np.abs(values), np.abs(before[lost])])
        real = np.abs(change) > _ROUNDING * size_there
        columns, rows = np.divmod(found[real], size)
        nodes, place = np.unique(np.concatenate([rows, columns]), return_inverse=True)
        dense = np.zeros((len(nodes),) * 2, dtype=np.complex128)
        dense[place[: len(rows)], place[len(rows) :]] = change[real]
        return nodes, dense

    def _compensated(
        self,
        held: NDArray[np.int64],
        touched: NDArray[np.int64],
        difference: NDArray[np.complex128],
        zero: NDArray[np.int64],
        dead: NDArray[np.int64],
    ) -> NetworkChange | None:
        buses, n_held = np.concatenate([held, touched]), len(held)
        columns = [self._column(bus) for bus in buses.tolist()]
        terminals = [self._row(bus) for bus in buses.tolist()]
        caused = self._seen(columns).T
        seen = self._seen(terminals)
        between = np.array([c[self._row_of[buses]] for c in columns], dtype=np.complex128)
        between = between.reshape((len(buses),) * 2).T
        moved = np.hstack([np.zeros((len(touched), n_held)), difference])
        left, right = between.copy(), np.eye(len(buses), dtype=np.complex128)
        left[n_held:] = moved @ between
        left[n_held:, n_held:] += np.eye(len(touched))
        right[n_held:] = moved
        try:
            drawn = np.asarray(np.linalg.solve(left, right @ seen), dtype=np.complex128)
        except np.linalg.LinAlgError:
            return None
        if not np.isfinite(drawn).all():
            return None
        return NetworkChange(buses, drawn, caused, zero, dead, difference)

    def _seen(self, voltages: Sequence[NDArray[np.complex128]]) -> NDArray[np.complex128]:
        """Voltages (n_live,) at the terminals, (k, n_terminals)."""
        rows = self.intact.terminals
        found = [np.where(rows >= 0, one[rows], 0.0) for one in voltages]
        return np.array(found, dtype=np.complex128).reshape(len(voltages), len(rows))

    def _column(self, bus: int) -> NDArray[np.complex128]:
        """Voltages of all live buses for a unit current at `bus`."""
        if bus not in self._columns:
            self._columns[bus] = self.intact.factors.solve(self._unit(bus))
        return self._columns[bus]

    def _row(self, bus: int) -> NDArray[np.complex128]:
        """Voltage at `bus` for a unit current at each live bus."""
        if bus not in self._rows:
            self._rows[bus] = self.intact.factors.solve(self._unit(bus), trans="T")
        return self._rows[bus]

    def _unit(self, bus: int) -> NDArray[np.complex128]:
        unit = np.zeros(len(self.intact.live), dtype=np.complex128)
        unit[self._row_of[bus]] = 1.0
        return unit


def _entries(
    equations: NetworkEquations,
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.complex128]]:
    """Rows, columns and values of the admittances over all nodes, by columns."""
    matrix, live = equations.matrix, equations.live
    matrix.sort_indices()
    columns = np.repeat(live, np.diff(matrix.indptr))
    return live[matrix.indices], columns, matrix.data
