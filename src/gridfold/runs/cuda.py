"""Simulate many disturbances of one model on a GPU."""

from __future__ import annotations

import time
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from threading import Lock
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gridfold.dynamics.batch.voltages import VoltageExtreme
from gridfold.dynamics.cuda.kernel import (
    ARGUMENTS,
    HIGH,
    LOW,
    compiled_step,
    device_models,
    why_not,
)
from gridfold.dynamics.cuda.tables import (
    Array,
    Arrays,
    ConditionTable,
    NetworkTable,
    energized,
    model_arrays,
)
from gridfold.dynamics.model import DetailedModel
from gridfold.errors import OptionError
from gridfold.grid.change import Event
from gridfold.numerics.columns import NOT_FINITE
from gridfold.numerics.cuda_device import why_no_gpu
from gridfold.numerics.steppers import RungeKutta4, Stepper
from gridfold.numerics.watch import SpreadWatch
from gridfold.runs.batch import why_single
from gridfold.runs.members import Member, Outcome, Plans
from gridfold.runs.method import fit_stepper
from gridfold.runs.simulate import ModelStore
from gridfold.runs.size import check_states
from gridfold.runs.synchronism import DEFAULT_CRITERION, SynchronismCriterion
from gridfold.runs.trajectory import Trajectory

#: Bytes of a block of threads' shared memory, and threads that it has at most.
_SHARED, _THREADS = 48 * 1024, 256
#: Buses with machines up to which a full matrix of impedances is right.
_TERMINALS = 400
#: Bytes that what is kept of the runs of one launch may take.
_BYTES = 2**30


def why_not_on_gpu(model: DetailedModel, stepper: Stepper) -> str | None:
    """Why runs of a model are not made for a GPU; None if they are."""
    single = why_single(model, stepper)
    if single is not None:
        return single
    if not isinstance(stepper, RungeKutta4):
        return f"the method {stepper.name} is not made for GPUs; rk4 is"
    if len(model.layout.terminals) > _TERMINALS:
        return f"machines stand at more than {_TERMINALS} buses"
    return why_not([block.device for block in model.layout.blocks])


def simulate_on_gpu(
    model: DetailedModel,
    disturbances: Sequence[Sequence[Event]],
    t_end: float = 16.0,
    stepper: Stepper | None = None,
    criterion: SynchronismCriterion | None = DEFAULT_CRITERION,
    store: ModelStore | None = None,
    every_state: bool = False,
) -> Iterator[tuple[int, Outcome]]:
    """Simulate disturbances on a GPU, from the equilibrium at t = 0.

    Parameters and results are those of :func:`gridfold.simulate_batch`. A disturbance that cannot
    go side by side with others runs on the CPU.

    Raises
    ------
    OptionError
        There is no GPU, or runs of this model or with this stepper are not made for one.
    """
    method = fit_stepper(model, stepper)
    reason = why_no_gpu() or why_not_on_gpu(model, method.stepper)
    if reason is not None:
        raise OptionError(f"runs cannot be made on a GPU: {reason}")
    if every_state:
        check_states(model, t_end, method.stepper.step)
    store = {model.state: model} if store is None else store
    plans = Plans(model, t_end, method, criterion, store)
    launch = _Launch(plans, plans.kept_states(every_state))
    waiting: list[Member] = []
    size = 0
    for number, events in enumerate(disturbances):
        found = plans.ready(number, tuple(events))
        if not isinstance(found, Member):
            yield number, found
            continue
        waiting.append(found)
        size += launch.size(found)
        if size > _BYTES:
            yield from launch.runs(waiting)
            waiting, size = [], 0
    if waiting:
        yield from launch.runs(waiting)


@dataclass
class _Launch:
    """Runs that are stepped by one start of the kernel."""

    plans: Plans
    kept: NDArray[np.int64]

    def __post_init__(self) -> None:
        model = self.plans.model
        self.shared = model_arrays(model, self.kept)
        self.on = energized(model)
        units = [len(block.units) for block in model.layout.blocks]
        self.threads = min(max(*units, len(model.layout.terminals)), _THREADS)

    def size(self, member: Member) -> int:
        """Bytes that a member takes at most."""
        layout = self.plans.model.layout
        rank = sum(len(change.buses) for change in member.changes if change is not None)
        kept = len(member.times) * len(self.kept) + 3 * layout.n_states + layout.n_signals
        return 8 * (kept + rank * (4 * len(layout.terminals) + 2 * len(self.on)))

    def runs(self, members: Sequence[Member]) -> Iterator[tuple[int, Trajectory]]:
        """Step the members, and yield what came of them with their numbers."""
        began = time.perf_counter()
        plans, model = self.plans, self.plans.model
        arrays = self.shared | self._tables(members)
        results = self._results(members)
        n, rank = len(model.layout.terminals), arrays["drawn"].shape[3]
        bytes_used = _vector_bytes(model, rank)
        in_shared = bytes_used + 16 * n * n <= _SHARED
        kernel = compiled_step(device_models(model.layout), in_shared)
        given: Arrays = arrays | results
        _call(
            kernel[len(members), self.threads, 0, bytes_used + in_shared * 16 * n * n],
            [given[name.strip()] for name in ARGUMENTS.split(",")],
            {name: results[name] for name in _READ},
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
            **conditions.arrays(),
            "segments_at": np.array(segments_at, dtype=np.int64),
            "segments": np.array(segments, dtype=np.int64),
            "times": times,
        }

    def _results(self, members: Sequence[Member]) -> Arrays:
        """Room for what the kernel writes."""
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


#: One launch at a time: it fills a GPU.
_ONE = Lock()
#: What is read back of the results.
_READ = ("states_of", "record", "verdict", "end_row", "extremes")


def _vector_bytes(model: DetailedModel, rank: int) -> int:
    """Bytes of the currents of a run, the compensating ones included, and of two verdicts."""
    return 8 * (2 * len(model.layout.terminals) + 2 * rank + 2)


def _call(kernel: Any, arrays: Sequence[Array], wanted: Arrays) -> None:
    """Start a kernel, and read the arrays that are `wanted` back; the others go one way."""
    from numba import cuda

    with _ONE, warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Grid size")  # few runs do not fill a GPU
        there = [cuda.to_device(np.ascontiguousarray(array)) for array in arrays]
        kernel(*there)
        for array, copy in zip(arrays, there, strict=True):
            if any(array is item for item in wanted.values()):
                copy.copy_to_host(array)
