"""The data of the kernel: of a model, of network states, and of what ends a run."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from gridfold.dynamics.batch.change import NetworkChange, NetworkChanges
from gridfold.dynamics.cuda.kernel import DEAD, ZERO
from gridfold.dynamics.cuda.levels import LevelFactors
from gridfold.dynamics.model import DetailedModel
from gridfold.dynamics.rhs import frozen_states
from gridfold.grid.case import UnitKey
from gridfold.numerics.watch import SpreadWatch

Array = NDArray[np.float64] | NDArray[np.int64] | NDArray[np.int8]
Arrays = dict[str, Array]


def model_arrays(model: DetailedModel, kept: NDArray[np.int64]) -> Arrays:
    """What all runs of a model share; `kept` are positions of states that are kept along a run."""
    layout, rows, inputs, parameters = model.layout, [], [], []
    inputs_at = parameters_at = 0
    for block in layout.blocks:
        rows.append(
            (len(block.units), block.state_start, block.signal_start, inputs_at, parameters_at)
        )
        inputs.append(block.inputs.ravel())
        parameters.append(block.parameters.ravel())
        inputs_at += block.inputs.size
        parameters_at += block.parameters.size
    start = np.zeros(layout.n_signals)
    start[: layout.n_states] = model.x0
    constants = slice(layout.constant_start, layout.constant_start + len(model.constants))
    start[constants] = model.constants
    terminals = layout.sources[:, 2]
    order = np.argsort(terminals, kind="stable")
    sources = np.column_stack([layout.sources[order, :2], order])
    counts = np.bincount(terminals, minlength=len(layout.terminals))
    return {
        "blocks": np.array(rows, dtype=np.int64).reshape(-1, 5),
        "inputs": np.concatenate(inputs),
        "parameters": np.concatenate(parameters),
        "start": start,
        "sources_at": np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
        "sources": np.ascontiguousarray(sources, dtype=np.int64),
        "kept": kept,
    }


def impedance_arrays(model: DetailedModel) -> Arrays:
    """Impedances of the intact network between terminals, and from them to the energized buses."""
    return {
        "impedance": _parts(model.equations.terminal_impedance().T).ravel(),
        "bus_impedance": _parts(model.equations.voltage_map[energized(model)].T),
    }


def factor_arrays(model: DetailedModel, factors: LevelFactors) -> Arrays:
    """Sparse factors of the intact network, and where currents go in and voltages come out."""
    n_rows = factors.lower.shape[0]
    terminals = np.flatnonzero(factors.terminal_rows >= 0)
    rows = factors.terminal_rows[terminals]
    order = np.argsort(rows, kind="stable")
    counts = np.bincount(rows, minlength=n_rows)
    return {
        "levels_at": factors.starts,
        "low_at": factors.lower.indptr.astype(np.int64),
        "low_columns": factors.lower.indices.astype(np.int64),
        "low_values": _parts(factors.lower.data),
        "up_at": factors.upper.indptr.astype(np.int64),
        "up_columns": factors.upper.indices.astype(np.int64),
        "up_values": _parts(factors.upper.data),
        "inverse_diagonal": _parts(factors.inverse_diagonal),
        "tail_inverse": _parts(factors.tail_inverse.T),
        "inputs_at": np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
        "inputs_of": terminals[order],
        "terminal_rows": factors.terminal_rows,
        "bus_rows": factors.rows[energized(model)],
    }


def energized(model: DetailedModel) -> NDArray[np.int64]:
    """Positions of the buses whose voltages are looked at."""
    return np.flatnonzero(model.equations.islands.energized)


@dataclass
class NetworkTable:
    """The networks that runs lead through, each once.

    Parameters
    ----------
    model : DetailedModel
        The model on the intact network.
    changes : NetworkChanges
        What has been found out about changes of it.
    """

    model: DetailedModel
    changes: NetworkChanges
    _known: dict[tuple[int, frozenset[UnitKey]], int] = field(default_factory=dict)
    _networks: list[tuple[NetworkChange | None, Collection[UnitKey]]] = field(default_factory=list)

    def number(self, change: NetworkChange | None, units_out: Collection[UnitKey]) -> int:
        """The number of a network, which is added if it is new."""
        key = (id(change), frozenset(units_out))
        if key not in self._known:
            self._known[key] = len(self._networks)
            self._networks.append((change, units_out))
        return self._known[key]

    @property
    def rank(self) -> int:
        """The largest rank of a change, at least one."""
        return max((len(c.buses) for c, _ in self._networks if c is not None), default=0) or 1

    def arrays(self) -> Arrays:
        """All networks; what one does not use is zero."""
        layout, on = self.model.layout, energized(self.model)
        count, n = len(self._networks), len(layout.terminals)
        found: Arrays = {
            "ranks": np.zeros(count, dtype=np.int64),
            "drawn": np.zeros((count, 2, n, self.rank)),
            "live": np.ones((count, len(layout.sources))),
            "frozen": np.zeros((count, layout.n_states), dtype=np.int8),
            "bus_kind": np.zeros((count, len(on)), dtype=np.int8),
        }
        rows = self.model.equations.bus_rows
        for w, (change, out) in enumerate(self._networks):
            found["live"][w] = [unit not in out for unit in layout.source_units]
            found["frozen"][w, frozen_states(layout, out)] = 1
            if change is None:
                continue
            r = len(change.buses)
            found["ranks"][w] = r
            found["drawn"][w, :, :, :r] = _parts(change.drawn.T)
            found["bus_kind"][w, np.isin(rows[on], rows[change.zero])] = ZERO
            found["bus_kind"][w, np.isin(rows[on], rows[change.dead])] = DEAD
        return found

    def caused_arrays(self) -> Arrays:
        """Voltages that compensating currents cause at terminals and at energized buses."""
        on = energized(self.model)
        count, n = len(self._networks), len(self.model.layout.terminals)
        at_terminals = np.zeros((count, 2, self.rank, n))
        at_buses = np.zeros((count, 2, self.rank, len(on)))
        for w, change in self._changes():
            r = len(change.buses)
            at_terminals[w, :, :r] = _parts(change.caused.T)
            at_buses[w, :, :r] = _parts(self.changes.caused_at(change, on).T)
        return {"caused": at_terminals, "bus_caused": at_buses}

    def row_arrays(self, factors: LevelFactors) -> Arrays:
        """Rows of the factors at which compensating currents go in."""
        rows = np.zeros((len(self._networks), self.rank), dtype=np.int64)
        for w, change in self._changes():
            rows[w, : len(change.buses)] = factors.rows[change.buses]
        return {"change_rows": rows}

    def _changes(self) -> Iterator[tuple[int, NetworkChange]]:
        for w, (change, _) in enumerate(self._networks):
            if change is not None:
                yield w, change


@dataclass
class ConditionTable:
    """What ends runs, each once: groups of states of which none may be far from their reference."""

    _known: dict[tuple[int, ...], int] = field(default_factory=dict)
    _conditions: list[tuple[SpreadWatch, ...]] = field(default_factory=list)

    def number(self, watches: Sequence[SpreadWatch]) -> int:
        """The number of a condition, which is added if it is new."""
        key = tuple(map(id, watches))
        if key not in self._known:
            self._known[key] = len(self._conditions)
            self._conditions.append(tuple(watches))
        return self._known[key]

    def arrays(self) -> Arrays:
        """All conditions with their groups and the entries of these."""
        groups_at, fixed, limits, entries_at = [0], [], [], [0]
        index, share = [np.zeros(0, dtype=np.int64)], [np.zeros(0)]
        for watches in self._conditions:
            for watch in watches:
                total = np.bincount(watch.group, watch.weight, len(watch.reference))
                for g, reference in enumerate(watch.reference):
                    own = watch.group == g
                    free = bool(np.isnan(reference))
                    index.append(watch.index[own])
                    share.append(watch.weight[own] / (total[g] or 1.0) if free else 0.0 * own[own])
                    fixed.append(0.0 if free else reference)
                    limits.append(watch.limit)
                    entries_at.append(entries_at[-1] + int(own.sum()))
            groups_at.append(len(fixed))
        return {
            "groups_at": np.array(groups_at, dtype=np.int64),
            "group_fixed": np.array(fixed, dtype=np.float64),
            "group_limit": np.array(limits, dtype=np.float64),
            "entries_at": np.array(entries_at, dtype=np.int64),
            "entry_index": np.concatenate(index).astype(np.int64),
            "entry_share": np.concatenate(share),
        }


def _parts(matrix: NDArray[np.complex128]) -> NDArray[np.float64]:
    """Real and imaginary part, shape (2, rows, columns)."""
    return np.ascontiguousarray(np.stack([matrix.real, matrix.imag]))
