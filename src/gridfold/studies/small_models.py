"""The small models of a family, each built once."""

from __future__ import annotations

import time as clock
from enum import Enum

from gridfold.dynamics.equilibrium import find_equilibrium
from gridfold.dynamics.model import DetailedModel
from gridfold.errors import InitializationError
from gridfold.grid.network_state import NetworkState
from gridfold.studies.limit_watches import LinearLimits, linear_limits
from gridfold.studies.reduced import ModelFamily, SmallModel


class Mode(Enum):
    """Which model is in use."""

    DETAILED = "detailed"
    HYBRID = "hybrid"
    LINEAR = "linear"


class SmallModels:
    """Linear and hybrid models by network state, about the operating point that belongs to it.

    Hand the same store to several runs to build each model once.
    """

    def __init__(self, family: ModelFamily):
        self.family = family
        self._families: dict[tuple[object, ...], ModelFamily | None] = {(): family}
        self._models: dict[tuple[NetworkState, Mode], SmallModel] = {}
        self._limits: dict[tuple[NetworkState, Mode], LinearLimits | None] = {}
        self.seconds = 0.0

    def family_for(self, model: DetailedModel) -> ModelFamily | None:
        """The family about the equilibrium of the network state; None if there is no equilibrium."""
        key = _topology(model)
        if key not in self._families:
            began = clock.perf_counter()
            try:
                point = find_equilibrium(model, self.family.origin)
                self._families[key] = self.family.moved(model, point)
            except InitializationError:
                self._families[key] = None
            self.seconds += clock.perf_counter() - began
        return self._families[key]

    def get(self, model: DetailedModel, mode: Mode) -> SmallModel | None:
        """The small model of `mode` in the network state of `model`."""
        key = (model.state, mode)
        if key not in self._models:
            family = self.family_for(model)
            if family is None:
                return None
            began = clock.perf_counter()
            build = family.linear if mode is Mode.LINEAR else family.hybrid
            self._models[key] = build(model)
            self.seconds += clock.perf_counter() - began
        return self._models[key]

    def limits(self, model: DetailedModel, mode: Mode) -> LinearLimits | None:
        """Limits of the units that are linear in the small model of `mode`; None if there are none."""
        key = (model.state, mode)
        if key not in self._limits:
            family, small = self.family_for(model), self.get(model, mode)
            if family is None or small is None:
                return None
            began = clock.perf_counter()
            self._limits[key] = linear_limits(model, small, family.origin, family.at_limits)
            self.seconds += clock.perf_counter() - began
        return self._limits[key]


def _topology(model: DetailedModel) -> tuple[object, ...]:
    """What moves the equilibrium: nothing for the intact network, faults aside."""
    state = model.state
    if (state.branches_out, state.units_out, state.load_steps) == (
        model.case.branches_out,
        frozenset(),
        (),
    ):
        return ()
    return (state.branches_out, state.units_out, state.load_steps)
