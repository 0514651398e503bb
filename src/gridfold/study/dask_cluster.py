"""Dask clusters: one of this machine's that opens no more than it needs, or one that is there already.

Imported where a cluster is asked for: Dask is optional.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from importlib import import_module
from importlib.util import find_spec
from typing import Any

from gridfold.errors import GridfoldError, OptionError
from gridfold.study.prepare import Offline
from gridfold.study.processes import NO_START, ready, solve_offline
from gridfold.study.solve import Batch
from gridfold.study.team import Team

_dask: Any = import_module("distributed")

#: Where the processes of a local cluster listen: nothing from other machines reaches them.
_LOOPBACK = "127.0.0.1"
#: Seconds to wait for a scheduler, and times that the cluster repeats what a lost worker had.
_PATIENCE, _RETRIES = 10, 3


class _QuietScheduler(_dask.Scheduler):  # type: ignore[misc]
    """A scheduler without pages: Dask opens port 8787 even where no dashboard is asked for."""

    def start_http_server(self, *arguments: Any, **options: Any) -> None:
        """Open nothing."""


class _QuietWorker(_dask.Worker):  # type: ignore[misc]
    """A worker without pages."""

    def start_http_server(self, *arguments: Any, **options: Any) -> None:
        """Open nothing."""


@contextmanager
def dask_team(cluster: str, offline: Offline, processes: int) -> Iterator[Team]:
    """The workers of a cluster: ``local``, or that of the scheduler at an address.

    Raises
    ------
    OptionError
        There is no scheduler, there are no workers, or they do not get as far as the first task.
    """
    with ExitStack() as stack:
        address = stack.enter_context(_local(processes)) if cluster == "local" else cluster
        try:
            client = stack.enter_context(_dask.Client(address, timeout=_PATIENCE))
        except (OSError, ValueError, TypeError) as error:
            raise OptionError(f"there is no scheduler at {cluster}: {error}") from None
        yield _members(client, offline)


@contextmanager
def _local(processes: int) -> Iterator[Any]:
    """Processes of this machine, which speak TLS where the package cryptography is there."""
    encrypted = find_spec("cryptography") is not None
    security = _dask.Security.temporary() if encrypted else _dask.Security()
    protocol = "tls" if encrypted else "tcp"
    place = {"host": _LOOPBACK, "protocol": protocol, "security": security, "dashboard": False}
    worker: dict[str, Any] = {
        "worker_class": _QuietWorker,
        "nthreads": 1,
        "memory_limit": "auto",
        "silence_logs": logging.ERROR,
        **place,
    }
    try:
        cluster = _dask.SpecCluster(
            scheduler={"cls": _QuietScheduler, "options": {"port": 0, **place}},
            workers={k: {"cls": _dask.Nanny, "options": worker} for k in range(processes)},
            security=security,
            silence_logs=logging.ERROR,
        )
    except RuntimeError as error:
        raise OptionError(NO_START.format(reason=f": {error}")) from None
    with cluster:
        yield cluster


def _members(client: Any, offline: Offline) -> Team:
    threads = client.nthreads()
    if not threads:
        raise OptionError("the cluster has no workers")
    everywhere = client.scatter(offline, broadcast=True, hash=False)
    executor = client.get_executor(pure=False, retries=_RETRIES)
    try:
        executor.submit(_prove, everywhere).result()
    except GridfoldError:
        raise
    except Exception as error:  # whatever a foreign machine lacks
        raise OptionError(
            f"the workers of the cluster cannot prepare the study: {type(error).__name__}: {error}"
        ) from None
    count = sum(threads.values())
    name = f"Dask, {len(threads)} workers with {count} threads"

    def submit(batch: Batch) -> Any:
        nonlocal everywhere
        if everywhere.status != "finished":  # it went with a worker
            everywhere = client.scatter(offline, broadcast=True, hash=False)
        return executor.submit(solve_offline, everywhere, batch)

    return Team(count, name, submit)


def _prove(offline: Offline) -> None:
    """The empty first task."""
    ready(offline)
