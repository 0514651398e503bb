"""Branches with hardly an impedance: solved as far as double precision goes, and no further."""

from dataclasses import replace

import numpy as np
import pytest

import gridfold as gf
from gridfold.dynamics.model import good_residual
from gridfold.dynamics.network.real_sparse import solve_with_loads
from gridfold.grid.admittance import bus_admittance
from gridfold.powerflow.rounding import rounding_power

SLACK = gf.Control.SLACK
LOAD_MW, LOAD_MVAR, REACTANCE = 80.0, 20.0, 0.1
PLACES = ("at the slack", "at the load", "in the middle", "twice in the middle")


def line_with(tiny, place):
    """A load at bus 3 behind 0.1 p.u. and `tiny` p.u. in series."""
    half = REACTANCE / 2
    branches = {
        "at the slack": [(1, 2, "1", tiny), (2, 3, "1", REACTANCE)],
        "at the load": [(1, 2, "1", REACTANCE), (2, 3, "1", tiny)],
        "in the middle": [(1, 2, "1", half), (2, 4, "1", tiny), (4, 3, "1", half)],
        "twice in the middle": [(1, 2, "1", half), (4, 3, "1", half)]
        + [(2, 4, circuit, 2 * tiny) for circuit in "12"],
    }[place]
    numbers = (1, 2, 3, 4) if place.endswith("middle") else (1, 2, 3)
    return gf.Case(
        "line",
        tuple(gf.Bus(number) for number in numbers),
        tuple(gf.Branch(a, b, circuit, reactance=x) for a, b, circuit, x in branches),
        (gf.Generator(1, control=SLACK),),
        loads=(gf.Load(3, active_mw=LOAD_MW, reactive_mvar=LOAD_MVAR),),
    )


def at_the_load(x):
    """The upper solution of v^4 + (2 q x - 1) v^2 + x^2 (p^2 + q^2) = 0 and its angle."""
    p, q = LOAD_MW / 100, LOAD_MVAR / 100
    half = 0.5 - q * x
    v = np.sqrt(half + np.sqrt(half**2 - x**2 * (p**2 + q**2)))
    return v * np.exp(-1j * np.arcsin(p * x / v))


def reactive_loss(x):
    """x I^2 of the line."""
    return x * (LOAD_MW**2 + LOAD_MVAR**2) / 1e4 / abs(at_the_load(x)) ** 2


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("power", range(3, 12))
def test_voltages_are_right_however_small_an_impedance_is(place, power):
    tiny = 10.0**-power
    flow = gf.solve_power_flow(line_with(tiny, place))
    allowed = max(1e-10, 100 * 2.3e-16 / tiny * 4)
    assert abs(flow.voltage[2] - at_the_load(REACTANCE + tiny)) < 0.1 * allowed + 1e-11
    assert flow.mismatch < allowed
    assert flow.unit_power[0].real == pytest.approx(0.8, abs=allowed)


def test_what_rounding_may_leave_grows_with_admittance_and_voltage():
    case = line_with(1e-7, "in the middle")
    voltage = np.array([1.0, 0.9, 0.8, 0.7]) * np.exp(0.3j)
    expected = [
        20 * 1.9,
        (20 + 1e7) * 0.9 + 20 + 1e7 * 0.7,
        20 * 1.5,
        (1e7 + 20) * 0.7 + 1e7 * 0.9 + 16,
    ]
    expected = 100 * np.finfo(float).eps * np.array(expected) * np.abs(voltage)
    np.testing.assert_allclose(rounding_power(bus_admittance(case), voltage), expected, rtol=1e-12)


def test_elsewhere_the_tolerance_stays():
    case = line_with(1e-3, "in the middle")
    flow = gf.solve_power_flow(case)
    assert flow.mismatch <= 1e-10
    with pytest.raises(gf.PowerFlowError, match="did not converge"):
        gf.solve_power_flow(replace(case, loads=(gf.Load(3, active_mw=600.0),)))
    tiny = line_with(1e-9, "in the middle")
    with pytest.raises(gf.PowerFlowError, match="did not converge"):
        gf.solve_power_flow(replace(tiny, loads=(gf.Load(3, active_mw=600.0),)))


@pytest.mark.parametrize("tiny", [1e-7, 1e-9, 1e-11])
def test_a_machine_behind_hardly_an_impedance_starts_at_rest(tiny):
    case = line_with(tiny, "in the middle")
    machine = gf.DeviceRecord("classical", 1, "1", {"inertia": 3.0, "transient_reactance": 0.2})
    model = gf.build_model(replace(case, devices=(machine,)))
    assert not [line for line in model.warnings if line.startswith("at the start")]
    allowed = max(1e-8, 100 * np.finfo(float).eps * 4 / tiny)
    assert good_residual(model.power_flow) <= allowed
    assert np.abs(model.compiled(model.x0)).max() < allowed


@pytest.mark.parametrize("power", range(5, 11))
def test_a_load_of_constant_power_behind_hardly_an_impedance_has_its_voltage(power):
    tiny, behind = 10.0**-power, 0.2j
    case = line_with(tiny, "in the middle")
    machine = gf.DeviceRecord("classical", 1, "1", {"inertia": 3.0, "transient_reactance": 0.2})
    loads = gf.LoadModel.parse("1,0,0")
    model = gf.build_model(replace(case, devices=(machine,)), loads=loads)
    power_1 = LOAD_MW / 100 + 1j * (LOAD_MVAR / 100 + reactive_loss(REACTANCE + tiny))
    source = (1 + behind * np.conj(power_1)) / behind
    nonlinear = model.injections.nonlinear
    voltage = solve_with_loads(model.equations, np.array([source, 0]), nonlinear, np.array([1]))
    at_load = voltage[model.equations.terminals[1]]
    assert abs(at_load - at_the_load(REACTANCE + tiny)) < max(1e-10, 1e-16 / tiny * 10)
