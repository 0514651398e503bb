"""The small models of a family, each built once."""

from __future__ import annotations

import time as clock
from collections import OrderedDict
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from enum import Enum
from threading import Lock, RLock, local

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


_Key = tuple[object, ...]
_INTACT: _Key = ()


@dataclass
class _Topology:
    """What is known about one topology: the family about its equilibrium, its models, limits."""

    known: bool = False
    family: ModelFamily | None = None
    models: dict[tuple[NetworkState, Mode], SmallModel] = field(default_factory=dict)
    limits: dict[tuple[NetworkState, Mode], LinearLimits | None] = field(default_factory=dict)
    lock: RLock = field(default_factory=RLock)


class SmallModels:
    """Linear and hybrid models by network state, about the operating point that belongs to it.

    Hand the same store to several runs to build each model once. Threads may share it: what two of them
    need is built by one while the other waits.

    Parameters
    ----------
    family : ModelFamily
        The models of the intact network.
    most : int, optional
        Other topologies that are kept, the last used; all of them by default.
    """

    def __init__(self, family: ModelFamily, most: int | None = None):
        self.family = family
        self.most = most
        self._intact = _Topology(known=True, family=family)
        self._others: OrderedDict[_Key, _Topology] = OrderedDict()
        self._lock = Lock()
        self._spent = local()

    @property
    def seconds(self) -> float:
        """Seconds that this thread has spent on building."""
        return float(getattr(self._spent, "seconds", 0.0))

    def family_for(self, model: DetailedModel) -> ModelFamily | None:
        """The family about the equilibrium of the network state; None if there is no equilibrium."""
        return self._family(model, self._topology(model))

    def get(self, model: DetailedModel, mode: Mode) -> SmallModel | None:
        """The small model of `mode` in the network state of `model`."""
        return self._small(model, mode, self._topology(model))

    def limits(self, model: DetailedModel, mode: Mode) -> LinearLimits | None:
        """Limits of the units that are linear in the small model of `mode`; None if there are none."""
        topology, key = self._topology(model), (model.state, mode)
        if key not in topology.limits:
            family = self._family(model, topology)
            small = self._small(model, mode, topology)
            if family is None or small is None:
                return None
            with self._building(topology):
                if key not in topology.limits:
                    found = linear_limits(model, small, family.origin, family.at_limits)
                    topology.limits[key] = found
        return topology.limits[key]

    def _family(self, model: DetailedModel, topology: _Topology) -> ModelFamily | None:
        if not topology.known:
            with self._building(topology):
                if not topology.known:
                    try:
                        point = find_equilibrium(model, self.family.origin)
                        topology.family = self.family.moved(model, point)
                    except InitializationError:
                        topology.family = None
                    topology.known = True
        return topology.family

    def _small(self, model: DetailedModel, mode: Mode, topology: _Topology) -> SmallModel | None:
        key = (model.state, mode)
        if key not in topology.models:
            family = self._family(model, topology)
            if family is None:
                return None
            with self._building(topology):
                if key not in topology.models:
                    build = family.linear if mode is Mode.LINEAR else family.hybrid
                    topology.models[key] = build(model)
        return topology.models[key]

    def _topology(self, model: DetailedModel) -> _Topology:
        """What is known about the topology of `model`; the longest unused gives way to a new one."""
        key = _changes(model)
        if key == _INTACT:
            return self._intact
        with self._lock:
            found = self._others.setdefault(key, _Topology())
            self._others.move_to_end(key)
            while self.most is not None and len(self._others) > self.most:
                self._others.popitem(last=False)
            return found

    @contextmanager
    def _building(self, topology: _Topology) -> Iterator[None]:
        """One thread at a time; what the others wait counts as spent on building too."""
        began = clock.perf_counter()
        with topology.lock:
            yield
        self._spent.seconds = self.seconds + clock.perf_counter() - began


def _changes(model: DetailedModel) -> _Key:
    """What moves the equilibrium: nothing for the intact network, faults aside."""
    state = model.state
    if (state.branches_out, state.units_out, state.load_steps) == (
        model.case.branches_out,
        frozenset(),
        (),
    ):
        return _INTACT
    return (state.branches_out, state.units_out, state.load_steps)
