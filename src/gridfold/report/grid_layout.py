"""Where the buses of a grid are drawn on its map."""

from __future__ import annotations

from typing import Any

#: Buses up to which the layout by graph distances is computed; it takes their number cubed.
_BY_DISTANCES = 400
_SEED = 1


def with_places(grid: dict[str, Any]) -> dict[str, Any]:
    """A map as the study store keeps it, with coordinates for its buses if it has none.

    The buses are laid out by their distances in the graph (T. Kamada, S. Kawai, "An algorithm for
    drawing general undirected graphs", Information Processing Letters 31 (1989) 7), large grids by
    springs.
    """
    if all(bus["x"] is not None for bus in grid["buses"]):
        return grid
    places = _layout([bus["number"] for bus in grid["buses"]], grid["branches"])
    return {
        **grid,
        "buses": [
            {**bus, "x": round(float(x), 5), "y": round(float(y), 5)}
            for bus, (x, y) in zip(grid["buses"], places, strict=True)
        ],
    }


def _layout(numbers: list[int], branches: list[list[int]]) -> list[tuple[float, float]]:
    import networkx as nx

    graph = nx.Graph()
    graph.add_nodes_from(numbers)
    graph.add_edges_from(branches)
    if len(graph) <= _BY_DISTANCES:
        found = nx.kamada_kawai_layout(graph)
    else:
        found = nx.spring_layout(graph, seed=_SEED, iterations=60)
    return [tuple(found[number]) for number in numbers]
