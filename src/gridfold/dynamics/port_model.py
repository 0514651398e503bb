"""A model of which some units are exact and all others are a linear area behind ports."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from gridfold.dynamics.layout import Group, build_layout
from gridfold.dynamics.model import DetailedModel
from gridfold.dynamics.network import build_equations, compile_with_loads
from gridfold.dynamics.port_rhs import LinearPorts, pack_port_rhs
from gridfold.numerics.rhs import CompiledRhs
from gridfold.systems.statemap import StateMap


@dataclass(frozen=True)
class PortModel:
    """A system v = (exact states, z).

    Parameters
    ----------
    exact_index, area_index : ndarray of int
        Positions of the exact states and of the area's in the whole model's state vector.
    states : StateMap
        x = x0 + T~ z of the area's states.
    compiled : CompiledRhs
        The right-hand side.
    state_names : tuple of str
        Names of v.
    """

    exact_index: NDArray[np.int64]
    area_index: NDArray[np.int64]
    states: StateMap
    compiled: CompiledRhs = field(repr=False)
    state_names: tuple[str, ...] = field(repr=False)

    def lift(self, v: NDArray[np.float64]) -> NDArray[np.float64]:
        """States of the whole model, (..., n_states), from v, (..., n)."""
        n_exact = len(self.exact_index)
        x = np.empty((*v.shape[:-1], n_exact + len(self.area_index)))
        x[..., self.exact_index] = v[..., :n_exact]
        x[..., self.area_index] = self.states.lift(v[..., n_exact:])
        return x

    def lift_rows(self, v: NDArray[np.float64], index: NDArray[np.int64]) -> NDArray[np.float64]:
        """The states at the positions `index` alone, (..., len(index)), from v, (..., n)."""
        n_exact = len(self.exact_index)
        place = np.empty(n_exact + len(self.area_index), dtype=np.int64)
        place[self.exact_index] = np.arange(n_exact)
        place[self.area_index] = n_exact + np.arange(len(self.area_index))
        at = place[index]
        linear = at >= n_exact
        x = np.empty((*v.shape[:-1], len(index)))
        x[..., ~linear] = v[..., at[~linear]]
        x[..., linear] = self.states.lift_rows(v[..., n_exact:], at[linear] - n_exact)
        return x

    def restrict(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """The state v nearest to the whole model's state x: z = T (x - x0)."""
        return np.concatenate([x[self.exact_index], self.states.restrict(x[self.area_index])])


def build_port_model(
    model: DetailedModel,
    ports: Sequence[int],
    area: LinearPorts,
    area_index: NDArray[np.int64],
    states: StateMap,
) -> PortModel:
    """Compile a model whose units are exact, but for those of the linear area.

    Parameters
    ----------
    model : DetailedModel
        The whole system in the network state wanted.
    ports : sequence of int
        Bus numbers of the ports.
    area : LinearPorts
        The linear area as its ports know it.
    area_index : ndarray of int, shape (n,)
        Positions of its states in the whole model's state vector.
    states : StateMap
        The way between these states and the area's coordinates.
    """
    groups, index = _exact_groups(model, area_index)
    layout = build_layout(groups, ports)
    values = dict(zip(model.layout.constant_names, model.constants, strict=True))
    equations = build_equations(model.power_flow, model.injections, layout.terminals, model.state)
    network = compile_with_loads(
        equations, model.backend, layout.terminals, model.injections, model.power_flow
    )
    at = np.array([layout.terminals.index(bus) for bus in ports], dtype=np.int64)
    compiled = pack_port_rhs(
        layout,
        np.array([values[name] for name in layout.constant_names]),
        network,
        at,
        area,
        model.state.units_out,
    )
    names = (*layout.state_names, *(f"z:{k + 1}" for k in range(area.order)))
    return PortModel(index, area_index, states, compiled, names)


def _exact_groups(
    model: DetailedModel, area_index: NDArray[np.int64]
) -> tuple[list[Group], NDArray[np.int64]]:
    """Units without states in the area by device, and their states in order of their layout."""
    linear, groups, index = set(area_index.tolist()), [], [np.zeros(0, dtype=np.int64)]
    behind = {
        unit
        for block in model.layout.blocks
        for unit, column in zip(block.units, block.state_index.T, strict=True)
        if linear.intersection(column.tolist())
    }
    for block in model.layout.blocks:
        columns = [k for k, unit in enumerate(block.units) if unit not in behind]
        if columns:
            units = [block.units[k] for k in columns]
            groups.append((block.device, units, np.ascontiguousarray(block.parameters[:, columns])))
            index.append(block.state_index[:, columns].ravel())
    return groups, np.concatenate(index)
