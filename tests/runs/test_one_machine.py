"""Analytic answers for one machine on an infinite bus, and the energy of a lossless system."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from cases import (
    POWER_MW,
    X_GRID,
    X_LINE,
    X_MACHINE,
    H,
    lossless_classical_system,
    one_machine_infinite_bus,
)

import gridfold as gf

BASE_SPEED = 120 * np.pi
P = POWER_MW / 100


@pytest.fixture(scope="module")
def model() -> gf.DetailedModel:
    return gf.build_model(one_machine_infinite_bus())


def internal_angle(model: gf.DetailedModel) -> tuple[float, float]:
    """Angle between the two internal voltages in rad, and the largest transfer in p.u."""
    v = model.power_flow.voltage
    current = (v[0] - v[1]) / (1j * X_LINE)
    machine, grid = v[0] + 1j * X_MACHINE * current, v[1] - 1j * X_GRID * current
    transfer = abs(machine) * abs(grid) / (X_MACHINE + X_LINE + X_GRID)
    return float(np.angle(machine / grid)), float(transfer)


def test_critical_clearing_time_is_that_of_the_equal_area_criterion(model):
    """Fault at the machine's bus: no power during the fault (Kundur 1994, section 13.1)."""
    delta_0, transfer = internal_angle(model)
    assert transfer * np.sin(delta_0) == pytest.approx(P)
    delta_c = np.arccos((np.pi - 2 * delta_0) * np.sin(delta_0) - np.cos(delta_0))
    critical = np.sqrt(4 * H * (delta_c - delta_0) / (BASE_SPEED * P))
    resolution = 0.001
    found = gf.critical_clearing_time(
        model,
        gf.BusFault(1),
        resolution=resolution,
        t_end=5.0,
        stepper=gf.RungeKutta4(0.001),
    )
    assert found.seconds <= critical < found.seconds + resolution
    assert found.bounded


def test_rotor_angle_during_the_fault_is_the_parabola_of_constant_acceleration(model):
    run = gf.simulate(model, [gf.BusFault(1, start=0.5, duration=0.15)], t_end=0.7)
    on = (run.times >= 0.5 - 1e-9) & (run.times <= 0.65 + 1e-9)
    t = run.times[on] - 0.5
    angle = np.deg2rad(run.rotor_angle_deg(["1:1"])[on, 0])
    expected = angle[0] + 0.5 * BASE_SPEED * P / (2 * H) * t**2
    np.testing.assert_allclose(angle, expected, atol=1e-12)


def test_eigenvalues_are_those_of_the_linearized_swing_equation(model):
    delta_0, transfer = internal_angle(model)
    frequency = np.sqrt(transfer * np.cos(delta_0) * BASE_SPEED / (2 * H))
    modes = gf.small_signal(model)
    np.testing.assert_allclose(modes.eigenvalues, [1j * frequency, -1j * frequency], atol=1e-9)
    assert not modes.common_angle.any()
    damped = gf.small_signal(gf.build_model(one_machine_infinite_bus(damping=2.0)))
    real = -2.0 / (4 * H)
    assert damped.rightmost.real == pytest.approx(real, rel=1e-9)
    assert damped.damping_ratio[0] == pytest.approx(-real / frequency, rel=1e-9)
    np.testing.assert_allclose(damped.participation, 1.0, atol=1e-9)


def test_energy_of_a_lossless_classical_system_is_conserved():
    """Kinetic plus potential energy, written out from the internal voltages (Pai 1981, ch. 3)."""
    model = gf.build_model(lossless_classical_system())
    units = model.machines
    start = model.x0.copy()
    start[model.slots("speed", units)] += np.array([0.004, -0.003, 0.002])
    moved = replace(model, x0=start)
    run = gf.simulate(moved, t_end=10.0, stepper=gf.RungeKutta4(0.002), criterion=None)
    assert np.ptp(run.rotor_angle_deg(reference=gf.AngleReference.CENTRE_OF_INERTIA)) > 20
    power = {}
    for block in model.layout.blocks:
        power |= dict(zip(block.device.parameter_rows, block.parameters, strict=True))
    impedance = model.equations.terminal_impedance()
    y = np.array([model.injections.machine[unit] for unit in units])
    reduced = np.diag(y) - y[:, None] * impedance * y[None, :]
    np.testing.assert_allclose(reduced.real, 0, atol=1e-12)
    e, inertia = power["internal_voltage"], model.inertia(units)
    mechanical = model.signals(model.x0[None, :])[0][model.slots("mechanical_power", units)]
    angle = np.deg2rad(run.rotor_angle_deg())
    slip = run.signal("speed") - 1
    kinetic = (inertia * BASE_SPEED * slip**2).sum(axis=1)
    cosines = np.cos(angle[:, :, None] - angle[:, None, :])
    exchanged = 0.5 * np.einsum("i,j,ij,tij->t", e, e, reduced.imag, cosines)
    potential = -angle @ mechanical - exchanged
    energy = kinetic + potential
    assert np.ptp(kinetic) > 1e-2
    assert np.ptp(energy) < 1e-7 * np.ptp(kinetic)
