import numpy as np

import gridfold as gf
from gridfold.grid.islands import find_islands, island_labels


def parts(labels):
    """Positions of the members of each island."""
    return {tuple(np.flatnonzero(labels == label)) for label in set(labels)}


def test_ring_is_one_island(ring):
    assert parts(island_labels(ring)) == {(0, 1, 2, 3)}


def test_open_branches_part_the_network(ring):
    # without 2-3 (position 2), and with 4-1 (position 4) open: {1, 2} and {3, 4}
    assert parts(island_labels(ring, branches_out={2, 4})) == {(0, 1), (2, 3)}
    assert parts(island_labels(ring, branches_out={2})) == {(0, 1, 2, 3)}


def test_one_of_two_circuits_keeps_buses_together(ring):
    assert parts(island_labels(ring, {1, 2, 4})) == {(0, 1), (2, 3)}
    assert parts(island_labels(ring, {0, 1, 2, 4})) == {(0,), (1,), (2, 3)}


def test_islands_without_a_source_are_not_energized(ring):
    islands = find_islands(ring, {0, 1, 2, 4}, sources=[1, 3])
    assert islands.energized.tolist() == [True, False, True, True]


def test_members_are_bus_numbers(ring):
    islands = find_islands(ring, {0, 1, 2, 4}, sources=[3])
    assert sorted(islands.members(ring).values()) == [[1], [2], [3, 4]]
    assert islands.energized.tolist() == [False, False, True, True]


def test_without_sources_nothing_is_energized(ring):
    assert not find_islands(ring, (), sources=[]).energized.any()


def test_buses_without_branches_are_islands_of_their_own():
    case = gf.Case("apart", (gf.Bus(5), gf.Bus(3)), (), ())
    assert parts(island_labels(case)) == {(0,), (1,)}
