from __future__ import annotations

from itertools import combinations

import networkx as nx
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse import csr_array

import gridfold as gf
from gridfold.errors import OptionError
from gridfold.grid.timeline import build_timeline
from gridfold.partition.ports import _behind, _vertex_cut, find_ports

NEAR_BOUNDARY = (42, 50, 51, 78, 134)


@st.composite
def divided_graphs(draw):
    """A graph of up to seven buses, those of the study side and those of linear machines."""
    n = draw(st.integers(2, 7))
    pairs = list(combinations(range(n), 2))
    edges = draw(st.lists(st.sampled_from(pairs), unique=True))
    buses = st.sets(st.integers(0, n - 1), min_size=1, max_size=3)
    return n, edges, draw(buses), draw(buses)


def joined(n, edges):
    matrix = np.zeros((n, n), dtype=np.int32)
    for i, j in edges:
        matrix[i, j] = matrix[j, i] = 1
    return csr_array(matrix)


def with_ends(n, edges, near, far):
    graph = nx.Graph(edges)
    graph.add_nodes_from(range(n))
    graph.add_edges_from(("near", k) for k in near)
    graph.add_edges_from(("far", k) for k in far)
    return graph


def separates(graph, cut):
    left = graph.copy()
    left.remove_nodes_from(cut)
    return not nx.has_path(left, "near", "far")


def hidden_behind(graph, cut):
    left = graph.copy()
    left.remove_nodes_from(cut)
    return nx.node_connected_component(left, "far") - {"far"}


@given(divided_graphs())
@settings(max_examples=100, deadline=None)
def test_the_cut_separates_is_smallest_and_nearest_to_the_linear_machines(divided):
    n, edges, near, far = divided
    graph = with_ends(n, edges, near, far)
    cut = set(np.flatnonzero(_vertex_cut(joined(n, edges), near, far)).tolist())
    assert separates(graph, cut)
    connected = nx.has_path(graph, "near", "far")
    size = len(nx.minimum_node_cut(graph, "near", "far")) if connected else 0
    assert len(cut) == size
    for other in combinations(range(n), size):
        if separates(graph, other):
            behind = hidden_behind(graph, other)
            assert hidden_behind(graph, cut) <= behind
            assert cut <= behind | set(other)


@given(divided_graphs())
@settings(max_examples=40, deadline=None)
def test_behind_a_cut_is_what_the_linear_machines_reach_without_it(divided):
    n, edges, near, far = divided
    matrix = joined(n, edges)
    cut = _vertex_cut(matrix, near, far)
    expected = hidden_behind(with_ends(n, edges, near, far), np.flatnonzero(cut).tolist())
    assert set(np.flatnonzero(_behind(matrix, cut, far)).tolist()) == expected - {"near"}


def linear_units(parts, retained):
    return [unit for unit in parts.external_units if unit.bus not in retained]


@pytest.mark.parametrize(("retained", "count"), [((), 2), (NEAR_BOUNDARY, 7)])
def test_ports_of_npcc_are_as_few_as_a_minimum_cut_of_its_graph(npcc, parts, retained, count):
    linear = linear_units(parts, retained)
    ports = find_ports(npcc, linear, parts.study_buses)
    graph = nx.Graph([(b.from_bus, b.to_bus) for b in npcc.case.branches])
    graph.add_edges_from(("far", unit.bus) for unit in linear)
    near = set(parts.study_buses) | set(retained)
    graph.add_edges_from(("near", bus) for bus in near)
    assert len(ports.buses) == count == len(nx.minimum_node_cut(graph, "near", "far"))
    assert separates(graph, ports.buses)
    assert ports.inside == hidden_behind(graph, ports.buses)
    assert ports.units == tuple(linear)
    assert not ports.inside & near
    assert {unit.bus for unit in linear} <= ports.inside | set(ports.buses)


def test_branches_out_of_service_join_nothing(npcc, parts):
    out = build_timeline(npcc.case, [gf.BranchTrip("29-37")], 1.0)[-1].state
    ports = find_ports(npcc.for_state(out), parts.external_units, parts.study_buses)
    assert len(ports.buses) == 1


def test_a_machine_at_a_bus_of_the_study_area_makes_this_bus_a_port(npcc, parts):
    unit = parts.study_units[0]
    ports = find_ports(npcc, [unit], parts.study_buses)
    assert ports.buses == (unit.bus,)
    assert ports.inside == frozenset()


def test_an_area_needs_machines_on_both_sides(npcc, parts):
    with pytest.raises(OptionError, match="machines of its own"):
        find_ports(npcc, [], parts.study_buses)
    with pytest.raises(OptionError, match="others beside it"):
        find_ports(npcc, npcc.layout.source_units, [])


def test_islands_have_no_ports(npcc, parts):
    trips = [gf.BranchTrip("29-37"), gf.BranchTrip("35-73")]
    apart = npcc.for_state(build_timeline(npcc.case, trips, 1.0)[-1].state)
    with pytest.raises(OptionError, match="nothing joins"):
        find_ports(apart, parts.external_units, parts.study_buses)
