"""What a family of small models is, and the two families of the paper.

A family offers, for any network state of the study area, the models between which the adaptive
algorithm switches.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from gridfold.cards import Card, first_few
from gridfold.dynamics.area_model import (
    BoundaryCoupling,
    HeldBoundary,
    LinearArea,
    build_area_model,
)
from gridfold.dynamics.equilibrium import Equilibrium
from gridfold.dynamics.model import DetailedModel
from gridfold.dynamics.port_model import PortCoordinates
from gridfold.dynamics.unit_limits import limits_touched, touched_held
from gridfold.equivalents.model_kind import ReducerKind
from gridfold.errors import OptionError
from gridfold.grid.case import UnitKey
from gridfold.numerics.chained_form import chained_form
from gridfold.numerics.modal_form import modal_form
from gridfold.partition import Coupling, Partition, couple, linearize_external
from gridfold.reduction import BalancedTruncation, Reducer, Reduction
from gridfold.simulation.segment import Coordinates, lifts_rows
from gridfold.systems.dense import DenseSystem
from gridfold.systems.linear import LinearSystem
from gridfold.systems.modal import ModalSystem
from gridfold.systems.protocol import System
from gridfold.systems.statemap import StateMap

#: Threshold of the column norm in per unit, as the paper calibrates it for NPCC.
COLUMN_NORM = 1.0


@dataclass(frozen=True)
class SmallModel:
    """A model, and the way between its states and those of the whole system.

    `unlimited` are the units whose limits do not act in it as they should: linear ones, and those
    whose nonlinear part acts through a reduction, which holds for small corrections only. Limits
    that are `followed` act as they should nevertheless.
    """

    system: System
    coordinates: Coordinates
    nonlinear_functions: int
    unlimited: tuple[UnitKey, ...] = ()
    followed: frozenset[str] = frozenset()

    @cached_property
    def affine(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The whole system's states as origin + v @ slopes: shapes (n_states,) and (r, n_states)."""
        size = self.system.compiled.n_states
        origin = self.coordinates.lift(np.zeros(size))
        return origin, self.coordinates.lift(np.eye(size)) - origin

    def rows(self, index: NDArray[np.int64]) -> tuple[NDArray[np.float64], csr_array]:
        """The states at the positions `index` (m,) as origin + slopes @ v: shapes (m,) and (m, r)."""
        return affine_rows(self.coordinates, self.system.compiled.n_states, index)


def affine_rows(
    coordinates: Coordinates | None, size: int, index: NDArray[np.int64]
) -> tuple[NDArray[np.float64], csr_array]:
    """The whole system's states at `index` (m,) as origin + slopes @ v, from v (size,)."""
    if coordinates is None:
        ones, begins = np.ones(len(index)), np.arange(len(index) + 1)
        return np.zeros(len(index)), csr_array((ones, index, begins), shape=(len(index), size))
    if isinstance(coordinates, PortCoordinates):
        return coordinates.affine_rows(index)
    zero, unit = np.zeros(size), np.eye(size)
    if lifts_rows(coordinates):
        origin = coordinates.lift_rows(zero, index)
        return origin, csr_array((coordinates.lift_rows(unit, index) - origin).T)
    origin = coordinates.lift(zero)[index]
    return origin, csr_array((coordinates.lift(unit)[:, index] - origin).T)


class Mode(Enum):
    """Which model is in use.

    RETAINED: machines near the boundary exact beside the study area, the rest linear. HYBRID: their
    nonlinear functions put back into the linear area. LINEAR: the external area linear. WHOLE:
    everything linear.
    """

    DETAILED = "detailed"
    RETAINED = "retained"
    HYBRID = "hybrid"
    LINEAR = "linear"
    WHOLE = "linear whole"


class ModelFamily(Protocol):
    """Small models about one operating point."""

    @property
    def parts(self) -> Partition:
        """Study and external area."""

    @property
    def modes(self) -> tuple[Mode, ...]:
        """The models that there are, from the most exact to the cheapest."""

    @property
    def reference_unit(self) -> UnitKey | None:
        """The machine against which angle deviations are measured; None: the infinite bus."""

    @property
    def study_units(self) -> tuple[UnitKey, ...]:
        """Machines whose angle deviations decide."""

    @property
    def origin(self) -> NDArray[np.float64]:
        """State of the whole system at the operating point."""

    @property
    def light_limits(self) -> Mapping[Mode, float]:
        """Models in which limits of linear units are passed over, as sample swings allow."""

    def how(self, mode: Mode) -> str:
        """How the model `mode` came about, for the log."""

    def held_at_limits(self, mode: Mode) -> tuple[str, ...]:
        """Limits of linear units that act at the operating point: what they hold is frozen."""

    def build(self, mode: Mode, model: DetailedModel) -> SmallModel:
        """The model `mode`, in the network state of `model`."""

    def moved(self, model: DetailedModel, point: Equilibrium) -> ModelFamily:
        """The family about another operating point, that of `model` at `point`."""


@dataclass(frozen=True, repr=False)
class ReducedExternal(Card):
    """The external area reduced: equations (3)-(15) of Osipov & Sun.

    Build it with :func:`reduce_external`.

    Parameters
    ----------
    parts : Partition
        Study and external area.
    coupling : Coupling
        Column norms of the external machines.
    kept : tuple of UnitKey
        External machines whose functions stay nonlinear in the hybrid model.
    reduction : Reduction
        Reduced linear system, singular values and bound.
    area : LinearArea
        The same, ready to be simulated.
    origin : ndarray, shape (n_states,)
        State of the whole system at the operating point.
    reducer : Reducer
        How it was reduced.
    boundary : BoundaryCoupling
        How the areas know each other's boundary voltages.
    at_limits : tuple of str
        Limits of external units that act at the operating point.
    """

    parts: Partition
    coupling: Coupling
    kept: tuple[UnitKey, ...]
    reduction: Reduction
    area: LinearArea = field(repr=False)
    origin: NDArray[np.float64] = field(repr=False)
    reducer: Reducer
    boundary: BoundaryCoupling = BoundaryCoupling.EXACT
    at_limits: tuple[str, ...] = ()

    def _facts(self) -> dict[str, object]:
        bound = self.reduction.bound
        return {
            "case": self.parts.model.case.name,
            "states": f"{len(self.area.index)} reduced to {self.reduction.order}",
            "bound": "none" if bound is None else f"{bound:.1e}",
            "kept nonlinear": first_few(self.kept),
        }

    @property
    def reference_unit(self) -> UnitKey | None:
        """The electrically furthest machine."""
        return self.coupling.reference

    @property
    def study_units(self) -> tuple[UnitKey, ...]:
        """Machines of the study area."""
        return self.parts.study_units

    @property
    def light_limits(self) -> Mapping[Mode, float]:
        """All limits count."""
        return {}

    @property
    def modes(self) -> tuple[Mode, ...]:
        """The hybrid and the linear model."""
        return Mode.HYBRID, Mode.LINEAR

    def how(self, mode: Mode) -> str:
        """Every operating point has a linearization and a reduction of its own."""
        return "linearized and reduced anew"

    def held_at_limits(self, mode: Mode) -> tuple[str, ...]:
        """The same limits in both models."""
        return self.at_limits

    def build(self, mode: Mode, model: DetailedModel) -> SmallModel:
        """The hybrid or the linear model."""
        return self.linear(model) if mode is Mode.LINEAR else self.hybrid(model)

    def linear(self, model: DetailedModel) -> SmallModel:
        """Study area in full, external area linear and reduced."""
        return self._build(model, ())

    def hybrid(self, model: DetailedModel) -> SmallModel:
        """Study area in full, external area reduced with the kept functions nonlinear."""
        return self._build(model, self.kept)

    def moved(self, model: DetailedModel, point: Equilibrium) -> ReducedExternal:
        """Linearized and reduced again about `point`, the equilibrium of `model`."""
        moved = _reduce(self.parts, self.coupling, self.kept, self.reducer, model, point)
        return replace(moved, boundary=self.boundary)

    def _build(self, model: DetailedModel, corrected: Sequence[UnitKey]) -> SmallModel:
        held = None
        if self.boundary is BoundaryCoupling.LAGGED:
            held = HeldBoundary(self.parts.study_buses, self.parts.boundary_of_both)
        built = build_area_model(
            model,
            self.area,
            corrected,
            self.parts.boundary_buses,
            held=held,
            nonlinear=self.parts.nonlinear_functions if corrected else None,
        )
        truncated = self.reduction.order < len(self.area.index)
        exact = () if truncated else corrected
        unlimited = tuple(unit for unit in self.parts.external_units if unit not in exact)
        return SmallModel(built, built, built.nonlinear_functions, unlimited)


def reduce_external(
    parts: Partition,
    reducer: Reducer | None = None,
    column_norm: float = COLUMN_NORM,
    coupling: BoundaryCoupling = BoundaryCoupling.EXACT,
) -> ReducedExternal:
    """Linearize and reduce the external area at the equilibrium.

    Parameters
    ----------
    parts : Partition
        From :func:`gridfold.partition.partition`.
    reducer : Reducer
        Balanced truncation to a bound of 1e-5 by default, as in the paper.
    column_norm : float
        Machines with at least this column norm (p.u.) stay nonlinear in the hybrid model.
    coupling : BoundaryCoupling
        Boundary voltages solved for together, or taken from the previous step as in the paper.
    """
    norms = couple(parts)
    chosen = ReducerKind.BALANCED.build() if reducer is None else reducer
    start = Equilibrium(parts.model.x0, 0.0)
    kept = norms.kept(column_norm)
    reduced = _reduce(parts, norms, kept, chosen, parts.model, start)
    return replace(reduced, boundary=coupling)


def _reduce(
    parts: Partition,
    coupling: Coupling,
    kept: tuple[UnitKey, ...],
    reducer: Reducer,
    model: DetailedModel,
    point: Equilibrium,
) -> ReducedExternal:
    smooth = touched_held(model, point.x, parts.external_units)
    linear = linearize_external(parts, smooth, point.x)
    if isinstance(reducer, BalancedTruncation) and reducer.slow_modes is not None:
        slow = slow_modes(smooth, point.x, reducer.slow_modes)[linear.state_index]
        reduction = reducer.reduce(linear.system, linear.x0, include=slow)
    else:
        reduction = reducer.reduce(linear.system, linear.x0)
    if reduction.system.d.any():
        raise OptionError("a reduction with feed-through cannot stand in for an external area")
    form = modal_form(reduction.system.a)
    a, b, states, partners = reduction.system.a, reduction.system.b, reduction.state_map, None
    if form is not None:
        a, partners = np.stack([form.diagonal, form.coupling]), form.partner
        b = form.inverse @ b
        states = StateMap(
            states.reference,
            states.lift_matrix @ form.basis,
            form.inverse @ states.restrict_matrix,
        )
    area = LinearArea(
        linear.state_index, states, linear.system, a, partners, b, linear.u0, linear.drift
    )
    at_limits = limits_touched(model, point.x, parts.external_units)
    return ReducedExternal(
        parts, coupling, kept, reduction, area, point.x, reducer, at_limits=at_limits
    )


def slow_modes(model: DetailedModel, x: NDArray[np.float64], decay: float) -> NDArray[np.float64]:
    """Modes of the whole grid at the state `x` that decay more slowly than by `decay` (1/s), or grow.

    A reduced area that can be in the same state as the area is in a mode of the whole grid leaves
    this mode as it is, eigenvalue and shape. The common turn of all rotor angles is such a mode.

    Returns
    -------
    ndarray, shape (n_states, 2 k)
        Real parts, then imaginary parts (zero for a real mode), of deviations of the states.
    """
    values, vectors = np.linalg.eig(model.jacobian(x))
    chosen = vectors[:, (values.real > -decay) & (values.imag >= 0)]
    return np.hstack([chosen.real, chosen.imag])


@dataclass(frozen=True, repr=False)
class WholeSystem(Card):
    """The whole system without partition: equations (16) and (17) of Osipov & Sun.

    The hybrid model keeps the functions of the study area and of the kept machines; the linear model
    linearizes everything, and is stepped by modes; by its full matrix if modes coincide.
    """

    parts: Partition
    coupling: Coupling
    kept: tuple[UnitKey, ...]
    origin: NDArray[np.float64] = field(repr=False)
    rate: float = 0.0
    at_limits: tuple[str, ...] = ()

    def _facts(self) -> dict[str, object]:
        return {
            "case": self.parts.model.case.name,
            "states": len(self.origin),
            "kept nonlinear": first_few(self.kept),
        }

    @property
    def reference_unit(self) -> UnitKey | None:
        """The electrically furthest machine."""
        return self.coupling.reference

    @property
    def study_units(self) -> tuple[UnitKey, ...]:
        """Machines of the study area."""
        return self.parts.study_units

    @property
    def light_limits(self) -> Mapping[Mode, float]:
        """All limits count."""
        return {}

    @property
    def modes(self) -> tuple[Mode, ...]:
        """The hybrid and the linear model."""
        return Mode.HYBRID, Mode.LINEAR

    def how(self, mode: Mode) -> str:
        """Every operating point has a linearization and a reduction of its own."""
        return "linearized and reduced anew"

    def held_at_limits(self, mode: Mode) -> tuple[str, ...]:
        """The same limits in both models."""
        return self.at_limits

    def build(self, mode: Mode, model: DetailedModel) -> SmallModel:
        """The hybrid or the linear model."""
        return self.linear(model) if mode is Mode.LINEAR else self.hybrid(model)

    def linear(self, model: DetailedModel) -> SmallModel:
        """Everything linear, equation (17), in modal coordinates where the modes can be told apart."""
        jacobian, drift = self._jacobian(model), model.compiled(self.origin)
        form = chained_form(jacobian)
        if form is None:
            dense = DenseSystem(jacobian, drift)
            return SmallModel(dense, StateMap.identity(self.origin), 0, model.layout.source_units)
        states = StateMap(self.origin, form.basis, form.inverse)
        system = ModalSystem(form, form.inverse @ drift)
        return SmallModel(system, states, 0, model.layout.source_units)

    def hybrid(self, model: DetailedModel) -> SmallModel:
        """Functions of far machines linear, equation (16)."""
        near = set(self.parts.study_units) | set(self.kept)
        far = [unit for unit in self.parts.external_units if unit not in near]
        index = np.array(self.parts.states_of(far), dtype=np.int64)
        rest = np.setdiff1d(np.arange(model.n_states), index)
        jacobian = self._jacobian(model)
        full = LinearSystem(
            jacobian[np.ix_(index, index)], jacobian[np.ix_(index, rest)], np.eye(len(index))
        )
        drift = model.compiled(self.origin)[index]
        states = StateMap.identity(self.origin[index])
        reference = self.origin[rest]
        area = LinearArea(index, states, full, full.a, None, full.b, reference, drift)
        built = build_area_model(model, area, input_states=rest.tolist())
        return SmallModel(built, built, 0, tuple(far))

    def _jacobian(self, model: DetailedModel) -> NDArray[np.float64]:
        smooth = touched_held(model, self.origin, model.layout.source_units)
        return smooth.jacobian(self.origin)

    def moved(self, model: DetailedModel, point: Equilibrium) -> WholeSystem:
        """About another operating point."""
        at_limits = limits_touched(model, point.x, model.layout.source_units)
        return WholeSystem(self.parts, self.coupling, self.kept, point.x, point.rate, at_limits)


def whole_system(parts: Partition, column_norm: float = COLUMN_NORM) -> WholeSystem:
    """The version without partition, about the equilibrium."""
    coupling, start = couple(parts), Equilibrium(parts.model.x0, 0.0)
    kept = coupling.kept(column_norm)
    return WholeSystem(parts, coupling, kept, start.x).moved(parts.model, start)
