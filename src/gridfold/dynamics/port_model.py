"""A model of which some units are exact and all others are a linear area behind ports."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array

from gridfold.dynamics.layout import Group, Layout, build_layout, frame_states
from gridfold.dynamics.model import DetailedModel
from gridfold.dynamics.network.equations import NetworkEquations
from gridfold.dynamics.port_network import load_buses, port_network
from gridfold.dynamics.port_rhs import LinearPorts, pack_port_rhs
from gridfold.grid.case import UnitKey
from gridfold.numerics.rhs import CompiledRhs
from gridfold.systems.statemap import StateMap


@dataclass(frozen=True)
class PortCoordinates:
    """The way between the states of the whole model and v = (exact states, z).

    Parameters
    ----------
    exact_index, area_index : ndarray of int
        Positions of the exact states and of the area's in the whole model's state vector.
    states : StateMap
        x = x0 + T~ z of the area's states.
    """

    exact_index: NDArray[np.int64]
    area_index: NDArray[np.int64]
    states: StateMap

    def lift(self, v: NDArray[np.float64]) -> NDArray[np.float64]:
        """States of the whole model, (..., n_states), from v, (..., n)."""
        n_exact = len(self.exact_index)
        x = np.empty((*v.shape[:-1], n_exact + len(self.area_index)))
        x[..., self.exact_index] = v[..., :n_exact]
        x[..., self.area_index] = self.states.lift(v[..., n_exact:])
        return x

    def lift_rows(self, v: NDArray[np.float64], index: NDArray[np.int64]) -> NDArray[np.float64]:
        """The states at the positions `index` alone, (..., len(index)), from v, (..., n)."""
        n_exact, at, linear = self._places(index)
        x = np.empty((*v.shape[:-1], len(index)))
        x[..., ~linear] = v[..., at[~linear]]
        x[..., linear] = self.states.lift_rows(v[..., n_exact:], at[linear] - n_exact)
        return x

    def affine_rows(self, index: NDArray[np.int64]) -> tuple[NDArray[np.float64], csr_array]:
        """The states at the positions `index` (m,) as origin + slopes @ v: shapes (m,) and (m, n)."""
        n_exact, at, linear = self._places(index)
        exact, area, r = np.flatnonzero(~linear), np.flatnonzero(linear), self.states.order
        origin = np.zeros(len(index))
        origin[area] = self.states.reference[at[area] - n_exact]
        rows = np.concatenate([exact, np.repeat(area, r)])
        columns = np.concatenate([at[exact], np.tile(n_exact + np.arange(r), len(area))])
        slopes = self.states.lift_matrix[at[area] - n_exact]
        values = np.concatenate([np.ones(len(exact)), slopes.ravel()])
        shape = len(index), n_exact + r
        return origin, csr_array(coo_array((values, (rows, columns)), shape=shape))

    def _places(self, index: NDArray[np.int64]) -> tuple[int, NDArray[np.int64], NDArray[np.bool_]]:
        """Number of exact states; places of states among these and the area's; which are the area's."""
        n_exact = len(self.exact_index)
        place = np.empty(n_exact + len(self.area_index), dtype=np.int64)
        place[self.exact_index] = np.arange(n_exact)
        place[self.area_index] = n_exact + np.arange(len(self.area_index))
        return n_exact, place[index], place[index] >= n_exact

    def restrict(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """The state v nearest to the whole model's state x: z = T (x - x0)."""
        return np.concatenate([x[self.exact_index], self.states.restrict(x[self.area_index])])


@dataclass(frozen=True)
class PortParts:
    """What the right-hand side of a port model is made of.

    Parameters
    ----------
    model : DetailedModel
        The whole system in the network state of the port model.
    layout : Layout
        The exact units, with ports among its terminals.
    constants : ndarray
        Values of its constants.
    ports : ndarray of int, shape (p,)
        The terminal of each port.
    area : LinearPorts
        The linear area as its ports know it.
    """

    model: DetailedModel
    layout: Layout
    constants: NDArray[np.float64]
    ports: NDArray[np.int64]
    area: LinearPorts

    @property
    def equations(self) -> NetworkEquations:
        """The network as seen from the terminals."""
        index = self.model.case.bus_index
        return self.model.equations.seen_from([index[bus] for bus in self.layout.terminals])


@dataclass(frozen=True)
class PortModel(PortCoordinates):
    """A system v = (exact states, z).

    Parameters
    ----------
    compiled : CompiledRhs
        The right-hand side.
    state_names : tuple of str
        Names of v.
    parts : PortParts
        What the right-hand side is made of.
    """

    compiled: CompiledRhs = field(repr=False)
    state_names: tuple[str, ...] = field(repr=False)
    parts: PortParts = field(repr=False)


def port_coordinates(
    model: DetailedModel,
    units: Collection[UnitKey],
    area_index: NDArray[np.int64],
    states: StateMap,
) -> PortCoordinates:
    """The coordinates of :func:`build_port_model`, without the model."""
    _, index = _exact_groups(model, set(units), set(area_index.tolist()))
    return PortCoordinates(index, area_index, states)


def build_port_model(
    model: DetailedModel,
    ports: Sequence[int],
    study: Collection[int],
    units: Collection[UnitKey],
    area: LinearPorts,
    area_index: NDArray[np.int64],
    states: StateMap,
    origin: NDArray[np.float64],
) -> PortModel:
    """Compile a model whose units are exact, but for those of the linear area.

    Parameters
    ----------
    model : DetailedModel
        The whole system in the network state wanted.
    ports, study : collections of int
        Bus numbers of the ports and of the study area, where loads stay as they are.
    units : collection of UnitKey
        The units of the linear area.
    area : LinearPorts
        The linear area as its ports know it.
    area_index : ndarray of int, shape (n,)
        Positions of its states in the whole model's state vector.
    states : StateMap
        The way between these states and the area's coordinates.
    origin : ndarray, shape (n_states,)
        The operating point.
    """
    groups, index = _exact_groups(model, set(units), set(area_index.tolist()))
    speeds = [(unit, "speed") for unit in area.movers.units] if area.movers is not None else []
    layout = build_layout(groups, [*ports, *load_buses(model, study)], speeds)
    values = dict(zip(model.layout.constant_names, model.constants, strict=True))
    values |= dict.fromkeys(speeds, 1.0)
    found = port_network(model, layout.terminals, study, origin)
    out = model.state.units_out
    angles = frame_states(layout.state_names, out).tolist()
    constants = np.array([values[name] for name in layout.constant_names])
    places = np.array([layout.terminals.index(bus) for bus in ports], dtype=np.int64)
    compiled = pack_port_rhs(
        layout,
        constants,
        found.network,
        places,
        area,
        (angles, origin[index[angles]]) if found.turns else ((), ()),
        out,
    )
    names = (*layout.state_names, *(f"z:{k + 1}" for k in range(area.order)))
    parts = PortParts(model, layout, constants, places, area)
    return PortModel(index, area_index, states, compiled, names, parts)


def _exact_groups(
    model: DetailedModel, linear: set[UnitKey], area: set[int]
) -> tuple[list[Group], NDArray[np.int64]]:
    """Devices without part in the area, and their states in order of their layout.

    These are all devices of units that are not linear, and others with states none of which is in the
    area.
    """
    groups: list[Group] = []
    index = [np.zeros(0, dtype=np.int64)]
    for block in model.layout.blocks:
        columns = [
            k
            for k, (unit, states) in enumerate(
                zip(block.units, block.state_index.T.tolist(), strict=True)
            )
            if unit not in linear or (states and not area.intersection(states))
        ]
        if columns:
            units = [block.units[k] for k in columns]
            groups.append((block.device, units, np.ascontiguousarray(block.parameters[:, columns])))
            index.append(block.state_index[:, columns].ravel())
    return groups, np.concatenate(index)
