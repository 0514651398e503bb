"""All kinds of relays.

They stand beside the events of a run. To add one, write a frozen dataclass with ``elements(case)`` and
put it into :data:`RELAYS`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from gridfold.grid.case import Case
from gridfold.grid.change import Event
from gridfold.grid.line_relays import DistanceRelay, OutOfStepRelay
from gridfold.grid.motor_trips import MotorTrips
from gridfold.grid.relay import Element, Relay
from gridfold.grid.shedding_relays import (
    SheddingStage,
    UnderFrequencyShedding,
    UnderVoltageShedding,
)
from gridfold.grid.unit_relays import GeneratorFrequencyTrip, GeneratorVoltageTrip

#: Name of each kind of relay in files.
RELAYS: Mapping[str, type] = {
    "under-frequency-shedding": UnderFrequencyShedding,
    "under-voltage-shedding": UnderVoltageShedding,
    "generator-voltage-trip": GeneratorVoltageTrip,
    "generator-frequency-trip": GeneratorFrequencyTrip,
    "distance": DistanceRelay,
    "out-of-step": OutOfStepRelay,
}


def relays_of_run(events: Sequence[Event], case: Case) -> tuple[Relay, ...]:
    """Those of the events that are relays, and those that belong to the case."""
    given = tuple(event for event in events if isinstance(event, Relay))
    own = MotorTrips()
    return (*given, own) if own.elements(case) else given


__all__ = [
    "RELAYS",
    "DistanceRelay",
    "Element",
    "GeneratorFrequencyTrip",
    "GeneratorVoltageTrip",
    "MotorTrips",
    "OutOfStepRelay",
    "Relay",
    "SheddingStage",
    "UnderFrequencyShedding",
    "UnderVoltageShedding",
    "relays_of_run",
]
