"""A device by itself at the operating point of its machine, to be driven by hand."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from cases import one_machine_infinite_bus

import gridfold as gf
from gridfold.dynamics.device import Device
from gridfold.dynamics.evaluate import derivative_stage, output_stage, source_stage
from gridfold.dynamics.limiting import acting_limits
from gridfold.dynamics.machines.genrou import DYR_COLUMNS as GENROU_COLUMNS
from gridfold.dynamics.registry import DEVICES
from gridfold.numerics.newton import complex_step_jacobian

#: Record of the machine on 100 MVA, in the order of the DYR file.
MACHINE = (6.5, 0.03, 0.6, 0.05, 4.0, 0.0, 1.8, 1.7, 0.3, 0.55, 0.25, 0.2, 0.05, 0.3)
Records = Mapping[str, Mapping[str, float]]


def named(model: str, record: tuple[float | None, ...], **changes: float) -> dict[str, float]:
    """Parameters by name from a record in the order of the DYR file."""
    columns = zip(DEVICES[model].psse_record, record, strict=True)
    known = {name: float(value) for name, value in columns if name is not None}
    assert set(changes) <= {p.name for p in DEVICES[model].parameters}
    return known | changes


def machine_with(records: Records, machine_base: float = 100.0) -> gf.Case:
    """A GENROU with these devices at an infinite bus; the machine is the same on any base."""
    case = one_machine_infinite_bus(base_mva=machine_base)
    ratio = machine_base / 100.0
    machine = dict(zip(GENROU_COLUMNS, MACHINE, strict=True))
    for name in machine:
        if name.endswith("reactance"):
            machine[name] *= ratio
    machine["inertia"] /= ratio
    own = (gf.DeviceRecord(model, 1, "1", dict(values)) for model, values in records.items())
    return replace(
        case,
        devices=(
            gf.DeviceRecord("genrou", 1, "1", machine),
            gf.DeviceRecord("infinite_bus", 2, "1", {"reactance": 0.1}),
            *own,
        ),
    )


@dataclass
class Alone:
    """A device by itself at the operating point of its machine."""

    device: Device
    x: np.ndarray
    u: np.ndarray
    p: np.ndarray

    def stages(self, x: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        x, u, p = (np.asarray(rows, dtype=complex) for rows in (x, u, self.p))
        y = output_stage(self.device, x, u, p, source_stage(self.device, x, p))
        return y, derivative_stage(self.device, x, u, p, y)

    def signals(self, x: np.ndarray, u: np.ndarray) -> dict[str, float]:
        y, _ = self.stages(x, u)
        rows = dict(zip(self.device.states, x[:, 0], strict=True))
        return rows | dict(zip(self.device.signal_rows, y[:, 0].real, strict=True))

    def rates(self, x: np.ndarray, u: np.ndarray) -> dict[str, float]:
        rates = self.stages(x, u)[1][:, 0].real
        return dict(zip(self.device.states, rates, strict=True))

    def value(self, name: str) -> float:
        return float(self.p[self.device.parameter_rows.index(name), 0])

    def inputs(self, **changes: float) -> np.ndarray:
        u = self.u.copy()
        for name, change in changes.items():
            u[self.columns(name)] += change
        return u

    def columns(self, name: str) -> list[int]:
        """Inputs of a name; the terminal voltage is also what feeds an exciter."""
        also = ("supply_voltage",) if name == "terminal_voltage" else ()
        return [k for k, own in enumerate(self.device.inputs) if own in (name, *also)]

    def gain(self, name: str, s: complex, output: str = "field_voltage") -> complex:
        """Transfer function from the input `name` to the signal `output`, linearized."""
        n = len(self.device.states)
        columns = [n + column for column in self.columns(name)]

        def evaluate(z):
            y, dx = self.stages(z[:n], z[n:])
            rows = [*z[:n], *y]
            names = (*self.device.states, *self.device.signal_rows)
            return np.concatenate([dx, [rows[names.index(output)]]])

        jacobian = complex_step_jacobian(evaluate, np.concatenate([self.x, self.u]))[:, :, 0]
        a, b = jacobian[:n, :n], jacobian[:n, columns].sum(axis=1)
        c, d = jacobian[n, :n], jacobian[n, columns].sum()
        return complex(c @ np.linalg.solve(s * np.eye(n) - a, b) + d)

    def run(self, u: np.ndarray, seconds: float, x: np.ndarray | None = None, step: float = 5e-4):
        """Heun's method with constant inputs; states along the way, the last one at the end."""
        states = [self.x if x is None else x]
        for _ in range(round(seconds / step)):
            before = states[-1]
            rate = self.stages(before, u)[1].real
            after = self.stages(before + step * rate, u)[1].real
            states.append(before + 0.5 * step * (rate + after))
        return states

    def limits_at(self, x: np.ndarray, u: np.ndarray) -> set[str]:
        """Names of the limits that act."""
        acting = acting_limits(self.device, x, u, self.p)[:, 0]
        pairs = zip(self.device.limits, acting, strict=True)
        return {limit.parameter for limit, acts in pairs if acts}


def alone_in(built: gf.DetailedModel, model: str) -> Alone:
    """The device `model` of a built model with one such unit."""
    block = next(b for b in built.layout.blocks if b.device.model == model)
    signals = built.signals(built.x0[None, :])[0]
    return Alone(block.device, built.x0[block.state_index], signals[block.inputs], block.parameters)


def residual(built: gf.DetailedModel) -> float:
    """Largest derivative at the start."""
    return float(np.abs(built.compiled(built.x0)).max())


def jacobian_error(built: gf.DetailedModel, x: np.ndarray) -> float:
    """Largest difference of the Jacobian from central differences, against the row's largest entry."""
    columns = [
        (built.compiled(x + 1e-6 * e) - built.compiled(x - 1e-6 * e)) / 2e-6
        for e in np.eye(built.n_states)
    ]
    expected = np.array(columns).T
    scale = np.abs(expected).max(axis=1, keepdims=True) + 1.0
    return float(np.abs((built.jacobian(x) - expected) / scale).max())


def lag(s: complex, time: float) -> complex:
    """1 / (1 + s T)."""
    return 1 / (1 + s * time)


def lead_lag(s: complex, lead: float, time: float) -> complex:
    """(1 + s T1) / (1 + s T2)."""
    return (1 + s * lead) / (1 + s * time)


def saturation_slope(p: Mapping[str, float], voltage: float) -> float:
    """Slope of E SE(E) at a voltage: the parabola through both points, by its square root."""
    e_1, e_2 = p["saturation_voltage_1"], p["saturation_voltage_2"]
    low, high = np.sqrt(p["saturation_1"] * e_1), np.sqrt(p["saturation_2"] * e_2)
    root = (high - low) / (e_2 - e_1)
    return float(2 * root * max(low + root * (voltage - e_1), 0.0))
