"""The kernel that steps runs on a GPU, made for a combination of device models.

CUDA has no pointers to functions, so the kernels of the devices are called one by one: the text of
the kernel is written from the devices in their order of evaluation and compiled. The numbers of units
and of buses are data, so grids with the same device models share one kernel.

A block of threads steps one run. A thread copies what belongs to its unit into matrices of one column,
calls the device's kernel, and puts back what it wrote.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from textwrap import indent
from typing import Any, NamedTuple

import numpy as np

from gridfold.dynamics.cuda.network_text import NetworkText
from gridfold.dynamics.cuda.precision import Precision
from gridfold.dynamics.device import Device, Kernel
from gridfold.dynamics.layout import Layout
from gridfold.numerics.cuda_code import device_code, unknown_names

#: What has come of a run.
GOES_ON, BEYOND, NOT_FINITE = range(3)
#: Columns of the table of blocks.
UNITS, STATES_AT, SIGNALS_AT, INPUTS_AT, PARAMETERS_AT = range(5)
#: Columns of the table of segments: rows of the run, network, watched condition, if both are new.
FIRST, LAST, NETWORK, CONDITION, NEW = range(5)
#: What is the matter with a bus: it has a voltage, a fault holds it at zero, or it is de-energized.
ALIVE, ZERO, DEAD = range(3)
#: Columns of the extremes of voltages: squares, and their buses and rows.
LOW, LOW_BUS, LOW_ROW, HIGH, HIGH_BUS, HIGH_ROW = range(6)

#: Arrays that every kernel takes, in order; behind them stand those of its network.
_ARGUMENTS = (
    "blocks", "inputs", "parameters", "start", "sources_at", "sources", "kept", "ranks", "drawn",
    "live", "frozen", "bus_kind", "groups_at", "group_fixed", "group_limit", "entries_at",
    "entry_index", "entry_share", "segments_at", "segments", "times", "signals_of", "states_of",
    "record", "verdict", "end_row", "extremes",
)  # fmt: skip

_HEAD = """\
def step_runs({arguments}):
    tid, size, run = cuda.threadIdx.x, cuda.blockDim.x, cuda.blockIdx.x
    n, n_buses, n_states = len(sources_at) - 1, bus_kind.shape[1], frozen.shape[1]
    signals, x, total, slope = signals_of[run], states_of[run, 0], states_of[run, 1], states_of[run, 2]
    voltages, most = len(start) - 2 * n, drawn.shape[3]
    # Shared by the threads of a run: currents, compensating currents, what was found, the network's.
    shared = cuda.shared.array(0, real)
    compensating = 2 * n
    found = compensating + 2 * most
    room = found + 2
{begin}
    for k in range(tid, len(start), size):
        signals[k] = start[k]
    for k in range(tid, n_states, size):
        x[k] = start[k]
    if tid == 0:
        shared[found] = 0.0
        shared[found + 1] = 0.0
    low, low_bus, low_row, high, high_bus, high_row = math.inf, 0, 0, -1.0, 0, 0
    over, row = {goes_on}, 0
{matrices}
    cuda.syncthreads()
    for s in range(segments_at[run], segments_at[run + 1]):
        row, last = segments[s, {first}], segments[s, {last}]
        network, condition = segments[s, {network}], segments[s, {condition}]
        rank = ranks[network]
        if segments[s, {new}] != 0:
            low, high = math.inf, -1.0
        for k in range(tid, len(kept), size):
            record[run, row, k] = x[kept[k]]
        looking = row == last
        while True:
            h = 0.0 if looking else times[run, row + 1] - times[run, row]
            for stage in range(4):
{sources}
                cuda.syncthreads()
                for t in range(tid, n, size):
                    i_r, i_i = zero, zero
                    for k in range(sources_at[t], sources_at[t + 1]):
                        on = live[network, sources[k, 2]]
                        i_r += on * signals[sources[k, 0]]
                        i_i += on * signals[sources[k, 1]]
                    shared[t], shared[n + t] = i_r, i_i
                cuda.syncthreads()
                for r in range(tid, rank, size):
                    j_r, j_i = zero, zero
                    for t in range(n):
                        w_r, w_i = drawn[network, 0, t, r], drawn[network, 1, t, r]
                        j_r -= w_r * shared[t] - w_i * shared[n + t]
                        j_i -= w_r * shared[n + t] + w_i * shared[t]
                    shared[compensating + r] = j_r
                    shared[compensating + most + r] = j_i
                cuda.syncthreads()
{solve}
                if stage == 0:
                    for b in range(tid, n_buses, size):
                        kind, squared = bus_kind[network, b], zero
                        if kind == {dead}:
                            continue
                        if kind == {alive}:
{bus}
                            squared = v_r * v_r + v_i * v_i
                        if squared < low:
                            low, low_bus, low_row = squared, b, row
                        if squared > high:
                            high, high_bus, high_row = squared, b, row
                cuda.syncthreads()
                if looking:
                    break
{outputs}
{derivatives}
                cuda.syncthreads()
                for k in range(tid, n_states, size):
                    rate = 0.0 if frozen[network, k] != 0 else slope[k]
                    if stage == 0:
                        total[k] = x[k] + h / 6 * rate
                        signals[k] = x[k] + h / 2 * rate
                    elif stage < 3:
                        total[k] += h / 3 * rate
                        signals[k] = x[k] + (h / 2 if stage == 1 else h) * rate
                    else:
                        new = total[k] + h / 6 * rate
                        x[k] = new
                        signals[k] = new
                        if not math.isfinite(new):
                            shared[found] = 1.0
                cuda.syncthreads()
            if looking:
                break
            row += 1
            for k in range(tid, len(kept), size):
                record[run, row, k] = x[kept[k]]
            for g in range(groups_at[condition] + tid, groups_at[condition + 1], size):
                reference = group_fixed[g]
                for k in range(entries_at[g], entries_at[g + 1]):
                    reference += entry_share[k] * x[entry_index[k]]
                for k in range(entries_at[g], entries_at[g + 1]):
                    if abs(x[entry_index[k]] - reference) > group_limit[g]:
                        shared[found + 1] = 1.0
            cuda.syncthreads()
            if shared[found] != 0.0:
                over = {not_finite}
            elif shared[found + 1] != 0.0:
                over = {beyond}
            looking = over != {goes_on} or row == last
        if over != {goes_on}:
            break
    extremes[run, tid, {low}], extremes[run, tid, {high}] = low, high
    extremes[run, tid, {low_bus}], extremes[run, tid, {low_row}] = low_bus, low_row
    extremes[run, tid, {high_bus}], extremes[run, tid, {high_row}] = high_bus, high_row
    if tid == 0:
        verdict[run] = over
        end_row[run] = row
"""

_MATRICES = """\
x{b} = cuda.local.array(({states}, 1), real)
u{b} = cuda.local.array(({inputs}, 1), real)
p{b} = cuda.local.array(({parameters}, 1), real)
y{b} = cuda.local.array(({signals}, 1), real)
d{b} = cuda.local.array(({states}, 1), real)
"""

_CALL = """\
units = blocks[{b}, 0]
for i in range(tid, units, size):
    for k in range({n_states}):
        x{b}[k, 0] = signals[blocks[{b}, 1] + k * units + i]
    for k in range({n_inputs}):
        u{b}[k, 0] = signals[inputs[blocks[{b}, 3] + k * units + i]]
    for k in range({n_parameters}):
        p{b}[k, 0] = parameters[blocks[{b}, 4] + k * units + i]
    for k in range({n_signals}):
        y{b}[k, 0] = signals[blocks[{b}, 2] + k * units + i]
    {kernel}(x{b}, u{b}, p{b}, y{b}, d{b})
"""

_PUT_OUTPUTS = """\
    for k in range({n_signals}):
        signals[blocks[{b}, 2] + k * units + i] = y{b}[k, 0]
"""

_PUT_SLOPES = """\
    for k in range({n_states}):
        slope[blocks[{b}, 1] + k * units + i] = d{b}[k, 0]
"""


class Model(NamedTuple):
    """What the kernel has to know of a device model: its kernels, and the rows of its matrices."""

    source: Kernel | None
    output: Kernel | None
    derivative: Kernel | None
    n_states: int
    n_inputs: int
    n_parameters: int
    n_signals: int


def device_models(layout: Layout) -> tuple[Model, ...]:
    """The device models of a layout, in order of evaluation."""
    return tuple(
        Model(
            device.source,
            device.output,
            device.derivative,
            len(device.states),
            len(device.inputs),
            len(device.parameter_rows),
            len(device.signal_rows),
        )
        for device in (block.device for block in layout.blocks)
    )


def why_not(devices: Sequence[Device]) -> str | None:
    """Which device model cannot run on a GPU, and why; None if all can."""
    for device in devices:
        for stage, kernel in device.kernels.items():
            unknown = unknown_names(kernel)
            if unknown:
                return f"the {stage} kernel of {device.model} uses {', '.join(unknown)}"
    return None


def arguments(network: NetworkText) -> tuple[str, ...]:
    """Names of the arrays that a kernel takes, in order."""
    return (*_ARGUMENTS, *network.arguments)


def kernel_text(models: Sequence[Model], network: NetworkText) -> str:
    """Text of the kernel of some device models that solves its network so."""
    matrices, sources, outputs, derivatives = [], [], [], []
    for b, model in enumerate(models):
        rows = {name: max(1, getattr(model, f"n_{name}")) for name in _ROWS}
        matrices.append(_MATRICES.format(b=b, **rows))
        known = {"b": b, **model._asdict()}
        first = _CALL.format_map(known | {"n_inputs": 0, "kernel": f"source{b}"})
        if model.source is not None:
            sources.append(first + _PUT_OUTPUTS.format_map(known))
        if model.output is not None:
            call = _CALL.format_map(known | {"kernel": f"output{b}"})
            outputs.append(call + _PUT_OUTPUTS.format_map(known) + "cuda.syncthreads()\n")
        if model.derivative is not None:
            call = _CALL.format_map(known | {"kernel": f"derivative{b}"})
            derivatives.append(call + _PUT_SLOPES.format_map(known))
    return _HEAD.format(
        arguments=", ".join(arguments(network)),
        begin=indent(network.begin, " " * 4),
        solve=indent(network.solve, " " * 16),
        bus=indent(network.bus, " " * 28),
        matrices=indent("".join(matrices), " " * 4),
        sources=indent("".join(sources), " " * 16),
        outputs=indent("".join(outputs), " " * 16),
        derivatives=indent("".join(derivatives), " " * 16),
        **_NUMBERS,
    )


_ROWS = ("states", "inputs", "parameters", "signals")
_NUMBERS = {
    name.lower(): value
    for name, value in globals().items()
    if name.isupper() and isinstance(value, int)
}


@cache
def compiled_step(models: tuple[Model, ...], network: NetworkText, precision: Precision) -> Any:
    """The kernel of a combination of device models."""
    from numba import cuda

    compiled: Any = cuda.jit
    return compiled(step_function(models, network, precision))


def step_function(models: Sequence[Model], network: NetworkText, precision: Precision) -> Any:
    """The same as a function that is not compiled yet; what it calls is."""
    import math

    from numba import cuda, from_dtype

    number = precision.number
    names: dict[str, Any] = {
        "cuda": cuda, "math": math, "real": from_dtype(np.dtype(number)), "zero": number(0.0),
    }  # fmt: skip
    for b, model in enumerate(models):
        for stage in ("source", "output", "derivative"):
            kernel = getattr(model, stage)
            if kernel is not None:
                names[f"{stage}{b}"] = device_code(kernel, number)
    exec(compile(kernel_text(models, network), "<runs on a GPU>", "exec"), names)
    return names["step_runs"]
