"""Several swing buses in one island hold voltage and angle, each its own."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import root

import gridfold as gf

SLACK = gf.Control.SLACK
VOLTAGES = {1: (1.04, 0.0), 4: (0.99, -6.0), 5: (1.01, 2.5)}


def ring(*swinging):
    """A ring of five buses with loads at 2 and 3, and units at 1, 4 and 5."""
    buses = tuple(
        gf.Bus(k, voltage_pu=VOLTAGES.get(k, (1, 0))[0], angle_deg=VOLTAGES.get(k, (1, 0))[1])
        for k in range(1, 6)
    )
    branches = tuple(
        gf.Branch(k, k % 5 + 1, resistance=0.01 * k, reactance=0.08 + 0.01 * k, susceptance=0.04)
        for k in range(1, 6)
    )
    units = tuple(
        gf.Generator(
            k, active_mw=20.0, voltage_pu=v, control=SLACK if k in swinging else gf.Control.VOLTAGE
        )
        for k, (v, _) in VOLTAGES.items()
    )
    loads = (gf.Load(2, active_mw=70, reactive_mvar=20), gf.Load(3, active_mw=50, reactive_mvar=10))
    return gf.Case("ring", buses, branches, units, loads=loads)


def solved_by_scipy(case, swinging):
    """Voltages by a general root finder on power balances written out from the circuit."""
    n = len(case.buses)
    y = np.zeros((n, n), dtype=complex)
    for b in case.branches:
        i, j, series = b.from_bus - 1, b.to_bus - 1, 1 / complex(b.resistance, b.reactance)
        y[[i, j], [i, j]] += series + 0.5j * b.susceptance
        y[[i, j], [j, i]] -= series
    power = np.zeros(n, dtype=complex)
    for load in case.loads:
        power[load.bus - 1] -= complex(load.active_mw, load.reactive_mvar) / 100
    for unit in case.generators:
        power[unit.bus - 1] += unit.active_mw / 100

    def voltages(z):
        angle, size = z[:n].copy(), z[n:].copy()
        for bus, (v, degrees) in VOLTAGES.items():
            size[bus - 1] = v
            if bus in swinging:
                angle[bus - 1] = np.deg2rad(degrees)
        return size * np.exp(1j * angle)

    def error(z):
        v = voltages(z)
        balance = v * np.conj(y @ v) - power
        held = np.isin(np.arange(1, n + 1), list(VOLTAGES))
        swing = np.isin(np.arange(1, n + 1), swinging)
        active = np.where(swing, z[:n] - np.angle(v), balance.real)
        reactive = np.where(held, z[n:] - np.abs(v), balance.imag)
        return np.concatenate([active, reactive])

    result = root(error, np.concatenate([np.zeros(n), np.ones(n)]), tol=1e-13)
    assert result.success
    v = voltages(result.x)
    return v, v * np.conj(y @ v)


@pytest.mark.parametrize("swinging", [(1,), (1, 4), (4, 5), (1, 4, 5)])
def test_every_swing_bus_holds_its_voltage_and_angle(swinging):
    case = ring(*swinging)
    flow = gf.solve_power_flow(case)
    voltage, injected = solved_by_scipy(case, swinging)
    np.testing.assert_allclose(flow.voltage, voltage, atol=1e-10)
    for k, unit in enumerate(case.generators):
        assert flow.unit_power[k] == pytest.approx(injected[unit.bus - 1], abs=1e-9)


def test_from_a_flat_start_swing_buses_still_hold_their_angles():
    case = ring(1, 4)
    bad = tuple(
        bus if bus.number in VOLTAGES else replace(bus, voltage_pu=0.2, angle_deg=170.0)
        for bus in case.buses
    )
    flow = gf.solve_power_flow(replace(case, buses=bad))
    np.testing.assert_allclose(flow.voltage, gf.solve_power_flow(case).voltage, atol=1e-10)


def test_swing_buses_at_the_ends_of_one_line_carry_what_their_angles_say():
    """P = V1 V2 sin(d) / x, with nothing else in the grid."""
    buses = (gf.Bus(1, angle_deg=10.0), gf.Bus(2, voltage_pu=0.95))
    units = (gf.Generator(1, control=SLACK), gf.Generator(2, voltage_pu=0.95, control=SLACK))
    case = gf.Case("pair", buses, (gf.Branch(1, 2, reactance=0.2),), units)
    power = 0.95 * np.sin(np.deg2rad(10.0)) / 0.2
    flow = gf.solve_power_flow(case)
    np.testing.assert_allclose(flow.unit_power.real, [power, -power], atol=1e-12)
