"""Disturbances as small records.

An event says what it changes in the :class:`~gridfold.grid.network_state.NetworkState`, and when.
To add one, write a frozen dataclass with a ``changes(case)`` method and put it into :data:`EVENTS`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from gridfold.errors import EventError
from gridfold.grid.branch_events import BranchFault, BranchOpenEnd, BranchReclose, BranchTrip
from gridfold.grid.case import Case, UnitKey
from gridfold.grid.change import Change, Event
from gridfold.grid.device_events import SetParameter
from gridfold.grid.event_checks import (
    branches_at,
    check_bus,
    check_impedance,
    check_time,
    check_window,
    open_branches,
)
from gridfold.grid.load_events import LoadShed, LoadStep
from gridfold.grid.network_state import NetworkState
from gridfold.grid.redispatch import Redispatch
from gridfold.grid.shunt_events import ShuntClose, ShuntStep, ShuntTrip


@dataclass(frozen=True)
class BusFault:
    """A three-phase fault at a bus.

    Parameters
    ----------
    bus : int
        Bus number.
    start, duration : float
        Time of the fault and of its clearing after that, in seconds.
    resistance, reactance : float
        Fault impedance in per unit on the system base; 0 is a bolted fault.
    trip_bus : bool
        False: the fault clears itself. True: it is cleared by tripping every branch at the bus.
    """

    bus: int
    start: float = 0.0
    duration: float = 0.1
    resistance: float = 0.0
    reactance: float = 0.0
    trip_bus: bool = False

    def changes(self, case: Case) -> list[Change]:
        """Fault on; fault off, with all branches at the bus if `trip_bus`."""
        where = f"fault at bus {self.bus}"
        check_window(where, self.start, self.duration)
        check_impedance(where, self.resistance, self.reactance)
        check_bus(where, case, self.bus)
        fault = (self.bus, complex(self.resistance, self.reactance))
        opened = branches_at(case, self.bus) if self.trip_bus else frozenset()

        def put_on(state: NetworkState) -> NetworkState:
            if any(bus == self.bus for bus, _ in state.bus_shorts(case)):
                raise EventError(f"{where}: the bus is faulted already at {self.start:g} s")
            return replace(state, bus_faults=state.bus_faults | {fault})

        def clear(state: NetworkState) -> NetworkState:
            return open_branches(replace(state, bus_faults=state.bus_faults - {fault}), opened)

        cleared = f"bus {self.bus} tripped" if self.trip_bus else f"{where} cleared"
        return [
            Change(self.start, where, put_on, (self.bus,)),
            Change(self.start + self.duration, cleared, clear),
        ]


@dataclass(frozen=True)
class MachineTrip:
    """The unit `id` at `bus` is disconnected at `time` (s); its states are frozen from then on.

    It has no effect on a unit that another event has disconnected.
    """

    bus: int
    id: str = "1"
    time: float = 0.0

    def changes(self, case: Case) -> list[Change]:
        """The unit is disconnected."""
        key = UnitKey(self.bus, str(self.id))
        where = f"trip of machine {key}"
        check_time(where, "time", self.time)
        check_bus(where, case, self.bus)
        if not any(g.key == key and g.in_service for g in case.generators):
            known = ", ".join(str(g.key) for g in case.generators if g.bus == self.bus) or "none"
            raise EventError(f"{where}: no such machine in service (at bus {self.bus}: {known})")

        def apply(state: NetworkState) -> NetworkState:
            return replace(state, units_out=state.units_out | {key})

        return [Change(self.time, f"machine {key} tripped", apply, (self.bus,))]


#: Name of each kind of event in files and on the command line.
EVENTS: Mapping[str, type] = {
    "bus-fault": BusFault,
    "branch-fault": BranchFault,
    "branch-trip": BranchTrip,
    "branch-open-end": BranchOpenEnd,
    "branch-reclose": BranchReclose,
    "machine-trip": MachineTrip,
    "load-step": LoadStep,
    "load-shed": LoadShed,
    "shunt-trip": ShuntTrip,
    "shunt-close": ShuntClose,
    "shunt-step": ShuntStep,
    "set": SetParameter,
    "redispatch": Redispatch,
}

__all__ = [
    "EVENTS",
    "BranchFault",
    "BranchOpenEnd",
    "BranchReclose",
    "BranchTrip",
    "BusFault",
    "Change",
    "Event",
    "LoadShed",
    "LoadStep",
    "MachineTrip",
    "Redispatch",
    "SetParameter",
    "ShuntClose",
    "ShuntStep",
    "ShuntTrip",
]
