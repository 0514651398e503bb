from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import root

import gridfold as gf

SLACK, VOLTAGE, POWER = gf.Control.SLACK, gf.Control.VOLTAGE, gf.Control.POWER


def three_buses(load_mw=120.0, load_mvar=40.0, unit_mw=70.0, ratio=0.97, shift_deg=4.0):
    """Slack at 1, generator at 2, load at 3; a phase-shifting transformer from 1 to 3."""
    return gf.Case(
        "three",
        (gf.Bus(1, angle_deg=5.0), gf.Bus(2), gf.Bus(3)),
        (
            gf.Branch(1, 2, resistance=0.01, reactance=0.08, susceptance=0.05),
            gf.Branch(1, 3, reactance=0.12, ratio=ratio, shift_deg=shift_deg),
            gf.Branch(2, 3, resistance=0.02, reactance=0.15, susceptance=0.03),
        ),
        (
            gf.Generator(1, voltage_pu=1.04, control=SLACK),
            gf.Generator(2, active_mw=unit_mw, voltage_pu=1.02),
        ),
        loads=(gf.Load(3, active_mw=load_mw, reactive_mvar=load_mvar),),
        shunts=(gf.Shunt(3, conductance_mw=2.0, susceptance_mvar=20.0),),
    )


def injected(case, voltage):
    """Complex power into the network at each bus, branch by branch from the circuit."""
    v = dict(zip((bus.number for bus in case.buses), voltage, strict=True))
    current = dict.fromkeys(v, 0j)
    for b in case.branches:
        tap = b.ratio * np.exp(1j * np.deg2rad(b.shift_deg))
        behind, far = v[b.from_bus] / tap, v[b.to_bus]
        through = (behind - far) / complex(b.resistance, b.reactance)
        current[b.from_bus] += (through + 0.5j * b.susceptance * behind) / np.conj(tap)
        current[b.to_bus] += -through + 0.5j * b.susceptance * far
    for s in case.shunts:
        current[s.bus] += complex(s.conductance_mw, s.susceptance_mvar) / case.base_mva * v[s.bus]
    return np.array([v[bus] * np.conj(current[bus]) for bus in v])


def solved_by_scipy(case):
    """Voltages of the three-bus case by a general root finder."""
    load = case.loads[0]
    unit_mw = case.generators[1].active_mw

    def voltages(z):
        angle_1 = np.deg2rad(case.buses[0].angle_deg)
        return np.array([1.04 * np.exp(1j * angle_1), 1.02 * np.exp(1j * z[0]), z[1] + 1j * z[2]])

    def mismatch(z):
        power = injected(case, voltages(z)) * case.base_mva
        return [
            power[1].real - unit_mw,
            power[2].real + load.active_mw,
            power[2].imag + load.reactive_mvar,
        ]

    result = root(mismatch, [0.0, 1.0, 0.0], tol=1e-13)
    assert result.success
    return voltages(result.x)


@settings(max_examples=25, deadline=None)
@given(
    st.floats(0.0, 150.0),
    st.floats(-30.0, 60.0),
    st.floats(0.0, 120.0),
    st.floats(0.9, 1.1),
    st.floats(-15.0, 15.0),
)
def test_three_bus_voltages_agree_with_a_general_root_finder(mw, mvar, unit_mw, ratio, shift_deg):
    case = three_buses(mw, mvar, unit_mw, ratio, shift_deg)
    np.testing.assert_allclose(
        gf.solve_power_flow(case).voltage, solved_by_scipy(case), rtol=0, atol=1e-9
    )


def test_the_slack_bus_keeps_its_stored_angle():
    voltage = gf.solve_power_flow(three_buses()).voltage
    assert voltage[0] == pytest.approx(1.04 * np.exp(1j * np.deg2rad(5.0)), abs=1e-12)


def test_generation_load_and_network_balance_at_every_bus():
    case = three_buses()
    flow = gf.solve_power_flow(case)
    balance = np.array([*flow.unit_power, 0]) - flow.load_power
    np.testing.assert_allclose(injected(case, flow.voltage), balance, atol=1e-9)
    assert flow.unit_power[1].real == pytest.approx(0.70, abs=1e-12)


def test_losses_are_those_in_resistances_and_shunts():
    case = three_buses()
    flow = gf.solve_power_flow(case)
    assert flow.losses_mw == pytest.approx(injected(case, flow.voltage).real.sum() * 100, abs=1e-8)
    lossless = replace(
        case, branches=tuple(replace(b, resistance=0.0) for b in case.branches), shunts=()
    )
    assert gf.solve_power_flow(lossless).losses_mw == pytest.approx(0.0, abs=1e-8)


def test_tolerance_bounds_the_mismatch():
    flow = gf.solve_power_flow(three_buses(), tolerance=1e-12)
    assert flow.mismatch <= 1e-12
    assert 1 <= flow.iterations <= 10


def test_units_at_one_bus_share_what_the_bus_generates():
    case = three_buses()
    units = (
        gf.Generator(1, "1", 10.0, 0.0, 1.04, control=SLACK, share=3.0),
        gf.Generator(1, "2", 20.0, 5.0, 1.04, control=SLACK, share=1.0),
        gf.Generator(1, "3", 15.0, 7.0, 1.04, control=VOLTAGE, share=4.0),
        gf.Generator(1, "4", 5.0, 6.0, 1.04, control=POWER),
        gf.Generator(1, "5", 99.0, 99.0, 1.04, control=SLACK, in_service=False),
        case.generators[1],
    )
    alone = gf.solve_power_flow(case)
    shared = gf.solve_power_flow(replace(case, generators=units))
    np.testing.assert_allclose(shared.voltage, alone.voltage, atol=1e-12)
    first, second, held, fixed, out, other = shared.unit_power
    assert first + second + held + fixed == pytest.approx(alone.unit_power[0], abs=1e-12)
    assert held.real == pytest.approx(0.15)
    assert fixed == pytest.approx(0.05 + 0.06j)
    assert out == 0
    assert first.real == pytest.approx(3 * second.real)
    assert first.imag == pytest.approx(3 * second.imag)
    assert held.imag == pytest.approx(4 * second.imag)
    assert other == pytest.approx(alone.unit_power[1], abs=1e-12)


def test_unit_of_fixed_power_acts_as_a_negative_load():
    case = three_buses(load_mw=120.0, load_mvar=40.0)
    split = replace(
        case,
        loads=(
            gf.Load(3, "1", 200.0, 70.0),
            gf.Load(3, "2", 30.0, 5.0),
            gf.Load(3, "3", 500.0, 500.0, in_service=False),
        ),
        generators=(*case.generators, gf.Generator(3, "1", 110.0, 35.0, 0.9, control=POWER)),
    )
    flow = gf.solve_power_flow(split)
    np.testing.assert_allclose(flow.voltage, gf.solve_power_flow(case).voltage, atol=1e-12)
    assert flow.load_power[2] == pytest.approx(2.30 + 0.75j)


def test_branch_out_of_service_carries_nothing():
    case = three_buses(load_mw=40.0, load_mvar=10.0)
    extra = gf.Branch(1, 3, "9", reactance=0.01, in_service=False)
    with_extra = replace(case, branches=(*case.branches, extra))
    np.testing.assert_array_equal(
        gf.solve_power_flow(with_extra).voltage, gf.solve_power_flow(case).voltage
    )


def test_islands_are_solved_each_with_its_slack():
    one = three_buses()
    renamed = {1: 101, 2: 102, 3: 103}
    two = replace(
        one,
        buses=(
            *one.buses,
            *(replace(b, number=renamed[b.number], angle_deg=0.0) for b in one.buses),
        ),
        branches=(
            *one.branches,
            *(
                replace(b, from_bus=renamed[b.from_bus], to_bus=renamed[b.to_bus])
                for b in one.branches
            ),
        ),
        generators=(*one.generators, *(replace(g, bus=renamed[g.bus]) for g in one.generators)),
        loads=(*one.loads, gf.Load(103, active_mw=60.0)),
        shunts=(*one.shunts, *(replace(s, bus=renamed[s.bus]) for s in one.shunts)),
    )
    flow = gf.solve_power_flow(two)
    np.testing.assert_allclose(flow.voltage[:3], gf.solve_power_flow(one).voltage, atol=1e-12)
    other = replace(one, loads=(gf.Load(3, active_mw=60.0),), buses=(gf.Bus(1), *one.buses[1:]))
    np.testing.assert_allclose(flow.voltage[3:], gf.solve_power_flow(other).voltage, atol=1e-12)


def test_a_bus_alone_supplies_its_own_load():
    case = gf.Case(
        "alone",
        (gf.Bus(1),),
        (),
        (gf.Generator(1, voltage_pu=1.05, control=SLACK),),
        loads=(gf.Load(1, active_mw=50.0, reactive_mvar=10.0),),
    )
    flow = gf.solve_power_flow(case)
    assert flow.voltage == pytest.approx([1.05])
    assert flow.unit_power == pytest.approx([0.5 + 0.1j])


def test_a_hopeless_stored_start_is_left_for_a_flat_one():
    case = three_buses()
    wild = replace(
        case, buses=(case.buses[0], gf.Bus(2, angle_deg=170.0), gf.Bus(3, voltage_pu=1e-6))
    )
    np.testing.assert_allclose(
        gf.solve_power_flow(wild).voltage, gf.solve_power_flow(case).voltage, atol=1e-9
    )


def test_a_load_beyond_the_network_names_the_worst_buses_first():
    with pytest.raises(gf.PowerFlowError, match="case three: the power flow did not conv") as error:
        gf.solve_power_flow(three_buses(load_mw=5000.0))
    worst = str(error.value).splitlines()[1]
    assert "bus 3:" in worst
    assert "MW" in worst
    assert "p.u." in worst


def test_a_case_at_fault_is_refused_before_it_is_solved():
    case = three_buses()
    with pytest.raises(gf.CaseError, match="there is no bus 7"):
        gf.solve_power_flow(replace(case, loads=(gf.Load(7),)))


def test_npcc_is_solved_to_rounding(npcc):
    flow = npcc.power_flow
    assert flow.mismatch < 1e-10
    generation = np.zeros(len(npcc.case.buses), dtype=complex)
    for unit, power in zip(npcc.case.generators, flow.unit_power, strict=True):
        generation[npcc.case.bus_index[unit.bus]] += power
    np.testing.assert_allclose(
        injected(npcc.case, flow.voltage), generation - flow.load_power, atol=1e-9
    )


def test_npcc_loses_power(npcc):
    load_mw = 100 * npcc.power_flow.load_power.real.sum()
    assert 0 < npcc.power_flow.losses_mw < 0.03 * load_mw


def test_npcc_unit_at_bus_46_gives_the_reactive_power_of_the_paper(npcc):
    keys = [unit.key for unit in npcc.case.generators]
    power = npcc.power_flow.unit_power[keys.index(gf.UnitKey(46, "1"))]
    assert power.imag == pytest.approx(0.6787, abs=1e-4)
    assert power.real == pytest.approx(1.54, abs=1e-10)


@pytest.mark.parametrize(("bus", "shares"), [(23, (0.55, 0.45)), (54, (0.5, 0.5))])
def test_npcc_twin_units_share_their_bus(npcc, bus, shares):
    powers = [
        power
        for unit, power in zip(npcc.case.generators, npcc.power_flow.unit_power, strict=True)
        if unit.bus == bus
    ]
    for power, share in zip(powers, shares, strict=True):
        assert power.imag == pytest.approx(share * sum(powers).imag)
        assert power.real == pytest.approx(share * sum(powers).real)
