from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from area_cases import boundary_voltages, external_admittance, external_derivatives

import gridfold as gf
from gridfold.errors import OptionError
from gridfold.grid.timeline import build_timeline
from gridfold.partition import linearize_external, partition


def differences(function, point, h=1e-5):
    """Jacobian by central differences of fourth order."""
    columns = []
    for k in range(len(point)):
        shift = np.zeros(len(point))
        shift[k] = h
        near = function(point + shift) - function(point - shift)
        far = function(point + 2 * shift) - function(point - 2 * shift)
        columns.append((8 * near - far) / (12 * h))
    return np.array(columns).T


def assert_close(found, expected):
    scale = np.abs(expected).max(axis=1, keepdims=True) + 1.0
    assert np.abs((found - expected) / scale).max() < 1e-8


def state_off(npcc, spread):
    return npcc.x0 + spread * np.random.default_rng(11).standard_normal(npcc.n_states)


@pytest.mark.parametrize("spread", [0.0, 0.1])
@pytest.mark.parametrize("study", [range(1, 37), [*range(1, 37), 78, 133, 134]])
def test_a_and_b_equal_differences_of_the_printed_equations(npcc, study, spread):
    parts = partition(npcc, study)
    x = state_off(npcc, spread)
    linear = linearize_external(parts, x=x)
    y = external_admittance(parts)
    boundary = boundary_voltages(parts, npcc, x)
    index = parts.states_of(parts.external_units)
    n_ports = len(parts.boundary_buses)

    def by_states(z):
        whole = x.copy()
        whole[index] = z
        return external_derivatives(parts, y, whole, boundary)

    def by_inputs(u):
        return external_derivatives(parts, y, x, u[n_ports:] * np.exp(1j * u[:n_ports]))

    u0 = np.concatenate([np.angle(boundary), np.abs(boundary)])
    np.testing.assert_allclose(linear.x0, x[index])
    np.testing.assert_allclose(linear.u0, u0, atol=1e-12)
    np.testing.assert_allclose(linear.drift, by_states(x[index]), atol=1e-8)
    assert_close(linear.system.a, differences(by_states, x[index]))
    assert_close(linear.system.b, differences(by_inputs, u0))


@pytest.mark.parametrize("spread", [0.0, 0.1])
def test_a_common_turn_of_all_rotors_and_boundary_angles_changes_nothing(npcc, parts, spread):
    system = linearize_external(parts, x=state_off(npcc, spread)).system
    angles = np.array([name.startswith("rotor_angle:") for name in system.state_names])
    inputs = np.array([name.startswith("angle:") for name in system.input_names])
    assert angles.sum() == 39
    assert inputs.sum() == 2
    turn = system.a[:, angles].sum(axis=1) + system.b[:, inputs].sum(axis=1)
    assert np.abs(turn).max() < 1e-9 * np.abs(system.a).max()


def test_the_external_area_is_stable_and_at_rest_at_the_equilibrium(parts):
    linear = linearize_external(parts)
    assert linear.system.poles.real.max() < -0.1
    assert np.abs(linear.drift).max() < 1e-8
    assert (linear.system.n, linear.system.m, linear.system.p) == (351, 4, 351)


def test_a_boundary_bus_without_voltage_has_no_angle_to_linearize_about(npcc, parts):
    faulted = build_timeline(npcc.case, [gf.BusFault(29, duration=0.1)], 1.0)[0].state
    with pytest.raises(OptionError, match="boundary bus 29"):
        linearize_external(parts, npcc.for_state(faulted), npcc.x0)


def with_joined_buses(reactance):
    """The NPCC system with three short lines at bus 37, outside of the study area."""
    case = gf.load_case("npcc")
    short = {"branch 38-37:1", "branch 39-37:1", "branch 40-37:1"}
    branches = tuple(
        replace(b, resistance=0.0, reactance=reactance) if str(b) in short else b
        for b in case.branches
    )
    return gf.partition(gf.build_model(replace(case, branches=branches)), range(1, 37))


def test_joined_buses_outside_are_as_with_hardly_an_impedance():
    joined, near = (linearize_external(with_joined_buses(x)) for x in (0.0, 1e-7))
    assert joined.system.state_names == near.system.state_names
    np.testing.assert_allclose(joined.system.a, near.system.a, rtol=1e-4, atol=1e-4)
    np.testing.assert_allclose(joined.system.b, near.system.b, rtol=1e-4, atol=1e-4)


def test_a_tie_line_without_impedance_is_refused_in_words():
    case = gf.load_case("npcc")
    branches = tuple(
        replace(b, resistance=0.0, reactance=0.0) if str(b) == "branch 37-29:1" else b
        for b in case.branches
    )
    parts = gf.partition(gf.build_model(replace(case, branches=branches)), range(1, 37))
    with pytest.raises(gf.OptionError, match="joins boundary buses of the study area"):
        linearize_external(parts)
