"""The external area folded behind ports: linear, reduced, and as cheap as its ports."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from gridfold.dynamics.equilibrium import Equilibrium
from gridfold.dynamics.model import DetailedModel
from gridfold.dynamics.port_model import build_port_model
from gridfold.dynamics.port_rhs import LinearPorts
from gridfold.dynamics.unit_limits import limits_touched, without_touched
from gridfold.errors import OptionError
from gridfold.grid.case import UnitKey
from gridfold.numerics.modal_form import ModalForm, modal_form
from gridfold.partition import Coupling, Partition, couple
from gridfold.partition.port_area import PortArea, interface_weights, linearize_ports
from gridfold.partition.ports import Ports, find_ports
from gridfold.reduction import Reducer, Reduction
from gridfold.studies.model_kind import ReducerKind
from gridfold.studies.reduced import SmallModel
from gridfold.systems.statemap import StateMap


@dataclass(frozen=True)
class FoldedArea:
    parts: Partition
    coupling: Coupling
    ports: Ports
    reduction: Reduction
    area: PortArea = field(repr=False)
    linear_ports: LinearPorts = field(repr=False)
    states: StateMap = field(repr=False)
    weights: NDArray[np.float64] = field(repr=False)
    origin: NDArray[np.float64] = field(repr=False)
    reducer: Reducer
    at_limits: tuple[str, ...] = ()

    @property
    def reference_unit(self) -> UnitKey:
        return self.coupling.reference

    @property
    def study_units(self) -> tuple[UnitKey, ...]:
        return self.parts.study_units

    def linear(self, model: DetailedModel) -> SmallModel:
        built = build_port_model(
            model, self.ports.buses, self.linear_ports, self.area.state_index, self.states
        )
        return SmallModel(built, built, 0, self.ports.units)

    def moved(self, model: DetailedModel, point: Equilibrium) -> "FoldedArea":
        return _fold(self.parts, self.coupling, self.ports, self.weights, self.reducer, model, point)


def fold(
    parts: Partition, retained: Collection[UnitKey] = (), reducer: Reducer | None = None
) -> FoldedArea:
    linear = [unit for unit in parts.external_units if unit not in set(retained)]
    ports = find_ports(parts.model, linear, parts.study_buses)
    weights = interface_weights(parts.model, ports)
    chosen = ReducerKind.BALANCED.build() if reducer is None else reducer
    start = Equilibrium(parts.model.x0, 0.0)
    return _fold(parts, couple(parts), ports, weights, chosen, parts.model, start)


def _fold(parts, coupling, ports, weights, reducer, model, point):
    smooth = without_touched(model, point.x, ports.units)
    area = linearize_ports(ports, smooth, point.x, weights)
    reduction = reducer.reduce(area.system.dense(), area.x0)
    form = modal_form(reduction.system.a)
    assert form is not None
    order, n_pairs = pair_order(form)
    states = StateMap(
        reduction.state_map.reference,
        reduction.state_map.lift_matrix @ form.basis[:, order],
        form.inverse[order] @ reduction.state_map.restrict_matrix,
    )
    n_real = len(order) - 2 * n_pairs
    lp = LinearPorts(
        form.diagonal[order],
        form.coupling[order][n_real : n_real + n_pairs],
        form.inverse[order] @ reduction.system.b,
        states.restrict_matrix @ area.drift,
        area.log_slopes @ states.lift_matrix,
        area.current,
        area.voltage,
    )
    at_limits = limits_touched(model, point.x, ports.units)
    return FoldedArea(parts, coupling, ports, reduction, area, lp, states, weights, point.x, reducer, at_limits)


def pair_order(form: ModalForm) -> tuple[NDArray[np.int64], int]:
    every = np.arange(len(form.partner))
    real = np.flatnonzero(form.partner == every)
    first = np.flatnonzero(form.partner > every)
    return np.concatenate([real, first, form.partner[first]]), len(first)
