"""GENTPJ1, CSVGN1, WSIEG1, IEEEVC, MAXEX2 and MNLEX2: start, transfer functions, limits, records."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from cases import one_machine_infinite_bus
from device_alone import (
    Alone,
    alone_in,
    jacobian_error,
    lag,
    lead_lag,
    machine_with,
    named,
    residual,
)

import gridfold as gf
from gridfold.dynamics.psse_records import Unsupported, device_records
from gridfold.grid.dynamic_records import DynamicData, DynamicRecord

GENTPJ1 = (6.5, 0.03, 0.6, 0.05, 4.0, 0.0, 1.8, 1.7, 0.3, 0.55, 0.25, 0.2, 0.05, 0.3, 0.1)
CSVGN1 = (50.0, 0.1, 0.02, 0.3, 0.05, 0.03, 10.0, 1.0, 0.0, 60.0)
WSIEG1 = (
    0, None, 20.0, 0.1, 0.05, 0.2, 0.3, -0.2, 1.0, 0.0, 0.3, 0.3, 0, 7.0, 0.4, 0, 0.4, 0.3, 0, 0.1,
    0.0, 0, 0.0006, 0, 0, 0, 0, 0.3, 0.25, 0.5, 0.5, 0.8, 0.85, 1.1, 1.05, 0,
)  # fmt: skip
SEXS = (0.1, 10.0, 100.0, 0.05, -3.0, 6.0)
MNLEX2 = (0.1, 1.0, 0.3, 0.5, 0.1, 2.5, 3.0)
MAXEX2 = (1, 2.0, 1.05, 20.0, 1.2, 5.0, 1.5, 2.0, 1.0, 0.02, -0.1)
FREQUENCIES = (0.05j, 0.7j, 9j, -1 + 40j)
NO_IRON = {"saturation_10": 0.0, "saturation_12": 0.0}


def tpj(base: float = 100.0, **changes: float) -> gf.DetailedModel:
    case = one_machine_infinite_bus()
    machine = gf.DeviceRecord("gentpj1", 1, "1", named("gentpj1", GENTPJ1, **changes))
    units = tuple(replace(g, base_mva=base) for g in case.generators)
    return gf.build_model(replace(case, generators=units, devices=(machine, case.devices[1])))


def svc(**changes: float) -> gf.DetailedModel:
    """The compensator at a third bus, on 120 MVA."""
    case = one_machine_infinite_bus()
    unit = gf.Generator(3, "1", active_mw=-0.5, voltage_pu=1.03, base_mva=120.0)
    record = gf.DeviceRecord("csvgn1", 3, "1", named("csvgn1", CSVGN1, **changes))
    lines = (gf.Branch(1, 3, reactance=0.2), gf.Branch(3, 2, reactance=0.2))
    return gf.build_model(
        replace(
            case,
            buses=(*case.buses, gf.Bus(3, voltage_pu=1.03)),
            branches=(*case.branches, *lines),
            generators=(*case.generators, unit),
            devices=(*case.devices, record),
        )
    )


@cache
def excited(**more: tuple[float, ...]) -> gf.DetailedModel:
    records = {"sexs": SEXS, **more}
    return gf.build_model(machine_with({m: named(m, row) for m, row in records.items()}))


def governor(**changes: float) -> Alone:
    built = gf.build_model(machine_with({"wsieg1": named("wsieg1", WSIEG1, **changes)}))
    assert residual(built) < 1e-9
    return alone_in(built, "wsieg1")


EVERY = {
    "gentpj1": tpj,
    "gentpj1 without a q circuit": lambda: tpj(q_open_circuit_time=0.0),
    "csvgn1": svc,
    "limiters": lambda: excited(mnlex2=MNLEX2, maxex2=MAXEX2, ieeevc=(0.01, -0.05)),
}


@pytest.mark.parametrize("name", EVERY)
def test_start_is_an_equilibrium_and_the_jacobian_is_that_of_differences(name):
    built = EVERY[name]()
    assert residual(built) < 2e-9
    x = built.x0 + 0.002 * np.random.default_rng(1).standard_normal(built.n_states)
    assert jacobian_error(built, x) < 1e-6


def test_rotor_of_gentpj1_stands_on_the_saturated_q_axis():
    """Phasor diagram with Xqs = (Xq - Xl) / Sq + Xl, and the field that it needs."""
    machine = alone_in(tpj(), "gentpj1")
    v = machine.u[0, 0] + 1j * machine.u[1, 0]
    at_start = machine.signals(machine.x, machine.u)
    i = np.conj((at_start["active_power"] + 1j * at_start["reactive_power"]) / v)
    m = abs(v + 0.2j * i) + 0.1 * abs(i)
    low, high = np.sqrt(0.05), np.sqrt(0.3 * 1.2)
    root = (high - low) / 0.2
    s = (low + root * (m - 1.0)) ** 2 / m
    s_d, s_q = 1 + s, 1 + 1.7 / 1.8 * s
    angle = np.angle(v + 1j * (1.5 / s_q + 0.2) * i)
    assert at_start["rotor_angle"] == pytest.approx(angle, abs=1e-10)
    turn = np.exp(-1j * (angle - np.pi / 2))
    i_d = (i * turn).real
    field = s_d * ((v * turn).imag + (1.6 / s_d + 0.2) * i_d)
    assert at_start["field_current"] == pytest.approx(field, rel=1e-9)
    same = tpj(base=250.0, **{
        name: GENTPJ1[k] * (2.5 if k >= 6 else 0.4)
        for k, name in enumerate(machine.device.psse_record)
        if name.endswith("reactance") or name in ("inertia", "current_multiplier")
    })  # fmt: skip
    np.testing.assert_allclose(same.x0, tpj().x0, rtol=1e-9)


def test_flux_of_gentpj1_has_its_operational_reactance():
    """Without iron psi''d / Id is (a T'd0 s + Xd - X'') / (1 + s (T'd0 + b T''d0) + s^2 T'd0 T''d0)."""
    machine = alone_in(tpj(**NO_IRON), "gentpj1")
    a, b = 0.3 - 0.25, (1.8 - 0.25) / (0.3 - 0.25)
    for s in FREQUENCIES:
        flux = machine.gain("voltage_real", s, "d_subtransient_flux")
        current = machine.gain("voltage_real", s, "d_current")
        below = 1 + s * (6.5 + 0.03 * b) + s * s * 6.5 * 0.03
        assert flux / current == pytest.approx(-(a * 6.5 * s + 1.55) / below, rel=1e-9)


def test_salient_gentpj1_has_no_transient_voltage_in_the_d_axis():
    built = tpj(q_open_circuit_time=0.0)
    run = gf.simulate(built, [gf.BusFault(1, duration=0.05)], 1.0)
    assert np.abs(run.signal("d_transient_voltage", ["1:1"])).max() == 0.0


def test_svc_gives_the_power_of_the_power_flow_and_follows_its_diagram():
    unit = alone_in(svc(), "csvgn1")
    at_start = unit.signals(unit.x, unit.u)
    assert at_start["active_power"] == pytest.approx(-0.005, rel=1e-9)
    v = np.hypot(*unit.u[:2, 0])
    given = 0.6 - 1.2 * at_start["reactor"]
    assert at_start["reactive_power"] == pytest.approx(given * v**2, rel=1e-9)
    angle = np.arctan2(unit.u[1, 0], unit.u[0, 0])
    for s in FREQUENCIES:
        found = np.cos(angle) * unit.gain("voltage_real", s, "reactor")
        found += np.sin(angle) * unit.gain("voltage_imag", s, "reactor")
        regulator = 50.0 * lead_lag(s, 0.1, 0.3) * lead_lag(s, 0.02, 0.05)
        assert found == pytest.approx(regulator * lag(s, 0.03), rel=1e-9)


@pytest.mark.parametrize(("scale", "value"), [(1.2, 1.0), (0.8, 10.0 / 120.0)])
def test_reactor_of_the_svc_stops_at_its_limits(scale, value):
    unit = alone_in(svc(), "csvgn1")
    u = scale * unit.u
    x = unit.run(u, 2.0)[-1]
    assert unit.signals(x, u)["reactor"] == pytest.approx(value, abs=5e-3)
    susceptance = 0.6 - 1.2 * value
    power = unit.signals(x, u)["reactive_power"]
    assert power == pytest.approx(susceptance * np.hypot(*u[:2, 0]) ** 2, rel=2e-2)


def test_svc_holds_the_voltage_along_a_run():
    """The susceptance that the run shows in the network is that of the reactor."""
    built = svc()
    run = gf.simulate(built, [gf.BranchTrip("1-2", time=0.1)], 2.0)
    v = np.abs(run.bus_voltage([3])[:, 0])
    given = run.signal("reactive_power", ["3:1"])[:, 0]
    wanted = (0.6 - 1.2 * np.clip(run.signal("reactor", ["3:1"])[:, 0], 1 / 12, 1.0)) * v**2
    late = run.times > 0.2
    np.testing.assert_allclose(given[late], wanted[late], atol=5e-3)
    assert np.ptp(given) > 0.05


def test_wsieg1_has_the_transfer_function_of_its_diagram_beyond_the_dead_band():
    unit = governor()
    gate = unit.signals(unit.x, unit.u)["gate"]
    assert unit.gain("speed", 2j, "mechanical_power") == 0.0
    beyond = Alone(unit.device, unit.x, unit.inputs(speed=0.001), unit.p)
    slope = (0.85 - 0.5) / (0.8 - 0.5)
    power = 0.5 + slope * (gate - 0.5)
    assert power == pytest.approx(0.8 / (0.3 + 0.4 + 0.3), rel=1e-9)
    for s in FREQUENCIES:
        moved = -20.0 * lead_lag(s, 0.05, 0.1) * lag(s, 0.2)
        chest = slope * moved * lag(s, 0.3)
        reheater = chest * lag(s, 7.0)
        expected = 0.3 * chest + 0.4 * reheater + 0.3 * reheater * lag(s, 0.4)
        found = beyond.gain("speed", s, "mechanical_power")
        assert found == pytest.approx(expected, rel=1e-9)
    without = governor(dead_band=0.0)
    assert abs(without.gain("speed", 2j, "mechanical_power")) > 1.0
    rates = beyond.rates(beyond.x, beyond.u)
    assert rates["governor_signal"] == pytest.approx(0.001 / 0.1, rel=1e-9)


def test_gate_of_wsieg1_moves_no_faster_than_its_rates_and_stays_in_its_range():
    unit = governor()
    row = unit.device.states.index("gate")
    for slip, rate, end in ((-0.2, 0.3, 1.0), (0.2, -0.2, 0.0)):
        gates = np.array([x[row, 0] for x in unit.run(unit.inputs(speed=slip), 8.0, step=4e-3)])
        assert np.abs(np.diff(gates) / 4e-3).max() == pytest.approx(abs(rate), rel=1e-6)
        assert gates[-1] == pytest.approx(end, abs=1e-2)


@pytest.mark.parametrize(
    ("changes", "slip"),
    [
        ({"blocking_code": 1.0}, 0.05),
        ({"blocking_code": 2.0, "highest_gate": 0.0}, -0.05),
        ({"blocking_code": 3.0, "highest_gate": 0.0}, 0.05),
    ],
)
def test_blocking_holds_the_gate_of_the_start(changes, slip):
    unit = governor(**changes)
    row = unit.device.states.index("gate")
    x = unit.run(unit.inputs(speed=slip), 3.0, step=4e-3)[-1]
    assert x[row, 0] == pytest.approx(unit.x[row, 0], abs=1e-9)


def test_without_points_the_curve_of_wsieg1_is_left_out():
    points = {f"curve_{kind}_{k}": 0.0 for kind in ("gate", "power") for k in range(1, 6)}
    unit = governor(**points)
    at_start = unit.signals(unit.x, unit.u)
    assert at_start["gate"] == pytest.approx(at_start["chest_power"], rel=1e-12)


@pytest.mark.parametrize(
    ("changes", "match"),
    [
        ({"gate_backlash": 0.01}, "a hysteresis is not modelled"),
        ({"blocking_code": 4.0}, "IBLOCK is 0, 1, 2 or 3, not 4"),
        ({"curve_power_3": 0.1}, "PGV1 to PGV5 have to rise"),
    ],
)
def test_wrong_parameters_of_wsieg1_are_refused(changes, match):
    with pytest.raises(gf.CaseError, match=match):
        governor(**changes)


@pytest.mark.parametrize("impedance", [(0.0, 0.08), (0.03, -0.05)])
def test_exciter_sees_the_voltage_that_the_compensator_gives(impedance):
    built = excited(ieeevc=impedance)
    machine = alone_in(built, "genrou")
    v = machine.u[0, 0] + 1j * machine.u[1, 0]
    found = machine.signals(machine.x, machine.u)
    i = np.conj((found["active_power"] + 1j * found["reactive_power"]) / v)
    expected = abs(v + complex(*impedance) * i)
    assert alone_in(built, "sexs").u[0, 0] == pytest.approx(expected, rel=1e-12)
    assert abs(expected - abs(v)) > 1e-3


def test_what_feeds_an_exciter_is_the_terminal_voltage_whatever_it_measures():
    scrx = (0.1, 10.0, 100.0, 0.05, -3.0, 6.0, 0, 10.0)
    records = {"scrx": named("scrx", scrx), "ieeevc": named("ieeevc", (0.0, 0.08))}
    exciter = alone_in(gf.build_model(machine_with(records)), "scrx")
    by_name = dict(zip(exciter.device.inputs, exciter.u[:, 0], strict=True))
    assert by_name["supply_voltage"] == pytest.approx(1.02, rel=1e-12)
    assert by_name["terminal_voltage"] > 1.03


def test_underexcitation_limiter_follows_its_circle_and_feedback():
    """At an operating point outside of the circle; its slope in Q is -2 (Qo V^2 - Q)."""
    built = excited(mnlex2=(*MNLEX2[:4], 0.5, 0.4, 0.6))
    limiter = alone_in(built, "mnlex2")
    found = limiter.signals(limiter.x, limiter.u)["underexcitation_signal"]
    v, p, q = limiter.u[:, 0]
    error = (0.4 * v**2 - q) ** 2 + p**2 - (0.6 * v**2) ** 2
    assert found == pytest.approx(0.3 * error, rel=1e-9)
    assert 0 < found < 0.5
    for s in FREQUENCIES:
        slope = -2 * (0.4 * v**2 - q)
        loop = 0.3 / (1 + 0.5 * s)
        expected = slope * loop / (1 + loop * 0.1 * s / (1 + s))
        gain = limiter.gain("reactive_power", s, "underexcitation_signal")
        assert gain == pytest.approx(expected, rel=1e-9)


def test_underexcitation_limiter_is_idle_within_its_circle_and_stops_at_its_limit():
    limiter = alone_in(excited(mnlex2=MNLEX2, maxex2=MAXEX2, ieeevc=(0.01, -0.05)), "mnlex2")
    inside = limiter.run(limiter.inputs(reactive_power=0.2), 3.0)[-1]
    assert limiter.signals(inside, limiter.u)["underexcitation_signal"] == 0.0
    outside = limiter.inputs(reactive_power=-1.2)
    x = limiter.run(outside, 6.0)[-1]
    assert limiter.signals(x, outside)["underexcitation_signal"] == pytest.approx(0.1, abs=2e-3)


@pytest.mark.parametrize(("excess", "seconds"), [(1.1, 15.0), (1.3, 4.0), (2.0, 2.0)])
def test_overexcitation_limiter_acts_after_the_time_of_its_curve(excess, seconds):
    """Times between the points (1.05, 20 s), (1.2, 5 s) and (1.5, 2 s) on straight lines."""
    limiter = alone_in(excited(maxex2=MAXEX2), "maxex2")
    u = limiter.u.copy()
    u[1, 0] = 2.0 * excess
    states = limiter.run(u, 1.3 * seconds, step=5e-3)
    signal = np.array([limiter.signals(x, u)["overexcitation_signal"] for x in states[::4]])
    times = 0.02 * np.arange(len(signal))
    begun = times[signal < -1e-6]
    assert begun[0] == pytest.approx(seconds, rel=0.02, abs=0.1)
    rate = (signal[-1] - signal[np.searchsorted(times, begun[0])]) / (times[-1] - begun[0])
    assert rate == pytest.approx(0.02 * (1.0 - excess), rel=0.05)
    u[1, 0] = 2.0 * 0.5
    back = limiter.run(u, 30.0, x=states[-1], step=1e-2)[-1]
    assert limiter.signals(back, u)["overexcitation_signal"] == pytest.approx(0.0, abs=1e-6)


def test_limiters_lower_and_raise_what_the_exciter_holds():
    built = excited(mnlex2=MNLEX2, maxex2=MAXEX2, ieeevc=(0.01, -0.05))
    x = built.x0.copy()
    x[built.state_names.index("overexcitation_state:1:1")] = -0.04
    x[built.state_names.index("underexcitation_state:1:1")] = 0.03
    change = (built.compiled(x) - built.compiled(built.x0)) * 0.05 / 100.0
    rows = [
        built.state_names.index(f"{name}:1:1") for name in ("exciter_voltage", "lead_lag_state")
    ]
    assert change[rows[0]] == pytest.approx(0.1 * -0.01, rel=1e-6)


@pytest.mark.parametrize(
    ("exciter", "made", "outcome"),
    [
        ("SEXS", ["genrou 1:1", "sexs 1:1", "ieeevc 1:1", "mnlex2 1:1", "maxex2 1:1"], None),
        (
            "ESST4B",
            ["genrou 1:1", "esst4b 1:1", "ieeevc 1:1"],
            "left out, ESST4B takes it at a gate",
        ),
        (None, ["genrou 1:1"], "left out, the unit has no exciter for it"),
    ],
)
def test_records_of_limiters_need_an_exciter_that_adds_their_signals(exciter, made, outcome):
    case = one_machine_infinite_bus()
    genrou = (6.5, 0.05, 0.6, 0.06, 5.0, 1.0, 1.8, 1.75, 0.3, 0.5, 0.25, 0.15, 0.05, 0.3)
    rows = {"GENROU": genrou, "IEEEVC": (0.0, 0.05), "MNLEX2": MNLEX2, "MAXEX2": MAXEX2}
    if exciter is not None:
        rows[exciter] = SEXS if exciter == "SEXS" else (0.0,) * 17
    records = [DynamicRecord(m, 1, "1", values, k) for k, (m, values) in enumerate(rows.items(), 1)]
    records.append(DynamicRecord("GENCLS", 2, "1", (0.0, 0.0), 9))
    data = DynamicData("own.dyr", tuple(records))
    found = device_records(case, data, unsupported=Unsupported.DROP)
    assert [str(r) for r in found.records if r.bus == 1] == made
    told = {item.model: item.outcome for item in found.replaced}
    assert {told.get(model) for model in ("MNLEX2", "MAXEX2")} == {outcome}
