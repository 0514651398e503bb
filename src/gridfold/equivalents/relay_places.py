"""Whether relays watch what a family of small models leaves exact."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from gridfold.equivalents.families import ModelFamily, WholeSystem
from gridfold.grid.case import Case
from gridfold.grid.measurements import Level, Measurement
from gridfold.grid.relays import Element


def blind_spots(elements: Sequence[Element], family: ModelFamily, case: Case) -> str:
    """Why small models cannot stand in where relays watch, in words; empty where they can."""
    if isinstance(family, WholeSystem):
        return "relays watch the run, and the model has no area that stays exact"
    exact = family.parts.study_buses
    for element in elements:
        outside = [bus for bus in _watched(element.measurement, case) if bus not in exact]
        if outside:
            return f"a relay watches bus {outside[0]}, outside of the study area"
    return ""


def _watched(measurement: Measurement, case: Case) -> Iterator[int]:
    """Buses at which something is measured."""
    if isinstance(measurement, Level):
        yield measurement.bus
    else:
        branch = case.branches[measurement.branch]
        yield from (branch.from_bus, branch.to_bus)
