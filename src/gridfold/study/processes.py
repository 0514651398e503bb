"""Processes of this machine that solve contingencies, and go when their parent goes."""

from __future__ import annotations

import contextlib
import ctypes
import multiprocessing
import os
import pickle
import signal
import sys
import tempfile
import warnings
from collections.abc import Callable, Iterator, Sized
from concurrent.futures import BrokenExecutor, Future, ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from multiprocessing import connection
from pathlib import Path
from threading import Lock, Thread, Timer
from typing import Any, Protocol

from gridfold.errors import GridfoldWarning, OptionError
from gridfold.study.prepare import Offline, Prepared, prepare
from gridfold.study.solve import Batch, Solved, solve_batch

#: Seconds beyond the time limit after which a process that does not answer ends itself.
_GRACE = 10.0
#: prctl(2): the signal that this process gets when its parent ends.
_PR_SET_PDEATHSIG = 1

NO_START = (
    "the worker processes end before they begin{reason}. A program that uses them needs a file of its "
    "own, not standard input, and has to call gridfold under if __name__ == '__main__':"
)


class Limited(Protocol):
    """What processes are given to work from."""

    @property
    def time_limit(self) -> float | None:
        """Longest time for one piece of work in seconds."""


@dataclass(frozen=True)
class Trade:
    """What a process does: makes itself ready once, then solves batches; functions of a module."""

    prepare: Callable[[Any], Any]
    solve: Callable[[Any, Any], Any]


class Processes:
    """A pool of processes that is replaced where one of them has died.

    Parameters
    ----------
    count : int
        How many.
    offline : Limited
        What they work from, as plain data.
    trade : Trade
        What they do with it: a study's contingencies by default.

    Raises
    ------
    OptionError
        No process gets as far as the first contingency.
    """

    def __init__(self, count: int, offline: Limited, trade: Trade | None = None):
        self.count = count
        # By a file: Python hands arguments to a new process through a pipe, and waits for ever where
        # that ends before it has read them.
        self.scratch = tempfile.TemporaryDirectory(prefix="gridfold-")
        self.offline = Path(self.scratch.name) / "offline.pickle"
        self.offline.write_bytes(pickle.dumps((offline, trade or Trade(prepare, solve_batch))))
        self.pool = self._new()

    def _new(self) -> ProcessPoolExecutor:
        context = multiprocessing.get_context("spawn")
        return ProcessPoolExecutor(self.count, context, _begin, (self.offline,))

    def submit(self, batch: Sized) -> Future[Any]:
        """Give tasks to the pool."""
        try:
            return self.pool.submit(_solve, batch)
        except BrokenExecutor:
            self.pool.shutdown(wait=False)
            self.pool = self._new()
            return self.pool.submit(_solve, batch)

    def __enter__(self) -> Processes:
        try:
            self.pool.submit(_prove).result()
        except BrokenExecutor:
            self.close()
            raise OptionError(NO_START.format(reason="")) from None
        except BaseException:
            self.close()
            raise
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """Call back what has not begun, and let the processes end."""
        self.pool.shutdown(cancel_futures=True)
        self.scratch.cleanup()


def refuse_nested() -> None:
    """Raise an OptionError in a process that is itself just being started by another one."""
    if getattr(multiprocessing.current_process(), "_inheriting", False):
        raise OptionError(NO_START.format(reason=": each of them begins the study anew"))


def solve_offline(offline: Offline, batch: Batch) -> tuple[Solved, ...]:
    """Solve tasks in a process that may not have seen the study before."""
    return solve_batch(ready(offline), batch)


_ready: dict[str, Prepared] = {}
_ready_lock = Lock()


def ready(offline: Offline) -> Prepared:
    """The study made ready once in this process; one at a time is kept."""
    with _ready_lock:
        if offline.token not in _ready:
            _ready.clear()
            _ready[offline.token] = prepare(offline)
        return _ready[offline.token]


_begun: list[Path] = []


def _begin(offline: Path) -> None:
    """First of all in a process of its own.

    Ctrl-C reaches all processes of a terminal; the one that asked decides what to do.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    warnings.simplefilter("ignore", GridfoldWarning)  # the process that asked has warned
    _end_with_parent()
    _begun.append(offline)


@cache
def _begun_work() -> tuple[Any, Trade, float | None]:
    """What this process is ready to work from, its trade, and its time limit in seconds."""
    offline, trade = pickle.loads(_begun[-1].read_bytes())
    return trade.prepare(offline), trade, offline.time_limit


def _prove() -> None:
    """The empty first task: what it raises, each task would."""
    _begun_work()


def _solve(batch: Sized) -> Any:
    prepared, trade, limit = _begun_work()
    with _last_resort(None if limit is None else limit * len(batch) + _GRACE):
        return trade.solve(prepared, batch)


@contextmanager
def _last_resort(seconds: float | None) -> Iterator[None]:
    """End this process if the block takes longer: a kernel that never returns cannot be asked."""
    if seconds is None:
        yield
        return
    timer = Timer(seconds, os._exit, (1,))
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


def _end_with_parent() -> None:
    """End this process when its parent ends, however that comes about.

    The kernel does it on Linux, whatever this process is at; a thread that waits for the end of the
    parent's pipe does it everywhere.
    """
    parent = multiprocessing.parent_process()
    if parent is None:
        return
    if sys.platform == "linux":
        with contextlib.suppress(OSError, AttributeError):
            ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    Thread(target=_wait_for, args=(parent.sentinel, os._exit), daemon=True).start()


def _wait_for(sentinel: int, end: Callable[[int], None]) -> None:
    connection.wait([sentinel])
    end(1)
