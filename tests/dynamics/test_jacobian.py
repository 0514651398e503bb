from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from cases import lossless_classical_system, one_machine_infinite_bus

import gridfold as gf
from gridfold.dynamics.evaluate import derivative_stage, output_stage, source_stage


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


def open_network(model: gf.DetailedModel, x: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, ...]:
    """Derivatives and Norton currents at states x and terminal voltages v, block by block."""
    layout = model.layout
    w = model.signals(x.real[None, :])[0].astype(complex)
    w[: len(x)], w[layout.voltage_start :] = x, v
    dx = np.zeros(len(x), dtype=complex)
    for stage in ("source", "output", "derivative"):
        for block in layout.blocks:
            device, p = block.device, block.parameters.astype(complex)
            states, inputs, y = w[block.state_index], w[block.inputs], w[block.signal_index]
            if stage == "source":
                count = len(device.sources)
                w[block.signal_index[:count]] = source_stage(device, states, p)[:count]
            elif stage == "output":
                w[block.signal_index] = output_stage(device, states, inputs, p, y)
            else:
                dx[block.state_index] = derivative_stage(device, states, inputs, p, y)
    current = np.zeros(len(layout.terminals), dtype=complex)
    both = np.array([current, current])
    for real, imag, terminal in layout.sources:
        both[:, terminal] += w[[real, imag]]
    return dx, both.ravel()


def test_partial_derivatives_are_those_of_the_blocks_evaluated_one_after_the_other(npcc):
    x = npcc.x0 + 0.05 * np.random.default_rng(5).standard_normal(npcc.n_states)
    v = npcc.signals(x[None, :])[0][npcc.layout.voltage_start :]
    found, step, n = npcc.partials(x), 1e-30, len(x)
    slopes = []
    for k in range(n + len(v)):
        both = np.concatenate([x, v]).astype(complex)
        both[k] += step * 1j
        slopes.append([part.imag / step for part in open_network(npcc, both[:n], both[n:])])
    derivatives, currents = (np.array(part).T for part in zip(*slopes, strict=True))
    np.testing.assert_allclose(found.states.toarray(), derivatives[:, :n], atol=1e-10)
    np.testing.assert_allclose(found.voltages.toarray(), derivatives[:, n:], atol=1e-10)
    np.testing.assert_allclose(found.currents.toarray(), currents[:, :n], atol=1e-10)
    assert not currents[:, n:].any()
