"""Branches without impedance: the power flow is that of the case with one bus in their place."""

from dataclasses import replace

import numpy as np
import pytest

import gridfold as gf

SLACK, VOLTAGE = gf.Control.SLACK, gf.Control.VOLTAGE


def merged():
    """Slack at 1, a station of two units and a load at 2, a load and a shunt at 3."""
    return gf.Case(
        "merged",
        (gf.Bus(1, angle_deg=3.0), gf.Bus(2, voltage_pu=1.02), gf.Bus(3)),
        (
            gf.Branch(1, 2, resistance=0.01, reactance=0.08, susceptance=0.05),
            gf.Branch(1, 3, reactance=0.12, ratio=0.97, shift_deg=4.0),
            gf.Branch(2, 3, resistance=0.02, reactance=0.15, susceptance=0.03),
        ),
        (
            gf.Generator(1, voltage_pu=1.04, control=SLACK),
            gf.Generator(2, "1", 50.0, voltage_pu=1.02, share=2.0),
            gf.Generator(2, "2", 20.0, voltage_pu=1.02, share=1.0),
        ),
        loads=(gf.Load(2, active_mw=30.0), gf.Load(3, active_mw=90.0, reactive_mvar=30.0)),
        shunts=(gf.Shunt(3, susceptance_mvar=20.0),),
    )


def split():
    """The same with bus 2 as buses 2, 20 and 21, each with a part of what stands there."""
    case = merged()
    line_1, transformer, line_2 = case.branches
    slack, first, second = case.generators
    return replace(
        case,
        buses=(*case.buses, gf.Bus(20, voltage_pu=1.02), gf.Bus(21)),
        branches=(
            line_1,
            transformer,
            replace(line_2, from_bus=21),
            gf.Branch(2, 20),
            gf.Branch(21, 20, "K"),
        ),
        generators=(slack, first, replace(second, bus=20)),
        loads=(replace(case.loads[0], bus=21), case.loads[1]),
    )


def test_the_power_flow_is_that_of_one_bus():
    one, several = gf.solve_power_flow(merged()), gf.solve_power_flow(split())
    np.testing.assert_allclose(several.voltage[:3], one.voltage, atol=1e-12)
    np.testing.assert_allclose(several.voltage[3:], [one.voltage[1]] * 2, atol=1e-12)
    np.testing.assert_allclose(several.unit_power, one.unit_power, atol=1e-12)
    assert several.losses_mw == pytest.approx(one.losses_mw, abs=1e-9)


def test_what_a_joining_branch_has_at_its_ends_counts():
    case = split()
    coupler = replace(
        case.branches[3], susceptance=0.2, from_conductance=0.01, to_susceptance=-0.05
    )
    several = replace(case, branches=(*case.branches[:3], coupler, case.branches[4]))
    one = replace(
        merged(), shunts=(*merged().shunts, gf.Shunt(2, conductance_mw=1.0, susceptance_mvar=15.0))
    )
    found, expected = gf.solve_power_flow(several), gf.solve_power_flow(one)
    np.testing.assert_allclose(found.voltage[:3], expected.voltage, atol=1e-12)


def test_with_the_coupler_open_the_case_is_another_one():
    case = split()
    opened = replace(case.branches[4], in_service=False)
    flow = gf.solve_power_flow(replace(case, branches=(*case.branches[:4], opened)))
    small = [
        replace(b, reactance=1e-9) if b.joins and b.in_service else b for b in case.branches[:4]
    ]
    near = gf.solve_power_flow(replace(case, branches=(*small, opened)))
    np.testing.assert_allclose(flow.voltage, near.voltage, atol=1e-7)
    assert abs(flow.voltage[4] - flow.voltage[1]) > 0.01


@pytest.mark.parametrize("swing", [1, 20])
def test_a_swing_unit_at_any_of_the_joined_buses_holds_the_angle_of_its_own(swing):
    case = split()
    at = {1: (1.04, 3.0), 20: (1.02, 11.0)}[swing]
    units = tuple(
        replace(unit, control=SLACK if unit.bus == swing else VOLTAGE, active_mw=unit.active_mw + 1)
        for unit in case.generators
    )
    buses = tuple(replace(b, angle_deg=11.0 if b.number == 20 else b.angle_deg) for b in case.buses)
    flow = gf.solve_power_flow(replace(case, buses=buses, generators=units))
    place = case.bus_index[swing]
    assert flow.voltage[place] == pytest.approx(at[0] * np.exp(1j * np.deg2rad(at[1])), abs=1e-12)
