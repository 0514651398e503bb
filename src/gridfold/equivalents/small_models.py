"""The small models of a family, each built once."""

from __future__ import annotations

import time as clock
from collections import OrderedDict
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, fields
from threading import Lock, RLock, local

from gridfold.cards import Card
from gridfold.dynamics.equilibrium import find_equilibrium
from gridfold.dynamics.model import DetailedModel
from gridfold.equivalents.angle_watches import AngleWatches
from gridfold.equivalents.families import Mode, ModelFamily, SmallModel
from gridfold.equivalents.limit_watches import LinearLimits, linear_limits
from gridfold.errors import InitializationError, OptionError
from gridfold.grid.case import Case
from gridfold.grid.network_state import NetworkState
from gridfold.grid.timeline import initial_state

Topology = tuple[object, ...]
#: That of the case.
INTACT: Topology = ()


@dataclass
class _Known:
    """What is known about one topology: the family about its equilibrium, its models, limits.

    `complete` once the equilibrium was looked for; where there is none there is no family.
    """

    complete: bool = False
    family: ModelFamily | None = None
    models: dict[tuple[NetworkState, Mode], SmallModel | None] = field(default_factory=dict)
    limits: dict[tuple[NetworkState, Mode], LinearLimits | None] = field(default_factory=dict)
    watches: dict[tuple[NetworkState, Mode], AngleWatches] = field(default_factory=dict)
    lock: RLock = field(default_factory=RLock)


class SmallModels(Card):
    """Small models by network state, about the operating point that belongs to it.

    Hand the same store to several runs to build each model once. Threads may share it: what two of them
    need is built by one while the other waits.

    Parameters
    ----------
    family : ModelFamily
        The models of the intact network.
    most : int, optional
        Other topologies that are kept, the last used; all of them by default.
    """

    def _facts(self) -> dict[str, object]:
        return {
            "family": repr(self.family),
            "other topologies": len(self._others),
        }

    def __init__(self, family: ModelFamily, most: int | None = None):
        self.family = family
        self.most = most
        self._intact = _Known(complete=True, family=family)
        self._others: OrderedDict[Topology, _Known] = OrderedDict()
        self._lock = Lock()
        self._spent = local()

    @property
    def seconds(self) -> float:
        """Seconds that this thread has spent on building."""
        return float(getattr(self._spent, "seconds", 0.0))

    def family_for(self, model: DetailedModel) -> ModelFamily | None:
        """The family about the equilibrium of the network state.

        None if there is no equilibrium, or if the linear area cannot be joined to the rest there.
        """
        return self._family(model, self._topology(model))

    def get(self, model: DetailedModel, mode: Mode) -> SmallModel | None:
        """The small model of `mode` in the network state of `model`."""
        return self._small(model, mode, self._topology(model))

    def limits(self, model: DetailedModel, mode: Mode) -> LinearLimits | None:
        """Limits of the units that are linear in the small model of `mode`.

        None if there are none, or if they are passed over.
        """
        known, key = self._topology(model), (model.state, mode)
        if key not in known.limits:
            family = self._family(model, known)
            small = self._small(model, mode, known)
            if family is None or small is None or mode in family.light_limits:
                return None
            with self._building(known):
                if key not in known.limits:
                    held = family.held_at_limits(mode)
                    found = linear_limits(model, small, family.origin, held)
                    known.limits[key] = found
        return known.limits[key]

    def watches(self, model: DetailedModel, mode: Mode) -> AngleWatches:
        """Watches on the rotor angles in the model `mode`, in the network state of `model`.

        Those of a network with a fault are used once, and not kept.
        """
        known, key = self._topology(model), (model.state, mode)
        found = known.watches.get(key)
        if found is None:
            family = None if model.state.faulted else self._family(model, known)
            small = None if mode is Mode.DETAILED else self._small(model, mode, known)
            found = AngleWatches(model, family, small)
            if not model.state.faulted:
                known.watches[key] = found
        return found

    def _family(self, model: DetailedModel, known: _Known) -> ModelFamily | None:
        if not known.complete:
            with self._building(known):
                if not known.complete:
                    try:
                        point = find_equilibrium(model, self.family.origin)
                        known.family = self.family.moved(model, point)
                    except (InitializationError, OptionError):
                        known.family = None
                    known.complete = True
        return known.family

    def _small(self, model: DetailedModel, mode: Mode, known: _Known) -> SmallModel | None:
        key = (model.state, mode)
        if key not in known.models:
            family = self._family(model, known)
            if family is None:
                return None
            with self._building(known):
                if key not in known.models:
                    try:
                        known.models[key] = family.build(mode, model)
                    except OptionError:
                        known.models[key] = None
        return known.models[key]

    def _topology(self, model: DetailedModel) -> _Known:
        """What is known about the topology of `model`; the longest unused gives way to a new one."""
        key = topology(model.state, model.case)
        if key == INTACT:
            return self._intact
        with self._lock:
            found = self._others.setdefault(key, _Known())
            self._others.move_to_end(key)
            while self.most is not None and len(self._others) > self.most:
                self._others.popitem(last=False)
            return found

    @contextmanager
    def _building(self, known: _Known) -> Iterator[None]:
        """One thread at a time; what the others wait counts as spent on building too."""
        began = clock.perf_counter()
        with known.lock:
            yield
        self._spent.seconds = self.seconds + clock.perf_counter() - began


def topology(state: NetworkState, case: Case) -> Topology:
    """What moves the equilibrium: nothing, ``()``, for the intact network, faults aside."""
    healthy = state.healthy
    if healthy == initial_state(case):
        return INTACT
    return tuple(getattr(healthy, item.name) for item in fields(healthy))
