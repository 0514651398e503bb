"""Run a study: hand out contingencies, write what comes back, go on where a run was broken off."""

from __future__ import annotations

import hashlib
import json
import platform
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from contextlib import ExitStack
from dataclasses import dataclass
from datetime import UTC, datetime
from enum import Enum
from pathlib import Path
from threading import Event
from typing import Any

import numpy as np

from gridfold.contingencies.executors import Team, Workers, team
from gridfold.contingencies.generate import Contingency, contingency_from_record
from gridfold.contingencies.grid_map import grid_map
from gridfold.contingencies.prepare import Offline, Prepared, describe, do_offline_work, prepare
from gridfold.contingencies.solve import Solved, Task, failed
from gridfold.contingencies.study_file import Study, load_study
from gridfold.contingencies.summary import column_types
from gridfold.errors import OptionError
from gridfold.io.results import replacing
from gridfold.io.study_store import StudyStore
from gridfold.version import __version__

#: Tasks handed out for each worker: one that is worked on, one that waits.
_AHEAD = 2
#: Seconds after which a wait is broken off to see whether the study is to be stopped.
_GLANCE = 0.2
#: Times a contingency is tried where the process that worked on it dies.
_TRIES = 3


class Stage(Enum):
    """Where a study is."""

    PREPARING = "preparing"
    RUNNING = "running"
    DONE = "done"
    INTERRUPTED = "interrupted"


@dataclass(frozen=True)
class Progress:
    """How far a study is.

    Parameters
    ----------
    stage : Stage
        Where it is.
    done, total : int
        Contingencies with a result, of how many.
    stable, unstable, failed : int
        Of those done, how many of each.
    seconds : float
        Since the run began.
    per_second : float
        Contingencies a second in this run; 0 before the first.
    latest : mapping, optional
        Name and figures of the contingency that has just been written.
    message : str
        What there is to say.
    """

    stage: Stage
    done: int = 0
    total: int = 0
    stable: int = 0
    unstable: int = 0
    failed: int = 0
    seconds: float = 0.0
    per_second: float = 0.0
    latest: Mapping[str, Any] | None = None
    message: str = ""


@dataclass(frozen=True)
class StudyRun:
    """What a run of a study came to; the results are in `folder`."""

    folder: Path
    stage: Stage
    done: int
    total: int
    stable: int
    unstable: int
    failed: int
    seconds: float
    workers: str

    @property
    def complete(self) -> bool:
        """Whether every contingency has a result."""
        return self.done == self.total


def run_study(
    study: Study | str | Path,
    out: str | Path | None = None,
    *,
    resume: bool = False,
    workers: Workers | str = Workers.THREADS,
    count: int | None = None,
    cluster: str | None = None,
    executor: Executor | None = None,
    folder: str | Path | None = None,
    on_progress: Callable[[Progress], None] | None = None,
    stop: Event | None = None,
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

    Returns
    -------
    StudyRun
        Counts.

    Raises
    ------
    GridfoldError
        The study does not fit, or the results cannot be written. What was written stays.
    """
    began = time.monotonic()
    path = None if isinstance(study, Study) else Path(study)
    wanted = study if isinstance(study, Study) else load_study(study)
    start = Path(folder) if folder is not None else (path.parent if path else Path())
    target = _target(out, path)
    kind = _kind(workers)
    tell = on_progress or (lambda progress: None)
    tell(Progress(Stage.PREPARING, message="power flow, linearization, reduction"))
    with ExitStack() as stack:
        store, todo, offline, prepared = _open(wanted, start, target, resume, count, stack)
        crew = stack.enter_context(team(offline, prepared, kind, count, cluster, executor))
        work = _Work(store, crew, todo, tell, began)
        stage = work.run(stop or Event())
        store.tell("last_run", _provenance(crew))
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


def _open(
    study: Study, start: Path, target: Path, resume: bool, count: int | None, stack: ExitStack
) -> tuple[StudyStore, list[Task], Offline, Prepared]:
    """The store, what is to be done, and the study made ready."""
    if resume:
        # Locked before the work begins, so that two runs cannot both find it free.
        store = stack.enter_context(StudyStore.resume(target))
        _refuse_other(store, study)
    offline, contingencies = do_offline_work(study, start, count)
    prepared = prepare(offline)
    identity = _identity(offline)
    if resume:
        _refuse_changed(store, identity, contingencies)
    else:
        about = identity | {
            "study": study.content(),
            "settings": describe(offline, prepared),
            "map": grid_map(offline.case, offline.study_buses),
            "checked": sorted(_checked(study, len(contingencies))),
        }
        records = [item.record() for item in contingencies]
        store = stack.enter_context(StudyStore.create(target, about, records, column_types()))
    return store, _tasks(store), offline, prepared


def _identity(offline: Offline) -> dict[str, Any]:
    """What must be the same for a study to be resumed."""
    content = json.dumps(offline.study.content(), sort_keys=True)
    return {
        "gridfold": __version__,
        "case": offline.case.name,
        "fingerprint": offline.case.fingerprint,
        "study_hash": hashlib.sha256(content.encode()).hexdigest(),
    }


def _refuse_other(store: StudyStore, study: Study) -> None:
    """Say which key differs before the work is done, where the study file is another one."""
    before, now = store.identity["study"], study.content()
    for key in sorted(_flat(before).keys() | _flat(now).keys()):
        was, wants = _flat(before).get(key), _flat(now).get(key)
        if was != wants:
            raise OptionError(
                f"{store.folder}: the results belong to another study: {key} was {was!r} and is "
                f"{wants!r}; take another folder with --out"
            )


def _refuse_changed(
    store: StudyStore, identity: Mapping[str, Any], contingencies: Sequence[Contingency]
) -> None:
    there = store.identity
    words = {
        "gridfold": "another version of gridfold",
        "fingerprint": "other data of the case",
        "case": "another case",
    }
    for key, what in words.items():
        if there.get(key) != identity[key]:
            raise OptionError(
                f"{store.folder}: the results were made with {what} ({there.get(key)}, now "
                f"{identity[key]}); take another folder with --out"
            )
    if store.contingencies() != [json.loads(json.dumps(c.record())) for c in contingencies]:
        raise OptionError(f"{store.folder}: the list of contingencies is another one")


def _flat(content: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for key, value in content.items():
        if isinstance(value, dict):
            flat |= _flat(value, f"{prefix}{key}.")
        else:
            flat[prefix + key] = value
    return flat


def _checked(study: Study, total: int) -> set[int]:
    """Numbers of the contingencies that are checked: spread evenly over the list."""
    sample = study.check.sample
    size = total if sample == "all" else min(int(sample), total)
    return {int(number) for number in np.linspace(1, total, size).round()} if size else set()


def _tasks(store: StudyStore) -> list[Task]:
    done, checked = store.done(), set(store.identity["checked"])
    return [
        Task(contingency_from_record(record), record["number"] in checked)
        for record in store.contingencies()
        if record["number"] not in done
    ]


def _provenance(crew: Team) -> dict[str, Any]:
    return {
        "finished": datetime.now(UTC).isoformat(timespec="seconds"),
        "workers": crew.description,
        "machine": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
        "numpy": np.__version__,
    }


class _Work:
    """Tasks that are handed out, and the count of what came back."""

    def __init__(
        self,
        store: StudyStore,
        crew: Team,
        todo: Sequence[Task],
        tell: Callable[[Progress], None],
        began: float,
    ):
        self.store, self.crew, self.tell, self.began = store, crew, tell, began
        self.total = len(store.contingencies())
        self.names = {task.contingency.number: task.contingency.name for task in todo}
        self.waiting: Iterator[Task] = iter(todo)
        self.again: list[Task] = []
        self.tries: dict[int, int] = {}
        self.flying: dict[Future[Solved], Task] = {}
        self.counts = _counts(store)
        self.here = 0
        self.started = time.monotonic()

    def run(self, stop: Event) -> Stage:
        """Work until all is done, or `stop` is set."""
        self._tell(Stage.RUNNING, message=self.crew.description)
        try:
            while self._hand_out() and not stop.is_set():
                done, _ = wait(self.flying, _GLANCE, FIRST_COMPLETED)
                self._take(done)
        except KeyboardInterrupt:
            stop.set()
        if stop.is_set():
            self._wind_up()
        stage = Stage.DONE if sum(self.counts.values()) == self.total else Stage.INTERRUPTED
        self._tell(stage)
        return stage

    def outcome(self, folder: Path, stage: Stage) -> StudyRun:
        """The counts at the end."""
        seconds = time.monotonic() - self.began
        counts = self.counts
        return StudyRun(
            folder,
            stage,
            sum(counts.values()),
            self.total,
            counts["stable"],
            counts["unstable"],
            counts["failed"],
            seconds,
            self.crew.description,
        )

    def _hand_out(self) -> bool:
        """Keep the workers busy; false when nothing is left."""
        while len(self.flying) < _AHEAD * self.crew.count:
            task = self.again.pop() if self.again else next(self.waiting, None)
            if task is None:
                break
            self.flying[self.crew.submit(task)] = task
        return bool(self.flying)

    def _take(self, done: set[Future[Solved]]) -> None:
        """Write what has come back."""
        for future in sorted(done, key=lambda f: self.flying[f].contingency.number):
            task = self.flying.pop(future)
            solved = self._result(future, task)
            if solved is not None:
                self._write(solved)

    def _result(self, future: Future[Solved], task: Task) -> Solved | None:
        """What a future holds; None if the task is to be tried again."""
        try:
            return future.result()
        except Exception as error:  # the worker, or the way to it, not the contingency
            number = task.contingency.number
            self.tries[number] = self.tries.get(number, 0) + 1
            if self.tries[number] < _TRIES:
                self.again.append(task)
                return None
            return failed(task, f"{type(error).__name__}: {error}")

    def _write(self, solved: Solved) -> None:
        number = solved.result.number
        if solved.parquet is not None:
            path = self.store.folder / "trajectories" / f"{number:06d}.parquet"
            with replacing(path) as temporary:
                temporary.write_bytes(solved.parquet)
        self.store.add([solved.result])
        self.counts[_verdict(solved.figures)] += 1
        self.here += 1
        latest = {"number": number, "name": self.names[number], **solved.figures}
        self._tell(Stage.RUNNING, latest)

    def _wind_up(self) -> None:
        """Call back what has not begun, and write what comes of the rest."""
        for future in list(self.flying):
            if future.cancel():
                del self.flying[future]
        while self.flying:
            done, _ = wait(self.flying, return_when=FIRST_COMPLETED)
            self._take(done)

    def _tell(
        self, stage: Stage, latest: Mapping[str, Any] | None = None, message: str = ""
    ) -> None:
        now = time.monotonic()
        rate = self.here / (now - self.started) if self.here else 0.0
        self.tell(
            Progress(
                stage,
                sum(self.counts.values()),
                self.total,
                self.counts["stable"],
                self.counts["unstable"],
                self.counts["failed"],
                now - self.began,
                rate,
                latest,
                message,
            )
        )


def _verdict(figures: Mapping[str, Any]) -> str:
    if figures["stable"] is None:
        return "failed"
    return "stable" if figures["stable"] else "unstable"


def _counts(store: StudyStore) -> dict[str, int]:
    frame = store.frame()
    stable = int((frame["stable"] == True).sum())  # noqa: E712  (nullable: neither if missing)
    unstable = int((frame["stable"] == False).sum())  # noqa: E712
    return {"stable": stable, "unstable": unstable, "failed": len(frame) - stable - unstable}
