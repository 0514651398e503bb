"""Runs and studies on a GPU that Numba's simulator stands for; what they give goes to a file as JSON.

Run with ``NUMBA_ENABLE_CUDASIM=1`` and the tests on the path: ``python simulated_gpu.py FOLDER``.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from device_families import FAMILIES
from three_machines import disturbances, three_machines

import gridfold as gf
from gridfold.dynamics.cuda import networks
from gridfold.dynamics.cuda.levels import level_factors
from gridfold.dynamics.cuda.precision import Precision
from gridfold.io.study_store import StudyStore
from gridfold.numerics.steppers import RungeKutta4
from gridfold.report.study_tables import study_facts
from gridfold.runs import cuda_launch
from gridfold.runs.cuda import simulate_on_gpu
from gridfold.runs.summary import summarize
from gridfold.runs.trajectory import Trajectory
from gridfold.study import Progress, run_study
from gridfold.study.study_file import parse_study
from gridfold.study.summary import WALL

T_END, STEPPER = 0.14, RungeKutta4(0.02)
#: What ends some of the runs early.
CRITERION = gf.SynchronismCriterion(limit_deg=11.5)
#: Buses with machines up to which the network is a full matrix; all levels but the last are levels.
SPARSE, ONE_ROW = 0, partial(level_factors, tail=1)
STUDY = {
    "schema": 1,
    "contingencies": {"bus_faults": "1-4", "clearing_time": 0.05},
    "contingency": [
        {
            "name": "redispatched",
            "events": [{"kind": "redispatch", "active_mw": 2.0, "buses": "2"}],
        }
    ],
    "model": {"kind": "detailed"},
    "run": {"t_end": 0.1, "step": 0.02, "method": "rk4"},
}


def compared(
    model: gf.DetailedModel,
    events: Sequence[Sequence[gf.Event]],
    criterion: gf.SynchronismCriterion | None = CRITERION,
    **options: Any,
) -> list[dict[str, object]]:
    """How far each run on the GPU is from the run by itself on the CPU."""
    rest = (T_END, STEPPER, criterion)
    found = dict(simulate_on_gpu(model, events, *rest, every_state=True, **options))
    return [
        difference(found[number], gf.simulate(model, happens, *rest))
        for number, happens in enumerate(events)
    ]


def in_global_memory(model: gf.DetailedModel, **options: Any) -> dict[str, object]:
    """The same of a run whose network does not fit into shared memory, and which nothing ends early."""
    fits, cuda_launch._SHARED = cuda_launch._SHARED, 0
    (found,) = compared(model, disturbances()[1:2], None, **options)
    cuda_launch._SHARED = fits
    return found


def difference(run: object, alone: Trajectory) -> dict[str, object]:
    assert isinstance(run, Trajectory), run
    here, there = summarize(run), summarize(alone)
    extremes = [
        (mine, other)
        for mine, other in (
            (here.lowest_voltage, there.lowest_voltage),
            (here.highest_voltage, there.highest_voltage),
        )
        if mine is not None and other is not None
    ]
    return {
        "status": run.status.value,
        "same": (run.status, run.culprit, run.notices)
        == (alone.status, alone.culprit, alone.notices)
        and np.array_equal(run.times, alone.times),
        "angle_deg": float(np.nanmax(np.abs(run.rotor_angle_deg() - alone.rotor_angle_deg()))),
        "moved_deg": float(np.nanmax(np.ptp(run.rotor_angle_deg(), axis=0))),
        "state": float(np.abs(run.states - alone.states).max()),
        "voltage": max(abs(mine.value - other.value) for mine, other in extremes),
    }


def family(name: str) -> dict[str, object]:
    """A run of three steps with a fault at a machine, in either precision; its devices."""
    model, rest = FAMILIES[name](), (0.03, RungeKutta4(0.01), None)
    events = [gf.BusFault(model.layout.terminals[0], 0.01, 0.01, 0.01, 0.05)]
    alone = gf.simulate(model, events, *rest)
    apart = {}
    for precision in Precision:
        ((_, run),) = simulate_on_gpu(model, [events], *rest, every_state=True, precision=precision)
        assert isinstance(run, Trajectory), run
        relative = np.abs(run.states - alone.states) / (1.0 + np.abs(alone.states))
        apart[precision.value] = float(relative.max())
    devices = [block.device.model for block in model.layout.blocks]
    moved = float(np.abs(alone.states - alone.states[0]).max())
    return {"apart": apart, "moved": moved, "devices": devices}


def studied(folder: Path, name: str, device: str, **changes: Any) -> dict[str, Any]:
    """Rows of the study, what it said, and how often the kernel was started."""
    words: list[str] = []
    started: list[object] = []
    start = cuda_launch._call
    cuda_launch._call = lambda *given: started.append(given) or start(*given)
    case = {"source": str(folder / "grid"), "devices": [str(folder / "mine.py")]}

    def tell(progress: Progress) -> None:
        words.extend(progress.warnings)

    run = run_study(
        parse_study(STUDY | {"case": case} | changes),
        folder / name,
        device=device,
        count=1,
        on_progress=tell,
        trust_devices=True,
    )
    with StudyStore.read(run.folder) as store:
        frame, facts, about = store.frame(), study_facts(store), store.identity
    rows = frame[[column for column in frame if not column.startswith(WALL)]]
    cuda_launch._call = start
    return {
        "rows": rows.to_json(orient="split", double_precision=15),
        "words": words,
        "started": len(started),
        "facts": facts,
        "single": about.get("single_precision"),
    }


if __name__ == "__main__":
    sys.setswitchinterval(1e-5)  # a thread of the simulator waits for all others at every step
    target = Path(sys.argv[1])
    model = three_machines(target)
    model.case.save(target / "grid")
    runs = [*compared(model, disturbances()), in_global_memory(model)]
    networks.level_factors = ONE_ROW
    by_levels = [
        *compared(model, disturbances()[1:], full_terminals=SPARSE),
        in_global_memory(model, full_terminals=SPARSE),
    ]
    in_single = [
        *compared(model, disturbances()[1:3], None, precision=Precision.SINGLE),
        *compared(
            model, disturbances()[1:3], None, precision=Precision.SINGLE, full_terminals=SPARSE
        ),
    ]
    single = {"run": STUDY["run"] | {"t_end": 0.06, "precision": "single"}}
    record = {
        "runs": runs,
        "by_levels": by_levels,
        "in_single": in_single,
        "families": {name: family(name) for name in FAMILIES},
        "studies": {device: studied(target, device, device) for device in ("cpu", "cuda")},
        "single": studied(target, "single", "cuda", **single),
    }
    (target / "found.json").write_text(json.dumps(record), encoding="utf-8")
