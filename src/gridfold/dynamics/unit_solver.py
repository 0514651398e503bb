"""Solver of (I - gamma J) y = b for a detailed model, by elimination of the units onto the network.

The states of a unit see other units only through the voltage at its terminal:

    (I - gamma A) y - gamma B v = b,    v = Z C y,

with A block-diagonal by units. Each unit's block is inverted alone; what remains are the terminal
voltages, v = K C (I - gamma A)^-1 b with K = (I - gamma Z C (I - gamma A)^-1 B)^-1 Z.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from gridfold.dynamics.jacobian import Partials, model_partials
from gridfold.dynamics.layout import Layout
from gridfold.dynamics.network.equations import NetworkEquations
from gridfold.dynamics.network.loads import NonlinearLoads, closed_with_loads, real_form
from gridfold.grid.case import UnitKey
from gridfold.numerics.compiled import compile_callback, matrix_view
from gridfold.numerics.implicit import SOLVER_SIGNATURE, CompiledSolver
from gridfold.numerics.rhs import CompiledRhs

# Header of the integers; a row for each unit follows, then the positions of its states.
N_STATES, N_TERMINALS, N_UNITS, NETWORK_AT = range(4)
_HEADER = 4
SIZE, STATES_AT, TERMINAL, DATA_AT = range(4)
_COLUMNS = 4


@dataclass(frozen=True)
class UnitSolvers:
    """Makes the solvers of one detailed model: called with a state and gamma."""

    layout: Layout
    equations: NetworkEquations
    loads: NonlinearLoads | None
    units_out: Collection[UnitKey]
    rhs: CompiledRhs

    @cached_property
    def impedance(self) -> NDArray[np.float64]:
        """Real form of the impedance matrix, shape (2 n_terminals, 2 n_terminals)."""
        return real_form(self.equations.terminal_impedance())

    def __call__(self, x: NDArray[np.float64], gamma: float) -> CompiledSolver:
        """The solver at the state `x`."""
        signals = self.rhs.work_along(x[None, :], self.layout.n_signals)[0]
        partials = model_partials(self.layout, self.units_out, x, signals)
        layout = self.layout
        voltages = signals[layout.voltage_start : layout.n_signals].reshape(2, -1)
        network = closed_with_loads(
            self.impedance, self.loads, voltages[0] + 1j * voltages[1], layout.terminals
        )
        return unit_solver(layout, partials, network, gamma)


def unit_solver(
    layout: Layout, partials: Partials, impedance: NDArray[np.float64], gamma: float
) -> CompiledSolver:
    """The solver at the state of `partials`.

    Parameters
    ----------
    layout : Layout
        Which states belong to which unit, and its terminal.
    partials : Partials
        A, B and C.
    impedance : ndarray, shape (2 n_terminals, 2 n_terminals)
        Real form of Z, from currents to voltages.
    gamma : float
        In seconds.
    """
    n_t = len(layout.terminals)
    places = _places(layout)
    a = _blocks(partials.states, places.unit, places.row, places.unit, places.row, places.shape)
    rows = np.arange(2 * n_t)
    b = _blocks(
        partials.voltages, places.unit, places.row, None, rows // n_t, (*places.shape[:2], 2)
    )
    c = _blocks(
        partials.currents, None, rows // n_t, places.unit, places.row,
        (places.shape[0], 2, places.shape[1]),
    )  # fmt: skip
    inverse = np.linalg.inv(np.eye(places.shape[1]) - gamma * a)
    driven = gamma * inverse @ b
    returned = np.zeros((2, n_t, 2, n_t))
    at = places.terminal
    np.add.at(returned.transpose(1, 3, 0, 2), (at, at), c @ driven)
    loop = returned.reshape(2 * n_t, 2 * n_t)
    network = np.linalg.solve(np.eye(2 * n_t) - impedance @ loop, impedance)
    table, data = [], []
    states_at, data_at = _HEADER + _COLUMNS * len(places.sizes), 0
    for unit, size in enumerate(places.sizes):
        table.append((size, states_at, at[unit], data_at))
        data += [
            inverse[unit, :size, :size].ravel(),
            driven[unit, :size].ravel(),
            c[unit, :, :size].ravel(),
        ]
        states_at += size
        data_at += size * size + 4 * size
    header = np.array([layout.n_states, n_t, len(table), data_at], dtype=np.int64)
    return CompiledSolver(
        _compiled().address,
        np.concatenate([header, np.ravel(table), places.states]).astype(np.int64),
        np.concatenate([*data, network.ravel()]),
        4 * n_t,
    )


@dataclass(frozen=True)
class _Places:
    """Unit and row within it of every state, and of each unit its terminal, size and states."""

    unit: NDArray[np.int64]
    row: NDArray[np.int64]
    terminal: NDArray[np.int64]
    sizes: list[int]
    states: NDArray[np.int64]

    @property
    def shape(self) -> tuple[int, int, int]:
        """Shape of the blocks, all of them padded to the largest."""
        largest = max(self.sizes, default=0)
        return len(self.sizes), largest, largest


def _places(layout: Layout) -> _Places:
    members: dict[UnitKey, list[int]] = {unit: [] for unit in layout.source_units}
    for block in layout.blocks:
        for unit, column in zip(block.units, block.state_index.T, strict=True):
            members[unit] += column.tolist()
    members = {unit: states for unit, states in members.items() if states}
    unit_of, row_of = np.zeros((2, layout.n_states), dtype=np.int64)
    for number, states in enumerate(members.values()):
        unit_of[states], row_of[states] = number, np.arange(len(states))
    at = {bus: k for k, bus in enumerate(layout.terminals)}
    return _Places(
        unit_of,
        row_of,
        np.array([at[unit.bus] for unit in members], dtype=np.int64),
        [len(states) for states in members.values()],
        np.array([k for states in members.values() for k in states], dtype=np.int64),
    )


def _blocks(
    matrix: csr_array,
    first_unit: NDArray[np.int64] | None,
    first_row: NDArray[np.int64],
    second_unit: NDArray[np.int64] | None,
    second_row: NDArray[np.int64],
    shape: tuple[int, int, int],
) -> NDArray[np.float64]:
    """The entries of a sparse matrix by unit; where one side has no unit, that of the other."""
    entries = matrix.tocoo()
    side, index = (
        (first_unit, entries.row) if first_unit is not None else (second_unit, entries.col)
    )
    assert side is not None
    blocks = np.zeros(shape)
    np.add.at(blocks, (side[index], first_row[entries.row], second_row[entries.col]), entries.data)
    return blocks


def _solve(integers, reals, b, y, scratch):
    n_t, n_units = integers[N_TERMINALS], integers[N_UNITS]
    currents, voltages = scratch[: 2 * n_t], scratch[2 * n_t : 4 * n_t]
    for t in range(2 * n_t):
        currents[t] = 0.0
    for unit in range(n_units):
        row = _HEADER + _COLUMNS * unit
        size, states, terminal = integers[row], integers[row + STATES_AT], integers[row + TERMINAL]
        at = integers[row + DATA_AT]
        inverse = matrix_view(reals, at, size, size)
        seen = matrix_view(reals, at + size * (size + 2), 2, size)
        i_r, i_i = 0.0, 0.0
        for k in range(size):
            total = 0.0
            for j in range(size):
                total += inverse[k, j] * b[integers[states + j]]
            y[integers[states + k]] = total
            i_r += seen[0, k] * total
            i_i += seen[1, k] * total
        currents[terminal] += i_r
        currents[n_t + terminal] += i_i
    network = matrix_view(reals, integers[NETWORK_AT], 2 * n_t, 2 * n_t)
    for t in range(2 * n_t):
        total = 0.0
        for j in range(2 * n_t):
            total += network[t, j] * currents[j]
        voltages[t] = total
    for unit in range(n_units):
        row = _HEADER + _COLUMNS * unit
        size, states, terminal = integers[row], integers[row + STATES_AT], integers[row + TERMINAL]
        driven = matrix_view(reals, integers[row + DATA_AT] + size * size, size, 2)
        for k in range(size):
            v = driven[k, 0] * voltages[terminal] + driven[k, 1] * voltages[n_t + terminal]
            y[integers[states + k]] += v


@cache
def _compiled() -> Any:
    return compile_callback(_solve, SOLVER_SIGNATURE)
