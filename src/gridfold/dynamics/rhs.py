"""The compiled right-hand side of the detailed model.

One function serves every grid: it walks over a table of kernel calls. Its two data blocks are written
by :func:`pack_rhs` and read by :func:`_detailed_rhs`, both here, and nowhere else.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gridfold.dynamics.device import Kernel, compiled_kernel
from gridfold.dynamics.layout import Block, Layout
from gridfold.dynamics.network.backend import CompiledNetwork
from gridfold.grid.case import UnitKey
from gridfold.numerics.compiled import compile_callback, compiled_part, invoke, matrix_view
from gridfold.numerics.rhs import RHS_SIGNATURE, CompiledRhs
from gridfold.numerics.unit_matrix import unit_matrix

# Header of the integers.
(
    N_STATES,
    N_CONSTANTS,
    N_SIGNALS,
    N_TERMINALS,
    N_SOURCE_CALLS,
    N_OUTPUT_CALLS,
    N_DERIVATIVE_CALLS,
    N_SOURCES,
    SOURCES_AT,
    N_FROZEN,
    FROZEN_AT,
    NETWORK_ADDRESS,
    NETWORK_INTEGERS_AT,
    NETWORK_INTEGERS,
    NETWORK_REALS_AT,
    NETWORK_REALS,
    CONSTANTS_AT,
    INPUTS_AT,
    SCRATCH_AT,
    CALLS_AT,
) = range(20)
HEADER_SIZE = 20

# Columns of the table of kernel calls, which follows the header.
(
    ADDRESS,
    UNITS,
    STATE_ROWS,
    STATES_AT,
    INPUT_ROWS,
    INPUT_INDEX_AT,
    INPUT_RUNS_AT,
    PARAMETER_ROWS,
    PARAMETERS_AT,
    SIGNAL_ROWS,
    SIGNALS_AT,
) = range(11)
CALL_COLUMNS = 11


class Store:
    """A growing data block that tells where each part was put."""

    def __init__(self, dtype: type, start: int = 0):
        self.dtype = dtype
        self.parts: list[NDArray[Any]] = []
        self.size = start

    def add(self, values: Any) -> int:
        """Append `values`; return their position."""
        part: NDArray[Any] = np.asarray(values, dtype=self.dtype).ravel()
        self.parts.append(part)
        self.size += part.size
        return self.size - part.size

    def join(self) -> NDArray[Any]:
        """All parts in one array."""
        return np.concatenate([*self.parts, np.zeros(0, dtype=self.dtype)])


def pack_rhs(
    layout: Layout,
    constants: NDArray[np.float64],
    network: CompiledNetwork,
    units_out: Collection[UnitKey] = (),
) -> CompiledRhs:
    """Right-hand side of the model `layout` on `network`.

    Units that are out inject no current and keep their states.
    """
    data = pack_model(layout, constants, network, layout.blocks, units_out)
    return CompiledRhs(
        address=_compiled().address,
        integers=np.concatenate([data.header, data.integers.join()]),
        reals=data.reals.join(),
        work_size=data.work_size,
        n_states=layout.n_states,
    )


@dataclass(frozen=True)
class PackedModel:
    """The data that :func:`run_calls` and :func:`solve_voltages` read; more may be added behind.

    `header` holds the numbers named above and then the table of calls; it comes first. `parameters_at`
    are the positions of the blocks' parameters among the reals.
    """

    header: NDArray[np.int64]
    integers: Store
    reals: Store
    work_size: int
    parameters_at: tuple[int, ...]


def pack_model(
    layout: Layout,
    constants: NDArray[np.float64],
    network: CompiledNetwork,
    active: Sequence[Block],
    units_out: Collection[UnitKey] = (),
    header_size: int = HEADER_SIZE,
    compiled: Callable[[Kernel], Any] = compiled_kernel,
) -> PackedModel:
    """Pack a model of which only the `active` blocks have outputs and derivatives.

    `compiled` gives the compiled form of a kernel.
    """
    live_blocks = set(map(id, active))
    stages = [
        [
            (block, kernel)
            for block in layout.blocks
            if (kernel := pick(block)) is not None and (pick is _source or id(block) in live_blocks)
        ]
        for pick in (_source, _output, _derivative)
    ]
    n_calls = sum(len(stage) for stage in stages)
    integers = Store(np.int64, start=header_size + n_calls * CALL_COLUMNS)
    reals = Store(np.float64)
    data_at = {
        id(block): (
            integers.add(block.inputs),
            integers.add(_is_run(block.inputs)),
            reals.add(block.parameters),
        )
        for block in layout.blocks
    }
    calls = [
        _call_row(b, kernel, compiled(kernel).address, *data_at[id(b)])
        for stage in stages
        for b, kernel in stage
    ]
    live = [unit not in units_out for unit in layout.source_units]
    sources = layout.sources[live]
    frozen = frozen_states(layout, units_out)
    header = np.zeros(header_size, dtype=np.int64)
    header[N_STATES] = layout.n_states
    header[N_CONSTANTS] = len(constants)
    header[N_SIGNALS] = layout.n_signals
    header[N_TERMINALS] = len(layout.terminals)
    header[[N_SOURCE_CALLS, N_OUTPUT_CALLS, N_DERIVATIVE_CALLS]] = [len(s) for s in stages]
    header[[N_SOURCES, SOURCES_AT]] = len(sources), integers.add(sources)
    header[[N_FROZEN, FROZEN_AT]] = len(frozen), integers.add(frozen)
    header[NETWORK_ADDRESS] = network.address
    header[[NETWORK_INTEGERS_AT, NETWORK_INTEGERS]] = (
        integers.add(network.integers), network.integers.size,
    )  # fmt: skip
    header[[NETWORK_REALS_AT, NETWORK_REALS]] = reals.add(network.reals), network.reals.size
    header[CONSTANTS_AT] = reals.add(constants)
    header[INPUTS_AT] = layout.n_signals + 2 * len(layout.terminals)
    header[SCRATCH_AT] = header[INPUTS_AT] + max(
        (block.inputs.size for block in layout.blocks), default=0
    )
    header[CALLS_AT] = header_size
    table = np.array(calls, dtype=np.int64).ravel()
    work_size = int(header[SCRATCH_AT]) + network.scratch_size
    parameters_at = tuple(data_at[id(block)][2] for block in layout.blocks)
    return PackedModel(np.concatenate([header, table]), integers, reals, work_size, parameters_at)


def _source(block: Block) -> Kernel | None:
    return block.device.source


def _output(block: Block) -> Kernel | None:
    return block.device.output


def _derivative(block: Block) -> Kernel | None:
    return block.device.derivative


def _call_row(
    block: Block, kernel: Kernel, address: int, inputs_at: int, runs_at: int, parameters_at: int
) -> list[int]:
    row = [0] * CALL_COLUMNS
    row[ADDRESS] = address
    row[UNITS] = len(block.units)
    row[STATE_ROWS] = len(block.device.states)
    row[STATES_AT] = block.state_start
    row[INPUT_ROWS] = 0 if kernel is block.device.source else len(block.device.inputs)
    row[INPUT_INDEX_AT] = inputs_at
    row[INPUT_RUNS_AT] = runs_at
    row[PARAMETER_ROWS] = len(block.parameters)
    row[PARAMETERS_AT] = parameters_at
    row[SIGNAL_ROWS] = len(block.device.signal_rows)
    row[SIGNALS_AT] = block.signal_start
    return row


def _is_run(inputs: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Which rows of positions are consecutive, so that they can be copied as a block."""
    return np.asarray((np.diff(inputs, axis=1) == 1).all(axis=1))


def frozen_states(layout: Layout, units_out: Collection[UnitKey]) -> list[int]:
    """Positions of the states of units that are out."""
    if not units_out:
        return []
    return [
        int(index)
        for block in layout.blocks
        for unit, column in zip(block.units, block.state_index.T, strict=True)
        if unit in units_out
        for index in column
    ]


@compiled_part
def run_calls(first, count, integers, reals, work, x, dx):
    """Gather the inputs of each call and make it."""
    inputs_at = integers[INPUTS_AT]
    for c in range(first, first + count):
        at = integers[CALLS_AT] + c * CALL_COLUMNS
        units = integers[at + UNITS]
        index = integers[integers[at + INPUT_INDEX_AT] :]
        runs = integers[integers[at + INPUT_RUNS_AT] :]
        for row in range(integers[at + INPUT_ROWS]):
            slots, target = index[row * units :], work[inputs_at + row * units :]
            if runs[row]:
                values = work[slots[0] :]
                for k in range(units):
                    target[k] = values[k]
            else:
                for k in range(units):
                    target[k] = work[slots[k]]
        invoke(
            integers[at + ADDRESS],
            (
                unit_matrix(x, integers[at + STATES_AT], integers[at + STATE_ROWS], units),
                unit_matrix(work, inputs_at, integers[at + INPUT_ROWS], units),
                unit_matrix(
                    reals, integers[at + PARAMETERS_AT], integers[at + PARAMETER_ROWS], units
                ),
                unit_matrix(work, integers[at + SIGNALS_AT], integers[at + SIGNAL_ROWS], units),
                unit_matrix(dx, integers[at + STATES_AT], integers[at + STATE_ROWS], units),
            ),
        )


@compiled_part
def add_source_currents(integers, work):
    """Add up the Norton currents at the terminals."""
    n_terminals = integers[N_TERMINALS]
    real = work[integers[N_SIGNALS] :]
    imaginary = real[n_terminals:]
    for t in range(2 * n_terminals):
        real[t] = 0.0
    sources = matrix_view(integers, integers[SOURCES_AT], integers[N_SOURCES], 3)
    for s in range(sources.shape[0]):
        terminal = sources[s, 2]
        real[terminal] += work[sources[s, 0]]
        imaginary[terminal] += work[sources[s, 1]]


@compiled_part
def solve_network(integers, reals, work):
    """Solve the network for the terminal voltages at the currents that were added up."""
    n_terminals, n_signals = integers[N_TERMINALS], integers[N_SIGNALS]
    i_at, r_at = integers[NETWORK_INTEGERS_AT], integers[NETWORK_REALS_AT]
    invoke(
        integers[NETWORK_ADDRESS],
        (
            integers[i_at : i_at + integers[NETWORK_INTEGERS]],
            reals[r_at : r_at + integers[NETWORK_REALS]],
            work[n_signals : n_signals + 2 * n_terminals],
            work[n_signals - 2 * n_terminals : n_signals],
            work[integers[SCRATCH_AT] :],
        ),
    )


@compiled_part
def solve_voltages(integers, reals, work):
    """Add up the Norton currents at the terminals and solve the network for their voltages."""
    add_source_currents(integers, work)
    solve_network(integers, reals, work)


@compiled_part
def load_constants(integers, reals, work):
    """Put the constants behind the states in the signal vector."""
    constants, target = reals[integers[CONSTANTS_AT] :], work[integers[N_STATES] :]
    for i in range(integers[N_CONSTANTS]):
        target[i] = constants[i]


@compiled_part
def freeze(integers, dx):
    """Stop the states of units that are out."""
    for k in range(integers[N_FROZEN]):
        dx[integers[integers[FROZEN_AT] + k]] = 0.0


def _detailed_rhs(integers, reals, work, x, dx):
    for i in range(integers[N_STATES]):
        work[i] = x[i]
    load_constants(integers, reals, work)
    n_source, n_output = integers[N_SOURCE_CALLS], integers[N_OUTPUT_CALLS]
    run_calls(0, n_source, integers, reals, work, x, dx)
    solve_voltages(integers, reals, work)
    run_calls(n_source, n_output, integers, reals, work, x, dx)
    run_calls(n_source + n_output, integers[N_DERIVATIVE_CALLS], integers, reals, work, x, dx)
    freeze(integers, dx)


@cache
def _compiled() -> Any:
    return compile_callback(_detailed_rhs, RHS_SIGNATURE)
