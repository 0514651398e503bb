from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from cases import lossless_classical_system, one_machine_infinite_bus

import gridfold as gf


def central_differences(model: gf.DetailedModel, x: np.ndarray) -> np.ndarray:
    columns = []
    for k in range(model.n_states):
        h = 1e-6 * max(1.0, abs(x[k]))
        ahead, behind = x.copy(), x.copy()
        ahead[k] += h
        behind[k] -= h
        columns.append((model.compiled(ahead) - model.compiled(behind)) / (ahead[k] - behind[k]))
    return np.array(columns).T


def assert_jacobian_is_right(model: gf.DetailedModel, x: np.ndarray) -> None:
    expected = central_differences(model, x)
    scale = np.abs(expected).max(axis=1, keepdims=True) + 1.0
    assert np.abs((model.jacobian(x) - expected) / scale).max() < 1e-6


def test_equals_central_differences_at_the_equilibrium_of_npcc(npcc):
    assert_jacobian_is_right(npcc, npcc.x0)


@pytest.mark.parametrize("seed", [1, 2])
def test_equals_central_differences_away_from_it(npcc, seed):
    x = npcc.x0 + 0.2 * np.random.default_rng(seed).standard_normal(npcc.n_states)
    assert_jacobian_is_right(npcc, x)


def test_equals_central_differences_with_the_sparse_network(npcc_sparse):
    assert_jacobian_is_right(npcc_sparse, npcc_sparse.x0 + 0.01)


def test_equals_central_differences_in_a_faulted_network_with_a_machine_out(npcc):
    unit = gf.UnitKey(23, "2")
    state = replace(npcc.state, units_out=frozenset({unit}), bus_faults=frozenset({(7, 0.01j)}))
    model = npcc.for_state(state)
    assert_jacobian_is_right(model, npcc.x0 + 0.05)
    frozen = [k for k, name in enumerate(model.state_names) if name.endswith(":23:2")]
    assert len(frozen) == 9
    assert not model.jacobian(npcc.x0)[frozen].any()


@pytest.mark.parametrize("case", [one_machine_infinite_bus(1.0), lossless_classical_system()])
def test_equals_central_differences_for_every_other_device(case):
    model = gf.build_model(case)
    assert_jacobian_is_right(model, model.x0 + 0.1)
