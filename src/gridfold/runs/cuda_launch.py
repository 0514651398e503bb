"""Runs that one start of the kernel steps on a GPU, and what comes back of them."""

from __future__ import annotations

import time
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from threading import Lock
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gridfold.ceilings import memory_limit
from gridfold.dynamics.batch.voltages import VoltageExtreme
from gridfold.dynamics.cuda.kernel import HIGH, LOW, arguments, compiled_step, device_models
from gridfold.dynamics.cuda.networks import GpuNetwork
from gridfold.dynamics.cuda.precision import Precision
from gridfold.dynamics.cuda.tables import (
    Array,
    Arrays,
    ConditionTable,
    NetworkTable,
    energized,
    model_arrays,
)
from gridfold.dynamics.model import DetailedModel
from gridfold.errors import GpuError
from gridfold.numerics.columns import NOT_FINITE
from gridfold.numerics.watch import SpreadWatch
from gridfold.runs.members import Member, Plans
from gridfold.runs.trajectory import Trajectory

#: Bytes of a block of threads' shared memory, and threads that it has at most.
_SHARED, _THREADS = 48 * 1024, 256
#: Bytes that the runs of a launch take at most, and their share of the free memory.
_MOST, _SHARE = 2**33, 0.25


@dataclass
class Launch:
    """Runs that are stepped by one start of the kernel."""

    plans: Plans
    kept: NDArray[np.int64]
    network: GpuNetwork
    precision: Precision

    def __post_init__(self) -> None:
        model = self.plans.model
        self.shared = model_arrays(model, self.kept) | self.network.arrays
        self.on = energized(model)
        units = [len(block.units) for block in model.layout.blocks]
        self.threads = min(max(*units, len(model.layout.terminals)), _THREADS)

    def size(self, member: Member) -> int:
        """Bytes that a member takes at most."""
        layout = self.plans.model.layout
        changes = (change for change in member.changes if change is not None)
        changed = sum(self.network.change_size(len(change.buses)) for change in changes)
        kept = len(member.times) * len(self.kept) + 3 * layout.n_states + layout.n_signals
        return 8 * (kept + changed + self.network.room * self.network.own)

    def runs(self, members: Sequence[Member]) -> Iterator[tuple[int, Trajectory]]:
        """Step the members, and yield what came of them with their numbers."""
        plans, model = self.plans, self.plans.model
        given = self.precision.rounded(self.shared | self._tables(members))
        own, room = _vector_numbers(model, given["drawn"].shape[3]), self.network.room
        item = np.dtype(self.precision.number).itemsize
        in_shared = item * (own + room) <= _SHARED
        made = self._results(members) | self.network.vectors(len(members), in_shared)
        text = self.network.text(in_shared)
        kernel = compiled_step(device_models(model.layout), text, self.precision)
        began = time.perf_counter()
        results = _call(
            kernel,
            (len(members), self.threads, 0, item * (own + room if in_shared else own)),
            arguments(text),
            given,
            self.precision.rounded(made),
        )
        steps = max(int(results["end_row"].sum()), 1)
        per_step = (time.perf_counter() - began) / steps
        for k, member in enumerate(members):
            verdict, row = int(results["verdict"][k]), int(results["end_row"][k])
            stage = next(s for s, (_, last) in enumerate(member.rows) if row <= last)
            if verdict == 0:
                stage = len(member.rows) - 1
            end = row + (1 if verdict != NOT_FINITE else 0)
            x = np.asarray(results["states_of"][k, 0], dtype=np.float64)
            yield (
                member.number,
                plans.trajectory(
                    member,
                    stage,
                    end,
                    np.array(results["record"][k, :end], dtype=np.float64),
                    self.kept,
                    plans.status(verdict, member.stops[stage], x),
                    plans.voltage_range(member, *self._extremes(results["extremes"][k])),
                    per_step,
                ),
            )

    def _tables(self, members: Sequence[Member]) -> Arrays:
        """Networks, conditions, segments and times of the members."""
        networks = NetworkTable(self.plans.model, self.plans.changes)
        conditions = ConditionTable()
        segments, segments_at = [], [0]
        times = np.zeros((len(members), max(len(member.times) for member in members)))
        for k, member in enumerate(members):
            times[k, : len(member.times)] = member.times
            for stage, (first, last) in enumerate(member.rows):
                state = member.models[stage].state
                watches = [stop.watch for stop in member.stops[stage]]
                network = networks.number(member.changes[stage], state.units_out)
                condition = conditions.number([w for w in watches if isinstance(w, SpreadWatch)])
                new = stage == 0 or state != member.models[stage - 1].state
                segments.append((first, last, network, condition, int(new)))
            segments_at.append(len(segments))
        return {
            **networks.arrays(),
            **self.network.changed(networks),
            **conditions.arrays(),
            "segments_at": np.array(segments_at, dtype=np.int64),
            "segments": np.array(segments, dtype=np.int64),
            "times": times,
        }

    def _results(self, members: Sequence[Member]) -> Arrays:
        """What the kernel writes, as arrays of its shapes."""
        layout, count = self.plans.model.layout, len(members)
        rows = max(len(member.times) for member in members)
        return {
            "signals_of": np.zeros((count, layout.n_signals)),
            "states_of": np.zeros((count, 3, layout.n_states)),
            "record": np.zeros((count, rows, len(self.kept))),
            "verdict": np.zeros(count, dtype=np.int64),
            "end_row": np.zeros(count, dtype=np.int64),
            "extremes": np.zeros((count, self.threads, 6)),
        }

    def _extremes(self, found: Array) -> tuple[VoltageExtreme | None, VoltageExtreme | None]:
        """Lowest and highest of what the threads have found, of equal ones the earliest."""
        if not np.isfinite(found[:, LOW].min()):
            return None, None
        found = found[found[:, HIGH] >= 0]
        low, high = (
            found[np.lexsort((found[:, at + 1], found[:, at + 2], sign * found[:, at]))[0], at:]
            for at, sign in ((LOW, 1), (HIGH, -1))
        )
        return self._named(low), self._named(high)

    def _named(self, found: Array) -> VoltageExtreme:
        return VoltageExtreme(float(np.sqrt(found[0])), int(self.on[int(found[1])]), int(found[2]))


def room_for_launch() -> float:
    """Bytes that the runs of one launch may take, of what is free on the GPU and on this machine."""
    from numba import cuda

    context: Any = cuda.current_context
    free = context().get_memory_info()[0]
    return float(min(_MOST, _SHARE * free, _SHARE * memory_limit()))


#: One launch at a time: it fills a GPU.
_ONE = Lock()
#: Characters of what a compiler or driver says that are repeated.
_SAID = 300
#: What is read back of the results.
_READ = ("states_of", "record", "verdict", "end_row", "extremes")


def _vector_numbers(model: DetailedModel, rank: int) -> int:
    """Numbers of the currents of a run, the compensating ones included, and of two verdicts."""
    return 2 * len(model.layout.terminals) + 2 * rank + 2


def _call(
    kernel: Any, shape: tuple[int, ...], names: Sequence[str], given: Arrays, made: Arrays
) -> Arrays:
    """Start a kernel with the arrays of these names; returns those of `made` that are read back.

    What is `given` goes to the GPU. Of what is `made` there only the shapes count.

    Raises
    ------
    GpuError
        It cannot be compiled, has no room, or fails.
    """
    from numba import cuda

    try:
        with _ONE, warnings.catch_warnings():
            warnings.filterwarnings("ignore", message="Grid size")  # few runs do not fill a GPU
            there = {
                name: cuda.device_array(made[name].shape, made[name].dtype)
                if name in made
                else cuda.to_device(np.ascontiguousarray(given[name]))
                for name in names
            }
            kernel[shape](*there.values())
            return {name: there[name].copy_to_host() for name in _READ}
    except Exception as error:  # of the compiler or the driver, of whatever kind
        what = f"{type(error).__name__}: {' '.join(str(error).split())[:_SAID]}"
        raise GpuError(f"the GPU did not take {shape[0]} runs: {what}") from error
