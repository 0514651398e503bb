"""The Jacobian of the detailed model: complex steps through the kernels, analytic network.

The signals w = (states, constants, outputs, terminal voltages) depend on the states x stage by stage.
Each stage adds sparse rows dw = Wx dx + Wv dv, where v are the terminal voltages; with the sources'
rows the network gives dv = Z di, and the chain closes.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array, diags_array

from gridfold.dynamics.evaluate import derivative_stage, output_stage, source_stage
from gridfold.dynamics.layout import Block, Layout
from gridfold.grid.case import UnitKey
from gridfold.numerics.newton import complex_step_jacobian


@dataclass(frozen=True)
class Partials:
    """Partial derivatives of the devices at one state; the network is left open.

    Parameters
    ----------
    states : sparse array, shape (n_states, n_states)
        d(derivatives)/d(states) at constant terminal voltages.
    voltages : sparse array, shape (n_states, 2 n_terminals)
        d(derivatives)/d(terminal voltages), real parts before imaginary parts.
    currents : sparse array, shape (2 n_terminals, n_states)
        d(Norton currents into the terminals)/d(states).
    """

    states: csr_array
    voltages: csr_array
    currents: csr_array

    def close(self, network: NDArray[np.float64]) -> NDArray[np.float64]:
        """Jacobian with the voltages that `network`, (2 n_terminals, 2 n_terminals), gives."""
        coupling = self.voltages @ (network @ self.currents.toarray())
        return np.asarray(self.states.toarray() + coupling)


def model_partials(
    layout: Layout,
    units_out: Collection[UnitKey],
    x: NDArray[np.float64],
    signals: NDArray[np.float64],
) -> Partials:
    """Partial derivatives at the state `x` with its signal vector `signals`."""
    n, n_w, n_v = layout.n_states, layout.n_signals, 2 * len(layout.terminals)
    chain = _seed(n, n_w, n_v)
    for block in layout.blocks:
        chain = chain + _stage_rows(block, "source", n_w, x, signals) @ chain
    currents = csr_array(_source_currents(layout, units_out) @ chain[:, :n])
    for block in layout.blocks:
        chain = chain + _stage_rows(block, "output", n_w, x, signals) @ chain
    derivative = csr_array((n, n_w))
    for block in layout.blocks:
        derivative = derivative + _stage_rows(block, "derivative", n_w, x, signals)[:n]
    total = csr_array(derivative @ chain)
    moving = np.ones(n)
    for block in layout.blocks:
        for unit, column in zip(block.units, block.state_index.T, strict=True):
            if unit in units_out:
                moving[column] = 0.0
    total = csr_array(diags_array(moving) @ total)
    return Partials(csr_array(total[:, :n]), csr_array(total[:, n:]), currents)


def _seed(n: int, n_w: int, n_v: int) -> csr_array:
    """dw/d(x, v) before any stage: states are themselves, and so are the voltages."""
    rows = np.concatenate([np.arange(n), np.arange(n_w - n_v, n_w)])
    return csr_array((np.ones(n + n_v), (rows, np.arange(n + n_v))), shape=(n_w, n + n_v))


def _source_currents(layout: Layout, units_out: Collection[UnitKey]) -> csr_array:
    """Which signals add up to the currents at the terminals, shape (2 n_terminals, n_signals)."""
    live = [unit not in units_out for unit in layout.source_units]
    real, imag, terminal = layout.sources[live].T
    n_t = len(layout.terminals)
    rows = np.concatenate([terminal, n_t + terminal])
    columns = np.concatenate([real, imag])
    return csr_array((np.ones(len(rows)), (rows, columns)), shape=(2 * n_t, layout.n_signals))


def _stage_rows(
    block: Block, stage: str, n_w: int, x: NDArray[np.float64], signals: NDArray[np.float64]
) -> csr_array:
    """Partial derivatives of a stage of one block, placed at its rows of the signal vector."""
    device = block.device
    n_x, n_u, n_s = len(device.states), len(device.inputs), len(device.sources)
    columns = np.concatenate([block.state_index, block.inputs, block.signal_index])
    point = np.concatenate(
        [x[block.state_index], signals[block.inputs], signals[block.signal_index]]
    )
    parameters = block.parameters.astype(np.complex128)

    def evaluate(z: NDArray[np.complex128]) -> NDArray[np.complex128]:
        states, inputs, y = z[:n_x], z[n_x : n_x + n_u], z[n_x + n_u :]
        if stage == "source":
            return source_stage(device, states, parameters)[:n_s]
        if stage == "output":
            return output_stage(device, states, inputs, parameters, y)[n_s:]
        return derivative_stage(device, states, inputs, parameters, y)

    local = complex_step_jacobian(evaluate, point)
    first = {"source": 0, "output": n_s, "derivative": 0}[stage]
    index = block.state_index if stage == "derivative" else block.signal_index
    rows = index[first : first + len(local)]
    if local.size == 0:
        return csr_array((n_w, n_w))
    shape = local.shape
    row_of = np.broadcast_to(rows[:, None, :], shape).ravel()
    column_of = np.broadcast_to(columns[None, :, :], shape).ravel()
    return coo_array((local.ravel(), (row_of, column_of)), shape=(n_w, n_w)).tocsr()
