"""Hand out contingencies to workers, and write what comes back."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, wait
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from threading import Event
from typing import Any

from gridfold.cards import Card
from gridfold.errors import GpuError, OptionError
from gridfold.io.results import replacing
from gridfold.io.study_store import StudyStore
from gridfold.study.solve import Batch, Solved, failed
from gridfold.study.team import Solving, Team

#: Batches handed out for each worker: one that is worked on, one that waits.
_AHEAD = 2
#: Seconds after which a wait is broken off to see whether the study is to be stopped.
_GLANCE = 0.2
#: Times a contingency is tried alone where the process that worked on it dies.
_TRIES = 2


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
        Dynamic data of no unit and an unstable start, told once before the first contingency; what
        keeps contingencies from running side by side, or on a GPU, told once when it happens.
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


@dataclass(frozen=True, repr=False)
class StudyRun(Card):
    """What a run of a study came to; the results are in `folder`.

    `done` counts all that have a result, `here` those that this run has given one.
    """

    folder: Path
    stage: Stage
    done: int
    total: int
    stable: int
    unstable: int
    failed: int
    seconds: float
    workers: str
    here: int = 0

    @property
    def per_second(self) -> float:
        """Contingencies a second in this run, with all that it did from its beginning."""
        return self.here / self.seconds if self.seconds else 0.0

    def _facts(self) -> dict[str, object]:
        return {
            "folder": self.folder,
            "stage": self.stage.value,
            "done": f"{self.done} of {self.total}",
            "stable": self.stable,
            "unstable": self.unstable,
            "failed": self.failed,
            "time": f"{self.seconds:.1f} s with {self.workers}",
        }

    @property
    def complete(self) -> bool:
        """Whether every contingency has a result."""
        return self.done == self.total


class Work:
    """Batches that are handed out, and the count of what came back.

    A worker that dies takes others with it: those that were in flight are suspects, and are tried again
    one by one with nothing beside them. Only who loses its worker alone is written down as failed, and
    nobody before the first result: workers that never give one are an error, not a result.
    """

    def __init__(
        self,
        store: StudyStore,
        crew: Team,
        rounds: Iterable[tuple[str, Sequence[Batch]]],
        tell: Callable[[Progress], None],
        began: float,
    ):
        self.store, self.crew, self.tell, self.began = store, crew, tell, began
        self.total = len(store.contingencies())
        self.rounds = iter(rounds)
        self.names: dict[int, str] = {}
        self.left: set[int] = set()
        self.redone: dict[int, str] = {}
        self.waiting: Iterator[Batch] = iter(())
        self.suspects: list[Batch] = []
        self.alone: Solving | None = None
        self.lost: list[Solved] = []
        self.tries: Counter[int] = Counter()
        self.flying: dict[Solving, Batch] = {}
        self.counts = {"stable": 0, "unstable": 0, "failed": 0}
        self.counts |= Counter(_verdicts(store).values())
        self.here = 0
        self.notices = list(store.identity.get("notices", ()))
        self.started = time.monotonic()

    def run(self, stop: Event) -> Stage:
        """Work until all is done, or `stop` is set.

        Raises
        ------
        OptionError
            The workers take no tasks, or end before the first result.
        GpuError
            The GPU that is asked for fails.
        """
        try:
            for what, batches in self.rounds:
                self._begin(batches)
                self._tell(Stage.RUNNING, message=what or self.crew.description)
                while not stop.is_set() and self._hand_out():
                    done, _ = wait(self.flying, _GLANCE, FIRST_COMPLETED)
                    self._take(done)
                if stop.is_set() or self.lost:
                    break
        except KeyboardInterrupt:
            stop.set()
        if stop.is_set():
            self._wind_up()
        elif self.lost:
            raise OptionError(f"the workers end before the first result: {self._reason()}")
        left = self.left or any(batches for _, batches in self.rounds)
        stage = Stage.INTERRUPTED if left else Stage.DONE
        self._tell(stage)
        return stage

    def _begin(self, batches: Sequence[Batch]) -> None:
        """A round of batches; what has a row already is done again."""
        contingencies = [task.contingency for batch in batches for task in batch]
        self.names = {item.number: item.name for item in contingencies}
        self.left = set(self.names)
        verdicts = _verdicts(self.store)
        self.redone = {number: verdicts[number] for number in self.left & verdicts.keys()}
        self.waiting = iter(batches)

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
            self.here,
        )

    def _hand_out(self) -> bool:
        """Keep the workers busy; false when nothing is left."""
        if self.suspects:
            if not self.flying:
                self.alone = self._submit(self.suspects.pop(0))
            return True
        while self.alone is None and len(self.flying) < _AHEAD * self.crew.count:
            batch = next(self.waiting, None)
            if batch is None:
                break
            self._submit(batch)
        return bool(self.flying)

    def _submit(self, batch: Batch) -> Solving:
        try:
            future = self.crew.submit(batch)
        except Exception as error:  # the executor may be anybody's
            raise OptionError(
                f"the workers take no more tasks: {type(error).__name__}: {error}"
            ) from None
        self.flying[future] = batch
        return future

    def _take(self, done: set[Solving]) -> None:
        """Write what has come back."""
        for future in sorted(done, key=lambda f: self.flying[f][0].contingency.number):
            self._write(self._results(future, self.flying.pop(future)))

    def _results(self, future: Solving, batch: Batch) -> tuple[Solved, ...]:
        """What a future holds, with what was lost before the first result."""
        alone, self.alone = self.alone is future, None
        try:
            found = future.result()
        except GpuError:
            raise
        except Exception as error:  # the worker, or the way to it, not the contingency
            self._suspect(batch, alone, f"{type(error).__name__}: {error}")
            found = ()
        if not found and not self.here:
            return ()
        lost, self.lost = tuple(self.lost), []
        return (*lost, *found)

    def _suspect(self, batch: Batch, alone: bool, reason: str) -> None:
        """Have the tasks of a lost batch tried alone; give up one that was, more than once."""
        for task in batch:
            number = task.contingency.number
            self.tries[number] += alone
            if self.tries[number] < _TRIES:
                self.suspects.append((task,))
            else:
                self.lost.append(failed(task, reason))

    def _reason(self) -> str:
        return str(self.lost[0].figures["reason"])

    def _write(self, batch: tuple[Solved, ...]) -> None:
        batch = tuple(solved for solved in batch if not self._spoils(solved))
        for solved in batch:
            if solved.parquet is not None:
                name = f"{solved.result.number:06d}.parquet"
                with replacing(self.store.folder / "trajectories" / name) as temporary:
                    temporary.write_bytes(solved.parquet)
        self.store.add([solved.result for solved in batch], again=self.redone)
        self._note(notice for solved in batch for notice in solved.notices)
        for solved in batch:
            number = solved.result.number
            self.left.discard(number)
            if number in self.redone:
                self.counts[self.redone[number]] -= 1
            self.counts[_verdict(solved.figures)] += 1
            self.here += 1
            latest = {"number": number, "name": self.names[number], **solved.figures}
            self._tell(Stage.RUNNING, latest)

    def _note(self, notices: Iterable[str]) -> None:
        """Tell and keep what was not told before."""
        new = tuple(dict.fromkeys(notice for notice in notices if notice not in self.notices))
        if new:
            self.notices += new
            self.store.tell("notices", self.notices)
            self._tell(Stage.RUNNING, warnings=new)

    def _spoils(self, solved: Solved) -> bool:
        """Whether a failure would take the place of a row that is there: the row stays."""
        number = solved.result.number
        spoils = self.redone.get(number, "failed") != "failed" and solved.figures["stable"] is None
        if spoils:
            self.left.discard(number)
        return spoils

    def _wind_up(self) -> None:
        """Call back what has not begun, and write what comes of the rest."""
        self.suspects.clear()
        for future in list(self.flying):
            if future.cancel():
                del self.flying[future]
        while self.flying:
            done, _ = wait(self.flying, return_when=FIRST_COMPLETED)
            self._take(done)

    def _tell(
        self,
        stage: Stage,
        latest: Mapping[str, Any] | None = None,
        message: str = "",
        warnings: tuple[str, ...] = (),
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
                warnings,
            )
        )


def _verdict(figures: Mapping[str, Any]) -> str:
    if figures["stable"] is None:
        return "failed"
    return "stable" if figures["stable"] else "unstable"


def _verdicts(store: StudyStore) -> dict[int, str]:
    frame = store.frame()
    stable = frame["stable"].astype(object).where(frame["stable"].notna(), None)
    return {
        int(number): _verdict({"stable": value})
        for number, value in zip(frame["number"], stable, strict=True)
    }
