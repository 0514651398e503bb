"""The machines of PSS/E against circuits, phasor diagrams and one another."""

from __future__ import annotations

import re

import numpy as np
import pytest

import gridfold as gf
from gridfold.dynamics.device import Device
from gridfold.dynamics.evaluate import derivative_stage, output_stage, source_stage
from gridfold.dynamics.machines import gencls, genroe, genrou, gensae, gensal
from gridfold.dynamics.machines.genrou import GENROU
from gridfold.dynamics.machines.gensal import GENSAL
from gridfold.dynamics.registry import DEVICES
from gridfold.numerics.newton import complex_step_jacobian

BASE_SPEED = 2 * np.pi * 60.0
MODELS = DEVICES

ROUND = {
    "d_open_circuit_time": 8.0,
    "d_subtransient_open_circuit_time": 0.03,
    "q_open_circuit_time": 0.4,
    "q_subtransient_open_circuit_time": 0.05,
    "inertia": 6.5,
    "damping": 2.0,
    "d_reactance": 1.8,
    "q_reactance": 1.7,
    "d_transient_reactance": 0.3,
    "q_transient_reactance": 0.55,
    "subtransient_reactance": 0.25,
    "leakage_reactance": 0.2,
    "saturation_10": 0.11,
    "saturation_12": 0.45,
    "resistance": 0.003,
}
SALIENT = {name: ROUND[name] for name in (*gensal.DYR_COLUMNS, "resistance")} | {
    "q_reactance": 1.1,
    "inertia": 3.5,
    "subtransient_reactance": 0.22,
}
CLASSICAL = {"inertia": 3.0, "damping": 1.5, "resistance": 0.01, "reactance": 0.3}
SAMPLES = {
    "gencls": CLASSICAL,
    "genroe": ROUND,
    "genrou": ROUND,
    "gensae": SALIENT,
    "gensal": SALIENT,
}
NO_IRON = {"saturation_10": 0.0, "saturation_12": 0.0}
ALL = pytest.mark.parametrize("model", list(SAMPLES))
DETAILED = pytest.mark.parametrize("model", ["genroe", "genrou", "gensae", "gensal"])


def machine_on_grid(
    model: str,
    parameters: dict[str, float],
    active_mw: float = 80.0,
    voltage: float = 1.02,
    grid_voltage: float = 1.0,
    base_mva: float = 100.0,
) -> gf.DetailedModel:
    """The machine at bus 1, a line, an infinite bus at bus 2."""
    case = gf.Case(
        name=model,
        buses=(gf.Bus(1, voltage_pu=voltage), gf.Bus(2, voltage_pu=grid_voltage)),
        branches=(gf.Branch(1, 2, reactance=0.4),),
        generators=(
            gf.Generator(1, active_mw=active_mw, voltage_pu=voltage, base_mva=base_mva),
            gf.Generator(2, voltage_pu=grid_voltage, control=gf.Control.SLACK),
        ),
        devices=(
            gf.DeviceRecord(model, 1, "1", parameters),
            gf.DeviceRecord("infinite_bus", 2, "1", {"reactance": 0.1}),
        ),
    )
    return gf.build_model(case, devices=MODELS)


def start_of(built: gf.DetailedModel, *names: str) -> list[float]:
    """Signals of the machine at the start."""
    signals = built.signals(built.x0[None, :])[0]
    return [signals[built.slots(name, (gf.UnitKey(1, "1"),))[0]] for name in names]


class Machine:
    """A machine alone, at the rotor angle pi/2 where the network's axes are those of the rotor."""

    def __init__(self, device: Device, parameters: dict[str, float]):
        self.device = device
        values = [parameters[p.name] for p in device.parameters]
        self.p = np.array([*values, BASE_SPEED], dtype=complex)[:, None]
        self.rows = {name: k for k, name in enumerate(device.signal_rows)}
        self.n = len(device.states)

    def evaluate(self, z: np.ndarray) -> np.ndarray:
        """Derivatives and signals at z = states, inputs."""
        x, u = z[: self.n], z[self.n :]
        y = output_stage(self.device, x, u, self.p, source_stage(self.device, x, self.p))
        return np.concatenate([derivative_stage(self.device, x, u, self.p, y), y])

    def linear(self, states: np.ndarray, inputs: np.ndarray):
        """A, B, C, D of the rotor circuits; inputs Vd, Vq, Efd; outputs Id, Iq, Xad Ifd."""
        z = np.concatenate([states, inputs])[:, None]
        jacobian = complex_step_jacobian(self.evaluate, z)[:, :, 0]
        kept, driven = np.arange(2, self.n), self.n + np.arange(3)
        seen = [self.n + self.rows[s] for s in ("d_current", "q_current", "field_current")]
        parts = [np.ix_(rows, columns) for rows in (kept, seen) for columns in (kept, driven)]
        return [jacobian[part] for part in parts]

    def at_no_load(self):
        """Linear rotor circuits with E = 1 in the q axis, which is V = j here."""
        states = np.zeros(self.n)
        states[:3] = np.pi / 2, 1.0, 1.0
        states[self.device.states.index("d_damper_flux")] = 1.0
        return self.linear(states, np.array([0.0, 1.0, 1.0, 0.0]))

    def response(self, frequency: float) -> np.ndarray:
        """From (Vd, Vq, Efd) to (Id, Iq, Xad Ifd) at one frequency, in Hz."""
        a, b, c, d = self.at_no_load()
        s = 2j * np.pi * frequency
        return c @ np.linalg.solve(s * np.eye(len(a)) - a, b) + d


def windings(x: float, x_1: float, x_2: float, x_l: float, t_1: float, t_2: float):
    """Inductances and resistances of a field (or first damper) and a damper, per unit.

    From the standard parameters by their definitions: X' with the first winding closed, X'' with
    both; T'0 with the second winding open, T''0 with the first one closed and without resistance
    (Kundur, 1994, sections 4.1 and 4.2).
    """
    mutual, transient, subtransient = x - x_l, x_1 - x_l, x_2 - x_l
    first = 1 / (1 / transient - 1 / mutual)
    second = 1 / (1 / subtransient - 1 / transient)
    inductance = mutual + np.diag([first, second])
    resistance = np.diag([(mutual + first) / t_1, (second + transient) / t_2]) / BASE_SPEED
    return mutual, inductance, resistance


def axis_response(frequency: float, x: float, x_l: float, mutual, inductance, resistance):
    """Reactance x(s), the gain of the field voltage, and both for the current of winding 1.

    The rotor circuits are solved as they stand: d(psi)/dt = w0 (v - R i), psi = L i - Lad Id.
    """
    s = 2j * np.pi * frequency
    impedance = s * inductance + BASE_SPEED * resistance
    by_stator = np.linalg.solve(impedance, s * mutual * np.ones(2))
    field_scale = resistance[0, 0] / mutual
    by_field = np.linalg.solve(impedance, BASE_SPEED * np.array([field_scale, 0.0]))
    reactance = mutual + x_l - mutual * by_stator.sum()
    return reactance, mutual * by_field.sum(), mutual * by_stator[0], mutual * by_field[0]


FREQUENCIES = np.logspace(-4, 3, 15)


@ALL
def test_start_is_an_equilibrium_at_the_power_flow(model):
    built = machine_on_grid(model, SAMPLES[model])
    assert np.abs(built.compiled(built.x0)).max() < 1e-9
    active, voltage = start_of(built, "active_power", "terminal_voltage")
    assert active == pytest.approx(0.8, abs=1e-11)
    assert voltage == pytest.approx(1.02, abs=1e-11)


@ALL
def test_jacobian_equals_central_differences(model):
    built = machine_on_grid(model, SAMPLES[model])
    offset = np.random.default_rng(3).uniform(-0.05, 0.05, built.n_states)
    for x in (built.x0, built.x0 + offset):
        h = 1e-6
        steps = h * np.eye(len(x))
        expected = [(built.compiled(x + e) - built.compiled(x - e)) / (2 * h) for e in steps]
        scale = 1 + np.abs(expected).max()
        np.testing.assert_allclose(built.jacobian(x), np.transpose(expected), atol=1e-8 * scale)


@ALL
def test_machine_base_does_not_matter(model):
    ratio = 2.5
    device, sample = MODELS[model], SAMPLES[model]
    scales = {p.name: ratio**p.scaling.value for p in device.parameters}
    own_base = {name: value / scales[name] for name, value in sample.items()}
    same = machine_on_grid(model, sample)
    other = machine_on_grid(model, own_base, base_mva=100.0 * ratio)
    x = same.x0 + 0.01
    np.testing.assert_allclose(other.x0, same.x0, rtol=0, atol=1e-11)
    np.testing.assert_allclose(other.compiled(x), same.compiled(x), rtol=0, atol=1e-9)


def test_gencls_is_the_classical_machine():
    built = machine_on_grid("gencls", CLASSICAL)
    named = {name: value for name, value in CLASSICAL.items() if name != "reactance"}
    other = machine_on_grid("classical", named | {"transient_reactance": CLASSICAL["reactance"]})
    x = built.x0 + 0.1
    np.testing.assert_array_equal(built.x0, other.x0)
    np.testing.assert_array_equal(built.compiled(x), other.compiled(x))


@DETAILED
def test_unsaturated_start_is_the_phasor_diagram(model):
    p = SAMPLES[model] | NO_IRON
    built = machine_on_grid(model, p)
    v_r, v_i, active, reactive = start_of(
        built, "voltage_real", "voltage_imag", "active_power", "reactive_power"
    )
    angle, i_d, i_q, field, field_current, power = start_of(
        built,
        "rotor_angle",
        "d_current",
        "q_current",
        "field_voltage",
        "field_current",
        "mechanical_power",
    )
    voltage = v_r + 1j * v_i
    current = np.conj((active + 1j * reactive) / voltage)
    q_axis = voltage + (p["resistance"] + 1j * p["q_reactance"]) * current
    turn = np.exp(-1j * (np.angle(q_axis) - np.pi / 2))
    rotor = current * turn
    excitation = abs(q_axis) + (p["d_reactance"] - p["q_reactance"]) * rotor.real
    assert angle == pytest.approx(np.angle(q_axis), abs=1e-11)
    assert i_d + 1j * i_q == pytest.approx(rotor, abs=1e-11)
    assert field == pytest.approx(excitation, abs=1e-11)
    assert field_current == pytest.approx(field, abs=1e-11)
    assert power == pytest.approx(active + p["resistance"] * abs(current) ** 2, abs=1e-11)


def iron(model: str, p: dict[str, float], flux: float) -> float:
    """S at a flux: a parabola over the flux, or a power of it, through S(1.0) and S(1.2)."""
    if model in ("genroe", "gensae"):
        return p["saturation_10"] * flux ** (
            np.log(p["saturation_12"] / p["saturation_10"]) / np.log(1.2)
        )
    # The parabola through S(1.0) and S(1.2), found here as a linear problem in B and sqrt(B) A.
    low, high = np.sqrt(p["saturation_10"]), np.sqrt(1.2 * p["saturation_12"])
    root_b = (high - low) / 0.2
    return (root_b * flux - (root_b - low)) ** 2 / flux


@pytest.mark.parametrize("model", ["genroe", "genrou", "gensae"])
def test_saturated_start_is_the_phasor_diagram_with_saturated_reactances(model):
    """S(psi'') acts like the reactances Xl + (X - Xl)/(1 + S_axis) and a smaller field."""
    p = SAMPLES[model]
    built = machine_on_grid(model, p)
    v_r, v_i, active, reactive = start_of(
        built, "voltage_real", "voltage_imag", "active_power", "reactive_power"
    )
    voltage = v_r + 1j * v_i
    current = np.conj((active + 1j * reactive) / voltage)
    x_2, x_l = p["subtransient_reactance"], p["leakage_reactance"]
    flux = abs(voltage + (p["resistance"] + 1j * x_2) * current)
    s = iron(model, p, flux)
    s_q = s * (p["q_reactance"] - x_l) / (p["d_reactance"] - x_l)
    x_q = x_2 + (p["q_reactance"] - x_2) / (1 + s_q)
    angle = np.angle(voltage + (p["resistance"] + 1j * x_q) * current)
    turn = np.exp(-1j * (angle - np.pi / 2))
    flux_d = ((voltage + (p["resistance"] + 1j * x_2) * current) * turn).imag
    field = flux_d * (1 + s) + (p["d_reactance"] - x_2) * (current * turn).real
    assert start_of(built, "rotor_angle")[0] == pytest.approx(angle, abs=1e-11)
    assert start_of(built, "field_voltage")[0] == pytest.approx(field, abs=1e-11)


@DETAILED
def test_a_saturation_point_of_zero_means_that_the_iron_does_not_saturate(model):
    """As in PSS/E: neither a parabola from 1.0 on nor anything else."""
    start = [
        start_of(machine_on_grid(model, SAMPLES[model] | points), "field_voltage", "rotor_angle")
        for points in (
            NO_IRON,
            {"saturation_10": 0.0},
            {"saturation_10": 0.0, "saturation_12": 9.0},
        )
    ]
    np.testing.assert_array_equal(start[0], start[1])
    np.testing.assert_array_equal(start[0], start[2])


@DETAILED
def test_equal_saturation_points_are_a_curve_too(model):
    p = SAMPLES[model] | {"saturation_10": 0.2, "saturation_12": 0.2}
    for voltage in (1.0, 1.2):
        built = machine_on_grid(model, p, 0.0, voltage, voltage)
        field = start_of(built, "field_voltage")[0]
        assert field == pytest.approx(voltage * 1.2, abs=1e-11)


@DETAILED
@pytest.mark.parametrize(("voltage", "row"), [(1.0, "saturation_10"), (1.2, "saturation_12")])
def test_open_circuit_field_voltage_has_the_saturation_of_the_record(model, voltage, row):
    p = SAMPLES[model]
    built = machine_on_grid(model, p, 0.0, voltage, voltage)
    field, current = start_of(built, "field_voltage", "d_current")
    assert current == pytest.approx(0.0, abs=1e-12)
    assert field == pytest.approx(voltage * (1 + p[row]), abs=1e-11)


def test_gensal_saturates_with_its_transient_voltage_alone():
    without, with_iron = (machine_on_grid("gensal", SALIENT | more) for more in (NO_IRON, {}))
    names = [n for n in MODELS["gensal"].states if n != "speed"]
    np.testing.assert_allclose(start_of(without, *names), start_of(with_iron, *names), atol=1e-11)
    e_q = start_of(with_iron, "q_transient_voltage")[0]
    low, high = np.sqrt(SALIENT["saturation_10"]), np.sqrt(1.2 * SALIENT["saturation_12"])
    root_b = (high - low) / 0.2
    extra = start_of(with_iron, "field_voltage")[0] - start_of(without, "field_voltage")[0]
    assert extra == pytest.approx((root_b * e_q - (root_b - low)) ** 2, abs=1e-11)


@DETAILED
@pytest.mark.parametrize("frequency", FREQUENCIES)
def test_d_axis_is_the_circuit_of_field_and_damper(model, frequency):
    p = SAMPLES[model] | NO_IRON | {"resistance": 0.0}
    x, x_1, x_2, x_l, t_1, t_2 = (
        p[name]
        for name in (
            "d_reactance",
            "d_transient_reactance",
            "subtransient_reactance",
            "leakage_reactance",
            "d_open_circuit_time",
            "d_subtransient_open_circuit_time",
        )
    )
    reactance, gain, own, field = axis_response(
        frequency, x, x_l, *windings(x, x_1, x_2, x_l, t_1, t_2)
    )
    found = Machine(MODELS[model], p).response(frequency)
    # Vq = psi_d = gain Efd - xd(s) Id
    expected_id = np.array([0.0, -1 / reactance, gain / reactance])
    np.testing.assert_allclose(found[0], expected_id, rtol=1e-9, atol=1e-12)
    expected_field = own * expected_id + np.array([0.0, 0.0, field])
    np.testing.assert_allclose(found[2], expected_field, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("frequency", FREQUENCIES)
def test_q_axis_of_genrou_is_the_circuit_of_two_dampers(frequency):
    p = ROUND | NO_IRON | {"resistance": 0.0}
    x, x_1, x_2, x_l, t_1, t_2 = (
        p[name]
        for name in (
            "q_reactance",
            "q_transient_reactance",
            "subtransient_reactance",
            "leakage_reactance",
            "q_open_circuit_time",
            "q_subtransient_open_circuit_time",
        )
    )
    reactance = axis_response(frequency, x, x_l, *windings(x, x_1, x_2, x_l, t_1, t_2))[0]
    # Vd = -psi_q = xq(s) Iq
    found = Machine(GENROU, p).response(frequency)[1]
    np.testing.assert_allclose(found, [1 / reactance, 0.0, 0.0], rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("frequency", FREQUENCIES)
def test_q_axis_of_gensal_is_one_damper(frequency):
    p = SALIENT | NO_IRON | {"resistance": 0.0}
    s = 2j * np.pi * frequency * p["q_subtransient_open_circuit_time"]
    reactance = (p["q_reactance"] + s * p["subtransient_reactance"]) / (1 + s)
    found = Machine(GENSAL, p).response(frequency)[1]
    np.testing.assert_allclose(found, [1 / reactance, 0.0, 0.0], rtol=1e-9, atol=1e-12)


@DETAILED
def test_short_circuit_current_falls_from_subtransient_over_transient_to_steady(model):
    """A bolted short circuit at no load: Id = E/Xd + two decaying parts, at constant speed.

    The transient current is E/X'd where the damper is much faster than the field.
    """
    field, damper = 8.0, 8e-4
    times = {"d_open_circuit_time": field, "d_subtransient_open_circuit_time": damper}
    p = SAMPLES[model] | NO_IRON | times | {"resistance": 0.0}
    x, x_1, x_2 = (
        p[name] for name in ("d_reactance", "d_transient_reactance", "subtransient_reactance")
    )
    a, b, c, d = Machine(MODELS[model], p).at_no_load()
    drop = -b[:, 1]
    settled = -np.linalg.solve(a, drop)
    rates, modes = np.linalg.eig(a)
    parts = (c[0] @ modes) * np.linalg.solve(modes, -settled)
    steady = c[0] @ settled - d[0, 1]
    keep = np.abs(parts) > 1e-9
    slow, fast = sorted(zip(-1 / rates[keep].real, parts[keep].real, strict=True), reverse=True)
    assert steady == pytest.approx(1 / x, rel=1e-10)
    assert steady + slow[1] + fast[1] == pytest.approx(1 / x_2, rel=1e-10)
    assert steady + slow[1] == pytest.approx(1 / x_1, rel=1e-3)
    assert slow[0] == pytest.approx(field * x_1 / x, rel=1e-3)
    assert fast[0] == pytest.approx(damper * x_2 / x_1, rel=1e-3)


def test_genrou_without_transient_effect_in_the_q_axis_is_gensal():
    """X'q = Xq leaves one damper there; both machines are the same as long as no iron saturates."""
    salient = SALIENT | NO_IRON
    more = {"q_transient_reactance": salient["q_reactance"], "q_open_circuit_time": 0.7}
    disturbed = []
    for model, p in (("gensal", salient), ("genrou", salient | more)):
        built = machine_on_grid(model, p)
        fault = gf.BusFault(1, start=0.0, duration=0.1)
        run = gf.simulate(built, [fault], t_end=0.5)
        disturbed.append([run.signal(name) for name in ("speed", "d_current", "q_current")])
    np.testing.assert_allclose(*disturbed, rtol=0, atol=1e-9)


@DETAILED
def test_torque_balances_mechanical_power_over_speed(model):
    machine = Machine(MODELS[model], SAMPLES[model])
    speed, power = 1.04, 0.7
    states = np.full(machine.n, 0.4)
    states[:3] = np.pi / 2, speed, 1.1
    inputs = np.array([0.3, 0.8, 1.5, power])
    z = np.concatenate([states, inputs])[:, None].astype(complex)
    found = machine.evaluate(z)[:, 0].real
    y = dict(zip(machine.device.signal_rows, found[machine.n :], strict=True))
    p = SAMPLES[model]
    loss = p["resistance"] * (y["d_current"] ** 2 + y["q_current"] ** 2)
    expected = (power - p["damping"] * (speed - 1)) / speed - y["active_power"] - loss
    assert found[1] == pytest.approx(expected / (2 * p["inertia"]), rel=1e-12)
    assert found[0] == pytest.approx(BASE_SPEED * (speed - 1))


@DETAILED
@pytest.mark.parametrize("active", [-1.0, 0.2, 1.0])
@pytest.mark.parametrize("reactive", [-0.3, 0.0, 0.5])
def test_first_guess_meets_all_but_the_field_voltage(model, active, reactive):
    device, p = MODELS[model], SAMPLES[model]
    voltage = 1.05 * np.exp(0.4j)
    known = {
        "voltage_real": np.array([voltage.real]),
        "voltage_imag": np.array([voltage.imag]),
        "active_power": np.array([active]),
        "reactive_power": np.array([reactive]),
    }
    found = device.guess({name: np.array([value]) for name, value in p.items()}, known)
    names = (*device.states, "voltage_real", "voltage_imag", "field_voltage", "mechanical_power")
    z = np.array([np.broadcast_to((known | found)[name], 1) for name in names], dtype=complex)
    machine = Machine(device, p)
    result = machine.evaluate(z)[:, 0].real
    moving = [k for k, name in enumerate(device.states) if name != "q_transient_voltage"]
    np.testing.assert_allclose(result[moving], 0.0, atol=1e-12)
    y = dict(zip(device.signal_rows, result[machine.n :], strict=True))
    assert y["active_power"] == pytest.approx(active, abs=1e-12)
    assert y["reactive_power"] == pytest.approx(reactive, abs=1e-12)


def test_columns_are_those_of_the_dynamics_records():
    modules = (gencls, genroe, genrou, gensae, gensal)
    for module in modules:
        device = MODELS[module.__name__.rpartition(".")[2]]
        names = tuple(parameter.name for parameter in device.parameters)
        assert names[: len(module.DYR_COLUMNS)] == module.DYR_COLUMNS
    assert [len(module.DYR_COLUMNS) for module in modules] == [2, 14, 14, 12, 12]


@ALL
def test_sound_parameters_have_no_fault(model):
    assert list(MODELS[model].check(SAMPLES[model])) == []


@pytest.mark.parametrize(
    ("model", "change", "text"),
    [
        ("gencls", {"inertia": 0.0}, r"inertia \(H\) is 0.*infinite_bus"),
        ("genrou", {"q_transient_reactance": 0.0}, r"\(X'q\) is 0.*GENSAL"),
        ("genrou", {"q_open_circuit_time": 0.0}, r"\(T'q0\) is 0.*GENSAL"),
        ("genrou", {"saturation_12": 0.1}, r"\(S\(1.2\)\) 0.1 is less than .*\(S\(1.0\)\) 0.11"),
        (
            "genrou",
            {"leakage_reactance": 0.3, "subtransient_reactance": 0.3},
            r"\(X'd\) 0.3 must differ from leakage_reactance \(Xl\)",
        ),
        ("gensal", {"saturation_10": 0.5}, r"\(S\(1.2\)\) 0.45 is less than .*\(S\(1.0\)\) 0.5"),
    ],
)
def test_a_parameter_that_cannot_be_is_refused_with_symbol_and_value(model, change, text):
    with pytest.raises(gf.CaseError, match=text):
        machine_on_grid(model, SAMPLES[model] | change)


@pytest.mark.parametrize(
    ("model", "change", "text"),
    [
        ("genrou", {"d_reactance": 0.28}, r"\(Xd\) 0.28 is less than .*\(X'd\) 0.3"),
        ("genrou", {"d_transient_reactance": 0.24}, r"\(X'd\) 0.24 is less than .*\(X''d\) 0.25"),
        ("genrou", {"subtransient_reactance": 0.1}, r"\(X''d\) 0.1 is less than .*\(Xl\) 0.2"),
        ("genrou", {"q_reactance": 0.5}, r"\(Xq\) 0.5 is less than .*\(X'q\) 0.55"),
        ("genrou", {"q_transient_reactance": 0.21}, r"\(X'q\) 0.21 is less than .*\(X''d\) 0.25"),
        ("gensal", {"q_reactance": 0.21}, r"\(Xq\) 0.21 is less than .*\(X''d\) 0.22"),
        ("gensal", {"leakage_reactance": 0.23}, r"\(X''d\) 0.22 is less than .*\(Xl\) 0.23"),
    ],
)
def test_reactances_in_an_odd_order_are_a_warning(model, change, text):
    doubts = machine_on_grid(model, SAMPLES[model] | change).doubts
    assert any(re.search(text, str(doubt)) for doubt in doubts)


@DETAILED
def test_every_open_circuit_time_but_the_transient_one_in_the_q_axis_must_be_positive(model):
    times = [p.name for p in MODELS[model].parameters if p.unit == "s"]
    for name in set(times) - {"q_open_circuit_time"}:
        with pytest.raises(gf.CaseError, match=f"{name} must be positive"):
            machine_on_grid(model, SAMPLES[model] | {name: 0.0})


def test_no_flux_means_no_saturation():
    states = np.array([np.pi / 2, 1.0, 0.0, 0.0, 0.0, 0.0])
    a, *_ = Machine(GENROU, ROUND).linear(states, np.zeros(4))
    b, *_ = Machine(GENROU, ROUND | NO_IRON).linear(states, np.zeros(4))
    assert np.isfinite(a).all()
    np.testing.assert_array_equal(a, b)
