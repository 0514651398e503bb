"""Events of shunts: those of the case are switched, others are added."""

from __future__ import annotations

from dataclasses import dataclass, replace

from gridfold.errors import EventError
from gridfold.grid.case import Case
from gridfold.grid.change import Change
from gridfold.grid.event_checks import added, check_bus, check_finite, check_time
from gridfold.grid.network_state import NetworkState


@dataclass(frozen=True)
class ShuntTrip:
    """The fixed shunt `id` at `bus` goes out of service at `time` (s)."""

    bus: int
    id: str = "1"
    time: float = 0.0

    def changes(self, case: Case) -> list[Change]:
        """The shunt goes out; no effect on one that another event has put out."""
        return _switched(case, self.bus, self.id, self.time, to=False)


@dataclass(frozen=True)
class ShuntClose:
    """The fixed shunt `id` at `bus` comes into service at `time` (s)."""

    bus: int
    id: str = "1"
    time: float = 0.0

    def changes(self, case: Case) -> list[Change]:
        """The shunt comes in; no effect on one that another event has put in."""
        return _switched(case, self.bus, self.id, self.time, to=True)


@dataclass(frozen=True)
class ShuntStep:
    """A shunt is added at `bus` at `time` (s).

    At 1 p.u. voltage it generates `susceptance_mvar` (capacitors: positive, reactors: negative) and
    draws `conductance_mw`.
    """

    bus: int
    susceptance_mvar: float = 0.0
    conductance_mw: float = 0.0
    time: float = 0.0

    def changes(self, case: Case) -> list[Change]:
        """The shunt is added."""
        where = f"shunt step at bus {self.bus}"
        check_time(where, "time", self.time)
        check_bus(where, case, self.bus)
        sizes = {"susceptance_mvar": self.susceptance_mvar, "conductance_mw": self.conductance_mw}
        check_finite(where, **sizes)
        step = complex(self.conductance_mw, self.susceptance_mvar)

        def apply(state: NetworkState) -> NetworkState:
            return replace(state, shunt_steps=added(state.shunt_steps, {self.bus: step}))

        label = f"shunt at bus {self.bus} {self.susceptance_mvar:+g} Mvar"
        if self.conductance_mw:
            label += f" {self.conductance_mw:+g} MW"
        return [Change(self.time, label, apply, (self.bus,))]


def _switched(case: Case, bus: int, name: str, time: float, to: bool) -> list[Change]:
    """The change that puts a shunt in (`to`) or out."""
    name = str(name)
    what = "closed" if to else "tripped"
    where = f"shunt {bus}:{name} {what}"
    check_time(where, "time", time)
    check_bus(where, case, bus)
    here = {shunt.id: k for k, shunt in enumerate(case.shunts) if shunt.bus == bus}
    if name not in here:
        known = ", ".join(f"{bus}:{other}" for other in here) or "none"
        raise EventError(f"{where}: there is no such shunt (at bus {bus}: {known})")
    position = here[name]

    def apply(state: NetworkState) -> NetworkState:
        differs = case.shunts[position].in_service is not to
        rest = state.shunts_switched - {position}
        return replace(state, shunts_switched=rest | {position} if differs else rest)

    return [Change(time, where, apply, (bus,))]
