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

from gridfold.dynamics.jacobian import Partials, model_partials, real_form
from gridfold.dynamics.layout import Layout
from gridfold.dynamics.network.equations import NetworkEquations
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
        return unit_solver(self.layout, partials, self.impedance, gamma)


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
    a, b, c = partials.states.tolil(), partials.voltages.tocsr(), partials.currents.tocsc()
    rows, states, data = [], [], []
    loop = np.zeros((2 * n_t, 2 * n_t))
    states_at, data_at = 0, 0
    for index, terminal in _units(layout):
        at = [terminal, n_t + terminal]
        inverse = np.linalg.inv(np.eye(len(index)) - gamma * a[np.ix_(index, index)].toarray())
        driven = gamma * inverse @ b[index][:, at].toarray()
        seen = c[at][:, index].toarray()
        loop[np.ix_(at, at)] += seen @ driven
        rows.append((len(index), states_at, terminal, data_at))
        states.append(index)
        data += [inverse.ravel(), driven.ravel(), seen.ravel()]
        states_at += len(index)
        data_at += sum(part.size for part in data[-3:])
    network = np.linalg.solve(np.eye(2 * n_t) - impedance @ loop, impedance)
    table = np.array(rows, dtype=np.int64).reshape(-1, _COLUMNS)
    table[:, STATES_AT] += _HEADER + table.size
    header = np.array([layout.n_states, n_t, len(rows), data_at], dtype=np.int64)
    return CompiledSolver(
        _compiled().address,
        np.concatenate([header, table.ravel(), *states]).astype(np.int64),
        np.concatenate([*data, network.ravel()]),
        4 * n_t,
    )


def _units(layout: Layout) -> list[tuple[NDArray[np.int64], int]]:
    """Positions of the states of each unit, and its terminal."""
    found: dict[object, list[int]] = {unit: [] for unit in layout.source_units}
    for block in layout.blocks:
        for unit, column in zip(block.units, block.state_index.T, strict=True):
            found[unit] += column.tolist()
    place = {bus: k for k, bus in enumerate(layout.terminals)}
    return [
        (np.array(found[unit], dtype=np.int64), place[unit.bus])
        for unit in layout.source_units
        if found[unit]
    ]


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
