"""The folder of a study: its lock, and errors of its disk in words."""

from __future__ import annotations

import shutil
import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from filelock import FileLock, Timeout

from gridfold.errors import OptionError, OutputError
from gridfold.io.input_files import is_there
from gridfold.io.study_schema import FILE

LOCK = "study.lock"


def require(folder: Path) -> None:
    """Raise an OptionError unless the folder holds a study."""
    file = folder / FILE
    if not (is_there(file) and file.is_file()):
        raise OptionError(f"{folder} holds no study: there is no {FILE}")


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Keep others from working on the store within the block."""
    held = lock(folder)
    try:
        yield
    finally:
        held.release()


def lock(folder: Path, what: str = "study") -> FileLock:
    """The lock of a folder, held; an OptionError if another process holds it."""
    held = FileLock(folder / LOCK)
    try:
        with telling(folder):
            held.acquire(timeout=0)
    except Timeout:
        raise OptionError(f"another process is working on the {what} in {folder}") from None
    return held


@contextmanager
def telling(folder: Path) -> Iterator[None]:
    """Errors of the disk as :class:`OutputError` with the folder's name."""
    try:
        yield
    except (sqlite3.Error, UnicodeError) as error:
        raise OutputError(f"{folder / FILE}: {error}{_room(folder)}") from None
    except Timeout:
        raise
    except OSError as error:
        raise OutputError(f"{folder}: cannot be written: {error.strerror or error}") from None


def _room(folder: Path) -> str:
    """A hint where the disk is full."""
    try:
        free = shutil.disk_usage(folder).free
    except OSError:
        return ""
    return f" ({free // 1024} KiB are free on that disk)" if free < 2**24 else ""
