"""Solver of (I - gamma J) y = b for a detailed model, by elimination of the units onto the network.

The states of a unit see other units only through the voltage at its terminal:

    (I - gamma A) y - gamma B v = b,    Y v = C y + S v,

with A block-diagonal by units, and S the slopes of nonlinear loads. Each unit's block is inverted
alone; what remains are the terminal voltages,

    (Y - S - gamma C (I - gamma A)^-1 B) v = C (I - gamma A)^-1 b.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gridfold.dynamics.layout import Layout
from gridfold.dynamics.network.closed import ClosedNetworks
from gridfold.dynamics.network.equations import NetworkEquations
from gridfold.dynamics.network.loads import NonlinearLoads
from gridfold.dynamics.unit_partials import UnitKernels, UnitPlaces, UnitSlopes, unit_places
from gridfold.grid.case import UnitKey
from gridfold.numerics.compiled import compile_callback, compiled_part, invoke
from gridfold.numerics.implicit import SOLVER_SIGNATURE, CompiledSolver
from gridfold.numerics.rhs import CompiledRhs

# Header of the integers. A row for each group of units of equal size follows, then for each group the
# positions of its states (size, n_units) and the terminals of its units, then the network's integers.
(
    N_TERMINALS,
    N_GROUPS,
    N_PLACES,
    NETWORK_ADDRESS,
    NETWORK_INTEGERS_AT,
    NETWORK_INTEGERS,
    NETWORK_REALS_AT,
    NETWORK_REALS,
) = range(8)
_HEADER = 8
SIZE, UNITS, STATES_AT, TERMINALS_AT, MATRIX_AT, DRIVEN_AT, PLACES_AT = range(7)
_COLUMNS = 7


@dataclass(frozen=True)
class UnitSolvers:
    """Makes the solvers of one detailed model: called with a state and gamma."""

    layout: Layout
    equations: NetworkEquations
    loads: NonlinearLoads | None
    units_out: Collection[UnitKey]
    rhs: CompiledRhs

    @cached_property
    def places(self) -> UnitPlaces:
        """Where the states of the units are."""
        return unit_places(self.layout, self.units_out)

    @cached_property
    def kernels(self) -> UnitKernels:
        """The devices on complex numbers."""
        return UnitKernels(self.layout, self.places, self.rhs)

    @cached_property
    def networks(self) -> ClosedNetworks:
        """The network, ready for any slopes."""
        return ClosedNetworks(self.equations)

    def __call__(self, x: NDArray[np.float64], gamma: float) -> CompiledSolver:
        """The solver at the state `x`."""
        layout, n_t = self.layout, len(self.layout.terminals)
        voltages = self.rhs.work_along(x[None, :], layout.voltage_slots)[0]
        partials = self.kernels.slopes(x, voltages)
        slopes = np.zeros((n_t, 2, 2))
        if self.loads is not None:
            at = self.loads.places(layout.terminals)
            slopes[at] = self.loads.slopes((voltages[:n_t] + 1j * voltages[n_t:])[at])
        return unit_solver(self.places, partials, self.networks, slopes, gamma)


def unit_solver(
    places: UnitPlaces,
    partials: UnitSlopes,
    networks: ClosedNetworks,
    slopes: NDArray[np.float64],
    gamma: float,
) -> CompiledSolver:
    """The solver with the partial derivatives of one state.

    Parameters
    ----------
    places : UnitPlaces
        Which states belong to which unit, and its terminal.
    partials : UnitSlopes
        A, B and C.
    networks : ClosedNetworks
        The network.
    slopes : ndarray, shape (n_terminals, 2, 2)
        S.
    gamma : float
        In seconds.
    """
    n_t, slopes = len(slopes), slopes.copy()
    groups = places.groups
    table, indices, data = [], [], []
    index_at, data_at, places_at = _HEADER + _COLUMNS * len(groups), 0, 0
    for units, states in groups:
        size, count = states.shape
        a, b, c = (
            partials.states[units, :size, :size],
            partials.voltages[units, :size],
            partials.currents[units, :, :size],
        )
        inverse = np.linalg.inv(np.eye(size) - gamma * a)
        driven = gamma * inverse @ b
        np.add.at(slopes, places.terminal[units], c @ driven)
        matrix = np.concatenate([inverse, c @ inverse], axis=1)
        indices += [states.ravel(), places.terminal[units]]
        data += [matrix.transpose(1, 2, 0).ravel(), driven.transpose(1, 2, 0).ravel()]
        table += [
            size, count, index_at, index_at + size * count,
            data_at, data_at + matrix.size, places_at,
        ]  # fmt: skip
        index_at += (size + 1) * count
        data_at += matrix.size + driven.size
        places_at += (size + 2) * count
    network = networks(slopes)
    header = [
        n_t, len(groups), places_at, network.address,
        index_at, network.integers.size, data_at, network.reals.size,
    ]  # fmt: skip
    largest = max(
        (max(size, 2) * count for size, count in (at.shape for _, at in groups)), default=0
    )
    return CompiledSolver(
        _compiled().address,
        np.concatenate([header, table, *indices, network.integers]).astype(np.int64),
        np.concatenate([*data, network.reals]),
        places_at + 4 * n_t + largest + network.scratch_size,
    )


def _solve(integers, reals, b, y, scratch):
    n_t = integers[N_TERMINALS]
    voltages_at = integers[N_PLACES]
    voltages, currents = (
        scratch[voltages_at : voltages_at + 2 * n_t],
        scratch[voltages_at + 2 * n_t : voltages_at + 4 * n_t],
    )
    rest = scratch[voltages_at + 4 * n_t :]
    for t in range(2 * n_t):
        currents[t] = 0.0
        voltages[t] = 0.0
    for group in range(integers[N_GROUPS]):
        _alone(_HEADER + _COLUMNS * group, integers, reals, b, scratch, rest, currents)
    i_at, r_at = integers[NETWORK_INTEGERS_AT], integers[NETWORK_REALS_AT]
    network = integers[i_at : i_at + integers[NETWORK_INTEGERS]]
    values = reals[r_at : r_at + integers[NETWORK_REALS]]
    invoke(integers[NETWORK_ADDRESS], (network, values, currents, voltages, rest))
    for group in range(integers[N_GROUPS]):
        _together(_HEADER + _COLUMNS * group, integers, reals, voltages, scratch, y, rest)


@compiled_part
def _alone(row, integers, reals, b, scratch, given, currents):
    """States and currents of a group of units at zero voltage."""
    size, units, states = integers[row], integers[row + UNITS], integers[row + STATES_AT]
    n_t, places = integers[N_TERMINALS], integers[row + PLACES_AT]
    for k in range(size * units):
        given[k] = b[integers[states + k]]
    for k in range(size + 2):
        total = scratch[places + k * units : places + (k + 1) * units]
        for u in range(units):
            total[u] = 0.0
        for j in range(size):
            at = integers[row + MATRIX_AT] + (k * size + j) * units
            factor, value = reals[at : at + units], given[j * units : (j + 1) * units]
            for u in range(units):
                total[u] += factor[u] * value[u]
    for u in range(units):
        terminal = integers[integers[row + TERMINALS_AT] + u]
        currents[terminal] += scratch[places + size * units + u]
        currents[n_t + terminal] += scratch[places + (size + 1) * units + u]


@compiled_part
def _together(row, integers, reals, voltages, scratch, y, seen):
    """Add what the voltages do to a group of units."""
    size, units, states = integers[row], integers[row + UNITS], integers[row + STATES_AT]
    n_t, places = integers[N_TERMINALS], integers[row + PLACES_AT]
    real, imag = seen[:units], seen[units : 2 * units]
    for u in range(units):
        terminal = integers[integers[row + TERMINALS_AT] + u]
        real[u], imag[u] = voltages[terminal], voltages[n_t + terminal]
    for k in range(size):
        at = integers[row + DRIVEN_AT] + 2 * k * units
        by_real, by_imag = reals[at : at + units], reals[at + units : at + 2 * units]
        alone = scratch[places + k * units : places + (k + 1) * units]
        for u in range(units):
            alone[u] += by_real[u] * real[u] + by_imag[u] * imag[u]
        for u in range(units):
            y[integers[states + k * units + u]] = alone[u]


@cache
def _compiled() -> Any:
    return compile_callback(_solve, SOLVER_SIGNATURE)
