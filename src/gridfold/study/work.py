"""Hand out contingencies to workers, and write what comes back."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, wait
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from threading import Event
from typing import Any

from gridfold.io.results import replacing
from gridfold.io.study_store import StudyStore
from gridfold.study.executors import Solving, Team
from gridfold.study.solve import Batch, Solved, failed

#: Batches handed out for each worker: one that is worked on, one that waits.
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
    warnings : tuple of str
        Dynamic data of no unit and an unstable start, told once before the first contingency.
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
    warnings: tuple[str, ...] = ()


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


class Work:
    """Batches that are handed out, and the count of what came back."""

    def __init__(
        self,
        store: StudyStore,
        crew: Team,
        todo: Sequence[Batch],
        tell: Callable[[Progress], None],
        began: float,
    ):
        self.store, self.crew, self.tell, self.began = store, crew, tell, began
        self.total = len(store.contingencies())
        contingencies = [task.contingency for batch in todo for task in batch]
        self.names = {item.number: item.name for item in contingencies}
        self.waiting: Iterator[Batch] = iter(todo)
        self.again: list[Batch] = []
        self.tries: dict[int, int] = {}
        self.flying: dict[Solving, Batch] = {}
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
            batch = self.again.pop() if self.again else next(self.waiting, None)
            if batch is None:
                break
            self.flying[self.crew.submit(batch)] = batch
        return bool(self.flying)

    def _take(self, done: set[Solving]) -> None:
        """Write what has come back."""
        for future in sorted(done, key=lambda f: self.flying[f][0].contingency.number):
            self._write(self._results(future, self.flying.pop(future)))

    def _results(self, future: Solving, batch: Batch) -> tuple[Solved, ...]:
        """What a future holds. Where it was lost, its contingencies are tried again one by one."""
        try:
            return future.result()
        except Exception as error:  # the worker, or the way to it, not the contingency
            lost = []
            for task in batch:
                number = task.contingency.number
                self.tries[number] = self.tries.get(number, 0) + 1
                if self.tries[number] < _TRIES:
                    self.again.append((task,))
                else:
                    lost.append(failed(task, f"{type(error).__name__}: {error}"))
            return tuple(lost)

    def _write(self, batch: tuple[Solved, ...]) -> None:
        for solved in batch:
            if solved.parquet is not None:
                name = f"{solved.result.number:06d}.parquet"
                with replacing(self.store.folder / "trajectories" / name) as temporary:
                    temporary.write_bytes(solved.parquet)
        self.store.add([solved.result for solved in batch])
        for solved in batch:
            number = solved.result.number
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
