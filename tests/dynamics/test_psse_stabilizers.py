"""Stabilizers of PSS/E: start, transfer functions, limits, cut-off."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import StateSpace, lti, step

import gridfold as gf
from gridfold.dynamics.device import Device
from gridfold.dynamics.evaluate import derivative_stage, output_stage
from gridfold.dynamics.governors.tgov1 import TGOV1
from gridfold.dynamics.registry import DEVICES
from gridfold.dynamics.stabilizers import ieeest, st2cut
from gridfold.numerics.newton import complex_step_jacobian

STABILIZERS: dict[str, Device] = {"ieeest": ieeest.IEEEST, "st2cut": st2cut.ST2CUT}
MODULES = {"ieeest": ieeest, "st2cut": st2cut}
MACHINE = {
    "inertia": 4.0,
    "d_reactance": 1.8,
    "q_reactance": 1.7,
    "d_transient_reactance": 0.3,
    "q_transient_reactance": 0.3,
    "d_open_circuit_time": 8.0,
    "q_open_circuit_time": 0.4,
}
EXCITER = {
    "regulator_gain": 100.0,
    "regulator_time": 0.02,
    "exciter_gain": 1.0,
    "exciter_time": 0.1,
    "feedback_gain": 0.0,
    "feedback_time": 1.0,
}
GOVERNOR = {
    "droop": 0.05,
    "valve_time": 0.4,
    "highest_valve": 1.0,
    "lowest_valve": 0.0,
    "reheater_lead_time": 2.0,
    "reheater_time": 7.0,
    "turbine_damping": 0.3,
}
# In the order of the DYR file; the first as in the public case ACTIVSg2000.
RECORDS = {
    "ieeest": (
        1, 0, 1.013, 0.013, 0, 0, 1.013, 0.113, 0, 0.02, 0, 0, 1.65, 1.65, 3, 0.1, -0.1, 0, 0,
    ),
    "st2cut": (
        1, 0, 3, 0, 10, -0.5, 0.01, 0.02, 3, 3, 0.2, 0.02, 0.15, 0.03, 0, 0, 0.1, -0.1, 0, 0,
    ),
}  # fmt: skip
BASE_MVA = 250.0
POWER_MW = 180.0
SIGNALS = ("speed", "active_power", "mechanical_power", "terminal_voltage")
UNIT = (gf.UnitKey(1, "1"),)


def named(model: str, **changes: float) -> dict[str, float]:
    columns = zip(MODULES[model].DYR_COLUMNS, RECORDS[model], strict=True)
    return {name: float(value) for name, value in columns if name is not None} | changes


def case_with(
    model: str | None, parameters: dict[str, float] | None = None, governor: bool = False
) -> gf.Case:
    """A two-axis machine of 250 MVA with an exciter, against an infinite bus."""
    devices = [
        gf.DeviceRecord("two_axis", 1, "1", MACHINE),
        gf.DeviceRecord("ieee_type1", 1, "1", EXCITER),
        gf.DeviceRecord("infinite_bus", 2, "1", {"reactance": 0.02}),
    ]
    if model is not None and parameters is not None:
        devices.append(gf.DeviceRecord(model, 1, "1", parameters))
    if governor:
        devices.append(gf.DeviceRecord("tgov1", 1, "1", GOVERNOR))
    return gf.Case(
        name="stabilizer",
        buses=(gf.Bus(1, voltage_pu=1.02), gf.Bus(2)),
        branches=(gf.Branch(1, 2, reactance=0.15),),
        generators=(
            gf.Generator(1, active_mw=POWER_MW, voltage_pu=1.02, base_mva=BASE_MVA),
            gf.Generator(2, control=gf.Control.SLACK),
        ),
        devices=tuple(devices),
    )


def model_with(
    model: str | None, parameters: dict[str, float] | None = None, governor: bool = False
) -> gf.DetailedModel:
    case = case_with(model, parameters, governor)
    return gf.build_model(case, devices={**DEVICES, **STABILIZERS, "tgov1": TGOV1})


class Alone:
    """A stabilizer without its machine, at the start of its case."""

    def __init__(self, model: str, parameters: dict[str, float]):
        self.device = STABILIZERS[model]
        built = model_with(model, parameters)
        block = next(b for b in built.layout.blocks if b.device is self.device)
        self.p = block.parameters.astype(complex)
        self.x0 = built.x0[block.state_index[:, 0]]
        signals = built.signals(built.x0[None, :])[0]
        self.u0 = signals[block.inputs[:, 0]]

    def signal(self, x: np.ndarray, **inputs: complex) -> complex:
        return self._stages(x, self._inputs(inputs))[0]

    def derivative(self, x: np.ndarray, **inputs: complex) -> np.ndarray:
        return self._stages(x, self._inputs(inputs))[1].real

    def _inputs(self, inputs: dict[str, complex]) -> np.ndarray:
        values = dict(zip(SIGNALS, self.u0, strict=True)) | inputs
        return np.array([values[name] for name in SIGNALS])

    def _stages(self, x: np.ndarray, u: np.ndarray) -> tuple[complex, np.ndarray]:
        states, inputs = (np.asarray(v, dtype=complex).reshape(-1, 1) for v in (x, u))
        rows = np.zeros((len(self.device.signal_rows), 1), dtype=complex)
        y = output_stage(self.device, states, inputs, self.p, rows)
        return y[0, 0], derivative_stage(self.device, states, inputs, self.p, y)[:, 0]

    def linear(self, name: str) -> StateSpace:
        """Linearized from the input `name` to the stabilizer signal."""
        n, column = len(self.x0), SIGNALS.index(name)

        def both(z: np.ndarray) -> np.ndarray:
            u = self.u0.astype(complex)
            u[column] = z[-1, 0]
            signal, rates = self._stages(z[:-1, 0], u)
            return np.append(rates, signal)[:, None]

        point = np.append(self.x0, self.u0[column])[:, None]
        j = complex_step_jacobian(both, point)[:, :, 0]
        return StateSpace(j[:n, :n], j[:n, n:], j[n:, :n], j[n:, n:])

    def response(self, name: str, frequencies: np.ndarray) -> np.ndarray:
        system = self.linear(name)
        unit = np.eye(len(self.x0))
        return np.array(
            [
                (system.C @ np.linalg.solve(1j * w * unit - system.A, system.B) + system.D)[0, 0]
                for w in frequencies
            ]
        )


def ieeest_polynomials(c: dict[str, float]) -> tuple[np.ndarray, np.ndarray]:
    """Numerator and denominator of IEEEST, from the block diagram."""
    above = [
        [c["filter_a6"], c["filter_a5"], 1.0],
        [c["lead_time_1"], 1.0],
        [c["lead_time_2"], 1.0],
        [c["stabilizer_gain"] * c["washout_lead_time"], 0.0],
    ]
    below = [
        [c["filter_a2"], c["filter_a1"], 1.0],
        [c["filter_a4"], c["filter_a3"], 1.0],
        [c["lag_time_1"], 1.0],
        [c["lag_time_2"], 1.0],
        [c["washout_time"], 1.0],
    ]
    top, bottom = np.ones(1), np.ones(1)
    for factor in above:
        top = np.polymul(top, factor)
    for factor in below:
        bottom = np.polymul(bottom, factor)
    return np.trim_zeros(top, "f"), np.trim_zeros(bottom, "f")


def st2cut_response(c: dict[str, float], s: np.ndarray, k: int) -> np.ndarray:
    """Response of ST2CUT to the signal of its input `k`, from the block diagram."""
    value = c[f"input_gain_{k}"] / (1 + s * c[f"input_time_{k}"])
    value = value * s * c["washout_lead_time"] / (1 + s * c["washout_time"])
    for stage in (1, 2, 3):
        value = value * (1 + s * c[f"lead_time_{stage}"]) / (1 + s * c[f"lag_time_{stage}"])
    return value


def filter_of(*a: float) -> dict[str, float]:
    return {f"filter_a{k}": value for k, value in enumerate(a, start=1)}


FILTERS = {
    "none": filter_of(0, 0, 0, 0, 0, 0),
    "first pair, both zeros": filter_of(1.013, 0.013, 0, 0, 1.013, 0.113),
    "second pair, both zeros": filter_of(0, 0, 0.4, 0.05, 0.3, 0.02),
    "both pairs": filter_of(0.3, 0.04, 0.4, 0.05, 0.2, 0.03),
    "both pairs, no zeros": filter_of(0.3, 0.04, 0.4, 0.05, 0, 0),
    "one pole, one zero": filter_of(0.3, 0, 0, 0, 0.2, 0),
    "second pole, one zero": filter_of(0, 0, 0.3, 0, 0.2, 0),
    "two poles, both zeros": filter_of(0.3, 0, 0.4, 0, 0.2, 0.03),
    "pair and pole": filter_of(0.3, 0.04, 0.4, 0, 0.2, 0.03),
    "pole and pair": filter_of(0.3, 0, 0.4, 0.05, 0.2, 0.03),
    "undamped pair": filter_of(0, 0.04, 0.4, 0, 0.2, 0),
}
FREQUENCIES = np.logspace(-1, 2, 25)


@pytest.fixture(params=sorted(STABILIZERS))
def model(request) -> str:
    return request.param


def test_columns_of_the_record_are_the_parameters_in_order(model):
    names = [parameter.name for parameter in STABILIZERS[model].parameters]
    columns = MODULES[model].DYR_COLUMNS
    assert list(columns) == names[: len(columns)]
    assert names[len(columns) :] == ["power_base"]


@pytest.mark.parametrize("code", [1, 3, 4, 5])
@pytest.mark.parametrize("governor", [False, True])
def test_starts_in_equilibrium_with_no_signal_whatever_the_input(model, code, governor):
    changes = {"filter_a6": 0.0} if model == "ieeest" else {}
    name = "input_code" if model == "ieeest" else "input_code_1"
    built = model_with(model, named(model, **{name: code}, **changes), governor)
    assert np.abs(built.compiled(built.x0)).max() < 1e-9
    signals = built.signals(built.x0[None, :])[0]
    assert signals[built.slots("stabilizer_signal", UNIT)][0] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("code", [1, 3, 4, 5])
def test_jacobian_equals_central_differences(model, code):
    changes = {"filter_a6": 0.0} if model == "ieeest" else {}
    name = "input_code" if model == "ieeest" else "input_code_1"
    wide = {"highest_signal": 5.0, "lowest_signal": -5.0}
    built = model_with(model, named(model, **{name: code}, **wide, **changes), governor=True)
    x = built.x0 + 0.002 * np.random.default_rng(5).standard_normal(built.n_states)
    columns = [
        (built.compiled(x + 1e-6 * e) - built.compiled(x - 1e-6 * e)) / 2e-6
        for e in np.eye(built.n_states)
    ]
    expected = np.array(columns).T
    scale = np.abs(expected).max(axis=1, keepdims=True) + 1.0
    assert np.abs((built.jacobian(x) - expected) / scale).max() < 1e-6


@pytest.mark.parametrize("kind", sorted(FILTERS))
@pytest.mark.parametrize("leads", [(0, 0.02, 0, 0), (0.2, 0.02, 0.3, 0.05), (0, 0, 0, 0)])
def test_ieeest_has_the_transfer_function_of_its_block_diagram(kind, leads):
    names = ("lead_time_1", "lag_time_1", "lead_time_2", "lag_time_2")
    record = named("ieeest", **FILTERS[kind], **dict(zip(names, leads, strict=True)))
    top, bottom = ieeest_polynomials(record)
    s = 1j * FREQUENCIES
    expected = np.polyval(top, s) / np.polyval(bottom, s)
    response = Alone("ieeest", record).response("speed", FREQUENCIES)
    np.testing.assert_allclose(response, expected, rtol=1e-8)


def test_step_of_ieeest_is_that_of_its_transfer_function():
    record = named("ieeest", **FILTERS["both pairs"], lead_time_1=0.2, lag_time_2=0.04)
    times = np.linspace(0, 3, 61)
    _, expected = step(lti(*ieeest_polynomials(record)), T=times)
    system = Alone("ieeest", record).linear("speed")
    _, found = step(system, T=times)
    np.testing.assert_allclose(found, expected, atol=1e-6)


@pytest.mark.parametrize("zero", [(), ("input_time_1", "input_time_2")])
def test_st2cut_has_the_transfer_function_of_its_block_diagram(zero):
    record = named("st2cut", lead_time_3=0.4, lag_time_3=0.1, **dict.fromkeys(zero, 0.0))
    alone = Alone("st2cut", record)
    for k, name, base in ((1, "speed", 1.0), (2, "active_power", BASE_MVA / 100)):
        expected = st2cut_response(record, 1j * FREQUENCIES, k) / base
        np.testing.assert_allclose(alone.response(name, FREQUENCIES), expected, rtol=1e-8)


@pytest.mark.parametrize(
    ("code", "slopes"),
    [
        (1, {"speed": 1.0}),
        (3, {"active_power": 0.4}),
        (4, {"active_power": -0.4, "mechanical_power": 0.4}),
        (5, {"terminal_voltage": 1.0}),
    ],
)
def test_input_code_selects_the_signal_and_powers_are_on_the_machine_base(model, code, slopes):
    if model == "ieeest":
        record = named("ieeest", input_code=code, filter_a6=0.0)
        s = 1j * FREQUENCIES
        top, bottom = ieeest_polynomials(record)
        whole = np.polyval(top, s) / np.polyval(bottom, s)
    else:
        record = named("st2cut", input_code_1=code, input_code_2=0)
        whole = st2cut_response(record, 1j * FREQUENCIES, 1)
    alone = Alone(model, record)
    for name in SIGNALS:
        expected = slopes.get(name, 0.0) * whole
        np.testing.assert_allclose(
            alone.response(name, FREQUENCIES), expected, rtol=1e-8, atol=1e-12
        )


@pytest.mark.parametrize(
    "time", ["lag_time_1", "lag_time_2", "filter_a1", "filter_a2", "filter_a4"]
)
def test_a_time_constant_of_zero_is_the_limit_of_small_ones(time):
    record = named("ieeest", **filter_of(0.4, 0.05, 0.3, 0.04, 0, 0), lag_time_2=0.1)
    frequencies = np.logspace(-1, 1, 8)
    none, small = (
        Alone("ieeest", record | {time: value}).response("speed", frequencies)
        for value in (0.0, 1e-7)
    )
    np.testing.assert_allclose(none, small, rtol=1e-4)


def test_signal_stays_within_its_limits(model):
    alone = Alone(model, named(model))
    for speed, limit in ((1.05, 0.1), (0.95, -0.1)):
        assert alone.signal(alone.x0, speed=speed).real in (limit, 0.0)
        x = alone.x0.copy()
        for _ in range(300):
            x = x + 0.001 * alone.derivative(x, speed=speed)
        assert alone.signal(x, speed=speed).real == limit


def test_signal_of_a_lasting_deviation_is_washed_out(model):
    """After a long time nothing is left: there is no windup in the limits."""
    alone = Alone(model, named(model))
    x = alone.x0.copy()
    for _ in range(30000):
        x = x + 0.001 * alone.derivative(x, speed=1.02)
    assert abs(alone.signal(x, speed=1.02)) < 2e-4


@pytest.mark.parametrize(
    ("model", "bounds", "voltage", "factor"),
    [
        ("ieeest", (0.0, 0.0), 0.2, 1),
        ("ieeest", (1.1, 0.0), 1.2, 0),
        ("ieeest", (1.1, 0.0), 0.2, 1),
        ("ieeest", (1.1, 0.9), 0.8, 0),
        ("ieeest", (1.1, 0.9), 1.0, 1),
        ("st2cut", (0.0, 0.0), 0.2, 1),
        ("st2cut", (0.1, -0.1), 1.11, 1),
        ("st2cut", (0.1, -0.1), 1.13, 0),
        ("st2cut", (0.1, -0.1), 0.93, 1),
        ("st2cut", (0.1, -0.1), 0.91, 0),
    ],
)
def test_signal_is_cut_off_outside_a_band_of_voltages(model, bounds, voltage, factor):
    """The band of ST2CUT is around the start voltage, here 1.02 p.u."""
    upper, lower = bounds
    changes = {"input_time_1": 0.0, "input_code_2": 0.0} if model == "st2cut" else {}
    if model == "ieeest":
        changes = {"lag_time_1": 0.0}
    alone = Alone(model, named(model, upper_cut_off=upper, lower_cut_off=lower, **changes))
    signal = alone.signal(alone.x0, speed=1.1, terminal_voltage=voltage)
    assert signal.real == pytest.approx(0.1 * factor, abs=1e-15)


def test_accelerating_power_sees_a_mechanical_power_that_is_evaluated_later():
    """The governor's output comes after the stabilizer's, yet no old value of it is used."""
    built = model_with("ieeest", named("ieeest", input_code=4, filter_a6=0.0), governor=True)
    x = built.x0.copy()
    x[built.state_names.index("speed:1:1")] += 0.01
    first = built.compiled(x).copy()
    built.compiled(x + 0.1)
    np.testing.assert_array_equal(built.compiled(x), first)
    row = built.state_names.index("stabilizer_filter_slope_1:1:1")
    # Turbine damping and the governor's own blocks: only damping acts at once.
    change = -GOVERNOR["turbine_damping"] * 0.01 / 0.013
    assert first[row] == pytest.approx(change, rel=1e-6)


def damping_ratio(built: gf.DetailedModel) -> float:
    """Damping ratio of the swing mode: the oscillation between 0.5 and 2.5 Hz."""
    values = np.linalg.eigvals(built.jacobian(built.x0))
    swing = values[(values.imag > np.pi) & (values.imag < 5 * np.pi)]
    return float((-swing.real / np.abs(swing)).min())


@pytest.mark.parametrize("model", ["ieeest", "st2cut"])
def test_stabilizer_damps_the_swing_of_the_machine(model):
    if model == "ieeest":
        record = named("ieeest", **filter_of(0, 0, 0, 0, 0, 0), lead_time_1=0.15, lag_time_1=0.03)
        record |= {"stabilizer_gain": 10.0}
    else:
        record = named("st2cut", input_code_2=0.0, lead_time_2=0.0, lag_time_2=0.0)
    assert damping_ratio(model_with(model, record)) > damping_ratio(model_with(None)) + 0.03


@pytest.mark.parametrize(
    ("model", "changes", "message"),
    [
        ("ieeest", {"input_code": 2.0}, "bus frequency deviation"),
        ("ieeest", {"input_code": 6.0}, "derivative of the bus voltage"),
        ("ieeest", {"input_code": 9.0}, "none of 1, 3, 4 and 5"),
        ("ieeest", {"remote_bus": 12.0}, "remote bus 12"),
        ("ieeest", {"filter_a2": 0.0}, "more poles"),
        ("ieeest", {"lag_time_1": 0.0, "lead_time_1": 0.1}, "T2 is 0: T1"),
        ("ieeest", {"lead_time_2": 0.1}, "T4 is 0: T3"),
        ("ieeest", {"washout_time": 0.0}, "washout_time must be positive"),
        ("ieeest", {"input_code": 4.0, "lag_time_1": 0.0}, "accelerating power"),
        ("ieeest", {"lowest_signal": 0.5}, "LSMIN is above"),
        ("st2cut", {"input_code_1": 2.0}, "IC1 2"),
        ("st2cut", {"input_code_2": 6.0}, "IC2 6"),
        ("st2cut", {"remote_bus_2": 3.0}, "remote bus 3"),
        ("st2cut", {"lag_time_1": 0.0}, "T6 is 0: T5"),
        ("st2cut", {"lead_time_3": 0.1}, "T10 is 0: T9"),
        ("st2cut", {"washout_time": 0.0}, "washout_time must be positive"),
        ("st2cut", {"input_code_2": 4.0, "input_time_2": 0.0}, "IC2 4"),
        ("st2cut", {"lowest_signal": 0.5}, "LSMIN is above"),
    ],
)
def test_records_that_are_not_modelled_are_refused(model, changes, message):
    with pytest.raises(gf.CaseError, match=message):
        model_with(model, named(model, **changes))
