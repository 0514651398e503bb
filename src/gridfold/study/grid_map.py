"""Where the buses of a grid are, for its map in the report."""

from __future__ import annotations

from typing import Any

from gridfold.grid.case import Case

#: Buses up to which the layout by graph distances is computed; it takes their number cubed.
_BY_DISTANCES = 400
_SEED = 1


def grid_map(case: Case, study_buses: frozenset[int]) -> dict[str, Any]:
    """Buses with coordinates and areas, and branches, ready for JSON.

    Coordinates are those of the case, longitude and latitude, if every bus has them. Otherwise the
    buses are laid out by their distances in the graph (T. Kamada, S. Kawai, "An algorithm for drawing
    general undirected graphs", Information Processing Letters 31 (1989) 7), large grids by springs.
    """
    geographic = all(bus.latitude is not None and bus.longitude is not None for bus in case.buses)
    places = _coordinates(case) if geographic else _layout(case)
    machines = {record.bus for record in case.devices}
    return {
        "geographic": geographic,
        "buses": [
            {
                "number": bus.number,
                "name": bus.name,
                "x": round(float(x), 5),
                "y": round(float(y), 5),
                "study": bus.number in study_buses,
                "machine": bus.number in machines,
            }
            for bus, (x, y) in zip(case.buses, places, strict=True)
        ],
        "branches": [
            [branch.from_bus, branch.to_bus] for branch in case.branches if branch.in_service
        ],
    }


def _coordinates(case: Case) -> list[tuple[float, float]]:
    return [(bus.longitude or 0.0, bus.latitude or 0.0) for bus in case.buses]


def _layout(case: Case) -> list[tuple[float, float]]:
    import networkx as nx

    graph = nx.Graph()
    graph.add_nodes_from(bus.number for bus in case.buses)
    graph.add_edges_from((b.from_bus, b.to_bus) for b in case.branches if b.in_service)
    if len(graph) <= _BY_DISTANCES:
        found = nx.kamada_kawai_layout(graph)
    else:
        found = nx.spring_layout(graph, seed=_SEED, iterations=60)
    return [tuple(found[bus.number]) for bus in case.buses]
