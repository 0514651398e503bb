"""Loads that are no impedances in a batch: each member has the voltages of its own network."""

from __future__ import annotations

import numpy as np
import pytest

import gridfold as gf
from gridfold.dynamics.batch.block_factors import block_factors
from gridfold.dynamics.batch.change import NetworkChange, NetworkChanges
from gridfold.dynamics.batch.rhs import batch_rhs
from gridfold.grid.network_state import BranchFaultPoint, NetworkState

BUS = 9
STATES = (
    NetworkState(),
    NetworkState(bus_faults=frozenset({(BUS, 0j)})),
    NetworkState(bus_faults=frozenset({(BUS, 0.01 + 0.02j)})),
    NetworkState(branches_out=frozenset({3, 40})),
    NetworkState(units_out=frozenset({gf.UnitKey(21, "1")})),
    NetworkState(load_steps=((BUS, 100 - 20j), (12, 30j))),
    NetworkState(load_shed=((BUS, 0.6), (12, 0.3))),
    NetworkState(branch_faults=frozenset({BranchFaultPoint(30, 0.7, 0.01j)})),
)


@pytest.fixture(scope="module")
def mixed(npcc: gf.DetailedModel) -> gf.DetailedModel:
    return gf.build_model(npcc.case, loads=gf.LoadModel((0.4, 0.4, 0.2)))


def change_of(model: gf.DetailedModel, state: NetworkState) -> NetworkChange | None:
    if state == model.state:
        return None
    index, out = model.case.bus_index, state.units_out
    live = [index[unit.bus] for unit in model.layout.source_units if unit not in out]
    return NetworkChanges(model.equations).change(model.for_state(state).equations, live)


@pytest.mark.parametrize("state", STATES[1:])
def test_compensation_between_the_factors_gives_the_changed_network(
    mixed: gf.DetailedModel, state: NetworkState
) -> None:
    rng, n = np.random.default_rng(3), len(mixed.case.buses)
    slopes = rng.standard_normal((n, 2, 2))
    factors = block_factors(mixed.equations, slopes)
    change = change_of(mixed, state)
    assert change is not None
    path, drawn, caused = factors.compensation(change)
    assert len(path) <= len(change.buses) * factors.longest_path() < factors.n_rows

    there = mixed.for_state(state).equations
    y = np.zeros((n, n), dtype=complex)
    y[np.ix_(there.live, there.live)] = there.matrix.toarray()
    alive = np.zeros(n, dtype=bool)
    alive[there.live] = True
    real = np.zeros((n, 2, n, 2))
    real[:, 0, :, 0], real[:, 0, :, 1], real[:, 1, :, 0], real[:, 1, :, 1] = (
        y.real, -y.imag, y.imag, y.real,
    )  # fmt: skip
    real[np.arange(n), :, np.arange(n), :] -= slopes
    real = real[alive][:, :, alive].reshape(2 * alive.sum(), -1)
    current = rng.standard_normal((n, 2)) * alive[:, None]
    known = np.linalg.solve(real, current[alive].ravel()).reshape(-1, 2)

    lower, upper = triangles(factors)
    rows = factors.rows
    injected = np.zeros((factors.n_rows, 2))
    injected[rows] = current
    behind = np.linalg.solve(lower, injected.ravel()).reshape(-1, 2)
    currents = -np.einsum("pak,pa->k", drawn, behind[path])
    behind[path] += np.einsum("pak,k->pa", caused, currents)
    found = np.linalg.solve(upper, behind.ravel()).reshape(-1, 2)[rows]
    assert np.abs(found[alive] - known).max() < 1e-9 * np.abs(known).max()
    assert np.abs(found[~alive]).max(initial=0.0) < 1e-12 * np.abs(known).max()


def triangles(factors) -> tuple[np.ndarray, np.ndarray]:
    """L and U as full matrices."""
    n, starts, nodes = factors.n_rows, factors.tree.starts, factors.tree.nodes
    blocks = factors.blocks.reshape(-1, 2, 2)
    lower, upper = np.zeros((2, n, 2, n, 2))
    for k in range(n):
        lower[k, :, k], upper[k, :, k] = np.eye(2), np.linalg.inv(blocks[k])
        for e in range(starts[k], starts[k + 1]):
            lower[nodes[e], :, k] = blocks[n + e]
            upper[k, :, nodes[e]] = blocks[n + len(nodes) + e]
    return lower.reshape(2 * n, -1), upper.reshape(2 * n, -1)


@pytest.mark.parametrize("members", [8, 16])
def test_members_have_the_derivatives_of_their_own_networks(
    mixed: gf.DetailedModel, members: int
) -> None:
    rng = np.random.default_rng(1)
    states = mixed.x0[:, None] * (1 + 0.01 * rng.standard_normal((mixed.n_states, members)))
    batch = batch_rhs(mixed, members, rank=4)
    models = [mixed.for_state(STATES[member % len(STATES)]) for member in range(members)]
    for member, model in enumerate(models):
        change = change_of(mixed, model.state)
        batch.put(member, change, model.state.units_out, model.injections.nonlinear)
    for _ in range(2):
        found = batch.compiled(states.ravel()).reshape(-1, members)
        for member, model in enumerate(models):
            alone = model.compiled(states[:, member])
            assert np.abs(found[:, member] - alone).max() < 1e-9 * np.abs(alone).max()


def test_a_member_without_a_solution_leaves_the_others_alone(mixed: gf.DetailedModel) -> None:
    states = np.repeat(mixed.x0[:, None], 8, axis=1)
    states[:, 3] = np.nan
    batch = batch_rhs(mixed, 8, rank=1)
    found = batch.compiled(states.ravel()).reshape(-1, 8)
    others = np.delete(np.arange(8), 3)
    assert np.isnan(found[:, 3]).any()
    assert np.abs(found[:, others]).max() < 1e-8
    states[:, 3] = mixed.x0
    batch.put(3, None, ())
    assert np.abs(batch.compiled(states.ravel())).max() < 1e-8
