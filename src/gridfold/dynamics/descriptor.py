"""The Jacobian of a whole grid by its sparse blocks: devices, and the network that joins them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csc_array

from gridfold.dynamics.model import DetailedModel
from gridfold.dynamics.network.real_sparse import real_matrix
from gridfold.systems.descriptor import DescriptorSystem


def grid_descriptor(model: DetailedModel, x: NDArray[np.float64]) -> DescriptorSystem:
    """The whole system linearized at the state `x`, with the node voltages as algebraic unknowns.

    These are real, then imaginary parts over the live nodes of the network equations, and the
    algebraic equations are the sums of currents at them: devices less network, with loads at their
    slopes. There are no inputs or outputs. The states of units that are out stand still.
    """
    partials = model.partials(x)
    at = _terminals_at_nodes(model)
    none = np.zeros((model.n_states, 0))
    return DescriptorSystem(
        a11=csc_array(partials.states),
        a12=csc_array(partials.voltages @ at),
        a21=csc_array(at.T @ partials.currents),
        a22=csc_array(-_network_with_load_slopes(model, x)),
        b1=none,
        b2=np.zeros((at.shape[1], 0)),
        c=none.T,
        state_names=model.state_names,
    )


def node_currents(model: DetailedModel, x: NDArray[np.float64]) -> csc_array:
    """Norton currents of the machines into the nodes, real, then imaginary parts, (2 n_live, k).

    One column for each of the k machines of ``model.layout.source_units``; zero for units out.
    """
    signals, n_live = model.signals(x[None, :])[0], len(model.equations.live)
    real, imag, terminal = model.layout.sources.T
    node = model.equations.terminals[terminal]
    out = model.state.units_out
    live = (node >= 0) & [unit not in out for unit in model.layout.source_units]
    rows, columns = np.r_[node[live], n_live + node[live]], np.tile(np.flatnonzero(live), 2)
    values = np.r_[signals[real[live]], signals[imag[live]]]
    return csc_array(coo_array((values, (rows, columns)), shape=(2 * n_live, len(real))))


def _terminals_at_nodes(model: DetailedModel) -> csc_array:
    """Ones where a terminal (row) is a node (column), both in real form."""
    equations = model.equations
    n, k = len(equations.terminals), len(equations.live)
    live = np.flatnonzero(equations.terminals >= 0)
    node = equations.terminals[live]
    both = np.r_[live, n + live], np.r_[node, k + node]
    return csc_array(coo_array((np.ones(2 * len(live)), both), shape=(2 * n, 2 * k)))


def _network_with_load_slopes(model: DetailedModel, x: NDArray[np.float64]) -> csc_array:
    """Admittances between the nodes in real form, less the slopes of loads at the state `x`."""
    loads = model.injections.nonlinear
    if loads is None:
        return real_matrix(model.equations, np.zeros((0, 2, 2)), np.zeros(0, dtype=np.int64))
    places = loads.places(model.layout.terminals)
    slopes = loads.slopes(model.terminal_voltages(x[None, :])[0][places])
    return real_matrix(model.equations, slopes, model.equations.terminals[places])
