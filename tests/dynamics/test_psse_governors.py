"""Turbine-governors of PSS/E: start, transfer functions, limits."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.signal import StateSpace, lti, step

import gridfold as gf
from gridfold.dynamics.device import Device
from gridfold.dynamics.evaluate import derivative_stage, output_stage
from gridfold.dynamics.governors import gast, hygov, ieeeg1, tgov1
from gridfold.dynamics.limiting import without_limits
from gridfold.dynamics.registry import DEVICES
from gridfold.numerics.newton import complex_step_jacobian

MODULES = {"tgov1": tgov1, "ieeeg1": ieeeg1, "gast": gast, "hygov": hygov}
GOVERNORS: dict[str, Device] = {
    "tgov1": tgov1.TGOV1,
    "ieeeg1": ieeeg1.IEEEG1,
    "gast": gast.GAST,
    "hygov": hygov.HYGOV,
}
MACHINE = {
    "inertia": 4.0,
    "resistance": 0.003,
    "d_reactance": 1.8,
    "q_reactance": 1.7,
    "d_transient_reactance": 0.3,
    "q_transient_reactance": 0.3,
    "d_open_circuit_time": 8.0,
    "q_open_circuit_time": 0.4,
}
# Records in the order of the DYR file, of the public cases ACTIVSg2000, Kundur, IEEE 39 and WECC 240.
RECORDS = {
    "tgov1": (0.05, 0.49, 33.0, 0.4, 2.1, 7.0, 0.0),
    "ieeeg1": (
        0, 0, 20, 0.2511, 0, 0.2, 2, -2, 1.1911, 0, 0.4242, 1, 0, 8.5669, 0.3471, 0,
        0.5, 0.3093, 0, 0, 0, 0,
    ),
    "gast": (0.08, 0.3, 0.3, 3.0, 1.0, 2.0, 1.0, 0.0, 0.0),
    "hygov": (0.05, 0.626858, 5.91909, 0.05, 0.5, 0.167, 1, 0, 1.2091, 1.2, 0.5, 0.0791),
}  # fmt: skip
OTHER_RECORDS = {
    "tgov1": (0.08, 2.0, 1.0, 0.0, 3.0, 15.0, 0.4),
    "ieeeg1": (
        0, 0, 20, 0, 0, 0.02, 0.1, -0.1, 1, 0, 0, 0.3, 0, 8.3, 0.7, 0, 999, 0, 0, 999, 0, 0,
    ),
    "gast": (0.05, 0.4, 0.1, 3.0, 0.95, 2.0, 1.0, -0.05, 0.5),
    "hygov": (0.05, 0.075, 12.0, 0.5, 20.5, 0.1, 1.0, 0.0, 15.0, 1.5, 0.0, 0.08),
}  # fmt: skip
POWER_MW, BASE_MVA = 180.0, 250.0


def named(model: str, values: tuple[float, ...], **changes: float) -> dict[str, float]:
    columns = MODULES[model].DYR_COLUMNS
    record = {
        name: float(value) for name, value in zip(columns, values, strict=True) if name is not None
    }
    return record | changes


def case_with(model: str, parameters: dict[str, float]) -> gf.Case:
    """A two-axis machine of 250 MVA with constant field voltage, against an infinite bus."""
    return gf.Case(
        name="governor",
        buses=(gf.Bus(1, voltage_pu=1.02), gf.Bus(2)),
        branches=(gf.Branch(1, 2, reactance=0.1),),
        generators=(
            gf.Generator(1, active_mw=POWER_MW, voltage_pu=1.02, base_mva=BASE_MVA),
            gf.Generator(2, control=gf.Control.SLACK),
        ),
        devices=(
            gf.DeviceRecord("two_axis", 1, "1", MACHINE),
            gf.DeviceRecord(model, 1, "1", parameters),
            gf.DeviceRecord("infinite_bus", 2, "1", {"reactance": 0.02}),
        ),
    )


def model_with(model: str, parameters: dict[str, float]) -> gf.DetailedModel:
    return gf.build_model(case_with(model, parameters), devices={**DEVICES, **GOVERNORS})


def central_differences(model: gf.DetailedModel, x: np.ndarray) -> np.ndarray:
    step_size = 1e-6
    columns = [
        (model.compiled(x + step_size * unit) - model.compiled(x - step_size * unit))
        / (2 * step_size)
        for unit in np.eye(model.n_states)
    ]
    return np.array(columns).T


class Alone:
    """A governor without its machine, at the equilibrium for 0.7 p.u. on its own base."""

    def __init__(self, model: str, parameters: dict[str, float], free: bool = False):
        self.device = GOVERNORS[model]
        built = model_with(model, parameters)
        block = next(b for b in built.layout.blocks if b.device is self.device)
        self.p = without_limits(self.device, block.parameters) if free else block.parameters
        self.x0 = built.x0[block.state_index[:, 0]]

    def power(self, x: np.ndarray, speed: complex) -> complex:
        """Mechanical power on the machine's base."""
        return self._stages(x, speed)[0] / (BASE_MVA / 100)

    def derivative(self, x: np.ndarray, speed: complex) -> np.ndarray:
        return self._stages(x, speed)[1]

    def _stages(self, x: np.ndarray, speed: complex) -> tuple[complex, np.ndarray]:
        u = np.array([[speed]], dtype=complex)
        states, p = np.asarray(x, dtype=complex).reshape(-1, 1), self.p.astype(complex)
        y = output_stage(self.device, states, u, p, np.zeros((1, 1), dtype=complex))
        return y[0, 0], derivative_stage(self.device, states, u, p, y)[:, 0]

    def linear(self) -> StateSpace:
        """Linearized from speed to mechanical power."""

        def both(z: np.ndarray) -> np.ndarray:
            power, rates = self._stages(z[:-1, 0], z[-1, 0])
            return np.append(rates, power / (BASE_MVA / 100))[:, None]

        jacobian = complex_step_jacobian(both, np.append(self.x0, 1.0)[:, None])[:, :, 0]
        n = len(self.x0)
        return StateSpace(jacobian[:n, :n], jacobian[:n, n:], jacobian[n:, :n], jacobian[n:, n:])

    def response(self, frequencies: np.ndarray) -> np.ndarray:
        s = self.linear()
        n = len(self.x0)
        return np.array(
            [
                (s.C @ np.linalg.solve(1j * w * np.eye(n) - s.A, s.B) + s.D)[0, 0]
                for w in frequencies
            ]
        )

    def run(self, speed: Callable[[float], float], end: float, h: float = 0.005) -> np.ndarray:
        """States along a given speed, by the Runge-Kutta method of order four: (n_times, n_states)."""
        states = [self.x0]
        for k in range(round(end / h)):
            t, x = k * h, states[-1]
            k1 = self.derivative(x, speed(t)).real
            k2 = self.derivative(x + h / 2 * k1, speed(t + h / 2)).real
            k3 = self.derivative(x + h / 2 * k2, speed(t + h / 2)).real
            k4 = self.derivative(x + h * k3, speed(t + h)).real
            states.append(x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4))
        return np.array(states)


def expected_response(model: str, c: dict[str, float], s: np.ndarray, power: float) -> np.ndarray:
    """Speed deviation to mechanical power, from the block diagrams, on the machine's base."""
    if model == "tgov1":
        reheater = (1 + s * c["reheater_lead_time"]) / (1 + s * c["reheater_time"])
        return -reheater / (c["droop"] * (1 + s * c["valve_time"])) - c["turbine_damping"]
    if model == "gast":
        fuel = 1 / (c["droop"] * (1 + s * c["fuel_time"]) * (1 + s * c["turbine_time"]))
        return -fuel - c["turbine_damping"]
    if model == "ieeeg1":
        signal = (1 + s * c["governor_lead_time"]) / (1 + s * c["governor_lag_time"])
        flow = -c["governor_gain"] * signal / (1 + s * c["gate_time"])
        total = 0.0
        for name in ("chest", "reheater", "crossover", "outlet"):
            flow = flow / (1 + s * c[f"{name}_time"])
            total = total + c[f"{name}_fraction"] * flow
        return np.asarray(total)
    dashpot = (1 + s * c["reset_time"]) / (c["temporary_droop"] * c["reset_time"] * s)
    forward = dashpot / (1 + s * c["filter_time"])
    gate = -forward / (1 + c["droop"] * forward) / (1 + s * c["servo_time"])
    opening = power / c["turbine_gain"] + c["no_load_flow"]
    flow = 2 / (2 + s * c["water_time"] * opening)
    head = 2 * (flow - 1) / opening
    turbine = c["turbine_gain"] * ((opening - c["no_load_flow"]) * head + flow)
    return turbine * gate - c["turbine_damping"] * opening


@pytest.fixture(params=sorted(GOVERNORS))
def model(request) -> str:
    return request.param


@pytest.fixture(params=[RECORDS, OTHER_RECORDS], ids=["record", "other record"])
def parameters(request, model) -> dict[str, float]:
    return named(model, request.param[model])


def test_columns_of_the_record_are_the_parameters_in_order(model):
    names = [parameter.name for parameter in GOVERNORS[model].parameters]
    columns = [name for name in MODULES[model].DYR_COLUMNS if name is not None]
    assert columns == names[: len(columns)]
    assert names[len(columns) :] == ["power_base"]


def test_starts_in_equilibrium_at_the_power_that_the_machine_needs(model, parameters):
    built = model_with(model, parameters)
    assert np.abs(built.compiled(built.x0)).max() < 1e-9
    signals = built.signals(built.x0[None, :])[0]
    unit = (gf.UnitKey(1, "1"),)
    power = signals[built.slots("mechanical_power", unit)][0]
    current = np.hypot(*(signals[built.slots(f"{axis}_current", unit)][0] for axis in "dq"))
    assert power == pytest.approx(1.8 + MACHINE["resistance"] * 100 / BASE_MVA * current**2)


def test_jacobian_equals_central_differences(model, parameters):
    built = model_with(model, parameters)
    x = built.x0 + 0.003 * np.random.default_rng(3).standard_normal(built.n_states)
    expected = central_differences(built, x)
    scale = np.abs(expected).max(axis=1, keepdims=True) + 1.0
    assert np.abs((built.jacobian(x) - expected) / scale).max() < 1e-6


def test_linearized_device_has_the_transfer_function_of_the_block_diagram(model, parameters):
    alone = Alone(model, parameters)
    frequencies = np.logspace(-2, 2, 30)
    start = alone.power(alone.x0, 1.0).real
    expected = expected_response(model, parameters, 1j * frequencies, start)
    np.testing.assert_allclose(alone.response(frequencies), expected, rtol=1e-8)


def test_step_of_tgov1_is_that_of_its_transfer_function():
    record = named("tgov1", OTHER_RECORDS["tgov1"])
    alone = Alone("tgov1", record, free=True)
    change = -0.004
    states = alone.run(lambda t: 1.0 + change, 20.0, h=0.02)
    power = np.array([alone.power(x, 1.0 + change).real for x in states])
    numerator = -np.array([record["reheater_lead_time"], 1.0]) / record["droop"]
    denominator = np.polymul([record["valve_time"], 1.0], [record["reheater_time"], 1.0])
    _, expected = step(lti(numerator, denominator), T=np.arange(len(states)) * 0.02)
    offset = power - alone.power(alone.x0, 1.0).real
    expected = change * (expected - record["turbine_damping"])
    np.testing.assert_allclose(offset, expected, atol=1e-8)


def test_droop_is_the_power_for_a_lasting_speed_deviation(model):
    record = named(model, RECORDS[model])
    alone = Alone(model, record, free=True)
    response = alone.response(np.array([1e-7]))[0].real
    start = alone.power(alone.x0, 1.0).real
    expected = {
        "tgov1": -1 / 0.05,
        "ieeeg1": -20 * (1 + 0.3471 + 0.3093),
        "gast": -1 / 0.08,
        "hygov": -1.2 / 0.05 - 0.5 * (start / 1.2 + 0.0791),
    }[model]
    assert response == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize(
    ("model", "time", "others"),
    [
        ("tgov1", "valve_time", {}),
        ("tgov1", "reheater_time", {"reheater_lead_time": 0.0}),
        ("ieeeg1", "governor_lag_time", {}),
        ("ieeeg1", "chest_time", {}),
        ("ieeeg1", "reheater_time", {}),
        ("ieeeg1", "crossover_time", {}),
        ("ieeeg1", "outlet_time", {"outlet_fraction": 0.2}),
        ("gast", "fuel_time", {}),
        ("gast", "turbine_time", {}),
        ("gast", "exhaust_time", {}),
        ("hygov", "servo_time", {}),
    ],
)
def test_a_time_constant_of_zero_is_the_limit_of_small_ones(model, time, others):
    record = named(model, RECORDS[model], **others)
    frequencies = np.logspace(-2, 1, 10)
    none, small = (
        Alone(model, record | {time: value}, free=True).response(frequencies)
        for value in (0.0, 1e-6)
    )
    np.testing.assert_allclose(none, small, rtol=1e-4)


def test_gast_without_fuel_and_turbine_times_still_has_its_temperature_limit():
    record = named("gast", RECORDS["gast"], fuel_time=0.0, turbine_time=0.0, exhaust_time=0.5)
    alone = Alone("gast", record | {"temperature_limit": 0.8, "highest_fuel": 2.0})
    states = alone.run(lambda t: 0.97, 20.0, h=0.02)
    assert alone.power(states[-1], 0.97).real == pytest.approx(0.8, abs=1e-6)


@pytest.mark.parametrize(
    ("without", "row"),
    [((), 2), (("exhaust_time",), 1), (("exhaust_time", "turbine_time"), 0)],
)
def test_exhaust_of_gast_is_the_output_of_the_last_lag_that_is_there(without, row):
    record = named("gast", RECORDS["gast"], **dict.fromkeys(without, 0.0))
    alone = Alone("gast", record)
    x = np.array([0.93, 0.96, 0.99])
    limit, gain = record["temperature_limit"], record["temperature_gain"]
    expected = (limit + gain * (limit - x[row]) - x[0]) / record["fuel_time"]
    assert alone.derivative(x, 0.9)[0].real == pytest.approx(expected, rel=1e-12)


def low_then_high(low: float, high: float, change: float) -> Callable[[float], float]:
    return lambda t: low if t < change else high


@pytest.mark.parametrize(
    ("model", "state", "highest", "lowest"),
    [
        ("tgov1", "valve", "highest_valve", "lowest_valve"),
        ("ieeeg1", "gate", "highest_gate", "lowest_gate"),
        ("gast", "fuel", "highest_fuel", "lowest_fuel"),
        ("hygov", "desired_gate", "highest_gate", "lowest_gate"),
    ],
)
def test_limited_state_stays_at_its_limit_and_leaves_it_without_windup(
    model, state, highest, lowest
):
    record = named(model, RECORDS[model], **{highest: 0.9, lowest: 0.35})
    if model == "gast":
        record["temperature_limit"] = 2.0
    alone = Alone(model, record)
    if model == "ieeeg1":
        alone.p[alone.device.parameter_rows.index(lowest)] = 0.2
        record[lowest] = 0.2
    row = alone.device.states.index(state)
    h, change = 0.005, 25.0
    for held_speed, limit, side in ((0.93, record[highest], 1), (1.09, record[lowest], -1)):
        values = alone.run(low_then_high(held_speed, 2 - held_speed, change), 26.0, h)[:, row]
        turn = round(change / h)
        # A state may pass its limit by what it moves in one step; kernels clip what they use of it.
        assert (side * (values - limit) < 2e-2).all()
        assert values[turn] == pytest.approx(limit, abs=2e-2)
        assert side * (values[turn + round(0.5 / h)] - limit) < -0.02


def test_gate_of_ieeeg1_moves_no_faster_than_its_rates():
    record = named("ieeeg1", OTHER_RECORDS["ieeeg1"])
    alone = Alone("ieeeg1", record)
    h = 0.005
    gate = alone.run(low_then_high(0.98, 1.02, 2.0), 5.0, h)[:, 1]
    rate = np.diff(gate) / h
    assert rate.max() == pytest.approx(0.1, abs=1e-9)
    assert rate.min() == pytest.approx(-0.1, abs=1e-9)


def test_gate_of_hygov_moves_no_faster_than_its_velocity():
    alone = Alone("hygov", named("hygov", RECORDS["hygov"]))
    h = 0.005
    gate = alone.run(low_then_high(0.9, 1.1, 1.0), 3.0, h)[:, 1]
    rate = np.diff(gate) / h
    assert rate.max() == pytest.approx(0.167, abs=1e-9)
    assert rate.min() == pytest.approx(-0.167, abs=1e-9)


def test_water_inertia_first_turns_the_power_of_hygov_the_wrong_way():
    record = named("hygov", RECORDS["hygov"], turbine_damping=0.0)
    alone = Alone("hygov", record)
    states = alone.run(lambda t: 0.99, 3.0)
    power = np.array([alone.power(x, 0.99).real for x in states])
    assert power.min() < power[0] - 1e-3
    assert power[-1] > power[0]


def test_hygov_survives_a_closed_gate():
    alone = Alone("hygov", named("hygov", RECORDS["hygov"], gate_velocity=1.0))
    states = alone.run(lambda t: 1.3, 20.0)
    power = alone.power(states[-1], 1.0).real
    assert states[-1][2] == pytest.approx(0.0, abs=1e-6)
    assert power == pytest.approx(1.2 * (0.01 - 0.0791), abs=1e-6)


def test_temperature_limit_of_gast_takes_over_when_the_exhaust_is_hot():
    record = named("gast", RECORDS["gast"], temperature_limit=0.85, highest_fuel=2.0)
    alone = Alone("gast", record)
    states = alone.run(lambda t: 0.96, 40.0, h=0.02)
    power = np.array([alone.power(x, 0.96).real for x in states])
    assert power.max() > 0.9
    assert power[-1] == pytest.approx(0.85, abs=1e-4)


@pytest.mark.parametrize(
    ("model", "changes", "symbol"),
    [
        ("tgov1", {"highest_valve": 0.5}, "VMAX"),
        ("ieeeg1", {"highest_gate": 0.4}, "Pmax"),
        ("gast", {"temperature_limit": 0.5}, "AT"),
        ("hygov", {"highest_gate": 0.5}, "GMAX"),
    ],
)
def test_start_beyond_a_limit_is_refused_and_names_it(model, changes, symbol):
    with pytest.raises(gf.InitializationError, match=f"{model} 1:1: {symbol} "):
        model_with(model, named(model, RECORDS[model], **changes))


@pytest.mark.parametrize(
    ("model", "changes", "message"),
    [
        ("tgov1", {"reheater_time": 0.0}, "T3 is 0: reheater_lead_time T2"),
        ("tgov1", {"lowest_valve": 99.0}, "VMIN is above"),
        ("ieeeg1", {"second_bus": 7.0}, "JBUS"),
        ("ieeeg1", {"second_reheater_fraction": 0.2}, "K4"),
        ("ieeeg1", {"closing_rate": 0.1}, "Uc is positive"),
        ("ieeeg1", {"governor_lag_time": 0.0, "governor_lead_time": 1.0}, "T1 is 0"),
        (
            "ieeeg1",
            {"chest_fraction": 0.0, "reheater_fraction": 0.0, "crossover_fraction": 0.0},
            "add up to 0",
        ),
        ("ieeeg1", {"lowest_gate": 2.0}, "Pmin is above"),
        ("gast", {"fuel_time": 0.0, "turbine_time": 0.0, "exhaust_time": 0.0}, "algebraic loop"),
        ("gast", {"lowest_fuel": 2.0}, "VMIN is above"),
        ("hygov", {"filter_time": 0.0}, "filter_time must be positive"),
        ("hygov", {"lowest_gate": 2.0}, "GMIN is above"),
    ],
)
def test_records_that_make_no_sense_are_refused(model, changes, message):
    with pytest.raises(gf.CaseError, match=message):
        model_with(model, named(model, RECORDS[model], **changes))
