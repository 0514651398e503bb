"""Boundary voltages that are held during each time step: the coupling as the paper has it.

Each area is then a network of its own. The other area is a fictitious generator behind every tie
line, whose voltage is that of the opposite boundary bus at the end of the previous step (Osipov & Sun,
section II.A). The held voltages are states without derivative; the network between machines and
fictitious generators is cut between the areas.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.linalg import splu

from gridfold.dynamics.layout import Group, Layout
from gridfold.dynamics.machines.held_voltage import HELD_VOLTAGE
from gridfold.dynamics.model import DetailedModel
from gridfold.dynamics.network import CompiledNetwork, build_equations, dense_network
from gridfold.dynamics.network.loads import with_loads
from gridfold.grid.case import UnitKey


def held_bus(bus: int) -> int:
    """Number of the fictitious bus that stands for a boundary bus in the other area."""
    return -bus


def held_group(buses: Sequence[int]) -> Group:
    """The fictitious generators of boundary buses."""
    units = [UnitKey(held_bus(bus), "held") for bus in buses]
    return HELD_VOLTAGE, units, np.zeros((len(HELD_VOLTAGE.parameter_rows), len(units)))


def held_network(
    model: DetailedModel, layout: Layout, study: Collection[int], buses: Sequence[int]
) -> CompiledNetwork:
    """The network in the state of `model`, cut between the `study` buses and the others.

    Parameters
    ----------
    model : DetailedModel
        The whole system.
    layout : Layout
        Its terminals are buses and fictitious buses of :func:`held_group`.
    study : collection of int
        Bus numbers of the study area.
    buses : sequence of int
        Boundary buses of both areas.

    """
    held = [layout.terminals.index(held_bus(bus)) for bus in buses]
    real = np.setdiff1d(np.arange(len(layout.terminals)), held)
    terminals = tuple(layout.terminals[k] for k in real)
    equations = build_equations(model.power_flow, model.injections, terminals, model.state)
    numbers = np.array([bus.number for bus in model.case.buses])
    inside = np.isin(numbers[equations.live], list(study))
    entries = equations.matrix.tocoo()
    crossing = inside[entries.row] != inside[entries.col]
    row_of = {int(bus): row for row, bus in enumerate(equations.live)}
    rows = [row_of.get(model.case.bus_index[bus], -1) for bus in buses]
    apart = entries.copy()
    apart.data = np.where(crossing, 0.0, entries.data)
    between = entries.copy()
    between.data = np.where(crossing, -entries.data, 0.0)
    at = equations.terminals
    injected = np.zeros((len(inside), len(layout.terminals)), dtype=np.complex128)
    injected[at[at >= 0], real[at >= 0]] = 1.0
    columns = between.tocsc()
    for k, row in zip(held, rows, strict=True):
        if row >= 0:
            injected[:, k] = columns[:, [row]].toarray()[:, 0]
    solution = splu(apart.tocsc()).solve(injected)
    impedance = np.zeros((len(layout.terminals),) * 2, dtype=np.complex128)
    impedance[held, held] = 1.0
    impedance[real[at >= 0]] = solution[at[at >= 0]]
    cut = dense_network(impedance)
    loads = model.injections.nonlinear
    if loads is None:
        return cut
    voltages = model.terminal_voltages(model.x0[None, :])[0]
    place = {bus: k for k, bus in enumerate(model.layout.terminals)}
    near = np.array([voltages[place[bus]] if bus in place else 1.0 for bus in layout.terminals])
    return with_loads(cut, loads, layout.terminals, near)


def boundary_voltages(
    model: DetailedModel, x: NDArray[np.float64], buses: Sequence[int]
) -> NDArray[np.float64]:
    """Voltages of `buses` at the state `x`: real parts, then imaginary parts, shape (2 n_buses,)."""
    voltages = model.bus_voltages(x[None, :])[0]
    wanted = voltages[[model.case.bus_index[bus] for bus in buses]]
    return np.concatenate([wanted.real, wanted.imag])
