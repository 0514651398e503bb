"""Runs and a study on a GPU that Numba's simulator stands for; what they give goes to a file as JSON.

Run with ``NUMBA_ENABLE_CUDASIM=1`` and the tests on the path: ``python simulated_gpu.py FOLDER``.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
from three_machines import disturbances, three_machines

import gridfold as gf
from gridfold.io.study_store import StudyStore
from gridfold.numerics.steppers import RungeKutta4
from gridfold.runs import cuda
from gridfold.runs.cuda import simulate_on_gpu
from gridfold.runs.summary import summarize
from gridfold.runs.trajectory import Trajectory
from gridfold.study import Progress, run_study
from gridfold.study.study_file import parse_study
from gridfold.study.summary import WALL

T_END, STEPPER = 0.14, RungeKutta4(0.02)
#: What ends some of the runs early.
CRITERION = gf.SynchronismCriterion(limit_deg=11.5)
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


def compared(model: gf.DetailedModel) -> list[dict[str, object]]:
    """How far each run on the GPU is from the run by itself on the CPU."""
    found = dict(
        simulate_on_gpu(model, disturbances(), T_END, STEPPER, CRITERION, every_state=True)
    )
    return [
        difference(found[number], gf.simulate(model, events, T_END, STEPPER, CRITERION))
        for number, events in enumerate(disturbances())
    ]


def in_global_memory(model: gf.DetailedModel) -> dict[str, object]:
    """The same of a run whose impedances do not fit, and which nothing ends early."""
    fits, cuda._SHARED = cuda._SHARED, 0
    (events,) = disturbances()[1:2]
    ((_, run),) = simulate_on_gpu(model, [events], T_END, STEPPER, None, every_state=True)
    cuda._SHARED = fits
    return difference(run, gf.simulate(model, events, T_END, STEPPER, None))


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
        "field_voltage": float(
            np.nanmax(np.abs(run.signal("field_voltage") - alone.signal("field_voltage")))
        ),
        "voltage": max(abs(mine.value - other.value) for mine, other in extremes),
    }  # fmt: skip


def studied(folder: Path, device: str) -> tuple[str, list[str], int]:
    """Rows of the study as JSON, what it said, and how often the kernel was started."""
    words: list[str] = []
    started: list[object] = []
    start = cuda._call
    cuda._call = lambda *given: started.append(given) or start(*given)
    case = {"source": str(folder / "grid"), "devices": [str(folder / "mine.py")]}

    def tell(progress: Progress) -> None:
        words.extend(progress.warnings)

    run = run_study(
        parse_study(STUDY | {"case": case}),
        folder / device,
        device=device,
        count=1,
        on_progress=tell,
        trust_devices=True,
    )
    with StudyStore.read(run.folder) as store:
        frame = store.frame()
    rows = frame[[name for name in frame if not name.startswith(WALL)]]
    cuda._call = start
    return rows.to_json(orient="split", double_precision=15), words, len(started)


if __name__ == "__main__":
    sys.setswitchinterval(1e-5)  # a thread of the simulator waits for all others at every step
    target = Path(sys.argv[1])
    model = three_machines(target)
    model.case.save(target / "grid")
    record = {
        "runs": [*compared(model), in_global_memory(model)],
        "studies": {device: studied(target, device) for device in ("cpu", "cuda")},
    }
    (target / "found.json").write_text(json.dumps(record), encoding="utf-8")
