"""Relays that disconnect a generating unit."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from gridfold.errors import EventError
from gridfold.grid.case import Case, UnitKey
from gridfold.grid.event_checks import check_time
from gridfold.grid.events import MachineTrip
from gridfold.grid.measurements import Frequency, Voltage
from gridfold.grid.relay import Element, Relay, require_positive


@dataclass(frozen=True)
class GeneratorVoltageTrip(Relay):
    """A unit is disconnected where the voltage at its bus stays out of a range.

    Parameters
    ----------
    bus : int
        Bus of the unit.
    delay : float
        In seconds.
    below, above : float, optional
        Thresholds in p.u.; at least one.
    id : str
        Id of the unit.
    """

    bus: int
    delay: float
    below: float | None = None
    above: float | None = None
    id: str = "1"

    def elements(self, case: Case) -> list[Element]:
        """One for each threshold."""
        return list(_unit_elements(self, case, "voltage", "p.u.", Voltage))


@dataclass(frozen=True)
class GeneratorFrequencyTrip(Relay):
    """A unit is disconnected where the frequency at its bus stays out of a range.

    Parameters
    ----------
    bus : int
        Bus of the unit.
    delay : float
        In seconds.
    below, above : float, optional
        Thresholds in Hz; at least one.
    id : str
        Id of the unit.
    """

    bus: int
    delay: float
    below: float | None = None
    above: float | None = None
    id: str = "1"

    def elements(self, case: Case) -> list[Element]:
        """One for each threshold."""
        return list(_unit_elements(self, case, "frequency", "Hz", Frequency))


def _unit_elements(
    relay: GeneratorVoltageTrip | GeneratorFrequencyTrip,
    case: Case,
    name: str,
    unit: str,
    measure: type[Voltage] | type[Frequency],
) -> Iterator[Element]:
    key = UnitKey(relay.bus, str(relay.id))
    where = f"{name} trip of machine {key}"
    trip = MachineTrip(relay.bus, relay.id).changes(case)[0]
    check_time(where, "delay", relay.delay)
    if relay.below is None and relay.above is None:
        raise EventError(f"{where}: give below or above")
    for side in ("below", "above"):
        level = getattr(relay, side)
        if level is not None:
            require_positive(where, **{side: level})
            label = f"{where}, {side} {level:g} {unit}"
            seen = measure(relay.bus, unit=key, **{side: level})
            yield Element(label, seen, relay.delay, trip.apply, trip.buses)
