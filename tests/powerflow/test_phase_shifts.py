"""Phase shifts of any size: the network behind is the same, but for its angles."""

from dataclasses import replace

import numpy as np
import pytest

import gridfold as gf
from gridfold.powerflow.angles import shifted_branches

SLACK = gf.Control.SLACK
LOAD_MW, LOAD_MVAR, REACTANCE = 80.0, 20.0, 0.1


def behind_a_transformer(shift_deg, bus_deg=0.0, slack_deg=0.0, reverse=False):
    """A load behind one transformer, on a base of 100 MVA."""
    ends = (2, 1) if reverse else (1, 2)
    shift_deg = -shift_deg if reverse else shift_deg
    return gf.Case(
        "pair",
        (gf.Bus(1, angle_deg=slack_deg), gf.Bus(2, angle_deg=bus_deg)),
        (gf.Branch(*ends, reactance=REACTANCE, shift_deg=shift_deg),),
        (gf.Generator(1, control=SLACK),),
        loads=(gf.Load(2, active_mw=LOAD_MW, reactive_mvar=LOAD_MVAR),),
    )


def at_the_load(shift_deg, slack_deg=0.0):
    """The upper solution of v^4 + (2 q x - 1) v^2 + x^2 (p^2 + q^2) = 0 and its angle."""
    p, q, x = LOAD_MW / 100, LOAD_MVAR / 100, REACTANCE
    half = 0.5 - q * x
    v = np.sqrt(half + np.sqrt(half**2 - x**2 * (p**2 + q**2)))
    return v * np.exp(1j * (np.deg2rad(slack_deg - shift_deg) - np.arcsin(p * x / v)))


@pytest.mark.parametrize("shift_deg", [0, 30, 60, 90, 120, 150, 180, 210, -60, -90, -120, -180])
@pytest.mark.parametrize(("bus_deg", "slack_deg"), [(0, 0), (10, 0), (0, 25), (-40, 170)])
@pytest.mark.parametrize("reverse", [False, True])
def test_a_load_behind_a_shift_has_its_voltage_in_closed_form(
    shift_deg, bus_deg, slack_deg, reverse
):
    case = behind_a_transformer(shift_deg, bus_deg, slack_deg, reverse)
    voltage = gf.solve_power_flow(case).voltage[1]
    assert voltage == pytest.approx(at_the_load(shift_deg, slack_deg), abs=1e-10)


def meshed(seed):
    """Two copies of a random grid, and by how much each bus of the second is turned, in degrees.

    Each branch of the second one shifts by as much as its ends are turned against each other, so that
    its solution is that of the first one, turned. Its stored state is nearly flat.
    """
    rng = np.random.default_rng(seed)
    n = int(rng.integers(4, 10))
    turned = np.array([0, *rng.choice([0, 30, 60, 90, 120, 150, 180, -150, -90], n - 1)], float)
    ends = [(int(rng.integers(0, k)), k) for k in range(1, n)]
    ends += [tuple(map(int, rng.choice(n, 2, replace=False))) for _ in range(2)]
    plain = gf.Case(
        "meshed",
        tuple(gf.Bus(k + 1) for k in range(n)),
        tuple(
            gf.Branch(a + 1, b + 1, str(k), rng.uniform(0, 0.02), rng.uniform(0.02, 0.1))
            for k, (a, b) in enumerate(ends)
        ),
        (
            gf.Generator(1, control=SLACK),
            gf.Generator(2, active_mw=rng.uniform(0, 90), voltage_pu=1.01),
        ),
        loads=tuple(
            gf.Load(k + 1, active_mw=rng.uniform(0, 50), reactive_mvar=rng.uniform(0, 15))
            for k in range(1, n)
        ),
    )
    shifted = replace(
        plain,
        branches=tuple(
            replace(branch, shift_deg=turned[a] - turned[b])
            for branch, (a, b) in zip(plain.branches, ends, strict=True)
        ),
        buses=tuple(replace(bus, angle_deg=rng.uniform(-5, 5)) for bus in plain.buses[:1])
        + tuple(replace(bus, angle_deg=rng.uniform(-8, 8)) for bus in plain.buses[1:]),
    )
    return plain, shifted, turned


@pytest.mark.parametrize("seed", range(20))
def test_a_grid_of_shifts_that_fit_each_other_is_the_grid_without_them_turned(seed):
    plain, shifted, turned = meshed(seed)
    slack = shifted.buses[0].angle_deg
    expected = gf.solve_power_flow(plain).voltage * np.exp(1j * np.deg2rad(turned + slack))
    np.testing.assert_allclose(gf.solve_power_flow(shifted).voltage, expected, rtol=0, atol=1e-9)


def test_idle_angles_follow_the_shifts_along_the_branches_of_least_impedance():
    case = gf.Case(
        "loop",
        tuple(gf.Bus(k) for k in (1, 2, 3, 8, 9)),
        (
            gf.Branch(1, 2, reactance=0.1, shift_deg=90.0),
            gf.Branch(3, 2, reactance=0.1, shift_deg=30.0),
            gf.Branch(1, 3, reactance=5.0, shift_deg=-77.0),
            gf.Branch(1, 2, "2", reactance=0.2, shift_deg=-55.0),
            gf.Branch(2, 3, "9", reactance=0.01, shift_deg=11.0, in_service=False),
            gf.Branch(9, 8, reactance=0.1, shift_deg=180.0),
        ),
        (gf.Generator(1, control=SLACK),),
    )
    angle = np.rad2deg(shifted_branches(case).idle_angles(5))
    assert angle[:3] - angle[0] == pytest.approx([0, -90, -60])
    assert angle[3] - angle[4] == pytest.approx(-180)


def test_a_stored_state_that_follows_the_shifts_is_the_start():
    case = behind_a_transformer(150.0)
    solution = at_the_load(150.0)
    stored = gf.Bus(2, voltage_pu=abs(solution), angle_deg=float(np.rad2deg(np.angle(solution))))
    assert gf.solve_power_flow(case).iterations >= 3
    assert gf.solve_power_flow(replace(case, buses=(case.buses[0], stored))).iterations == 0


def test_a_start_at_the_lower_voltage_does_not_keep_it():
    """Of the two voltages at which the line carries the load the stored one is the wrong one."""
    p, q, x = LOAD_MW / 100, LOAD_MVAR / 100, REACTANCE
    half = 0.5 - q * x
    low = np.sqrt(half - np.sqrt(half**2 - x**2 * (p**2 + q**2)))
    stored = gf.Bus(2, voltage_pu=low, angle_deg=float(-np.rad2deg(np.pi - np.arcsin(p * x / low))))
    inner = replace(stored, angle_deg=float(-np.rad2deg(np.arcsin(p * x / low))))
    for bus in (stored, inner):
        case = replace(behind_a_transformer(0.0), buses=(gf.Bus(1), bus))
        assert gf.solve_power_flow(case).voltage[1] == pytest.approx(at_the_load(0.0), abs=1e-10)
