"""Partial derivatives of the devices unit by unit, all units at once.

The states of a unit depend on other units only through the voltage at its terminal. A complex step in
one state of every unit, or in every terminal's voltage, therefore gives one column of the Jacobian of
each unit: as many evaluations as the largest unit has states, and two for the voltages.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gridfold.dynamics.device import compiled_kernel
from gridfold.dynamics.layout import Layout
from gridfold.dynamics.rhs import (
    CALL_COLUMNS,
    CALLS_AT,
    N_DERIVATIVE_CALLS,
    N_OUTPUT_CALLS,
    N_SOURCE_CALLS,
    freeze,
    load_constants,
    run_calls,
)
from gridfold.grid.case import UnitKey
from gridfold.numerics.compiled import FAST, jit
from gridfold.numerics.newton import COMPLEX_STEP
from gridfold.numerics.rhs import CompiledRhs


@dataclass(frozen=True)
class UnitPlaces:
    """Where the states of each unit are.

    Parameters
    ----------
    unit, row : ndarrays of int, shape (n_states,)
        Unit of each state, and its row among the states of that unit.
    terminal, sizes : ndarrays of int, shape (n_units,)
        Terminal and number of states of each unit that has any.
    sources : ndarray of int, shape (n_sources, 3)
        Positions of the real and the imaginary Norton current in the signal vector, and the unit.
    """

    unit: NDArray[np.int64]
    row: NDArray[np.int64]
    terminal: NDArray[np.int64]
    sizes: NDArray[np.int64]
    sources: NDArray[np.int64]

    @property
    def largest(self) -> int:
        """States of the largest unit."""
        return int(self.sizes.max(initial=0))

    @cached_property
    def groups(self) -> tuple[tuple[NDArray[np.int64], NDArray[np.int64]], ...]:
        """Units of equal size (n_units,), and the positions of their states (size, n_units)."""
        return tuple(self._groups())

    def _groups(self) -> Iterator[tuple[NDArray[np.int64], NDArray[np.int64]]]:
        order = np.lexsort((self.row, self.unit))
        starts = np.concatenate([[0], np.cumsum(self.sizes)[:-1]]).astype(np.int64)
        for size in np.unique(self.sizes):
            units = np.flatnonzero(self.sizes == size)
            yield units, order[starts[units] + np.arange(size)[:, None]]


def unit_places(layout: Layout, units_out: Collection[UnitKey]) -> UnitPlaces:
    """Places of the states of a layout."""
    members: dict[UnitKey, list[int]] = {unit: [] for unit in layout.source_units}
    for block in layout.blocks:
        for unit, column in zip(block.units, block.state_index.T, strict=True):
            members[unit] += column.tolist()
    members = {unit: states for unit, states in members.items() if states}
    unit_of, row_of = np.zeros((2, layout.n_states), dtype=np.int64)
    for number, states in enumerate(members.values()):
        unit_of[states], row_of[states] = number, np.arange(len(states))
    number_of = {unit: number for number, unit in enumerate(members)}
    at = {bus: k for k, bus in enumerate(layout.terminals)}
    sources = [
        (real, imag, number_of[unit])
        for (real, imag, _), unit in zip(layout.sources, layout.source_units, strict=True)
        if unit in number_of and unit not in units_out
    ]
    return UnitPlaces(
        unit_of,
        row_of,
        np.array([at[unit.bus] for unit in members], dtype=np.int64),
        np.array([len(states) for states in members.values()], dtype=np.int64),
        np.array(sources, dtype=np.int64).reshape(-1, 3),
    )


@dataclass(frozen=True)
class UnitSlopes:
    """Partial derivatives of every unit, filled up with zeros to the largest.

    Parameters
    ----------
    states : ndarray, shape (n_units, largest, largest)
        d(derivatives)/d(states) at constant voltage.
    voltages : ndarray, shape (n_units, largest, 2)
        d(derivatives)/d(real, imaginary voltage).
    currents : ndarray, shape (n_units, 2, largest)
        d(real, imaginary Norton current)/d(states).
    """

    states: NDArray[np.float64]
    voltages: NDArray[np.float64]
    currents: NDArray[np.float64]


class UnitKernels:
    """The devices of a packed right-hand side on complex numbers, without its network."""

    def __init__(self, layout: Layout, places: UnitPlaces, rhs: CompiledRhs):
        self.places, self.voltage_start = places, layout.voltage_start
        self.integers = rhs.integers.copy()
        self.reals = rhs.reals.astype(np.complex128)
        self.work_size = rhs.work_size
        complex_address = {
            compiled_kernel(kernel).address: compiled_kernel(kernel, complex_numbers=True).address
            for block in layout.blocks
            for kernel in (block.device.source, block.device.output, block.device.derivative)
            if kernel is not None
        }
        stages = [N_SOURCE_CALLS, N_OUTPUT_CALLS, N_DERIVATIVE_CALLS]
        first = int(self.integers[CALLS_AT])
        for call in range(int(self.integers[stages].sum())):
            at = first + call * CALL_COLUMNS
            self.integers[at] = complex_address[int(self.integers[at])]

    def slopes(self, x: NDArray[np.float64], voltages: NDArray[np.float64]) -> UnitSlopes:
        """Derivatives at the state `x` and terminal voltages of shape (2 n_terminals,)."""
        places, n = self.places, self.places.largest
        shape = len(places.sizes), n
        a, b, c = np.zeros((*shape, n)), np.zeros((*shape, 2)), np.zeros((shape[0], 2, n))
        state, dx = np.zeros((2, len(x)), dtype=np.complex128)
        work = np.zeros(self.work_size, dtype=np.complex128)
        _slopes(
            self.integers, self.reals, work, state, dx, self.voltage_start,
            places.unit, places.row, places.sources, x, voltages, a, b, c,
        )  # fmt: skip
        return UnitSlopes(a, b, c)


@jit(nogil=True, error_model="numpy", fastmath=FAST)
def _slopes(
    integers, reals, work, state, dx, voltage_start,
    unit_of, row_of, sources, x, voltages, a, b, c,
):  # fmt: skip
    n_source, n_output = integers[N_SOURCE_CALLS], integers[N_OUTPUT_CALLS]
    n, largest, half = len(x), a.shape[1], len(voltages) // 2
    step = COMPLEX_STEP * 1j
    load_constants(integers, reals, work)
    for column in range(largest + 2):
        for i in range(n):
            state[i] = x[i] + (step if row_of[i] == column else 0.0)
            work[i] = state[i]
        for t in range(2 * half):
            stepped = t // half == column - largest
            work[voltage_start + t] = voltages[t] + (step if stepped else 0.0)
        run_calls(0, n_source, integers, reals, work, state, dx)
        run_calls(n_source, n_output, integers, reals, work, state, dx)
        run_calls(
            n_source + n_output, integers[N_DERIVATIVE_CALLS], integers, reals, work, state, dx
        )
        freeze(integers, dx)
        if column >= largest:
            for i in range(n):
                b[unit_of[i], row_of[i], column - largest] = dx[i].imag / COMPLEX_STEP
            continue
        for i in range(n):
            a[unit_of[i], row_of[i], column] = dx[i].imag / COMPLEX_STEP
        for s in range(len(sources)):
            for part in range(2):
                slope = work[sources[s, part]].imag / COMPLEX_STEP
                c[sources[s, 2], part, column] = slope
