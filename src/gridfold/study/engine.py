"""Run a study, or the rest of one that was broken off."""

from __future__ import annotations

import platform
import time
from collections.abc import Callable, Collection, Iterator, Sequence
from concurrent.futures import Executor
from contextlib import ExitStack
from dataclasses import asdict, replace
from datetime import UTC, datetime
from itertools import groupby
from pathlib import Path
from threading import Event
from typing import Any

import numpy as np

from gridfold.dynamics.cuda.precision import Precision
from gridfold.equivalents.small_models import Topology, topology
from gridfold.errors import OptionError
from gridfold.grid.grid_map import grid_map
from gridfold.grid.timeline import build_timeline
from gridfold.io.study_store import StudyStore
from gridfold.numerics.blas import one_blas_thread
from gridfold.numerics.deadline import check_limit
from gridfold.numerics.lanes import WIDTH
from gridfold.study.check_sample import checked_runs
from gridfold.study.executors import Workers, team
from gridfold.study.generate import Contingency, contingency_from_record
from gridfold.study.identity import identity_of, refuse_changed, refuse_other, refuse_other_files
from gridfold.study.named_files import NamedFiles, read_named
from gridfold.study.on_gpu import (
    choose_device,
    device_asked_for,
    refuse_single_elsewhere,
    with_precision,
)
from gridfold.study.prepare import Offline, Prepared, describe, do_offline_work, prepare
from gridfold.study.processes import refuse_nested
from gridfold.study.solve import Batch, Task, why_one_by_one
from gridfold.study.study_file import RunsOn, Study, load_study, with_own_devices
from gridfold.study.summary import column_types
from gridfold.study.team import Team
from gridfold.study.trust import code_record, require_trust
from gridfold.study.work import Progress, Stage, StudyRun, Work

#: Most contingencies on reduced models of other topologies that are handed out at once where each runs
#: by itself, and most that advance together: a kill loses those handed out.
_MOST_MOVED, _MOST_TOGETHER = 4, 128
#: Contingencies that are handed to a GPU at once.
_ON_GPU = 1024
#: States times steps of those that advance together, some seconds of one core.
_WORK_TOGETHER = 1.5e8


@one_blas_thread
def run_study(
    study: Study | str | Path,
    out: str | Path | None = None,
    *,
    resume: bool = False,
    retry_failed: bool = False,
    time_limit: float | None = None,
    device: RunsOn | str | None = None,
    precision: Precision | str | None = None,
    workers: Workers | str = Workers.THREADS,
    count: int | None = None,
    cluster: str | None = None,
    executor: Executor | None = None,
    folder: str | Path | None = None,
    on_progress: Callable[[Progress], None] | None = None,
    stop: Event | None = None,
    trust_devices: bool | Collection[str] = False,
    devices: Sequence[str | Path] = (),
) -> StudyRun:
    """Run a study, or the rest of one.

    Parameters
    ----------
    study : Study or path
        The study, or its file.
    out : path, optional
        Folder of the results; by default ``NAME.results`` beside the file ``NAME.toml``.
    resume : bool
        Go on with what is there; without it the folder must not hold a study.
    retry_failed : bool
        Go on, and try again what has failed; a row stays until there is a new one.
    time_limit : float, optional
        Longest time on the machine for one contingency in seconds, instead of the study's.
    device : {"auto", "cpu", "cuda"}, optional
        What contingencies run on, instead of what the study says.
    precision : {"double", "single"}, optional
        Digits with which a GPU computes, instead of what the study says.
    workers : {"threads", "processes"}
        What works on this machine.
    count : int, optional
        How many; as many as there are cores by default.
    cluster : str, optional
        ``local`` or ``tcp://HOST:PORT``: a Dask cluster, instead.
    executor : Executor, optional
        Any executor of the standard library's kind, instead.
    folder : path, optional
        Where relative file names in `study` start; by default at its file, else here.
    on_progress : callable, optional
        Called with a :class:`Progress` from the calling thread.
    stop : threading.Event, optional
        Ends it early once it is set, with what is in flight written. So does a KeyboardInterrupt.
    trust_devices : bool or collection of str
        Whether Python files that the study names as `devices` may run; or the digests
        (:attr:`gridfold.numerics.code_files.Code.digest`) of those that may.
    devices : sequence of path
        Python files with device models beside those that the study names. They may run, and are part
        of the study from then on.

    Returns
    -------
    StudyRun
        Counts.

    Raises
    ------
    GridfoldError
        The study does not fit, the GPU that is asked for fails, or the results cannot be written. What
        was written stays.
    """
    began = time.monotonic()
    path = None if isinstance(study, Study) else Path(study)
    wanted = study if isinstance(study, Study) else load_study(study)
    start = Path(folder) if folder is not None else (path.parent if path else Path())
    wanted = with_precision(with_own_devices(wanted, devices, start), precision)
    target = _target(out, path)
    kind = _kind(workers)
    check_limit(time_limit)
    asked = device_asked_for(wanted.run.device if device is None else device)
    refuse_single_elsewhere(asked, wanted.run.precision)
    if kind is Workers.PROCESSES or cluster == "local":
        refuse_nested()
    goes_on = resume or retry_failed
    tell = on_progress or (lambda progress: None)
    tell(Progress(Stage.PREPARING, message="power flow, linearization, reduction"))
    named = read_named(wanted, start)
    given = {Path(file).resolve() for file in devices}
    require_trust([c for c in named.own_code if Path(c.path) not in given], trust_devices)
    with ExitStack() as stack:
        # Locked before the work begins, so that two runs cannot both find it free.
        earlier = stack.enter_context(StudyStore.resume(target)) if goes_on else None
        offline, contingencies = _offline(wanted, named, count, earlier, time_limit)
        prepared = prepare(offline)
        chosen = choose_device(asked, prepared, contingencies)
        on_gpu, only = chosen.on_gpu, chosen.on_gpu and asked is RunsOn.CUDA
        offline = replace(offline, on_gpu=on_gpu, gpu_only=only)
        prepared = replace(prepared, on_gpu=on_gpu, gpu_only=only)
        count = None if count is None else min(count, max(len(contingencies), 1))
        # Proved before anything is written: workers that do not start leave nothing behind.
        crew = stack.enter_context(team(offline, prepared, kind, count, cluster, executor))
        store = earlier or stack.enter_context(_create(target, offline, prepared, contingencies))
        settings = store.identity["settings"]
        told = (*chosen.words, *settings.get("unplaced", ()), *settings.get("warnings", ()))
        tell(Progress(Stage.PREPARING, warnings=told))
        if chosen.single is not None:
            store.tell("single_precision", asdict(chosen.single))
        rounds = _rounds(store, prepared, crew.count, retry_failed)
        work = Work(store, crew, rounds, tell, began)
        stage = work.run(stop or Event())
        store.tell("last_run", _provenance(crew, prepared))
        return work.outcome(target, stage)


def _kind(workers: Workers | str) -> Workers:
    try:
        return Workers(workers)
    except ValueError:
        raise OptionError(f"workers must be threads or processes, not {workers!r}") from None


def _target(out: str | Path | None, path: Path | None) -> Path:
    if out is not None:
        return Path(out)
    return path.with_suffix(".results") if path else Path("study.results")


def _offline(
    study: Study,
    named: NamedFiles,
    count: int | None,
    store: StudyStore | None,
    time_limit: float | None,
) -> tuple[Offline, tuple[Contingency, ...]]:
    """The study made ready for workers; with a store, for the rest of that."""
    if store is not None:
        refuse_other(store, study)
        refuse_other_files(store, named.hashes)
    earlier = None if store is None else store.identity["settings"]
    offline, contingencies = do_offline_work(study, named, count, earlier)
    if store is not None:
        if store.identity.get("fingerprint") == offline.case.fingerprint:
            store.complete_list([item.record() for item in contingencies])
        refuse_changed(store, identity_of(offline), contingencies)
    limit = study.run.time_limit if time_limit is None else time_limit
    return replace(offline, time_limit=limit), contingencies


def _create(
    target: Path, offline: Offline, prepared: Prepared, contingencies: Sequence[Contingency]
) -> StudyStore:
    """A new store with what the study is about."""
    about = identity_of(offline) | {
        "study": offline.study.content(),
        "settings": describe(offline, prepared),
        "map": grid_map(offline.case, offline.study_buses),
        "own_code": [code_record(code) for code in offline.named.own_code],
    }
    records = [item.record() for item in contingencies]
    return StudyStore.create(target, about, records, column_types())


def _rounds(
    store: StudyStore, prepared: Prepared, workers: int, retry_failed: bool
) -> Iterator[tuple[str, list[Batch]]]:
    """What is to be done: all that has no result, then checks of those that matter."""
    records = {record["number"]: record for record in store.contingencies()}
    sample = prepared.study.check.sample
    every = sample == "all" or int(sample) >= len(records)
    left = records.keys() - store.done() | (store.failed() if retry_failed else set())
    tasks = [Task(contingency_from_record(records[number]), check=every) for number in sorted(left)]
    yield "", _batches(tasks, prepared, workers)
    if every or prepared.small is None:
        return
    frame = store.frame()
    chosen = set(checked_runs(frame, int(sample)))
    chosen -= set(frame["number"][frame["checked"].notna()])
    tasks = [
        Task(contingency_from_record(records[number]), check=True) for number in sorted(chosen)
    ]
    batches = _batches(tasks, prepared, workers)
    yield f"{len(tasks)} runs are checked with the detailed model", batches


def _batches(tasks: list[Task], prepared: Prepared, workers: int) -> list[Batch]:
    """Tasks that advance together; with reduced models those of one topology, built once, in a row."""
    if prepared.small is None:
        return _cut(tasks, _together(len(tasks), prepared, workers))
    case, t_end = prepared.model.case, prepared.study.run.t_end

    def last(task: Task) -> Topology:
        return topology(build_timeline(case, task.contingency.events, t_end)[-1].state, case)

    most = _MOST_MOVED
    if why_one_by_one(prepared) is None:
        most = max(_MOST_MOVED, min(WIDTH, -(-len(tasks) // max(workers, 1))))
    batches: list[Batch] = []
    moved: list[Task] = []
    for key, together in groupby(tasks, key=last):
        members = list(together)
        if not key:
            batches += _cut(members, _together(len(members), prepared, workers))
            continue
        for few in _cut(members, most):
            if len(moved) + len(few) > most:
                batches.append(tuple(moved))
                moved = []
            moved += few
    return [*batches, tuple(moved)] if moved else batches


def _cut(tasks: list[Task], size: int) -> list[Batch]:
    """Batches of at most so many tasks."""
    return [tuple(tasks[k : k + size]) for k in range(0, len(tasks), size)]


def _together(count: int, prepared: Prepared, workers: int) -> int:
    """How many of the tasks a worker takes at once: full groups, for all workers as many."""
    if why_one_by_one(prepared) is not None:
        return 1
    if prepared.on_gpu:
        return min(_ON_GPU, max(1, -(-count // max(workers, 1))))
    steps = prepared.study.run.t_end / prepared.method.stepper.step
    most = min(_WORK_TOGETHER / (max(prepared.model.n_states, 1) * steps), _MOST_TOGETHER)
    rounds = max(1, -(-count // (max(workers, 1) * max(int(most), WIDTH)))) * max(workers, 1)
    return max(WIDTH, -(-count // (rounds * WIDTH)) * WIDTH)


def _provenance(crew: Team, prepared: Prepared) -> dict[str, Any]:
    return {
        "finished": datetime.now(UTC).isoformat(timespec="seconds"),
        "workers": crew.description + (", a GPU" if prepared.on_gpu else ""),
        "machine": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
        "numpy": np.__version__,
    }
