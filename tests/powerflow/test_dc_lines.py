"""Dc lines in the power flow, against the equations of converters written out here."""

from dataclasses import replace
from math import acos, cos, pi, radians, sin, sqrt, tan

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq

import gridfold as gf
from gridfold.grid.dc_lines import (
    DcControl,
    LineControl,
    ThyristorEnd,
    ThyristorLine,
    TransistorEnd,
    TransistorLine,
)
from gridfold.powerflow.thyristor_lines import thyristor_flow
from gridfold.powerflow.transistor_lines import transistor_flow

RECTIFIER = ThyristorEnd(2, 2, 20.0, 5.0, 0.0, 6.0, 230.0, 0.48, 1.02)
INVERTER = ThyristorEnd(3, 2, 22.0, 15.0, 0.0, 5.0, 115.0, 0.95, 1.01)
LINE = ThyristorLine(
    "D", LineControl.POWER, 100.0, 5.0, 250.0, RECTIFIER, INVERTER, compounding_ohm=2.0
)


def dc_voltage(end, ac_pu, angle_deg, current_ka, sign=1):
    """By the mean of the rectified voltage over one of six pulses, commutation included."""
    peak = sqrt(2) * end.base_kv * ac_pu * end.transformer_ratio / end.tap
    angle = radians(angle_deg)
    mean = quad(lambda t: peak * cos(t), angle - pi / 6, angle + pi / 6)[0] / (pi / 3)
    lost = 6 * end.reactance_ohm / (2 * pi) * current_ka  # area of commutation, X I for each pulse
    return end.bridges * (mean - lost - sign * 2 * end.resistance_ohm * current_ka)


def fundamental(end, ac_pu, angle_deg, current_ka):
    """Power drawn by one end from the fundamental of its stepwise current with commutation, MVA."""
    volts = end.base_kv * ac_pu * end.transformer_ratio / end.tap
    start, ripple = radians(angle_deg), sqrt(2) * end.reactance_ohm * current_ka / volts
    end_of = acos(cos(start) - ripple)

    def wave(t):  # current of a phase from the firing of its valve on; 120 degrees later it falls
        rise = (cos(start) - cos(t)) / ripple if t < end_of else 1.0
        return current_ka * rise

    # The valve fires `start` after its voltage crosses; the phase voltage peaks 60 degrees after that.
    def part(kernel):
        up = quad(lambda t: wave(t) * kernel(t), start, end_of)[0]
        flat = quad(lambda t: current_ka * kernel(t), end_of, start + 2 * pi / 3)[0]
        down = quad(lambda t: (current_ka - wave(t)) * kernel(t + 2 * pi / 3), start, end_of)[0]
        return 2 / pi * (up + flat + down)

    in_phase, behind = part(lambda t: cos(t - pi / 3)), part(lambda t: sin(t - pi / 3))
    size = sqrt(3) * volts / sqrt(2)
    return end.bridges * complex(size * in_phase, size * behind)


def test_voltages_and_angles_are_those_of_the_rectified_waves():
    flow = thyristor_flow(LINE, 1.03, 0.98)
    current = flow.current_a / 1000
    alpha, gamma = flow.angles_deg
    sent, received = flow.dc_kv
    assert sent == pytest.approx(dc_voltage(RECTIFIER, 1.03, alpha, current), rel=1e-9)
    assert received == pytest.approx(dc_voltage(INVERTER, 0.98, gamma, current), rel=1e-9)
    assert sent - received == pytest.approx(5.0 * current, rel=1e-12)
    assert received + 2.0 * current == pytest.approx(250.0, rel=1e-12)
    assert flow.power_mva[0].real == pytest.approx(100.0, rel=1e-12)
    assert flow.power_mva[1].real == pytest.approx(-100.0 + 5.0 * current**2, rel=1e-12)


@pytest.mark.parametrize("setting", [40.0, 100.0, 180.0])
def test_reactive_power_is_that_of_the_fundamental_of_the_currents(setting):
    flow = thyristor_flow(replace(LINE, setting=setting), 1.03, 0.98)
    alpha, gamma = flow.angles_deg
    drawn = fundamental(RECTIFIER, 1.03, alpha, flow.current_a / 1000)
    assert flow.power_mva[0] == pytest.approx(drawn, rel=1e-6)
    mirrored = fundamental(INVERTER, 0.98, gamma, flow.current_a / 1000)
    assert flow.power_mva[1] == pytest.approx(complex(-mirrored.real, mirrored.imag), rel=1e-6)


def test_a_negative_power_is_held_at_the_inverter():
    flow = thyristor_flow(replace(LINE, setting=-90.0), 1.03, 0.98)
    assert flow.power_mva[1].real == pytest.approx(-90.0, rel=1e-12)


def test_a_line_may_hold_its_current():
    flow = thyristor_flow(replace(LINE, control=LineControl.CURRENT, setting=420.0), 1.03, 0.98)
    assert flow.current_a == pytest.approx(420.0, rel=1e-12)
    assert flow.power_mva[0].real == pytest.approx(0.42 * (250.0 + 3.0 * 0.42), rel=1e-12)


def test_an_inverter_at_its_least_angle_lets_the_voltage_go():
    flow = thyristor_flow(LINE, 1.03, 0.80)
    assert flow.told == "the inverter is at its least angle"
    assert flow.angles_deg[1] == pytest.approx(15.0, abs=1e-9)
    assert flow.power_mva[0].real == pytest.approx(100.0, rel=1e-12)
    assert flow.dc_kv[1] == pytest.approx(
        dc_voltage(INVERTER, 0.80, 15.0, flow.current_a / 1000), rel=1e-9
    )
    assert flow.dc_kv[1] < 240.0


def test_a_rectifier_at_its_least_angle_leaves_the_current_less_the_margin_to_the_inverter():
    line = replace(LINE, control=LineControl.CURRENT, setting=400.0, margin=0.1)
    flow = thyristor_flow(line, 0.80, 0.98)
    assert flow.told.startswith("the rectifier is at its least angle")
    assert flow.current_a == pytest.approx(360.0, rel=1e-12)
    assert flow.angles_deg[0] == pytest.approx(5.0, abs=1e-9)
    assert flow.dc_kv[0] == pytest.approx(dc_voltage(RECTIFIER, 0.80, 5.0, 0.36), rel=1e-9)
    assert flow.dc_kv[0] - flow.dc_kv[1] == pytest.approx(5.0 * 0.36, rel=1e-9)


def test_below_its_switching_voltage_a_line_holds_the_current_of_its_power():
    flow = thyristor_flow(replace(LINE, switch_kv=230.0), 1.03, 0.80)
    assert flow.current_a == pytest.approx(100.0 / 250.0 * 1000, rel=1e-12)
    assert "below 230 kV" in flow.told


def test_resistance_of_the_converters_is_lost_on_the_dc_side():
    lossy = replace(
        LINE,
        rectifier=replace(RECTIFIER, resistance_ohm=0.5),
        inverter=replace(INVERTER, resistance_ohm=0.4),
    )
    flow = thyristor_flow(lossy, 1.03, 0.98)
    current = flow.current_a / 1000
    alpha, gamma = flow.angles_deg
    assert flow.dc_kv[0] == pytest.approx(
        dc_voltage(lossy.rectifier, 1.03, alpha, current), rel=1e-9
    )
    assert flow.dc_kv[1] == pytest.approx(
        dc_voltage(lossy.inverter, 0.98, gamma, current, sign=-1), rel=1e-9
    )
    lost = (5.0 + 2 * 2 * 0.5 + 2 * 2 * 0.4) * current**2
    assert sum(power.real for power in flow.power_mva) == pytest.approx(lost, rel=1e-9)


@pytest.mark.parametrize("change", [{"control": LineControl.BLOCKED}, {"setting": 0.0}])
def test_a_blocked_line_draws_nothing(change):
    assert thyristor_flow(replace(LINE, **change), 1.03, 0.98).power_mva == (0j, 0j)


def test_converters_that_commutate_without_an_end_have_no_operating_point():
    many = replace(LINE, rectifier=replace(LINE.rectifier, bridges=10**30))
    with pytest.raises(gf.PowerFlowError, match="commutation takes"):
        thyristor_flow(many, 1.03, 0.98)


def test_a_line_that_cannot_carry_its_power_is_named():
    with pytest.raises(gf.PowerFlowError, match='dc line "D": no current carries 9000 MW'):
        thyristor_flow(replace(LINE, setting=-9000.0), 1.03, 0.98)
    with pytest.raises(gf.PowerFlowError, match=r"no operating point at 0\.0100 p\.u\."):
        thyristor_flow(replace(LINE, control=LineControl.CURRENT, setting=3000.0), 0.01, 0.98)


VSC = TransistorLine(
    "V",
    True,
    0.8,
    TransistorEnd(
        2, DcControl.VOLTAGE, 150.0, loss_kw=90.0, loss_kw_per_a=0.15, least_loss_kw=40.0
    ),
    TransistorEnd(3, DcControl.POWER, 80.0, power_factor=0.9, loss_kw=100.0, loss_kw_per_a=0.1),
)


@pytest.mark.parametrize("setting", [80.0, -80.0])
def test_power_of_converters_is_that_of_the_dc_line_and_their_losses(setting):
    line = replace(VSC, second=replace(VSC.second, setting=setting))

    def balance(current):  # kA into the second converter
        far = 150.0 - 0.8 * current
        return far * current - setting - (100.0 + 0.1 * abs(current) * 1000) / 1000

    current = brentq(balance, -2.0, 2.0, xtol=1e-14)
    flow = transistor_flow(line)
    drawn = 150.0 * current + (90.0 + 0.15 * abs(current) * 1000) / 1000
    assert flow.power_mva[0] == pytest.approx(complex(drawn), rel=1e-10)
    assert flow.power_mva[1].real == -setting
    assert flow.power_mva[1].imag == pytest.approx(-setting * tan(acos(0.9)), rel=1e-12)
    assert flow.current_a == pytest.approx(abs(current) * 1000, rel=1e-10)
    assert flow.dc_kv == pytest.approx((150.0, 150.0 - 0.8 * current), rel=1e-10)


def test_reactive_power_by_a_power_factor_ends_at_its_limits_and_its_sign_turns_it():
    end = replace(VSC.second, power_factor=-0.9, reactive_max_mvar=10.0, reactive_min_mvar=-12.0)
    assert transistor_flow(replace(VSC, second=end)).power_mva[1].imag == 12.0
    end = replace(end, power_factor=0.9)
    assert transistor_flow(replace(VSC, second=end)).power_mva[1].imag == -10.0


def test_the_least_loss_counts_and_a_converter_that_is_out_carries_nothing():
    idle = replace(VSC, second=replace(VSC.second, control=DcControl.OUT))
    assert transistor_flow(idle).power_mva == (0.09 + 0j, 0j)
    least = replace(idle, first=replace(VSC.first, loss_kw=0.0))
    assert transistor_flow(least).power_mva == (0.04 + 0j, 0j)


def grid(*lines):
    """A slack at 1, a rectifier at 2, an inverter at 3 with a load and a unit."""
    buses = tuple(gf.Bus(k, base_kv=kv) for k, kv in ((1, 230.0), (2, 230.0), (3, 115.0)))
    branches = (
        gf.Branch(1, 2, reactance=0.05, susceptance=0.1),
        gf.Branch(1, 3, resistance=0.01, reactance=0.2),
    )
    units = (gf.Generator(1, control=gf.Control.SLACK), gf.Generator(3, active_mw=20.0))
    loads = (gf.Load(3, active_mw=110.0, reactive_mvar=20.0),)
    return gf.Case("dc", buses, branches, units, loads=loads, dc_lines=tuple(lines))


def injected(case, voltage):
    power = {}
    for bus in case.buses:
        power[bus.number] = 0j
    for b in case.branches:
        i, j = case.bus_index[b.from_bus], case.bus_index[b.to_bus]
        through = (voltage[i] - voltage[j]) / complex(b.resistance, b.reactance)
        for at, current in ((i, through), (j, -through)):
            total = current + 0.5j * b.susceptance * voltage[at]
            power[case.buses[at].number] += voltage[at] * np.conj(total)
    return power


def test_the_ac_network_carries_what_the_line_draws_at_its_voltages():
    case = grid(LINE)
    flow = gf.solve_power_flow(case)
    power = injected(case, flow.voltage)
    line = thyristor_flow(LINE, *np.abs(flow.voltage[1:]))
    assert power[2] * 100 == pytest.approx(-line.power_mva[0], abs=1e-7)
    balance = flow.unit_power[1] * 100 - complex(110.0, 20.0) - line.power_mva[1]
    assert power[3] * 100 == pytest.approx(balance, abs=1e-7)
    assert flow.dc_flows == (line,)
    lost_dc = 5.0 * (line.current_a / 1000) ** 2
    total = flow.unit_power.real.sum() * 100 - 110.0
    assert flow.losses_mw == pytest.approx(total - lost_dc, abs=1e-7)
    assert flow.notices == (line.text,)
    assert 'dc line "D" draws 100.0 MW +' in line.text
    assert "in a run both ends are constant power" in line.text


def test_a_converter_that_holds_its_voltage_gives_the_reactive_power_for_it():
    line = replace(
        VSC, first=replace(VSC.first, bus=3), second=replace(VSC.second, bus=2, holds_voltage=True)
    )
    case = replace(grid(line), buses=(gf.Bus(1), gf.Bus(2, voltage_pu=1.02), gf.Bus(3)))
    flow = gf.solve_power_flow(case)
    assert abs(flow.voltage[1]) == pytest.approx(1.02, abs=1e-12)
    power = injected(case, flow.voltage)
    assert flow.dc_flows[0].power_mva[1] == pytest.approx(-power[2] * 100, abs=1e-7)
    assert flow.dc_flows[0].power_mva[1].real == pytest.approx(-80.0, abs=1e-9)


FAULTS = [
    ({"rectifier": replace(RECTIFIER, bus=9)}, "there is no bus 9"),
    ({"rectifier": replace(RECTIFIER, bus=3)}, "both of its ends are at one bus"),
    ({"rectifier": replace(RECTIFIER, tap=0.0)}, "at bus 2 tap must be positive, not 0.0"),
    ({"inverter": replace(INVERTER, bridges=0)}, "at bus 3 bridges must be positive, not 0"),
    (
        {"inverter": replace(INVERTER, reactance_ohm=-1.0)},
        "reactance_ohm must be 0 or more, not -1.0",
    ),
    ({"inverter": replace(INVERTER, angle_min_deg=30.0)}, "0 to 90 degrees in this order"),
    ({"setting": float("nan")}, "setting is nan, not a finite number"),
    ({"voltage_kv": 0.0}, "the scheduled dc voltage must be positive, not 0.0"),
    ({"margin": 1.0}, "the margin must be less than 1, not 1.0"),
]


@pytest.mark.parametrize(("change", "fault"), FAULTS)
def test_faults_of_a_line_name_it(change, fault):
    found = gf.validate_case(grid(replace(LINE, **change)))
    assert len(found) == 1
    assert found[0].startswith('dc line "D": ')
    assert fault in found[0]


def test_what_a_blocked_line_gives_does_not_matter():
    blocked = replace(LINE, control=LineControl.BLOCKED, voltage_kv=0.0)
    assert gf.validate_case(grid(replace(blocked, rectifier=replace(RECTIFIER, bridges=0)))) == []


def test_faults_of_voltage_source_converters_name_them():
    both = replace(VSC, second=replace(VSC.second, control=DcControl.VOLTAGE))
    assert gf.validate_case(grid(both)) == [
        'VSC dc line "V": 2 of its converters hold the dc voltage, and one has to'
    ]
    limits = replace(VSC.second, reactive_max_mvar=-5.0, reactive_min_mvar=5.0, power_factor=1.2)
    first = replace(VSC.first, setting=-150.0)
    assert len(gf.validate_case(grid(replace(VSC, first=first, second=limits)))) == 3
    assert gf.validate_case(grid(VSC, VSC)) == ['VSC dc line "V" is given 2 times']


def test_dc_lines_are_part_of_the_fingerprint():
    assert grid(LINE).fingerprint != grid().fingerprint != grid(VSC).fingerprint
