"""What solves tasks: threads, processes or a Dask cluster, all by the same kind of executor."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import (
    BrokenExecutor,
    Executor,
    Future,
    ProcessPoolExecutor,
    ThreadPoolExecutor,
)
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from enum import Enum
from importlib import import_module
from threading import Lock
from typing import Any

from gridfold.errors import GridfoldWarning, OptionError
from gridfold.study.prepare import Offline, Prepared, prepare
from gridfold.study.solve import Batch, Solved, solve_batch

#: Seconds to wait for a scheduler, and times that the cluster repeats what a lost worker had.
_PATIENCE, _RETRIES = 10, 3
#: Seconds that a thread may keep Python's interpreter to itself while another one waits for it.
_TURN = 0.05e-3


class Workers(Enum):
    """What solves the contingencies of one machine."""

    THREADS = "threads"
    PROCESSES = "processes"


Solving = Future[tuple[Solved, ...]]
Submit = Callable[[Batch], Solving]


@dataclass(frozen=True)
class Team:
    """Workers at the ready: how many, what they are, and how to give them tasks."""

    count: int
    description: str
    submit: Submit


@contextmanager
def team(
    offline: Offline,
    prepared: Prepared,
    workers: Workers = Workers.THREADS,
    count: int | None = None,
    cluster: str | None = None,
    executor: Executor | None = None,
) -> Iterator[Team]:
    """Workers for a study; they leave when the block ends.

    Parameters
    ----------
    offline, prepared
        The study, as data for other processes and for the threads of this one.
    workers, count
        Kind and number on this machine; as many as there are cores by default.
    cluster : str, optional
        ``local`` or the address ``tcp://HOST:PORT`` of a Dask scheduler, instead.
    executor : Executor, optional
        An executor of the caller's, instead. Tasks and results are sent by pickle if it needs that.
    """
    number = count or _cores()
    if executor is not None:
        size = count or getattr(executor, "_max_workers", None) or _cores()
        yield Team(size, type(executor).__name__, _sender(executor, offline))
    elif cluster is not None:
        with _dask(cluster, offline, count) as members:
            yield members
    elif workers is Workers.THREADS:
        with _quick_turns(), ThreadPoolExecutor(number) as pool:
            name = "1 thread" if number == 1 else f"{number} threads"
            yield Team(number, name, lambda batch: pool.submit(solve_batch, prepared, batch))
    else:
        with _Processes(number, offline) as processes:
            name = "1 process" if number == 1 else f"{number} processes"
            yield Team(number, name, processes.submit)


class _Processes:
    """A pool of processes that is replaced where one of them has died."""

    def __init__(self, count: int, offline: Offline):
        self.count, self.offline = count, offline
        self.pool = self._new()

    def _new(self) -> ProcessPoolExecutor:
        context = multiprocessing.get_context("spawn")
        return ProcessPoolExecutor(self.count, context, _begin, (self.offline,))

    def submit(self, batch: Batch) -> Solving:
        """Give tasks to the pool."""
        try:
            return self.pool.submit(_solve_begun, batch)
        except BrokenExecutor:
            self.pool.shutdown(wait=False)
            self.pool = self._new()
            return self.pool.submit(_solve_begun, batch)

    def __enter__(self) -> _Processes:
        return self

    def __exit__(self, *error: object) -> None:
        self.pool.shutdown(cancel_futures=True)


def _sender(executor: Executor, offline: Offline) -> Submit:
    return lambda batch: executor.submit(solve_offline, offline, batch)


def solve_offline(offline: Offline, batch: Batch) -> tuple[Solved, ...]:
    """Solve tasks in a process that may not have seen the study before."""
    return solve_batch(_prepared(offline), batch)


_ready: dict[str, Prepared] = {}
_begun: list[Prepared] = []
_ready_lock = Lock()


def _prepared(offline: Offline) -> Prepared:
    """The study made ready once in this process; one at a time is kept."""
    with _ready_lock:
        if offline.token not in _ready:
            _ready.clear()
            _ready[offline.token] = prepare(offline)
        return _ready[offline.token]


def _begin(offline: Offline) -> None:
    """First of all in a process of its own.

    Ctrl-C reaches all processes of a terminal; the one that asked decides what to do.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    warnings.simplefilter("ignore", GridfoldWarning)  # the process that asked has warned
    _begun.append(_prepared(offline))


def _solve_begun(batch: Batch) -> tuple[Solved, ...]:
    return solve_batch(_begun[-1], batch)


@contextmanager
def _dask(cluster: str, offline: Offline, count: int | None) -> Iterator[Team]:
    """A cluster of this machine's, or one that is there already."""
    try:
        dask: Any = import_module("distributed")
    except ImportError:
        raise OptionError("--cluster needs Dask: pip install 'gridfold[cluster]'") from None
    with ExitStack() as stack:
        address: Any = cluster
        if cluster == "local":
            processes = count or _cores()
            address = stack.enter_context(
                dask.LocalCluster(n_workers=processes, threads_per_worker=1, dashboard_address=None)
            )
        try:
            client = stack.enter_context(dask.Client(address, timeout=_PATIENCE))
        except (OSError, ValueError) as error:
            raise OptionError(f"there is no scheduler at {cluster}: {error}") from None
        yield _members(client, offline)


def _members(client: Any, offline: Offline) -> Team:
    threads = client.nthreads()
    if not threads:
        raise OptionError("the cluster has no workers")
    everywhere = client.scatter(offline, broadcast=True, hash=False)
    executor = client.get_executor(pure=False, retries=_RETRIES)
    count = sum(threads.values())
    name = f"Dask, {len(threads)} workers with {count} threads"
    return Team(count, name, lambda batch: executor.submit(solve_offline, everywhere, batch))


@contextmanager
def _quick_turns() -> Iterator[None]:
    """Let threads take turns in Python's interpreter sooner.

    A thread that comes back from compiled code otherwise waits 5 ms for one that is in Python code.
    """
    before = sys.getswitchinterval()
    sys.setswitchinterval(_TURN)
    try:
        yield
    finally:
        sys.setswitchinterval(before)


def _cores() -> int:
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:
        return os.cpu_count() or 1
