"""Loads with devices of their own: IEEL, CIM5 and CIM6 by themselves and in a run."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest
from cases import one_machine_infinite_bus
from device_alone import Alone, alone_in, jacobian_error, named, residual

import gridfold as gf
from gridfold.grid.events import Change
from gridfold.grid.network_state import NetworkState

LOAD = gf.Load(1, "1", active_mw=40.0, reactive_mvar=15.0)
UNIT = "1:load-1"
IEEL = (0.4, 0.1, 0.5, 0.3, 0.1, 0.6, 2.0, -1.8, 2.0, 1.3, 0.0, 2.0, 1.0, 0.4)
CIRCUIT = (0.02, 0.08, 3.0, 0.02, 0.1, 0.05, 0.06)  # Ra, Xa, Xm, R1, X1, R2, X2
REST = (0.0, 1.3, 0.6, 0.0, 0.0, 0.0)  # MBASE, PMULT, H, VI, TI, TB
SATURATION, NO_SATURATION = (1.0, 0.04, 1.2, 0.2), (1.0, 0.0, 1.2, 0.0)
CIM5 = (1, *CIRCUIT, *NO_SATURATION, *REST, 2.0, None)
CIM6 = (2, *CIRCUIT, *SATURATION, *REST, 0.3, 0.2, 0.3, 1.5, 0.2, None)
RECORDS = {"ieel": IEEL, "cim5": CIM5, "cim6": CIM6}
SINGLE = {"rotor_resistance_2": 0.0, "rotor_reactance_2": 0.0}
CAGES = [{}, {"cage_type": 2.0}, SINGLE]
EVERY = pytest.mark.parametrize("model", RECORDS)
FREQUENCIES = (0.3j, 4j, -25j, 2 + 60j)
W0 = 2 * np.pi * 60


def case_with(model: str, **changes: float) -> gf.Case:
    case = one_machine_infinite_bus()
    record = gf.DeviceRecord(model, 1, "load-1", named(model, RECORDS[model], **changes))
    return replace(case, loads=(LOAD,), devices=(*case.devices, record))


@cache
def start_of(model: str) -> gf.DetailedModel:
    return gf.build_model(case_with(model))


def alone(model: str, **changes: float) -> Alone:
    built = gf.build_model(case_with(model, **changes)) if changes else start_of(model)
    return alone_in(built, model)


@EVERY
def test_start_is_an_equilibrium_at_the_power_of_the_load(model):
    built = start_of(model)
    assert residual(built) < 1e-9
    found = alone_in(built, model)
    signals = found.signals(found.x, found.u)
    assert signals["active_power"] == pytest.approx(-0.4, rel=1e-10)
    assert signals["reactive_power"] == pytest.approx(-0.15, rel=1e-10)


@pytest.mark.parametrize("cages", CAGES)
@pytest.mark.parametrize("model", ["cim5", "cim6"])
def test_jacobian_equals_central_differences_off_the_equilibrium(model, cages):
    built = gf.build_model(case_with(model, **cages))
    x = built.x0 + 0.005 * np.random.default_rng(1).standard_normal(built.n_states)
    assert jacobian_error(built, x) < 1e-6


def test_jacobian_of_a_load_by_frequency_equals_central_differences():
    built = start_of("ieel")
    x = built.x0 + 0.02 * np.random.default_rng(2).standard_normal(built.n_states)
    assert jacobian_error(built, x) < 1e-6


def test_power_along_a_run_is_that_of_the_formula():
    """A line with a second circuit is tripped; voltage and frequency at the load change."""
    case = case_with("ieel")
    lines = (*case.branches, replace(case.branches[0], circuit="2", reactance=0.8))
    built = gf.build_model(replace(case, branches=lines))
    run = gf.simulate(built, [gf.BranchTrip("1-2:2", time=0.1)], 3.0)
    v = np.abs(run.bus_voltage([1])[:, 0])
    f = run.signal("bus_frequency_deviation", [UNIT])[:, 0]
    assert np.ptp(v) > 0.01
    assert np.abs(f).max() > 5e-4

    def power(a, n):
        return sum(weight * v**exponent for weight, exponent in zip(a, n, strict=True))

    p, q = power(IEEL[:3], IEEL[8:11]), power(IEEL[3:6], IEEL[11:14])
    wanted = 0.4 * p / p[0] * (1 + 2.0 * f), 0.15 * q / q[0] * (1 - 1.8 * f)
    late = run.times > 0.3  # the part by frequency sees the voltage through its filter
    for name, expected in zip(("active_power", "reactive_power"), wanted, strict=True):
        found = -run.signal(name, [UNIT])[:, 0]
        np.testing.assert_allclose(found[late], expected[late], rtol=0, atol=2e-5)
    every = run.bus_voltage()
    lines_left = gf.grid.admittance.bus_admittance(built.case, {1})
    into_lines = every * np.conj((lines_left @ every.T).T)
    given = run.signal("active_power", ["1:1"])[:, 0]
    np.testing.assert_allclose((given - into_lines[:, 0].real)[late], wanted[0][late], atol=2e-5)


def test_frequency_is_the_derivative_of_the_angle_through_two_lags():
    load = alone("ieel")
    v, theta = 1.02, np.arctan2(load.u[1, 0], load.u[0, 0])
    for s in FREQUENCIES:
        by_real, by_imag = (
            load.gain(name, s, "bus_frequency_deviation")
            for name in ("voltage_real", "voltage_imag")
        )
        found = v * (-np.sin(theta) * by_real + np.cos(theta) * by_imag)
        assert found == pytest.approx(s / W0 / (1 + 0.02 * s) ** 2, rel=1e-9)


def test_loads_without_frequency_have_no_states_and_the_same_voltage_dependence():
    plain = case_with("ieel", active_frequency_factor=0.0, reactive_frequency_factor=0.0)
    built = gf.build_model(plain)
    assert built.n_states == 2
    x = built.x0 + np.array([0.3, 0.0])
    both = np.concatenate([x, start_of("ieel").x0[2:]])
    np.testing.assert_allclose(built.compiled(x), start_of("ieel").compiled(both)[:2], atol=1e-10)


def test_terms_that_add_up_to_nothing_are_refused_with_the_load():
    with pytest.raises(gf.CaseError, match=r"load 1:1: the terms .* add up to 0 at 1\.02 p\.u\."):
        gf.build_model(
            case_with("ieel", active_weight_1=0.0, active_weight_2=0.0, active_weight_3=0.0)
        )


def impedance(s: complex, slip: float, cages: dict[str, float]) -> complex:
    """Of a motor whose slip stays, to phasors that change as exp(s t); saturation is left out."""
    r_a, x_a, x_m, r_1, x_1, r_2, x_2 = CIRCUIT
    whole = s + 1j * W0 * slip
    first, second = 1j * W0 * r_1 / whole, 1j * W0 * r_2 / whole + 1j * x_2
    if cages == SINGLE:
        rotor = first + 1j * x_1
    elif cages:
        rotor = 1j * x_1 + 1 / (1 / first + 1 / second)
    else:
        rotor = 1 / (1 / (first + 1j * x_1) + 1 / second)
    return r_a + 1j * x_a + 1 / (1 / (1j * x_m) + 1 / rotor)


@pytest.mark.parametrize("cages", CAGES)
def test_slip_at_the_start_is_that_of_the_circuit(cages):
    motor = alone("cim5", **cages)
    slip = motor.x[motor.device.states.index("slip"), 0]
    base = 0.4 * 1.3
    drawn = 1.02**2 * base / impedance(0.0, slip, cages).conjugate()
    assert drawn.real == pytest.approx(0.4, rel=1e-9)
    assert 0 < slip < 0.05
    shunt = motor.value("shunt_susceptance")
    assert drawn.imag - shunt * 1.02**2 == pytest.approx(0.15, rel=1e-9)


@pytest.mark.parametrize("cages", CAGES)
def test_current_follows_the_voltage_as_the_circuit_says(cages):
    """At a slip that inertia holds, the Norton current has the transfer function 1/Z'' - 1/Z(s)."""
    motor = alone("cim5", inertia=1e9, **cages)
    slip, base = motor.x[motor.device.states.index("slip"), 0], 0.4 * 1.3
    at_once = impedance(1e12, slip, cages) / base
    for s in FREQUENCIES:
        found = motor.gain("voltage_real", s, "source_real")
        found += 1j * motor.gain("voltage_real", s, "source_imag")
        expected = 1 / at_once - base / impedance(s, slip, cages)
        assert found == pytest.approx(expected, rel=1e-6)


def test_torque_and_load_are_in_balance_at_the_start():
    """Power of the air gap by the circuit; the load takes T0 (1 - s)^2."""
    motor = alone("cim5")
    slip = motor.x[motor.device.states.index("slip"), 0]
    current = 1.02 * 0.4 * 1.3 / impedance(0.0, slip, {})
    gap = 0.4 - abs(current) ** 2 * 0.02 / (0.4 * 1.3)
    assert motor.signals(motor.x, motor.u)["electric_torque"] == pytest.approx(gap, rel=1e-9)
    assert motor.value("load_torque") * (1 - slip) ** 2 == pytest.approx(gap, rel=1e-9)
    other = alone("cim6")
    w = 1 - other.x[other.device.states.index("slip"), 0]
    load = other.value("load_torque") * (0.3 * w**2 + 0.2 * w + 0.2 + 0.3 * w**1.5)
    assert other.signals(other.x, other.u)["electric_torque"] == pytest.approx(load, rel=1e-9)


def test_saturation_takes_reactive_power_that_the_shunt_makes_up_for():
    plain, iron = alone("cim5"), alone("cim5", saturation_1=0.04, saturation_2=0.2)
    assert iron.value("shunt_susceptance") > plain.value("shunt_susceptance") + 1e-3


def test_a_stalled_motor_stands_and_does_not_turn_backwards():
    motor = alone("cim5", torque_exponent=0.0)
    u = motor.inputs(voltage_real=-0.6 * motor.u[0, 0], voltage_imag=-0.6 * motor.u[1, 0])
    slips = np.array([x[1, 0] for x in motor.run(u, 12.0, step=2e-3)])
    assert slips.max() <= 1.0 + 1e-6
    assert slips[-1] == pytest.approx(1.0, abs=5e-3)


def test_base_is_mbase_or_a_multiple_of_the_power():
    by_load, by_base = alone("cim5"), alone("cim5", motor_base=52.0, load_multiple=0.0)
    np.testing.assert_allclose(by_load.x, by_base.x, rtol=1e-12)
    with pytest.raises(gf.CaseError, match=r"base is 0 MVA and must be positive"):
        gf.build_model(case_with("cim5", load_multiple=0.0))


@pytest.mark.parametrize(
    ("changes", "match"),
    [
        ({"cage_type": 3.0}, r"cage_type \(IT\) is 1 or 2, not 3"),
        ({"rotor_reactance_2": 0.0}, r"a second cage has both"),
        ({"saturation_1": 0.3, "saturation_2": 0.1}, r"have to rise"),
    ],
)
def test_wrong_parameters_are_refused(changes, match):
    with pytest.raises(gf.CaseError, match=match):
        gf.build_model(case_with("cim5", **changes))


def test_more_power_than_a_motor_can_draw_is_no_start():
    with pytest.raises(gf.InitializationError, match=r"cim5 1:load-1 has no equilibrium"):
        gf.build_model(case_with("cim5", load_multiple=0.2))


def test_motors_are_no_machines_of_angles_and_keep_no_island_alive():
    case = case_with("cim5")
    third = gf.Bus(3)
    line = gf.Branch(1, 3, reactance=0.05)
    moved = tuple(replace(d, bus=3) if d.model == "cim5" else d for d in case.devices)
    built = gf.build_model(
        replace(
            case,
            buses=(*case.buses, third),
            branches=(*case.branches, line),
            loads=(replace(LOAD, bus=3),),
            devices=moved,
        )
    )
    assert [str(unit) for unit in built.machines] == ["1:1"]
    assert [str(unit) for unit in built.units] == ["1:1", "2:1", "3:load-1"]
    run = gf.simulate(built, [gf.BranchTrip("1-3", time=0.2)], 1.0)
    assert run.status is gf.Status.COMPLETED
    assert np.abs(run.bus_voltage([3])[run.times > 0.2]).max() == 0.0
    assert any("de-energized, 40.0 MW of load lost" in notice.text for notice in run.notices)


@dataclass(frozen=True)
class MotorTrip:
    """What a relay does."""

    id: str = "load-1"

    def changes(self, case: gf.Case) -> list[Change]:
        def apply(state: NetworkState) -> NetworkState:
            return replace(state, units_out=state.units_out | {gf.UnitKey(1, self.id)})

        return [Change(0.2, "motor tripped", apply, (1,))]


@pytest.mark.parametrize("model", ["cim5", "cim6"])
def test_a_motor_that_is_disconnected_draws_nothing(model):
    run = gf.simulate(start_of(model), [MotorTrip()], 0.4)
    assert run.status is gf.Status.COMPLETED
    branch = case_with(model).branches[0]
    voltages = run.bus_voltage([branch.from_bus, branch.to_bus])
    here, there = voltages.T
    flow = (here * np.conj((here - there) / complex(branch.resistance, branch.reactance))).real
    generation = run.signal("active_power", ["1:1"])[:, 0]
    after = run.times > 0.2
    assert flow[after] == pytest.approx(generation[after], abs=1e-9)
    assert flow[0] == pytest.approx(generation[0] - 0.4, abs=1e-9)


@pytest.mark.parametrize("model", ["cim5", "ieel"])
def test_a_common_turn_of_all_angles_changes_nothing(model):
    """Without an infinite bus the grid has the eigenvalue zero of the common angle."""
    case = case_with(model)
    machine = dict(case.devices[0].parameters)
    devices = (case.devices[0], replace(case.devices[0], bus=2, parameters=machine))
    built = gf.build_model(replace(case, devices=(*devices, case.devices[-1])))
    modes = gf.small_signal(built)
    assert modes.common_angle.sum() == 1
    turned = built.x0.copy()
    turned[built.layout.angle_states()] += 0.7
    assert np.abs(built.compiled(turned)).max() < 1e-9


@pytest.mark.parametrize(
    ("record", "match"),
    [
        (
            gf.DeviceRecord("sexs", 1, "load-1", {}),
            r"device of a generator, but 1:load-1 is a load",
        ),
        (gf.DeviceRecord("ieel", 1, "1", {}), r"device of a load, but 1:1 is a generator"),
        (gf.DeviceRecord("ieel", 1, "load-7", {}), r"there is no load 1:load-7"),
    ],
)
def test_a_device_stands_where_it_belongs(record, match):
    case = replace(one_machine_infinite_bus(), loads=(LOAD,))
    case = replace(case, devices=(*case.devices, record))
    faults = [*gf.grid.validation.validate_case(case)]
    if not faults:
        with pytest.raises(gf.CaseError, match=match):
            gf.build_model(case)
    else:
        assert match in faults[0]


def test_a_motor_trips_once_its_voltage_has_been_low_for_its_cycles():
    fault = gf.BusFault(1, start=0.1, duration=0.2)
    for level, cycles, acts in ((0.7, 6.0, True), (0.7, 25.0, False), (0.0, 6.0, False)):
        built = gf.build_model(case_with("cim5", trip_voltage=level, trip_cycles=cycles))
        run = gf.simulate(built, [fault], 0.5)
        told = [(n.time, n.text) for n in run.notices if "motor 1:load-1 tripped" in n.text]
        assert bool(told) == acts
        if acts:
            assert told[0][0] == pytest.approx(0.2, abs=1e-9)
        out = np.isnan(run.signal("slip", [UNIT])[-1, 0])
        assert out == acts


def test_the_breaker_of_a_motor_adds_to_its_delay():
    case = case_with("cim5", trip_voltage=0.7, trip_cycles=3.0, breaker_cycles=6.0)
    run = gf.simulate(gf.build_model(case), [gf.BusFault(1, start=0.1, duration=0.2)], 0.5)
    [when] = [n.time for n in run.notices if "motor 1:load-1 tripped" in n.text]
    assert when == pytest.approx(0.1 + 9 / 60, abs=1e-9)


@pytest.mark.parametrize("model", ["cim5", "cim6", "ieel"])
@pytest.mark.parametrize("share", [0.25, 1.0])
def test_a_share_that_is_shed_leaves_what_the_network_sees(model, share):
    built = start_of(model)
    run = gf.simulate(built, [gf.LoadShed(share, buses="1", time=0.1)], 0.5)
    branch = built.case.branches[0]
    here, there = run.bus_voltage([branch.from_bus, branch.to_bus]).T
    flow = (here * np.conj((here - there) / complex(branch.resistance, branch.reactance))).real
    drawn = -run.signal("active_power", [UNIT])[:, 0]
    balance = run.signal("active_power", ["1:1"])[:, 0] - flow
    assert drawn == pytest.approx(balance, abs=1e-8)
    assert drawn[-1] == pytest.approx(0.4 * (1 - share), rel=0.1, abs=1e-8)


@pytest.mark.parametrize("model", ["cim5", "cim6"])
def test_a_share_of_a_motor_is_one_of_two_motors(model):
    case = case_with(model)
    values = case.devices[-1].parameters
    parts = tuple(
        replace(LOAD, id=name, active_mw=part * 40, reactive_mvar=part * 15)
        for name, part in (("1", 0.75), ("2", 0.25))
    )
    second = gf.DeviceRecord(model, 1, "load-2", values)
    two = gf.build_model(replace(case, loads=parts, devices=(*case.devices, second)))
    fault = gf.BusFault(1, start=0.1, duration=0.1)
    shed = gf.simulate(gf.build_model(case), [gf.LoadShed(0.25, buses="1", time=0.2), fault], 0.6)
    out = gf.simulate(two, [MotorTrip("load-2"), fault], 0.6)
    for name, unit in (("rotor_angle", "1:1"), ("slip", UNIT), ("active_power", UNIT)):
        both = (run.signal(name, [unit]) for run in (shed, out))
        assert np.abs(np.subtract(*both))[shed.times > 0.2].max() < 1e-9
