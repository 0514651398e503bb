"""What solves tasks: threads, processes or a Dask cluster, all by the same kind of executor."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import contextmanager
from enum import Enum
from importlib import import_module

from gridfold.ceilings import require_memory
from gridfold.errors import OptionError
from gridfold.runs.size import check_states
from gridfold.study.prepare import Offline, Prepared
from gridfold.study.processes import Processes, solve_offline
from gridfold.study.solve import solve_batch
from gridfold.study.team import Submit, Team

#: Bytes that a process takes beside its runs, roughly.
_PROCESS = 300e6
#: Seconds that a thread may keep Python's interpreter to itself while another one waits for it.
_TURN = 0.05e-3


class Workers(Enum):
    """What solves the contingencies of one machine."""

    THREADS = "threads"
    PROCESSES = "processes"


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
    number = count or cores()
    if executor is None and cluster in (None, "local"):
        check_crew(prepared, number, workers is Workers.PROCESSES or cluster is not None)
    if executor is not None:
        size = count or getattr(executor, "_max_workers", None) or cores()
        yield Team(size, type(executor).__name__, _sender(executor, offline))
    elif cluster is not None:
        with _dask(cluster, offline, count) as members:
            yield members
    elif workers is Workers.THREADS:
        with quick_turns(), ThreadPoolExecutor(number) as pool:
            name = "1 thread" if number == 1 else f"{number} threads"
            yield Team(number, name, lambda batch: pool.submit(solve_batch, prepared, batch))
    else:
        with Processes(number, offline) as processes:
            name = "1 process" if number == 1 else f"{number} processes"
            yield Team(number, name, processes.submit)


def check_crew(prepared: Prepared, count: int, processes: bool) -> None:
    """Refuse more workers than the memory allows.

    Raises
    ------
    OptionError
        They, or their runs, take too much.
    """
    if processes:
        advice = "Give fewer (--jobs), or threads (--workers threads)."
        require_memory(f"{count:,} processes", count * _PROCESS, advice)
    run = prepared.study.run
    check_states(prepared.model, run.t_end, prepared.method.stepper.step, count)


def _sender(executor: Executor, offline: Offline) -> Submit:
    return lambda batch: executor.submit(solve_offline, offline, batch)


@contextmanager
def _dask(cluster: str, offline: Offline, count: int | None) -> Iterator[Team]:
    try:
        module = import_module("gridfold.study.dask_cluster")
    except ModuleNotFoundError:
        raise OptionError("--cluster needs Dask: pip install 'gridfold[cluster]'") from None
    with module.dask_team(cluster, offline, count or cores()) as members:
        yield members


@contextmanager
def quick_turns() -> Iterator[None]:
    """Let threads take turns in Python's interpreter sooner.

    A thread that comes back from compiled code otherwise waits 5 ms for one that is in Python code.
    """
    before = sys.getswitchinterval()
    sys.setswitchinterval(_TURN)
    try:
        yield
    finally:
        sys.setswitchinterval(before)


def cores() -> int:
    """Cores that this process may use."""
    try:
        return len(os.sched_getaffinity(0))  # noqa: TID251  guarded
    except AttributeError:
        return os.cpu_count() or 1
