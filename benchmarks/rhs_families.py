"""What one right-hand side spends on each family of devices.

Every call of the compiled table of kernels is repeated by itself, with its inputs gathered, on the work
array that a whole right-hand side has filled.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from numba import njit
from report import Table
from timing import Timings, interleave, rhs_calls

from gridfold import DetailedModel
from gridfold.dynamics.layout import Block
from gridfold.dynamics.network import SPARSE_FROM
from gridfold.dynamics.rhs import run_calls, solve_voltages
from gridfold.numerics.compiled import invoke

_CALLS, _REPETITIONS = 20, 40
NETWORK, WHOLE = "network", "whole"

Action = Callable[[], object]


def calls_of(model: DetailedModel) -> list[Block]:
    """The block of each call, in the order of the compiled table: sources, outputs, derivatives."""
    blocks = model.layout.blocks
    kinds = ("source", "output", "derivative")
    return [b for kind in kinds for b in blocks if getattr(b.device, kind) is not None]


def actions(model: DetailedModel) -> Mapping[str, Action]:
    """What is timed: each device model with all of its kernels, the network, and the whole."""
    rhs, x = model.compiled, model.x0
    work, dx = np.zeros(rhs.work_size), np.empty(rhs.n_states)
    _once(rhs.address, rhs.integers, rhs.reals, work, x, dx)
    calls: dict[str, list[int]] = {}
    for k, block in enumerate(calls_of(model)):
        calls.setdefault(block.device.model, []).append(k)

    def repeated(which: list[int]) -> Action:
        at = np.array(which, dtype=np.int64)
        return lambda: _repeat_calls(_CALLS, at, rhs.integers, rhs.reals, work, x, dx)

    network = {NETWORK: lambda: _repeat_network(_CALLS, rhs.integers, rhs.reals, work)}
    whole = {WHOLE: rhs_calls(rhs, x, _CALLS)}
    return {name: repeated(which) for name, which in calls.items()} | network | whole


@njit
def _once(address, integers, reals, work, x, dx):
    invoke(address, (integers, reals, work, x, dx))


@njit
def _repeat_calls(count, which, integers, reals, work, x, dx):
    for _ in range(count):
        for k in which:
            run_calls(k, 1, integers, reals, work, x, dx)


@njit
def _repeat_network(count, integers, reals, work):
    for _ in range(count):
        solve_voltages(integers, reals, work)


def family_table(model: DetailedModel, times: Timings) -> Table:
    """Microseconds and shares by family, the models of each named."""
    units = {block.device.model: len(block.units) for block in model.layout.blocks}
    roles = {block.device.model: block.device.role for block in model.layout.blocks}
    spent = {name: 1e6 * times.minimum(name) / _CALLS for name in times.names}
    families: dict[str, list[str]] = {}
    for name, role in roles.items():
        families.setdefault(role.name.lower().replace("_", " "), []).append(name)
    rows = []
    for family, names in families.items():
        total = sum(spent[name] for name in names)
        words = ", ".join(
            f"{name} {units[name]} x {1e3 * spent[name] / units[name]:.0f}" for name in names
        )
        rows.append((family, f"{total:.1f}", f"{total / spent[WHOLE]:.0%}", words))
    rows.append((NETWORK, f"{spent[NETWORK]:.1f}", f"{spent[NETWORK] / spent[WHOLE]:.0%}", ""))
    known = sum(value for name, value in spent.items() if name != WHOLE)
    rest = spent[WHOLE] - known
    rows.append(("all else", f"{rest:.1f}", f"{rest / spent[WHOLE]:.0%}", ""))
    rows.append((WHOLE, f"{spent[WHOLE]:.1f}", "100%", ""))
    solver = "sparse" if len(model.layout.terminals) >= SPARSE_FROM else "dense"
    return Table(
        f"One right-hand side of {model.case.name}, {model.n_states} states, in microseconds (least of "
        f"{_REPETITIONS}); the network, {len(model.layout.terminals)} terminals, is {solver}; of each "
        "model units x nanoseconds a unit:",
        ("family", "time", "share", "models"),
        rows,
    )


def measure(model: DetailedModel) -> Table:
    """Time everything in turn."""
    return family_table(model, interleave(actions(model), _REPETITIONS))
