"""Events of loads: a step, and shedding a part of what the case has."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

from gridfold.errors import EventError
from gridfold.grid.case import Case
from gridfold.grid.change import Change
from gridfold.grid.event_checks import (
    added,
    check_bus,
    check_finite,
    check_time,
    chosen_buses,
    place_text,
)
from gridfold.grid.network_state import NetworkState

#: Part of a load that rounding may shed beyond all of it.
_ROUNDING = 1e-9


@dataclass(frozen=True)
class LoadStep:
    """Load is added at `bus` at `time` (s), as a constant impedance.

    `active_mw` and `reactive_mvar` are what it draws at the bus's initial voltage; negative values
    shed load.
    """

    bus: int
    time: float = 0.0
    active_mw: float = 0.0
    reactive_mvar: float = 0.0

    def changes(self, case: Case) -> list[Change]:
        """The load is added."""
        where = f"load step at bus {self.bus}"
        check_time(where, "time", self.time)
        check_bus(where, case, self.bus)
        check_finite(where, active_mw=self.active_mw, reactive_mvar=self.reactive_mvar)
        step = complex(self.active_mw, self.reactive_mvar)

        def apply(state: NetworkState) -> NetworkState:
            return replace(state, load_steps=added(state.load_steps, {self.bus: step}))

        label = f"load at bus {self.bus} {self.active_mw:+g} MW {self.reactive_mvar:+g} Mvar"
        return [Change(self.time, label, apply, (self.bus,))]


@dataclass(frozen=True)
class LoadShed:
    """A share of the load that the case has at some buses is disconnected at `time` (s).

    What is left keeps its dependence on voltage. Shares count from the load at the start: 0.1 and then
    0.2 leave 0.7 of it. Load that a :class:`LoadStep` has added stays.

    Parameters
    ----------
    share : float
        Part of the load, more than 0 and at most 1.
    buses, areas, zones : str
        Where, such as ``1-36,78``; all that one of them names.
    time : float
        In seconds.
    """

    share: float
    buses: str = ""
    areas: str = ""
    zones: str = ""
    time: float = 0.0

    def changes(self, case: Case) -> list[Change]:
        """A part of the load goes."""
        where = f"shedding of load at {self._place}"
        check_time(where, "time", self.time)
        if not 0 < self.share <= 1:
            raise EventError(
                f"{where}: share must be more than 0 and at most 1, not {self.share!r}"
            )
        buses = chosen_buses(where, case, self.buses, self.areas, self.zones)
        loads = [load for load in case.loads if load.in_service and load.bus in buses]
        if not loads:
            raise EventError(f"{where}: there is no load in service")
        shed = sum(case.stored_power(load).real for load in loads) * self.share
        there = tuple(sorted({load.bus for load in loads}))

        def apply(state: NetworkState) -> NetworkState:
            gone = dict(state.load_shed)
            for bus in there:
                if gone.get(bus, 0.0) + self.share > 1 + _ROUNDING:
                    raise EventError(
                        f"{where}: at bus {bus} {gone[bus]:.4g} of the load is shed already at "
                        f"{self.time:g} s; {self.share:g} more is more than there is"
                    )
            return shed_load(state, there, self.share)

        label = f"{100 * self.share:g} % of the load at {self._place} shed, {shed:.1f} MW"
        return [Change(self.time, label, apply, there)]

    @property
    def _place(self) -> str:
        return place_text(self.buses, self.areas, self.zones)


def shed_load(state: NetworkState, buses: Iterable[int], share: float) -> NetworkState:
    """The state with a further `share` of the load at each of the buses shed, as far as it is there."""
    gone = dict(state.load_shed)
    for bus in buses:
        total = gone.get(bus, 0.0) + share
        gone[bus] = 1.0 if math.isclose(total, 1.0, abs_tol=_ROUNDING) else min(total, 1.0)
    return replace(state, load_shed=tuple(sorted(gone.items())))
