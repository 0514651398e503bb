"""Start values: the equilibrium at the power-flow solution.

Block by block, in the order of demand (machine, load, exciter, turbine, governor, stabilizer), Newton's
method finds the states, set points and free inputs for which all derivatives vanish and the targets
are met. It works on the devices' own kernels, so no start-up formula repeats an equation. Limits are
taken away for that; one that the start is beyond is named, or moved to the start if asked for.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import Enum
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gridfold.dynamics.device import START_ORDER, Device, nothing_foreseen
from gridfold.dynamics.device_functions import first_guess, foreseen
from gridfold.dynamics.evaluate import derivative_stage, output_stage, source_stage
from gridfold.dynamics.layout import Block, Layout
from gridfold.dynamics.limiting import acting_limits, widened, without_limits
from gridfold.dynamics.start_signals import StartSignals
from gridfold.errors import InitializationError
from gridfold.grid.case import UnitKey
from gridfold.numerics.newton import COMPLEX_STEP, newton_batch
from gridfold.powerflow.result import PowerFlowResult

_RESIDUAL_LIMIT = 1e-6


class OnLimit(Enum):
    """What to do where the operating point is beyond a limit: refuse it, or move the limit there."""

    ERROR = "error"
    ADJUST = "adjust"


_MOVE = '--on-limit adjust (on_limit="adjust") moves limits to where the operating point needs them'


@dataclass(frozen=True)
class Start:
    """The layout with all set points filled in, the initial state and the constant inputs.

    `currents` are the Norton currents of the sources, (n_sources,); `adjusted` tells which limits
    were moved.
    """

    layout: Layout
    x0: NDArray[np.float64]
    constants: NDArray[np.float64]
    currents: NDArray[np.complex128]
    adjusted: tuple[str, ...] = ()


@dataclass
class _LimitReport:
    """Limits that the operating point is beyond."""

    on_limit: OnLimit
    lines: list[str] = field(default_factory=list)


def initialize(
    layout: Layout, power_flow: PowerFlowResult, on_limit: OnLimit = OnLimit.ERROR
) -> Start:
    """Find the start of every block.

    Raises
    ------
    InitializationError
        A device has no equilibrium, or it is beyond limits and `on_limit` does not say to move them;
        names every such limit.
    """
    report = _LimitReport(on_limit)
    blocks, x0, known = _start_all(layout, power_flow, report)
    if report.lines and on_limit is OnLimit.ERROR:
        raise InitializationError(
            "the operating point is beyond limits:\n  " + "\n  ".join(report.lines), [_MOVE]
        )
    constants = np.array([known.value(unit, name) for unit, name in layout.constant_names])
    currents = np.zeros(len(layout.source_units), dtype=np.complex128)
    place = {unit: k for k, unit in enumerate(layout.source_units)}
    for block in blocks:
        if block.device.injects:
            at = known.columns(block.units)
            real, imaginary = (known.row(name, at) for name in block.device.sources[:2])
            currents[[place[unit] for unit in block.units]] = real + 1j * imaginary
    return Start(
        replace(layout, blocks=tuple(blocks)),
        x0,
        constants,
        currents,
        tuple(report.lines),
    )


def reference_at_speed(
    layout: Layout, power_flow: PowerFlowResult, at: int, unit: UnitKey, name: str, speed: float
) -> float:
    """Set point `name` with which a unit's governor, block `at`, holds its power at `speed` (p.u.)."""
    report = _LimitReport(OnLimit.ADJUST)
    blocks, _, known = _start_all(layout, power_flow, report)
    block = blocks[at]
    column = block.units.index(unit)
    alone = replace(
        block, units=(unit,), parameters=np.ascontiguousarray(block.parameters[:, [column]])
    )
    known.put("speed", known.columns((unit,)), speed)
    found, _ = _start_block(alone, known, report)
    return float(found.parameters[found.device.parameter_rows.index(name), 0])


def _start_all(
    layout: Layout, power_flow: PowerFlowResult, report: _LimitReport
) -> tuple[list[Block], NDArray[np.float64], StartSignals]:
    """All blocks with their set points, the states, and all signals."""
    known = _operating_point(layout, power_flow)
    for block in layout.blocks:
        _foresee(block, known)
    x0 = np.zeros(layout.n_states)
    blocks = list(layout.blocks)
    order = sorted(range(len(blocks)), key=lambda k: START_ORDER.index(blocks[k].device.role))
    for k in order:
        blocks[k], x = _start_block(blocks[k], known, report)
        x0[blocks[k].state_index] = x
    return blocks, x0, known


def _operating_point(layout: Layout, power_flow: PowerFlowResult) -> StartSignals:
    case, units = power_flow.case, layout.source_units
    power = dict(zip(case.unit_keys, power_flow.unit_power.tolist(), strict=True))
    if not power.keys() >= set(units):
        power |= {load.key: -drawn for load, drawn in power_flow.drawn_by_loads()}
    voltage = power_flow.voltage[[case.bus_index[unit.bus] for unit in units]]
    given = np.array([power[unit] for unit in units], dtype=np.complex128)
    known = StartSignals(layout)
    at = known.columns(units)
    known.put("voltage_real", at, voltage.real)
    known.put("voltage_imag", at, voltage.imag)
    known.put("active_power", at, given.real)
    known.put("reactive_power", at, given.imag)
    return known


def _foresee(block: Block, known: StartSignals) -> None:
    """Add signals that a block decides before any other."""
    device, units = block.device, block.units
    if device.foresee is nothing_foreseen:
        return
    at = known.columns(units)
    signals = {name: known.row(name, at) for name in device.inputs if known.knows(name, at).all()}
    parameters = dict(zip(device.parameter_rows, block.parameters, strict=True))
    for name, values in foreseen(device, parameters, signals, len(units)).items():
        known.put(name, at, values)


def _start_block(
    block: Block, known: StartSignals, report: _LimitReport
) -> tuple[Block, NDArray[np.float64]]:
    """Solve one block; its signals are added to `known`."""
    device, units = block.device, block.units
    at = known.columns(units)
    seen = known.wanted(device, at)
    for name, value in device.defaults.items():
        known.put_default(name, at, value)
    given = [name for name in device.inputs if name not in device.solved_inputs]
    given_values = {}
    for name in dict.fromkeys((*given, *device.targets)):
        given_values[name], there = seen.row(name)
        if not there.all():
            raise InitializationError(
                f"{device.model} {units[int(np.argmin(there))]}: nothing tells the start value of "
                f"its {name}"
            )
    free = replace(block, parameters=without_limits(device, block.parameters))
    for name in device.solved_inputs:
        given_values.pop(name, None)
    problem = _StartProblem(free, given_values)
    solution = newton_batch(problem.residual, problem.guess(), jacobian=problem.jacobian)
    problem.check(solution)
    x, u, p, y = problem.split(solution.astype(np.complex128))
    solved = [device.inputs.index(name) for name in device.solved_inputs]
    for name, row in zip(device.solved_inputs, u[solved].real, strict=True):
        known.put(name, at, row)
    for rows, values in ((device.states, x), (device.signal_rows, y)):
        for name, row in zip(rows, values.real, strict=True):
            known.give(device, name, at, row)
    parameters = np.ascontiguousarray(p.real)
    for limit in device.limits:
        row = device.parameter_rows.index(limit.parameter)
        parameters[row] = block.parameters[row]
    _check_limits(block, x.real, u.real, parameters, report)
    return replace(block, parameters=parameters), x.real


def _check_limits(
    block: Block,
    x: NDArray[np.float64],
    u: NDArray[np.float64],
    p: NDArray[np.float64],
    report: _LimitReport,
) -> None:
    """Write down the limits that act at the start, and move them in `p` if that is asked for.

    A limit may hide another one behind it, so they are looked for again with those found moved.
    """
    device, moved = block.device, p.copy()
    for _ in device.limits:
        acting = np.argwhere(acting_limits(device, x, u, moved))
        if not len(acting):
            break
        for k, column in acting:
            limit = device.limits[k]
            row = device.parameter_rows.index(limit.parameter)
            one = [np.ascontiguousarray(rows[:, [column]]) for rows in (x, u, moved)]
            needed, symbol = widened(device, k, *one), device.parameters[row].symbol
            report.lines.append(
                f"{device.model} {block.units[column]}: {symbol} ({limit.parameter}) is "
                f"{p[row, column]:.6g}, the start needs {needed:.6g}"
            )
            moved[row, column] = needed
    if report.on_limit is OnLimit.ADJUST:
        p[:] = moved


class _StartProblem:
    """The equations of a block's start: unknowns are states, set points and solved inputs."""

    def __init__(self, block: Block, known: Mapping[str, NDArray[np.float64]]):
        self.block = block
        self.device: Device = block.device
        self.unknowns = (*self.device.states, *self.device.set_points, *self.device.solved_inputs)
        self.known = known
        self.targets = [self.known[name] for name in self.device.targets]
        self.parameters = dict(zip(self.device.parameter_rows, block.parameters, strict=True))

    def guess(self) -> NDArray[np.float64]:
        """First guess, shape (n_unknowns, n_units)."""
        columns = len(self.block.units)
        values = first_guess(self.device, self.parameters, self.known, columns)
        silent = np.zeros(columns)
        return np.array([values.get(name, silent) for name in self.unknowns]).reshape(-1, columns)

    def split(
        self, z: NDArray[np.complex128]
    ) -> tuple[
        NDArray[np.complex128],
        NDArray[np.complex128],
        NDArray[np.complex128],
        NDArray[np.complex128],
    ]:
        """States, inputs, parameters and outputs at the unknowns z."""
        device, columns = self.device, z.shape[1]
        found = dict(zip(self.unknowns, z, strict=True))
        x = np.array([found[name] for name in device.states]).reshape(-1, columns)
        u = np.array(
            [found.get(name, self.known.get(name)) for name in device.inputs], dtype=np.complex128
        ).reshape(-1, columns)
        p = self.block.parameters.astype(np.complex128)
        first = len(device.parameters)
        for row, name in enumerate(device.set_points, start=first):
            p[row] = found[name]
        y = output_stage(device, x, u, p, source_stage(device, x, p))
        return x, u, p, y

    def residual(self, z: NDArray[np.complex128]) -> NDArray[np.complex128]:
        """Derivatives, then target errors, shape (n_unknowns, n_units)."""
        x, u, p, y = self.split(z)
        dx = derivative_stage(self.device, x, u, p, y)
        rows = dict(zip(self.device.states, x, strict=True))
        rows |= dict(zip(self.device.signal_rows, y, strict=True))
        errors = [
            rows[name] - target
            for name, target in zip(self.device.targets, self.targets, strict=True)
        ]
        return np.concatenate([dx, np.array(errors).reshape(-1, z.shape[1])])

    def jacobian(self, z: NDArray[np.float64]) -> NDArray[np.float64]:
        """Slopes of the residuals in the unknowns, (n_unknowns, n_unknowns, n_units), by complex steps.

        All unknowns are stepped at once, each in columns of its own.
        """
        n, units = z.shape
        stepped = np.repeat(z.astype(np.complex128)[:, None, :], n, axis=1)
        every = np.arange(n)
        stepped[every, every] += 1j * COMPLEX_STEP
        found = self._side_by_side.residual(stepped.reshape(n, n * units))
        return found.imag.reshape(n, n, units) / COMPLEX_STEP

    @cached_property
    def _side_by_side(self) -> _StartProblem:
        """The same units again for each unknown."""
        again = len(self.unknowns)
        block = replace(
            self.block,
            units=self.block.units * again,
            parameters=np.ascontiguousarray(np.tile(self.block.parameters, again)),
        )
        known = {name: np.tile(values, again) for name, values in self.known.items()}
        return _StartProblem(block, known)

    def check(self, solution: NDArray[np.float64]) -> None:
        """Raise unless every unit has an equilibrium; names the worst unit and equation."""
        error = np.abs(self.residual(solution.astype(np.complex128)))
        if not error.size:
            return
        worst = np.unravel_index(np.argmax(np.nan_to_num(error, nan=np.inf)), error.shape)
        if not error[worst] <= _RESIDUAL_LIMIT:
            equations = [f"d {name}/dt" for name in self.device.states]
            equations += [f"target {name}" for name in self.device.targets]
            raise InitializationError(
                f"{self.device.model} {self.block.units[worst[1]]} has no equilibrium at the "
                f"power-flow solution: {equations[worst[0]]} is off by {error[worst]:.3g}"
            )
