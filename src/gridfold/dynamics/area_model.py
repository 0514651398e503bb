"""A model of which some units are exact, some corrected, and the rest linear and perhaps reduced."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from gridfold.dynamics.area_rhs import LinearPart, pack_area_rhs
from gridfold.dynamics.held_boundary import boundary_voltages, held_bus, held_group, held_network
from gridfold.dynamics.layout import Group, Layout, build_layout, frame_states
from gridfold.dynamics.model import DetailedModel
from gridfold.dynamics.network import CompiledNetwork, build_equations, compile_with_loads
from gridfold.grid.case import UnitKey
from gridfold.numerics.checked_arrays import (
    ANY_LENGTH,
    require_partners,
    require_positions,
    require_shapes,
)
from gridfold.numerics.rhs import CompiledRhs
from gridfold.systems.linear import LinearSystem
from gridfold.systems.statemap import StateMap

#: Random shift of the state by which functions are told to be linear, and what counts as a change.
_PROBE, _CHANGE = 0.1, 1e-9
#: Distances in per unit (of angles: radians) at which the functions of kept units are probed.
_FAR_PROBES = (0.1, 0.3, 1.0, 2.0, 5.0)


class BoundaryCoupling(Enum):
    """How the areas know each other's boundary voltages.

    EXACT: both networks are solved together in every evaluation. LAGGED: as in the paper, each takes
    the other's voltages of the previous step.
    """

    EXACT = "exact"
    LAGGED = "lagged"


@dataclass(frozen=True)
class HeldBoundary:
    """Buses (numbers) of the study area, and boundary buses of both areas whose voltage is held."""

    study: frozenset[int]
    buses: tuple[int, ...]


@dataclass(frozen=True)
class LinearArea:
    """The linear part of an area model, about an operating point.

    Parameters
    ----------
    index : ndarray of int, shape (n,)
        Positions of its states in the whole model's state vector.
    states : StateMap
        x = x0 + T~ z of these states.
    full : LinearSystem
        The linearization before reduction: A (n, n) and B (n, n_inputs).
    a : ndarray, shape (r, r), or (2, r) with `partners`
        A in the coordinates z, or diagonal and coupling of its modal form.
    partners : ndarray of int, shape (r,), or None
        Partner of each coordinate of a modal form.
    b : ndarray, shape (r, n_inputs)
        B in the coordinates z.
    input_reference : ndarray, shape (n_inputs,)
        The inputs at the operating point.
    drift : ndarray, shape (n,)
        Derivatives at the operating point: 0, but for angles that turn with a new frequency.
    """

    index: NDArray[np.int64]
    states: StateMap
    full: LinearSystem
    a: NDArray[np.float64]
    partners: NDArray[np.int64] | None
    b: NDArray[np.float64]
    input_reference: NDArray[np.float64]
    drift: NDArray[np.float64]

    def __post_init__(self) -> None:
        n, (r, m) = len(self.index), np.shape(self.b)
        a = (r, r) if self.partners is None else (2, r)
        shapes = {"index": (n,), "a": a, "input_reference": (m,), "drift": (n,)}
        require_shapes("a linear area", self, shapes)
        require_shapes("its map", self.states, {"reference": (n,), "lift_matrix": (n, r)})
        require_shapes("its linearization", self.full, {"a": (n, n), "b": (n, m)})
        require_positions("states of a linear area", self.index, ANY_LENGTH)
        if self.partners is not None:
            require_partners("partners in a linear area", self.partners, r)


@dataclass(frozen=True)
class AreaModel:
    """A system of exact and linear states, v = (exact states, held voltages, z).

    Parameters
    ----------
    exact_index : ndarray of int
        Positions of the exact states in the whole model's state vector.
    area : LinearArea
        The linear part.
    compiled : CompiledRhs
        The right-hand side.
    state_names : tuple of str
        Names of v.
    nonlinear_functions : int
        How many functions of linear units are evaluated as they are.
    held : tuple, optional
        The whole system and the boundary buses whose voltages are held during a step.
    """

    exact_index: NDArray[np.int64]
    area: LinearArea
    compiled: CompiledRhs = field(repr=False)
    state_names: tuple[str, ...] = field(repr=False)
    nonlinear_functions: int = 0
    held: tuple[DetailedModel, tuple[int, ...]] | None = None

    @property
    def n_states(self) -> int:
        """Length of v."""
        return self.compiled.n_states

    def lift(self, v: NDArray[np.float64]) -> NDArray[np.float64]:
        """States of the whole model, (..., n_states), from v, (..., n)."""
        n_exact = len(self.exact_index)
        x = np.empty((*v.shape[:-1], n_exact + len(self.area.index)))
        x[..., self.exact_index] = v[..., :n_exact]
        n_held = 0 if self.held is None else 2 * len(self.held[1])
        x[..., self.area.index] = self.area.states.lift(v[..., n_exact + n_held :])
        return x

    def lift_rows(self, v: NDArray[np.float64], index: NDArray[np.int64]) -> NDArray[np.float64]:
        """The states at the positions `index` alone, (..., len(index)), from v, (..., n)."""
        n_exact, n_z = len(self.exact_index), self.area.states.lift_matrix.shape[1]
        place = np.empty(n_exact + len(self.area.index), dtype=np.int64)
        place[self.exact_index] = np.arange(n_exact)
        place[self.area.index] = n_exact + np.arange(len(self.area.index))
        at = place[index]
        linear = at >= n_exact
        x = np.empty((*v.shape[:-1], len(index)))
        x[..., ~linear] = v[..., at[~linear]]
        z = v[..., v.shape[-1] - n_z :]
        x[..., linear] = self.area.states.lift_rows(z, at[linear] - n_exact)
        return x

    def restrict(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """The state v nearest to the whole model's state x: z = T (x - x0)."""
        z = self.area.states.restrict(x[self.area.index])
        held = np.zeros(0)
        if self.held is not None:
            model, buses = self.held
            held = boundary_voltages(model, x, buses)
        return np.concatenate([x[self.exact_index], held, z])


def build_area_model(
    model: DetailedModel,
    area: LinearArea,
    corrected: Collection[UnitKey] = (),
    ports: Sequence[int] = (),
    input_states: Sequence[int] = (),
    held: HeldBoundary | None = None,
    nonlinear: NDArray[np.bool_] | None = None,
) -> AreaModel:
    """Compile a model whose units outside `area` are exact.

    Parameters
    ----------
    model : DetailedModel
        The whole system in the network state wanted.
    area : LinearArea
        All states of the linear units.
    corrected : collection of UnitKey
        Units of the area whose nonlinear functions are put back.
    ports : sequence of int
        Boundary buses whose voltages are inputs.
    input_states : sequence of int
        Positions of exact states that are inputs, after the ports.
    held : HeldBoundary, optional
        Where voltages are held during a step; everything is solved together by default.
    nonlinear : ndarray of bool, shape (n_states,), optional
        From :func:`nonlinear_functions`, which does not depend on the network state.
    """
    require_positions("states of the linear area", area.index, model.n_states)
    exact_units, linear_units = _divide(model, set(area.index.tolist()))
    kept = [unit for unit in linear_units if unit in set(corrected)]
    rest = [unit for unit in linear_units if unit not in set(corrected)]
    groups = _split(model.layout, (exact_units, kept, rest))
    loads = model.injections.nonlinear
    load_buses = () if loads is None else loads.buses
    if held is None:
        layout = build_layout(groups, [*ports, *load_buses])
    else:
        layout = build_layout([*groups, held_group(held.buses)], [*held.buses, *load_buses])
        ports = [held_bus(bus) for bus in ports]
    slot = {name: k for k, name in enumerate(layout.state_names)}
    exact_index = np.setdiff1d(np.arange(model.n_states), area.index)
    own = _states_of(model, kept)
    read = _read_states(model)
    formed = [k for k in area.index.tolist() if k in own or k in read]
    rows: list[int] = []
    if kept:
        functions = nonlinear_functions(model) if nonlinear is None else nonlinear
        rows = [k for k in _nonlinear_rows(model, kept, functions) if k in own]
    place = {state: row for row, state in enumerate(area.index.tolist())}
    formed_rows, row_index = [place[k] for k in formed], [place[k] for k in rows]

    def slots(states: Iterable[int]) -> NDArray[np.int64]:
        return np.array([slot[model.state_names[k]] for k in states], dtype=np.int64)

    linear = LinearPart(
        a=area.a,
        partners=area.partners,
        b=area.b,
        offset=area.states.restrict_matrix @ area.drift,
        formed=slots(formed),
        reference=area.states.reference[formed_rows],
        lift=area.states.lift_matrix[formed_rows],
        input_reference=area.input_reference,
        ports=np.array([layout.terminals.index(bus) for bus in ports], dtype=np.int64),
        input_states=slots(input_states),
        corrected=slots(rows),
        f=area.full.a[row_index] @ area.states.lift_matrix,
        g=area.full.b[row_index],
        t=area.states.restrict_matrix[:, row_index],
    )
    angle_states = exact_index[frame_states([model.state_names[k] for k in exact_index])]
    held_names, held_table = _held_places(layout, held, len(exact_index))
    held_slots = np.array([slot[name] for name in held_names], dtype=np.int64)
    passive = set(rest)
    compiled = pack_area_rhs(
        layout,
        _constants(model, layout),
        _network(model, layout, held),
        [block for block in layout.blocks if not passive.intersection(block.units)],
        np.concatenate([slots(exact_index), held_slots]),
        (slots(angle_states), model.x0[angle_states]),
        linear,
        model.state.units_out,
        held_table,
    )
    names = [model.state_names[k] for k in exact_index]
    names += [*held_names, *(f"z:{k + 1}" for k in range(linear.order))]
    kept_voltages = None if held is None else (model, held.buses)
    return AreaModel(exact_index, area, compiled, tuple(names), len(rows), kept_voltages)


def _network(model: DetailedModel, layout: Layout, held: HeldBoundary | None) -> CompiledNetwork:
    if held is not None:
        return held_network(model, layout, held.study, held.buses)
    equations = build_equations(model.power_flow, model.injections, layout.terminals, model.state)
    return compile_with_loads(equations, model.backend, layout.terminals, model.injections)


def _held_places(
    layout: Layout, held: HeldBoundary | None, start: int
) -> tuple[list[str], NDArray[np.int64]]:
    """Names of the held states, and rows (terminal, place in v of its real part, of its other)."""
    if held is None:
        return [], np.zeros((0, 3), dtype=np.int64)
    device, units, _ = held_group(held.buses)
    names = [f"{state}:{unit}" for state in device.states for unit in units]
    terminals = [layout.terminals.index(bus) for bus in held.buses]
    first = start + np.arange(len(units))
    return names, np.stack([terminals, first, first + len(units)], axis=1).astype(np.int64)


def _divide(model: DetailedModel, linear_states: set[int]) -> tuple[list[UnitKey], list[UnitKey]]:
    """Units that have no linear state, and the others."""
    linear = {
        unit
        for block in model.layout.blocks
        for unit, column in zip(block.units, block.state_index.T, strict=True)
        if linear_states.intersection(column.tolist())
    }
    units = model.layout.source_units
    return [u for u in units if u not in linear], [u for u in units if u in linear]


def _split(layout: Layout, classes: Sequence[Sequence[UnitKey]]) -> list[Group]:
    """The blocks of a layout divided by classes of units, in the order of the classes."""
    groups: list[Group] = []
    for block in layout.blocks:
        for members in classes:
            columns = [k for k, unit in enumerate(block.units) if unit in set(members)]
            if columns:
                units = [block.units[k] for k in columns]
                parameters = np.ascontiguousarray(block.parameters[:, columns])
                groups.append((block.device, units, parameters))
    return groups


def _constants(model: DetailedModel, layout: Layout) -> NDArray[np.float64]:
    values = dict(zip(model.layout.constant_names, model.constants, strict=True))
    return np.array([values[name] for name in layout.constant_names])


def _probes(model: DetailedModel) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The equilibrium and a state some way off, at which derivatives are compared."""
    shift = np.random.default_rng(0).uniform(-_PROBE, _PROBE, model.n_states)
    return model.x0, model.x0 + shift


def _far_probes(model: DetailedModel) -> Iterator[NDArray[np.float64]]:
    """States at several distances from the equilibrium, with every state above and below it.

    A saturation or a dead band between two probes that are close together would not be seen.
    """
    generator = np.random.default_rng(0)
    for distance in _FAR_PROBES:
        shift = distance * generator.uniform(0.5, 1.0, model.n_states)
        sign = generator.choice((-1.0, 1.0), model.n_states)
        for signed in (shift, -shift, sign * shift, -sign * shift):
            yield model.x0 + signed


def _read_states(model: DetailedModel) -> set[int]:
    """States on which Norton currents depend."""
    slopes = sum(abs(model.partials(x).currents).sum(axis=0) for x in _probes(model))
    return set(np.flatnonzero(slopes).tolist())


def nonlinear_functions(model: DetailedModel) -> NDArray[np.bool_]:
    """Whether the function of each state is nonlinear in states and voltages, shape (n_states,)."""
    start = model.partials(model.x0)
    linear = np.ones(model.n_states, dtype=bool)
    for x in _far_probes(model):
        there = model.partials(x)
        change = abs(start.states - there.states).sum(axis=1)
        change = change + abs(start.voltages - there.voltages).sum(axis=1)
        # What is not finite there is not linear either.
        linear &= change <= _CHANGE
    return ~linear


def _nonlinear_rows(
    model: DetailedModel, units: Sequence[UnitKey], nonlinear: NDArray[np.bool_]
) -> list[int]:
    """States whose functions are nonlinear; with limits of `units`, all of theirs."""
    limited = {u for block in model.layout.blocks if block.device.limits for u in block.units}
    rows = nonlinear.copy()
    rows[list(_states_of(model, [unit for unit in units if unit in limited]))] = True
    return np.flatnonzero(rows).tolist()


def _states_of(model: DetailedModel, units: Sequence[UnitKey]) -> set[int]:
    wanted = set(units)
    return {
        int(index)
        for block in model.layout.blocks
        for unit, column in zip(block.units, block.state_index.T, strict=True)
        if unit in wanted
        for index in column
    }
