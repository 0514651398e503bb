from __future__ import annotations

import numpy as np
import pytest
from area_cases import external_admittance, external_derivatives

import gridfold as gf
from gridfold.dynamics.descriptor import grid_descriptor, node_currents
from gridfold.errors import OptionError
from gridfold.grid.timeline import build_timeline
from gridfold.partition import linearize_external, partition
from gridfold.partition.port_area import area_states, interface_weights, linearize_ports
from gridfold.partition.ports import find_ports

NEAR_BOUNDARY = (42, 50, 51, 78, 134)
MIXED = gf.LoadModel((0.3, 0.3, 0.4))


@pytest.fixture(scope="module")
def mixed():
    return gf.build_model(gf.load_case("npcc"), loads=MIXED)


def area_at(model, retained=NEAR_BOUNDARY, spread=0.0, study=range(1, 37)):
    parts = partition(model, study)
    linear = [unit for unit in parts.external_units if unit.bus not in retained]
    ports = find_ports(model, linear, parts.study_buses)
    x = state_off(model, spread)
    return linearize_ports(ports, model, x, interface_weights(model, ports)), x


def state_off(model, spread):
    return model.x0 + spread * np.random.default_rng(7).standard_normal(model.n_states)


def differences(function, point, h=1e-4):
    """Jacobian by central differences of fourth order."""
    columns = []
    for k in range(len(point)):
        step = np.zeros(len(point))
        step[k] = h
        near = function(point + step) - function(point - step)
        far = function(point + 2 * step) - function(point - 2 * step)
        columns.append((8 * near - far) / (12 * h))
    return np.array(columns).T


def assert_rows_close(found, expected, accuracy):
    scale = np.abs(expected).max(axis=1, keepdims=True) + 1.0
    assert np.abs((found - expected) / scale).max() < accuracy


def beyond_the_ports(model, ports):
    """The same grid, divided at the ports: all buses but those behind them are the study area."""
    outside = {bus.number for bus in model.case.buses} - ports.inside
    divided = partition(model, outside)
    assert divided.boundary_buses == ports.buses
    assert divided.external_units == ports.units
    return divided


def port_voltages(model, ports, x):
    voltages = model.bus_voltages(x[None, :])[0]
    return voltages[[model.case.bus_index[bus] for bus in ports.buses]]


@pytest.mark.parametrize("retained", [(), NEAR_BOUNDARY])
@pytest.mark.parametrize("spread", [0.0, 0.1])
def test_a_and_b_equal_differences_with_the_port_voltages_held(npcc, retained, spread):
    area, x = area_at(npcc, retained, spread)
    divided = beyond_the_ports(npcc, area.ports)
    y, held = external_admittance(divided), port_voltages(npcc, area.ports, x)
    n_ports, index = len(held), area.state_index

    def by_states(part):
        whole = x.copy()
        whole[index] = part
        return external_derivatives(divided, y, whole, held)

    def by_inputs(u):
        return external_derivatives(divided, y, x, held * np.exp(u[n_ports:] + 1j * u[:n_ports]))

    dense = area.system.dense()
    np.testing.assert_array_equal(index, divided.states_of(area.ports.units))
    np.testing.assert_array_equal(area.x0, x[index])
    np.testing.assert_allclose(area.voltage, held, atol=1e-12)
    np.testing.assert_allclose(area.drift, by_states(x[index]), atol=1e-8)
    assert_rows_close(dense.a, differences(by_states, x[index]), 1e-8)
    assert_rows_close(dense.b, differences(by_inputs, np.zeros(2 * n_ports)), 1e-8)


@pytest.mark.parametrize("retained", [(), NEAR_BOUNDARY])
@pytest.mark.parametrize("spread", [0.0, 0.05])
def test_a_and_b_equal_those_of_dense_matrices_with_any_loads(mixed, retained, spread):
    area, x = area_at(mixed, retained, spread)
    divided = beyond_the_ports(mixed, area.ports)
    linear = linearize_external(divided, x=x)
    by_logarithm = np.r_[np.ones(len(area.voltage)), np.abs(area.voltage)]
    np.testing.assert_array_equal(area.state_index, linear.state_index)
    assert_rows_close(area.system.dense().a, linear.system.a, 1e-10)
    assert_rows_close(area.system.b, linear.system.b * by_logarithm, 1e-10)


def node_impedance(model):
    return np.linalg.inv(model.equations.matrix.toarray())


def rows_of(model, buses):
    live = model.equations.live.tolist()
    return [live.index(model.case.bus_index[bus]) for bus in buses]


@pytest.mark.parametrize("retained", [(), NEAR_BOUNDARY])
def test_port_currents_cause_what_the_linear_machines_cause_in_the_rest(npcc, retained):
    area, x = area_at(npcc, retained, 0.1)
    linear = [unit in set(area.ports.units) for unit in npcc.layout.source_units]
    real, imag = np.split(node_currents(npcc, x)[:, linear].sum(axis=1), 2)
    impedance = node_impedance(npcc)
    caused = impedance @ (real + 1j * imag)
    by_ports = impedance[:, rows_of(npcc, area.ports.buses)] @ area.current
    rest = [bus.number for bus in npcc.case.buses if bus.number not in area.ports.inside]
    seen = rows_of(npcc, rest)
    np.testing.assert_allclose(by_ports[seen], caused[seen], atol=1e-10)
    hidden = rows_of(npcc, sorted(area.ports.inside))
    assert np.abs(by_ports[hidden] - caused[hidden]).max() > 0.1


def test_slopes_of_logarithm_and_angle_of_the_port_currents_are_differences(npcc):
    area, x = area_at(npcc, (), 0.1)

    def logarithms(part):
        whole = x.copy()
        whole[area.state_index] = part
        weights = np.eye(2 * len(area.ports.buses))
        moved = linearize_ports(area.ports, npcc, whole, weights)
        found = np.log(moved.current / area.current)
        return np.r_[found.real, found.imag]

    some = np.random.default_rng(1).standard_normal((len(area.x0), 3))
    along = differences(lambda s: logarithms(area.x0 + some @ s), np.zeros(3), 1e-3)
    np.testing.assert_allclose(along, area.log_slopes @ some, atol=1e-8)


@pytest.mark.parametrize("model", ["npcc", "mixed"])
@pytest.mark.parametrize("spread", [0.0, 0.1])
def test_a_common_turn_of_machines_and_ports_changes_nothing(request, model, spread):
    area, _ = area_at(request.getfixturevalue(model), spread=spread)
    angles = np.array([name.startswith("angle:") for name in area.system.input_names])
    assert area.turn.sum() == 34
    moved = area.system.apply(area.turn)[:, 0] + area.system.b[:, angles].sum(axis=1)
    assert np.abs(moved).max() < 1e-10 * np.abs(area.system.b).max()


def test_a_common_turn_turns_the_currents_of_machines_among_impedances(npcc):
    area, _ = area_at(npcc, spread=0.1)
    n_ports = len(area.ports.buses)
    turned = area.log_slopes @ area.turn[:, 0]
    np.testing.assert_allclose(turned, np.repeat([0.0, 1.0], n_ports), atol=1e-10)


def test_outputs_weigh_currents_by_the_voltages_that_they_cause(npcc, parts):
    area, _ = area_at(npcc)
    ports = area.ports
    kept = [unit.bus for unit in npcc.layout.source_units if unit not in set(ports.units)]
    change = np.random.default_rng(3).standard_normal(2 * len(ports.buses))
    caused = node_impedance(npcc)[:, rows_of(npcc, ports.buses)] @ (
        change[: len(ports.buses)] + 1j * change[len(ports.buses) :]
    )
    seen = caused[rows_of(npcc, sorted({*ports.buses, *kept}))]
    weights = interface_weights(npcc, ports)
    assert np.linalg.norm(weights @ change) == pytest.approx(np.linalg.norm(seen), rel=1e-10)
    some = np.random.default_rng(4).standard_normal(len(area.x0))
    logarithm, turn = np.split(area.log_slopes @ some, 2)
    currents = area.current * (logarithm + 1j * turn)
    expected = weights @ np.r_[currents.real, currents.imag]
    np.testing.assert_allclose(area.system.c @ some, expected, atol=1e-10)


def changed(model, *events):
    return model.for_state(build_timeline(model.case, list(events), 1.0)[-1].state)


@pytest.mark.parametrize("model", ["npcc", "npcc_sparse", "mixed"])
@pytest.mark.parametrize(
    "events", [[], [gf.BranchTrip("3-2")], [gf.MachineTrip(78)], [gf.LoadStep(3, active_mw=200.0)]]
)
def test_the_sparse_blocks_of_a_grid_make_its_dense_jacobian(request, model, events):
    model = changed(request.getfixturevalue(model), *events)
    x = state_off(model, 0.05)
    expected = model.jacobian(x)
    found = grid_descriptor(model, x).dense().a
    assert np.abs(found - expected).max() < 1e-9 * np.abs(expected).max()


def test_currents_at_the_nodes_are_those_that_make_the_bus_voltages(npcc):
    model = changed(npcc, gf.MachineTrip(78))
    x = state_off(model, 0.05)
    currents = node_currents(model, x)
    out = model.layout.source_units.index(gf.UnitKey(78, "1"))
    assert not currents[:, [out]].nnz
    real, imag = np.split(currents.sum(axis=1), 2)
    voltages = node_impedance(model) @ (real + 1j * imag)
    expected = model.bus_voltages(x[None, :])[0][model.equations.live]
    np.testing.assert_allclose(voltages, expected, atol=1e-10)


def test_states_of_the_area_are_those_of_its_machines(npcc, parts):
    area, _ = area_at(npcc)
    assert area_states(npcc, area.ports.units).tolist() == parts.states_of(area.ports.units)
    assert len(area.x0) == 34 * 9


@pytest.mark.parametrize("model", ["npcc", "mixed"])
def test_a_machine_that_is_out_neither_turns_nor_is_seen(request, model):
    model = changed(request.getfixturevalue(model), gf.MachineTrip(133))
    area, _ = area_at(model, spread=0.05)
    names = area.system.state_names
    out = np.array([name.endswith(":133:1") for name in names])
    angles = np.array([name.startswith("angle:") for name in area.system.input_names])
    dense = area.system.dense()
    assert area.turn[:, 0].tolist() == [
        float(name.startswith("rotor_angle:") and not name.endswith(":133:1")) for name in names
    ]
    moved = dense.a @ area.turn[:, 0] + dense.b[:, angles].sum(axis=1)
    assert np.abs(moved).max() < 1e-10 * np.abs(dense.b).max()
    assert not dense.a[~out][:, out].any()
    assert not dense.b[out].any()
    assert not area.log_slopes[:, out].any()
    np.testing.assert_array_equal(dense.a[out], -np.eye(len(names))[out])


def test_an_area_may_be_one_machine_at_its_port(npcc, parts):
    area, x = area_at(npcc, [unit.bus for unit in parts.external_units if unit.bus != 78], 0.1)
    assert area.ports.buses == (78,)
    at = npcc.layout.source_units.index(gf.UnitKey(78, "1"))
    currents = node_currents(npcc, x)[:, [at]].toarray()[:, 0]
    real, imag = currents[currents != 0]
    np.testing.assert_allclose(area.current, [real + 1j * imag], rtol=1e-12)
    np.testing.assert_allclose(area.log_slopes @ area.turn[:, 0], [0.0, 1.0], atol=1e-12)


def test_a_bus_without_voltage_or_without_machines_behind_it_is_no_port(npcc, parts):
    ports = find_ports(npcc, parts.external_units, parts.study_buses)
    weights = np.eye(2 * len(ports.buses))
    bus = ports.buses[0]
    faulted = npcc.for_state(build_timeline(npcc.case, [gf.BusFault(bus)], 1.0)[0].state)
    with pytest.raises(OptionError, match=f"bus {bus} is no port"):
        linearize_ports(ports, faulted, npcc.x0, weights)
