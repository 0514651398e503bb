"""How much a task may take: its size is estimated, and refused, before anything is allocated.

What is refused says how much it would take, how much there is, and what to change.
"""

from __future__ import annotations

import math
import os
import shutil
from pathlib import Path

from gridfold.errors import OptionError, OutputError

#: Part of the free memory that one task may be estimated at; the rest is for what is done with it.
_SHARE = 0.5
#: Variable of the environment that says how many GiB a task may take instead.
MEMORY_VARIABLE = "GRIDFOLD_MEMORY_GIB"
_GIB = 2.0**30
#: Bytes that are never refused: a short run on a small grid should not wait for a look at what is free.
_SMALL = 2.0**24
_UNITS = ("bytes", "KiB", "MiB", "GiB", "TiB", "PiB", "EiB")


def require_memory(what: str, needed: float, advice: str) -> None:
    """Refuse what needs too much memory.

    Parameters
    ----------
    what : str
        What it is that needs it, with its counts.
    needed : float
        Bytes.
    advice : str
        What to change.

    Raises
    ------
    OptionError
        It needs more than :func:`memory_limit`.
    """
    if needed < _SMALL and MEMORY_VARIABLE not in os.environ:
        return
    limit = memory_limit()
    if not needed <= limit:
        raise OptionError(
            f"{what} would take {size_text(needed)} of memory; {size_text(limit)} may be taken "
            f"({MEMORY_VARIABLE} sets another limit). {advice}"
        )


def require_disk(path: Path, what: str, needed: float, advice: str) -> None:
    """Refuse a file that does not fit on its disk.

    Raises
    ------
    OutputError
        `needed` bytes are more than the disk of `path` has free.
    """
    folder = next((place for place in path.absolute().parents if place.is_dir()), Path("/"))
    free = shutil.disk_usage(folder).free
    if not needed <= free:
        raise OutputError(
            f"{path}: {what} would take {size_text(needed)}; {size_text(free)} are free. {advice}"
        )


def memory_limit() -> float:
    """Bytes that one task may be estimated at: half of what is free, or as the environment says."""
    text = os.environ.get(MEMORY_VARIABLE)
    if text is None:
        return _SHARE * min(_free_memory(), _free_in_group(), _free_in_process())
    try:
        gib = float(text)
    except ValueError:
        gib = math.nan
    if not gib > 0:
        raise OptionError(f"{MEMORY_VARIABLE} must be a positive number, not {text!r}")
    return gib * _GIB


def size_text(size: float) -> str:
    """A number of bytes for people: three digits and a unit."""
    if not math.isfinite(size):
        return "more than can be counted"
    power = min(int(math.log2(max(size, 1.0)) // 10), len(_UNITS) - 1)
    return f"{size / 1024.0**power:.4g} {_UNITS[power]}"


def _free_memory() -> float:
    """Bytes of memory that are free on the machine, or all there are where that is not told."""
    for line in _lines("/proc/meminfo"):
        if line.startswith("MemAvailable:"):
            return 1024.0 * int(line.split()[1])
    try:
        pages, size = os.sysconf("SC_PHYS_PAGES"), os.sysconf("SC_PAGE_SIZE")  # noqa: TID251  guarded
        return float(pages * size)
    except (AttributeError, OSError, ValueError):
        return math.inf


def _free_in_group() -> float:
    """The same within the control group of the process (a container, a job of a cluster)."""
    for folder, most, used in (
        ("/sys/fs/cgroup", "memory.max", "memory.current"),
        ("/sys/fs/cgroup/memory", "memory.limit_in_bytes", "memory.usage_in_bytes"),
    ):
        limit, taken = ("".join(_lines(f"{folder}/{name}")).strip() for name in (most, used))
        if limit.isdigit() and taken.isdigit():
            return float(max(int(limit) - int(taken), 0))
    return math.inf


def _free_in_process() -> float:
    """The same within the limit of the process (``ulimit -v``)."""
    try:
        import resource  # noqa: TID251  guarded
    except ImportError:  # not on this system
        return math.inf
    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    pages = "".join(_lines("/proc/self/statm")).split()
    if limit == resource.RLIM_INFINITY or not pages:
        return math.inf
    return float(max(limit - int(pages[0]) * resource.getpagesize(), 0))


def _lines(path: str) -> list[str]:
    try:
        return Path(path).read_text(encoding="ascii").splitlines()
    except (OSError, ValueError):
        return []
