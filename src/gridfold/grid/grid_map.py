"""Where the buses of a grid are, for its map in the report."""

from __future__ import annotations

from typing import Any

from gridfold.grid.case import Case


def grid_map(case: Case, study_buses: frozenset[int]) -> dict[str, Any]:
    """Buses and branches, ready for JSON; with longitude and latitude if every bus has them.

    Otherwise the report finds places: a study does not wait for them.
    """
    geographic = all(bus.latitude is not None and bus.longitude is not None for bus in case.buses)
    machines = {record.bus for record in case.devices}
    return {
        "geographic": geographic,
        "buses": [
            {
                "number": bus.number,
                "name": bus.name,
                "x": bus.longitude if geographic else None,
                "y": bus.latitude if geographic else None,
                "study": bus.number in study_buses,
                "machine": bus.number in machines,
            }
            for bus in case.buses
        ],
        "branches": [
            [branch.from_bus, branch.to_bus] for branch in case.branches if branch.in_service
        ],
    }
