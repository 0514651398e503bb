from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from cases import one_machine_infinite_bus

import gridfold as gf
from gridfold.grid.admittance import split_branch
from gridfold.grid.network_state import BranchFaultPoint, NetworkState


def position(case: gf.Case, first: int, second: int) -> int:
    return next(k for k, b in enumerate(case.branches) if {b.from_bus, b.to_bus} == {first, second})


def npcc_states(case: gf.Case) -> dict[str, NetworkState]:
    bus_3 = frozenset(k for k, b in enumerate(case.branches) if 3 in (b.from_bus, b.to_bus))
    bus_21 = frozenset(k for k, b in enumerate(case.branches) if 21 in (b.from_bus, b.to_bus))
    return {
        "intact": NetworkState(),
        "bolted fault": NetworkState(bus_faults=frozenset({(3, 0j)})),
        "fault at a machine": NetworkState(bus_faults=frozenset({(26, 0j)})),
        "fault with impedance": NetworkState(bus_faults=frozenset({(7, 0.01 + 0.05j)})),
        "line out": NetworkState(branches_out=frozenset({position(case, 2, 3)})),
        "inside a line": NetworkState(
            branch_faults=frozenset({BranchFaultPoint(position(case, 29, 37), 0.3, 0j)})
        ),
        "bus without machine isolated": NetworkState(branches_out=bus_3),
        "machine on its own": NetworkState(branches_out=bus_21),
        "machine out": NetworkState(units_out=frozenset({gf.UnitKey(23, "1")})),
        "load step": NetworkState(load_steps=((20, 100 + 30j),)),
    }


NAMES = sorted(npcc_states(gf.load_case("npcc")))


@pytest.mark.parametrize("name", NAMES)
def test_dense_and_sparse_backends_agree_to_1e_10(npcc, npcc_sparse, name):
    state = npcc_states(npcc.case)[name]
    x = npcc.x0 + 0.1 * np.random.default_rng(3).standard_normal(npcc.n_states)
    dense, sparse = npcc.for_state(state), npcc_sparse.for_state(state)
    assert dense.compiled.address == sparse.compiled.address
    np.testing.assert_allclose(sparse.compiled(x), dense.compiled(x), rtol=0, atol=1e-10)


@pytest.mark.parametrize("name", NAMES)
def test_terminal_voltages_of_the_compiled_network_are_those_of_the_bus_equations(npcc, name):
    model = npcc.for_state(npcc_states(npcc.case)[name])
    states = npcc.x0[None, :] + 0.05
    buses, terminals = model.bus_voltages(states)[0], model.terminal_voltages(states)[0]
    index = [npcc.case.bus_index[bus] for bus in model.layout.terminals]
    np.testing.assert_allclose(terminals, buses[index], atol=1e-11)


def test_a_bolted_fault_is_the_limit_of_a_small_impedance(npcc):
    x = npcc.x0
    bolted = npcc.for_state(NetworkState(bus_faults=frozenset({(3, 0j)}))).compiled(x)
    errors = []
    for impedance in (1e-3j, 1e-4j, 1e-5j):
        state = NetworkState(bus_faults=frozenset({(3, impedance)}))
        errors.append(np.abs(npcc.for_state(state).compiled(x) - bolted).max())
    assert errors[0] > 5 * errors[1] > 25 * errors[2] > 0


def test_voltage_at_a_bolted_fault_is_zero_and_elsewhere_it_is_not(npcc):
    model = npcc.for_state(NetworkState(bus_faults=frozenset({(3, 0j)})))
    voltages = model.bus_voltages(npcc.x0[None, :])[0]
    assert voltages[2] == 0
    assert np.abs(np.delete(voltages, 2)).min() > 0.3


@pytest.mark.parametrize(("first", "second"), [(29, 37), (3, 2)])  # a line, a transformer
@pytest.mark.parametrize("impedance", [0j, 0.02j])
def test_a_fault_inside_a_branch_equals_one_at_a_bus_put_into_the_case_there(
    npcc, first, second, impedance
):
    case = npcc.case
    k = position(case, first, second)
    branch = case.branches[k]
    near, far = split_branch(branch, 0.3)
    parts = (
        replace(near, to_bus=999),
        replace(far, from_bus=999),
    )
    with_bus = replace(
        case,
        buses=(*case.buses, gf.Bus(999)),
        branches=(*case.branches[:k], *case.branches[k + 1 :], *parts),
    )
    expected = gf.build_model(with_bus)
    faulted = expected.for_state(NetworkState(bus_faults=frozenset({(999, impedance)})))
    point = BranchFaultPoint(k, 0.3, impedance)
    model = npcc.for_state(NetworkState(branch_faults=frozenset({point})))
    unfaulted = expected.compiled(npcc.x0) - npcc.compiled(npcc.x0)
    difference = faulted.compiled(npcc.x0) - model.compiled(npcc.x0)
    # Splitting a line with charging changes it a little even without a fault.
    tolerance = 1e-8 if branch.susceptance == 0 else max(2e-2, 10 * np.abs(unfaulted).max())
    assert np.abs(difference).max() < tolerance


def test_a_tripped_branch_is_a_branch_that_is_not_there(npcc):
    k = position(npcc.case, 29, 37)
    voltage = npcc.power_flow.voltage
    model = npcc.for_state(NetworkState(branches_out=frozenset({k})))
    dropped = (*npcc.case.branches[:k], *npcc.case.branches[k + 1 :])
    gone = replace(npcc.case, branches=dropped)
    flow = replace(npcc.power_flow, case=gone)
    np.testing.assert_array_equal(flow.voltage, voltage)
    expected = replace(npcc, power_flow=flow).for_state(NetworkState(load_steps=((1, 0j),)))
    np.testing.assert_allclose(
        model.compiled(npcc.x0), expected.compiled(npcc.x0), rtol=0, atol=1e-10
    )


def test_terminal_impedance_of_one_machine_on_an_infinite_bus_is_the_textbook_one():
    model = gf.build_model(one_machine_infinite_bus())
    z = model.equations.terminal_impedance()
    at = model.layout.terminals.index(1)
    y_1, y_2 = 1 / 0.3j, 1 / (0.4j + 0.1j)
    assert z[at, at] == pytest.approx(1 / (y_1 + y_2), rel=1e-12)


def test_a_network_that_is_all_at_zero_voltage_still_has_an_answer():
    model = gf.build_model(one_machine_infinite_bus())
    state = NetworkState(bus_faults=frozenset({(1, 0j), (2, 0j)}))
    for backend in (gf.NetworkBackend.DENSE, gf.NetworkBackend.SPARSE):
        faulted = replace(model, backend=backend).for_state(state)
        derivative = faulted.compiled(model.x0)
        assert derivative[1] == pytest.approx(0.8 / (2 * 3.0))
