"""All kinds of relays.

They stand beside the events of a run. To add one, write a frozen dataclass with ``elements(case)`` and
put it into :data:`RELAYS`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from gridfold.grid.change import Event
from gridfold.grid.line_relays import DistanceRelay, OutOfStepRelay
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


def relays_among(events: Sequence[Event]) -> tuple[Relay, ...]:
    """Those of the events that are relays."""
    return tuple(event for event in events if isinstance(event, Relay))


__all__ = [
    "RELAYS",
    "DistanceRelay",
    "Element",
    "GeneratorFrequencyTrip",
    "GeneratorVoltageTrip",
    "OutOfStepRelay",
    "Relay",
    "SheddingStage",
    "UnderFrequencyShedding",
    "UnderVoltageShedding",
    "relays_among",
]
