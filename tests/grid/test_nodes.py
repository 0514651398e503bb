import numpy as np
import pytest

import gridfold as gf
from gridfold.grid.admittance import bus_admittance
from gridfold.grid.islands import island_labels
from gridfold.grid.nodes import joined, node_of_buses


def chain(*joining, out=()):
    """Buses 5, 6, 7, 8 in a row; those of `joining` are joined to the next one."""
    branches = tuple(
        gf.Branch(k, k + 1, reactance=0.0 if k in joining else 0.1, in_service=k not in out)
        for k in (5, 6, 7)
    )
    buses = tuple(gf.Bus(k) for k in (5, 6, 7, 8))
    return gf.Case("chain", buses, branches, (gf.Generator(5, control=gf.Control.SLACK),))


@pytest.mark.parametrize(
    ("joining", "out", "nodes"),
    [
        ((), (), [0, 1, 2, 3]),
        ((6,), (), [0, 1, 1, 3]),
        ((5, 7), (), [0, 0, 2, 2]),
        ((5, 6, 7), (), [0, 0, 0, 0]),
        ((5, 6, 7), (6,), [0, 0, 2, 2]),
    ],
)
def test_a_node_is_named_by_the_first_of_its_buses(joining, out, nodes):
    assert node_of_buses(chain(*joining, out=out)).tolist() == nodes


def test_branches_that_are_open_in_a_network_state_join_nothing():
    assert node_of_buses(chain(5, 6, 7), branches_out={1}).tolist() == [0, 0, 2, 2]


@pytest.mark.parametrize(
    "change", [{"resistance": 1e-9}, {"reactance": 1e-9}, {"ratio": 1.1}, {"shift_deg": 5.0}]
)
def test_an_impedance_a_ratio_or_a_shift_keeps_buses_apart(change):
    assert gf.Branch(1, 2).joins
    assert gf.Branch(1, 2, susceptance=0.3, from_conductance=0.1).joins
    assert not gf.Branch(1, 2, **change).joins


def test_rows_and_columns_of_joined_buses_add_up():
    rng = np.random.default_rng(1)
    dense = rng.normal(size=(4, 4)) + 1j * rng.normal(size=(4, 4))
    nodes = np.array([0, 1, 1, 0])
    spread = np.zeros((4, 4))
    spread[np.arange(4), nodes] = 1.0
    from scipy.sparse import csc_array

    found = joined(csc_array(dense), nodes).toarray()
    np.testing.assert_allclose(found, spread.T @ dense @ spread, atol=1e-15)


@pytest.mark.parametrize("find", [node_of_buses, island_labels, lambda *a: bus_admittance(*a).data])
def test_what_the_branches_of_a_case_give_is_found_once_and_cannot_be_overwritten(find):
    case = chain(6, out=(7,))
    found = find(case)
    assert find(case, [2]) is found
    assert find(case, {1, 2}) is not found
    with pytest.raises(ValueError, match="read-only"):
        found[0] = 7
