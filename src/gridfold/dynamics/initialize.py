"""Start values: the equilibrium at the power-flow solution.

Block by block, in the order of demand (machine, load, exciter, turbine, governor, stabilizer), Newton's
method finds the states, set points and free inputs for which all derivatives vanish and the targets
are met. It works on the devices' own kernels, so no start-up formula repeats an equation. Limits are
taken away for that; one that the start is beyond is named, or moved to the start if asked for.
Units of several operating points stand side by side and are solved for together.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
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
from gridfold.errors import GridfoldError, InitializationError
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
class _Report:
    """What is wrong at each of several operating points: beyond limits, or without equilibrium.

    With `raises` a device without equilibrium is an error at once.
    """

    on_limit: OnLimit
    points: int = 1
    raises: bool = True
    lost: set[int] = field(default_factory=set)

    def __post_init__(self) -> None:
        self.lines: list[list[str]] = [[] for _ in range(self.points)]


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
    report = _Report(on_limit)
    (start,) = _starts((layout,), (power_flow,), report)
    (lines,) = report.lines
    if lines and on_limit is OnLimit.ERROR:
        raise InitializationError(
            "the operating point is beyond limits:\n  " + "\n  ".join(lines), [_MOVE]
        )
    return start


def initialize_each(
    layouts: Sequence[Layout], power_flows: Sequence[PowerFlowResult], on_limit: OnLimit
) -> list[Start | None]:
    """The same at several operating points of one grid, whose layouts have the same places.

    None where :func:`initialize` has to tell what is wrong.
    """
    report = _Report(on_limit, len(layouts), raises=False)
    try:
        starts = _starts(layouts, power_flows, report)
    except GridfoldError:
        return [None] * len(layouts)
    refused = on_limit is OnLimit.ERROR
    return [
        None if k in report.lost or (refused and report.lines[k]) else start
        for k, start in enumerate(starts)
    ]


def _starts(
    layouts: Sequence[Layout], power_flows: Sequence[PowerFlowResult], report: _Report
) -> list[Start]:
    """The start at each operating point; `report` has what is wrong with it."""
    blocks, states, known = _start_all(layouts, power_flows, report)
    layout, points = layouts[0], report.points
    constants = np.zeros((points, len(layout.constant_names)))
    for k, (unit, name) in enumerate(layout.constant_names):
        constants[:, k] = known.each(unit, name)
    currents = np.zeros((points, len(layout.source_units)), dtype=np.complex128)
    place = {unit: k for k, unit in enumerate(layout.source_units)}
    for block in layout.blocks:
        if block.device.injects:
            at = known.columns(block.units)
            real, imaginary = (known.row(name, at) for name in block.device.sources[:2])
            columns = [place[unit] for unit in block.units]
            currents[:, columns] = (real + 1j * imaginary).reshape(points, -1)
    return [
        Start(
            replace(own, blocks=tuple(_of_point(block, k, points) for block in blocks)),
            states[k],
            constants[k],
            currents[k],
            tuple(report.lines[k]),
        )
        for k, own in enumerate(layouts)
    ]


def _of_point(block: Block, point: int, points: int) -> Block:
    """The block of one operating point of several that stand side by side."""
    if points == 1:
        return block
    n = len(block.units) // points
    own = slice(point * n, (point + 1) * n)
    parameters = np.ascontiguousarray(block.parameters[:, own])
    return replace(block, units=block.units[own], parameters=parameters)


def reference_at_speed(
    layout: Layout, power_flow: PowerFlowResult, at: int, unit: UnitKey, name: str, speed: float
) -> float:
    """Set point `name` with which a unit's governor, block `at`, holds its power at `speed` (p.u.)."""
    report = _Report(OnLimit.ADJUST)
    blocks, _, known = _start_all((layout,), (power_flow,), report)
    block = blocks[at]
    column = block.units.index(unit)
    alone = replace(
        block, units=(unit,), parameters=np.ascontiguousarray(block.parameters[:, [column]])
    )
    known.put("speed", known.columns((unit,)), speed)
    found, _ = _start_block(alone, known, report)
    return float(found.parameters[found.device.parameter_rows.index(name), 0])


def _start_all(
    layouts: Sequence[Layout], power_flows: Sequence[PowerFlowResult], report: _Report
) -> tuple[list[Block], NDArray[np.float64], StartSignals]:
    """All blocks with their set points, the states (n_points, n_states), and all signals."""
    known = _operating_points(layouts[0], power_flows)
    blocks = [_side_by_side(same) for same in zip(*(own.blocks for own in layouts), strict=True)]
    for block in blocks:
        _foresee(block, known)
    states = np.zeros((report.points, layouts[0].n_states))
    order = sorted(range(len(blocks)), key=lambda k: START_ORDER.index(blocks[k].device.role))
    for k in order:
        own = layouts[0].blocks[k]
        blocks[k], x = _start_block(blocks[k], known, report)
        of_points = x.reshape(len(x), report.points, len(own.units))
        states[:, own.state_index] = of_points.transpose(1, 0, 2)
    return blocks, states, known


def _side_by_side(same: Sequence[Block]) -> Block:
    """A block of several operating points as one."""
    if len(same) == 1:
        return same[0]
    parameters = np.ascontiguousarray(np.hstack([block.parameters for block in same]))
    return replace(same[0], units=same[0].units * len(same), parameters=parameters)


def _operating_points(layout: Layout, power_flows: Sequence[PowerFlowResult]) -> StartSignals:
    case, units = power_flows[0].case, layout.source_units
    buses = [case.bus_index[unit.bus] for unit in units]
    power = np.array([_powers(units, flow) for flow in power_flows])
    voltage = np.array([flow.voltage[buses] for flow in power_flows])
    known = StartSignals(layout, len(power_flows))
    at = known.columns(units)
    known.put("voltage_real", at, voltage.real.ravel())
    known.put("voltage_imag", at, voltage.imag.ravel())
    known.put("active_power", at, power.real.ravel())
    known.put("reactive_power", at, power.imag.ravel())
    return known


def _powers(units: Sequence[UnitKey], power_flow: PowerFlowResult) -> NDArray[np.complex128]:
    """Power that sources give, (n_units,)."""
    of_units = power_flow.unit_power.tolist()
    power = dict(zip(power_flow.case.unit_keys, of_units, strict=True))
    if not power.keys() >= set(units):
        power |= {load.key: -drawn for load, drawn in power_flow.drawn_by_loads()}
    return np.array([power[unit] for unit in units], dtype=np.complex128)


def _foresee(block: Block, known: StartSignals) -> None:
    """Add signals that a block decides before any other."""
    device = block.device
    if device.foresee is nothing_foreseen:
        return
    at = known.columns_of(block)
    signals = {name: known.row(name, at) for name in device.inputs if known.knows(name, at).all()}
    parameters = dict(zip(device.parameter_rows, block.parameters, strict=True))
    for name, values in foreseen(device, parameters, signals, len(at)).items():
        known.put(name, at, values)


def _start_block(
    block: Block, known: StartSignals, report: _Report
) -> tuple[Block, NDArray[np.float64]]:
    """Solve one block; its signals are added to `known`."""
    device, units = block.device, block.units
    at = known.columns_of(block)
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
    _check_equilibrium(problem, solution, report)
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


def _check_equilibrium(
    problem: _StartProblem, solution: NDArray[np.float64], report: _Report
) -> None:
    """Note the points that have no equilibrium, or raise; names the worst unit and equation."""
    error = np.abs(problem.residual(solution.astype(np.complex128)))
    if not error.size:
        return
    unsolved = ~(error <= _RESIDUAL_LIMIT).all(axis=0)
    if not unsolved.any():
        return
    device, units = problem.device, problem.block.units
    if not report.raises:
        report.lost |= set((np.flatnonzero(unsolved) * report.points // len(units)).tolist())
        return
    worst = np.unravel_index(np.argmax(np.nan_to_num(error, nan=np.inf)), error.shape)
    equations = [f"d {name}/dt" for name in device.states]
    equations += [f"target {name}" for name in device.targets]
    raise InitializationError(
        f"{device.model} {units[worst[1]]} has no equilibrium at the "
        f"power-flow solution: {equations[worst[0]]} is off by {error[worst]:.3g}"
    )


def _check_limits(
    block: Block,
    x: NDArray[np.float64],
    u: NDArray[np.float64],
    p: NDArray[np.float64],
    report: _Report,
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
            report.lines[column * report.points // len(block.units)].append(
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
