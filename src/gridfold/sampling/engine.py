"""Make a data set, or the rest of one that was broken off."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Future, ThreadPoolExecutor, wait
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from threading import Event

from gridfold.errors import OptionError
from gridfold.io.sample_store import SampleStore, require_free
from gridfold.numerics.blas import one_blas_thread
from gridfold.sampling.card import write_card
from gridfold.sampling.plan import SamplePlan, load_plan
from gridfold.sampling.prepare import chunks, identity_of, prepared_work, refuse_other_plan
from gridfold.sampling.rows import INFEASIBLE, data_columns
from gridfold.sampling.work import (
    Chunk,
    Made,
    Sampler,
    counted,
    make_chunk,
    make_sampler,
)
from gridfold.study.executors import Workers, check_crew, cores, quick_turns
from gridfold.study.prepare import describe
from gridfold.study.processes import Processes, Trade, refuse_nested
from gridfold.study.work import Stage

#: Chunks handed out for each worker: one that is worked on, one that waits.
_AHEAD = 2
#: Seconds after which a wait is broken off to see whether the work is to be stopped.
_GLANCE = 0.2
#: Times that a chunk is given to a process that dies over it.
_TRIES = 2
_KINDS = ("stable", "unstable", INFEASIBLE, "failed")

Submit = Callable[[Chunk], "Future[Made]"]


@dataclass(frozen=True)
class SampleProgress:
    """How far a data set is.

    Parameters
    ----------
    stage : Stage
        Where it is.
    done, total : int
        Samples that are made, of how many.
    stable, unstable, infeasible, failed : int
        Of those, how many of each.
    seconds : float
        Since this run began.
    per_second : float
        Samples a second in this run; 0 before the first.
    message : str
        What there is to say.
    """

    stage: Stage
    done: int = 0
    total: int = 0
    stable: int = 0
    unstable: int = 0
    infeasible: int = 0
    failed: int = 0
    seconds: float = 0.0
    per_second: float = 0.0
    message: str = ""

    @property
    def seconds_left(self) -> float | None:
        """Seconds that the rest takes at this rate; None before the first sample."""
        return (self.total - self.done) / self.per_second if self.per_second else None


@dataclass(frozen=True)
class SampleRun:
    """What a run came to; the data are in `folder`."""

    folder: Path
    stage: Stage
    done: int
    total: int
    stable: int
    unstable: int
    infeasible: int
    failed: int
    seconds: float
    per_second: float
    workers: str

    @property
    def complete(self) -> bool:
        """Whether all samples are there."""
        return self.done == self.total


@one_blas_thread
def sample(
    plan: SamplePlan | str | Path,
    out: str | Path | None = None,
    *,
    resume: bool = False,
    workers: Workers | str = Workers.PROCESSES,
    count: int | None = None,
    folder: str | Path | None = None,
    on_progress: Callable[[SampleProgress], None] | None = None,
    stop: Event | None = None,
    trust_devices: bool | Collection[str] = False,
) -> SampleRun:
    """Make a labelled data set of operating points and faults, or the rest of one.

    Parameters
    ----------
    plan : SamplePlan or path
        The plan, or its file.
    out : path, optional
        Folder of the data; by default ``NAME.samples`` beside the file ``NAME.toml``.
    resume : bool
        Go on with what is there; without it the folder must not hold samples.
    workers : {"processes", "threads"}
        What works on this machine. Operating points are made in Python: processes are faster.
    count : int, optional
        How many; as many as there are cores by default.
    folder : path, optional
        Where relative file names in the plan start; by default at its file, else here.
    on_progress : callable, optional
        Called with a :class:`SampleProgress` after each chunk.
    stop : threading.Event, optional
        Ends it early once it is set, with the chunks that are worked on written. So does a
        KeyboardInterrupt.
    trust_devices : bool or collection of str
        Whether Python files that the plan names as devices may run, as for :func:`gridfold.run_study`.

    Returns
    -------
    SampleRun
        Counts. Samples without an operating point and samples that failed are rows too.

    Raises
    ------
    GridfoldError
        The plan does not fit, or the data cannot be written. What was written stays.
    """
    began = time.monotonic()
    path = None if isinstance(plan, SamplePlan) else Path(plan)
    wanted = plan if isinstance(plan, SamplePlan) else load_plan(plan)
    start = Path(folder) if folder is not None else (path.parent if path else Path())
    kind = _kind(workers)
    if kind is Workers.PROCESSES:
        refuse_nested()
    tell = on_progress or (lambda progress: None)
    tell(
        SampleProgress(Stage.PREPARING, total=wanted.samples, message="operating point, time step")
    )
    with ExitStack() as stack:
        target = _target(out, path)
        if not resume:
            require_free(target)
        earlier = stack.enter_context(SampleStore.resume(target)) if resume else None
        if earlier is not None:
            refuse_other_plan(earlier, wanted)
        sampler = prepared_work(wanted, start, earlier, trust_devices)
        about = identity_of(sampler) | {
            "settings": describe(sampler.work.offline, sampler.prepared)
        }
        crew = stack.enter_context(_crew(sampler, kind, count or cores()))
        store = earlier or stack.enter_context(SampleStore.create(target, about))
        store.tell(plan=wanted.content())
        making = _Making(sampler, store, crew, tell, began)
        stage = making.run(stop or Event())
        write_card(sampler, store)
        return making.outcome(stage)


def _kind(workers: Workers | str) -> Workers:
    try:
        return Workers(workers)
    except ValueError:
        raise OptionError(f"workers must be threads or processes, not {workers!r}") from None


def _target(out: str | Path | None, path: Path | None) -> Path:
    if out is not None:
        return Path(out)
    return path.with_suffix(".samples") if path else Path("samples")


@dataclass(frozen=True)
class _Crew:
    """Workers at the ready."""

    count: int
    description: str
    submit: Submit


@contextmanager
def _crew(sampler: Sampler, kind: Workers, count: int) -> Iterator[_Crew]:
    """Workers that leave when the block ends; proved before anything is written."""
    check_crew(sampler.prepared, count, kind is Workers.PROCESSES)
    if kind is Workers.THREADS:
        with quick_turns(), ThreadPoolExecutor(count) as pool:
            name = "1 thread" if count == 1 else f"{count} threads"
            yield _Crew(count, name, lambda chunk: pool.submit(make_chunk, sampler, chunk))
    else:
        with Processes(count, sampler.work, Trade(make_sampler, make_chunk)) as processes:
            name = "1 process" if count == 1 else f"{count} processes"
            yield _Crew(count, name, processes.submit)


@dataclass
class _Making:
    """Chunks that are handed out, and the count of what came back."""

    sampler: Sampler
    store: SampleStore
    crew: _Crew
    tell: Callable[[SampleProgress], None]
    began: float
    flying: dict[Future[Made], Chunk] = field(default_factory=dict)
    tries: Counter[int] = field(default_factory=Counter)
    here: int = 0

    def __post_init__(self) -> None:
        plan = self.sampler.work.plan
        every = chunks(plan)
        there = self.store.counts()
        self.total = plan.samples
        self.left = [chunk for chunk in every if there.get(chunk.position) != len(chunk)]
        kept = {chunk.position for chunk in every} - {chunk.position for chunk in self.left}
        self.counts = dict.fromkeys(_KINDS, 0)
        for position in kept:
            self._count(counted(self.store.table(position, ("status", "stable"))))
        self.columns = {name: column.kind for name, column in data_columns(plan.names).items()}
        self.started = time.monotonic()

    def run(self, stop: Event) -> Stage:
        """Work until all is done, or `stop` is set."""
        self.left.reverse()
        self._tell(Stage.RUNNING, self.crew.description)
        try:
            while not stop.is_set() and self._hand_out():
                done, _ = wait(self.flying, _GLANCE, FIRST_COMPLETED)
                self._take(done)
        except KeyboardInterrupt:
            stop.set()
        if stop.is_set():
            self._wind_up()
        stage = Stage.INTERRUPTED if self.left else Stage.DONE
        self._tell(stage)
        return stage

    def outcome(self, stage: Stage) -> SampleRun:
        """The counts at the end."""
        return SampleRun(
            self.store.folder,
            stage,
            sum(self.counts.values()),
            self.total,
            **self.counts,
            seconds=time.monotonic() - self.began,
            per_second=self._rate,
            workers=self.crew.description,
        )

    def _hand_out(self) -> bool:
        while self.left and len(self.flying) < _AHEAD * self.crew.count:
            chunk = self.left.pop()
            self.flying[self.crew.submit(chunk)] = chunk
        return bool(self.flying)

    def _take(self, done: Collection[Future[Made]]) -> None:
        """Write what has come back."""
        for future in done:
            chunk = self.flying.pop(future)
            try:
                made = future.result()
            except BrokenExecutor as error:
                self._lost(chunk, error)
                continue
            self.store.write(made.position, made.rows, self.columns, made.curves)
            self.here += len(made.rows)
            self._count(counted(made.rows))
            self._tell(Stage.RUNNING)

    def _lost(self, chunk: Chunk, error: BrokenExecutor) -> None:
        """Have a chunk made again whose process ended; not without end."""
        self.tries[chunk.position] += 1
        if self.tries[chunk.position] > _TRIES * self.crew.count:
            last = chunk.first + len(chunk) - 1
            raise OptionError(
                f"the worker processes end while they make samples {chunk.first} to {last}: {error}"
            )
        self.left.append(chunk)

    def _wind_up(self) -> None:
        """Call back what has not begun, and write what comes of the rest."""
        for future in list(self.flying):
            if future.cancel():
                self.left.append(self.flying.pop(future))
        while self.flying:
            done, _ = wait(self.flying, return_when=FIRST_COMPLETED)
            self._take(done)

    def _count(self, counts: Mapping[str, int]) -> None:
        for kind, number in counts.items():
            self.counts[kind] += number

    @property
    def _rate(self) -> float:
        return self.here / (time.monotonic() - self.started) if self.here else 0.0

    def _tell(self, stage: Stage, message: str = "") -> None:
        self.tell(
            SampleProgress(
                stage,
                sum(self.counts.values()),
                self.total,
                **self.counts,
                seconds=time.monotonic() - self.began,
                per_second=self._rate,
                message=message,
            )
        )
