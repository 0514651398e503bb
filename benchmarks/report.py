"""What all benchmarks share: one thread, tables in Markdown, goals, the machine and the date."""

from __future__ import annotations

import datetime
import os
import platform
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numba
import numpy as np
import scipy

from gridfold import __version__

ROOT = Path(__file__).resolve().parent.parent
GENERATED = ROOT / "docs" / "generated"

_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def one_thread() -> None:
    """Start the script anew with linear algebra on one thread, unless it runs so already.

    The libraries read these variables when they are loaded, before any line of a script that
    imports them is run.
    """
    if any(os.environ.get(name) != "1" for name in _THREADS):
        os.execve(sys.executable, sys.orig_argv, os.environ | dict.fromkeys(_THREADS, "1"))


@dataclass(frozen=True)
class Table:
    """A table: a caption, the heads of its columns, and rows of text."""

    caption: str
    heads: tuple[str, ...]
    rows: Sequence[Sequence[str]]

    def __str__(self) -> str:
        widths = [max(map(len, column)) for column in zip(self.heads, *self.rows, strict=True)]
        lines = [self.heads, ["-" * width for width in widths], *self.rows]
        text = "\n".join(
            "| " + " | ".join(c.ljust(w) for c, w in zip(line, widths, strict=True)) + " |"
            for line in lines
        )
        return f"{self.caption}\n\n{text}"


@dataclass(frozen=True)
class Goal:
    """A figure that should not exceed a limit."""

    figure: str
    value: float
    limit: float
    digits: int = 2

    @property
    def met(self) -> bool:
        """Whether the goal is met."""
        return self.value <= self.limit

    @property
    def row(self) -> tuple[str, ...]:
        """Figure, value, limit and verdict as text."""
        limit = f"at most {self.limit:.{self.digits}f}"
        return self.figure, f"{self.value:.{self.digits}f}", limit, "met" if self.met else "not met"


@dataclass(frozen=True)
class Section:
    """The outcome of one benchmark: title, the script that was run, tables, remarks and goals."""

    title: str
    script: str
    tables: tuple[Table, ...]
    remarks: tuple[str, ...] = ()
    goals: tuple[Goal, ...] = ()

    @property
    def command(self) -> str:
        """The command that repeats it."""
        made = self.script.startswith("make ")
        return self.script if made else f"python benchmarks/{self.script}"

    def __str__(self) -> str:
        parts = [f"## {self.title}", f"`{self.command}`", *map(str, self.tables)]
        if self.goals:
            rows = [goal.row for goal in self.goals]
            parts.append(str(Table("Goals", ("figure", "measured", "goal", "verdict"), rows)))
        return "\n\n".join([*parts, *self.remarks])


def machine() -> str:
    """One sentence on the machine, the versions and the date."""
    cores = os.cpu_count()
    return (
        f"Measured on {datetime.date.today().isoformat()} on {_processor()}, {cores} cores, "
        f"{_system()}; Python {platform.python_version()}, NumPy {np.__version__}, "
        f"SciPy {scipy.__version__}, Numba {numba.__version__}, gridfold {__version__}."
    )


def write(name: str, *parts: object) -> Path:
    """Write a fragment of the documentation; return its path."""
    GENERATED.mkdir(parents=True, exist_ok=True)
    path = GENERATED / name
    path.write_text("\n\n".join(map(str, parts)) + "\n", encoding="utf-8")
    return path


def sections_of(name: str) -> dict[str, str]:
    """Sections of a fragment that was written before, by title; empty where there is none."""
    path = GENERATED / name
    text = path.read_text(encoding="utf-8") if path.is_file() else ""
    sections = text.strip().split("\n\n## ")[1:]
    return {section.partition("\n")[0]: f"## {section}" for section in sections}


def _processor() -> str:
    """Model of the processor, from the system where it tells."""
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.is_file():
        for line in cpuinfo.read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()


def _system() -> str:
    try:
        return platform.freedesktop_os_release()["PRETTY_NAME"]
    except OSError:
        return f"{platform.system()} {platform.release()}"
