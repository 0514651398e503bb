"""The right-hand side of many members: each is the model in its own network state."""

from __future__ import annotations

import numpy as np
import pytest

import gridfold as gf
from gridfold.dynamics.batch.change import NetworkChange, NetworkChanges
from gridfold.dynamics.batch.rhs import batch_rhs
from gridfold.grid.network_state import BranchFaultPoint, NetworkState

BUS = 8
STATES = (
    NetworkState(bus_faults=frozenset({(BUS, 0j)})),
    NetworkState(bus_faults=frozenset({(BUS, 0.01 + 0.02j)})),
    NetworkState(branches_out=frozenset({3, 40})),
    NetworkState(units_out=frozenset({gf.UnitKey(21, "1")})),
    NetworkState(load_steps=((BUS, 100 - 20j), (12, 30j))),
    NetworkState(branch_faults=frozenset({BranchFaultPoint(30, 0.4, 0j)})),
    NetworkState(branch_faults=frozenset({BranchFaultPoint(30, 0.7, 0.01j)})),
)


def change_of(model: gf.DetailedModel, state: NetworkState) -> NetworkChange:
    other = model.for_state(state)
    index, out = model.case.bus_index, state.units_out
    live = [index[unit.bus] for unit in model.layout.source_units if unit not in out]
    found = NetworkChanges(model.equations).change(other.equations, live)
    assert found is not None
    return found


@pytest.mark.parametrize("state", STATES)
def test_a_change_gives_the_impedances_of_the_changed_network(
    npcc: gf.DetailedModel, state: NetworkState
) -> None:
    change = change_of(npcc, state)
    intact = npcc.equations.terminal_impedance()
    there = npcc.for_state(state).equations.terminal_impedance()
    assert len(change.buses) <= 4
    assert np.abs(intact - change.caused @ change.drawn - there).max() < 1e-12


@pytest.mark.parametrize("members", [8, 16])
def test_members_have_the_derivatives_of_their_own_networks(
    npcc: gf.DetailedModel, members: int
) -> None:
    rng = np.random.default_rng(1)
    scatter = 0.01 * rng.standard_normal((npcc.n_states, members))
    states = npcc.x0[:, None] * (1 + scatter)
    batch = batch_rhs(npcc, members, rank=4)
    models = []
    for member in range(members):
        state = STATES[member % len(STATES)]
        batch.put(member, change_of(npcc, state), state.units_out)
        models.append(npcc.for_state(state))
    found = batch.compiled(states.ravel()).reshape(-1, members)
    for member, model in enumerate(models):
        alone = model.compiled(states[:, member])
        assert np.abs(found[:, member] - alone).max() < 1e-9 * np.abs(alone).max()


def test_a_member_that_is_put_back_is_on_the_intact_network_again(npcc: gf.DetailedModel) -> None:
    batch = batch_rhs(npcc, 8, rank=4)
    for state in STATES:
        batch.put(5, change_of(npcc, state), state.units_out)
    batch.put(5, None, ())
    found = batch.compiled(np.repeat(npcc.x0, 8)).reshape(-1, 8)
    assert np.abs(found).max() < 1e-8
