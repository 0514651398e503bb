"""How long it takes until something happens: import, help, first run; and what is installed."""

from __future__ import annotations

import os
import subprocess
import sys
import tomllib
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from tempfile import TemporaryDirectory

from packaging.requirements import Requirement
from report import ROOT, Goal, Section, Table, machine, write
from timing import first_and_second

_REPEATED = 5
_GRIDFOLD = [sys.executable, "-m", "gridfold"]
_SHOWN = 10
#: Processes of which the least time is taken: what is timed, the command, and the goal in seconds.
PROCESSES: tuple[tuple[str, list[str], float | None], ...] = (
    ("python -c pass", [sys.executable, "-c", "pass"], None),
    ("import gridfold", [sys.executable, "-c", "import gridfold"], 0.5),
    ("gridfold --version", [*_GRIDFOLD, "--version"], 0.4),
    ("gridfold --help", [*_GRIDFOLD, "--help"], 0.4),
    ("gridfold simulate --help", [*_GRIDFOLD, "simulate", "--help"], None),
)
#: Commands as whole processes, with the cache of compiled code empty and filled.
RUNS = (
    "gridfold simulate npcc --fault-bus 3",
    "gridfold demo",
)


def measure() -> Section:
    """All of it."""
    with TemporaryDirectory() as cache:
        seconds = {name: _least(command, cache) for name, command, _ in PROCESSES}
    starts = Table(
        f"Processor time of whole processes, the least of {_REPEATED}:",
        ("", "seconds"),
        [(f"`{name}`", f"{value:.2f}") for name, value in seconds.items()],
    )
    timed = [(f"`{command}`", *first_and_second(_command(command))) for command in RUNS]
    runs = Table(
        "Whole processes that compile, and the same with the code on disk, in seconds:",
        ("", "first", "second"),
        [(name, f"{first:.1f}", f"{second:.1f}") for name, first, second in timed],
    )
    goals = [Goal(name, seconds[name], goal) for name, _, goal in PROCESSES if goal is not None]
    tables = (starts, runs, _sizes())
    return Section("The start", "start.py", tables, goals=tuple(goals))


def _command(text: str) -> list[str]:
    return [*_GRIDFOLD, *text.split()[1:]]


def _least(command: Sequence[str], cache: str) -> float:
    """Processor seconds of the quickest of some processes, their modules compiled before.

    Other programs on the machine do not change them much; on a quiet one they are what a user waits.
    """
    environment = os.environ | {"PYTHONPYCACHEPREFIX": cache}
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    seconds = []
    for _ in range(_REPEATED + 1):
        began = _children()
        subprocess.run(command, env=environment, check=True, capture_output=True)
        seconds.append(_children() - began)
    return min(seconds[1:])


def _children() -> float:
    """Processor seconds of all processes that this one has begun and that have ended."""
    spent = os.times()
    return spent.children_user + spent.children_system


def _sizes() -> Table:
    """Megabytes of the files of the package and of all that it needs."""
    sizes = {name: _megabytes(name) for name in _needed("gridfold")}
    largest = sorted(sizes, key=lambda name: -sizes[name])
    shown = largest[:_SHOWN] + [name for name in largest[_SHOWN:] if name == "gridfold"]
    rows = [(name, f"{sizes[name]:.0f}") for name in shown]
    rest = sum(size for name, size in sizes.items() if name not in shown)
    rows += [(f"{len(sizes) - len(shown)} others", f"{rest:.0f}")]
    rows += [("all", f"{sum(sizes.values()):.0f}")]
    return Table("Installed size in MB, without extras:", ("package", "MB"), rows)


def _needed(name: str) -> set[str]:
    """A package and all that it needs here, by name."""
    found: set[str] = set()
    waiting = [name]
    while waiting:
        current = waiting.pop().lower().replace("_", "-")
        try:
            lines = _requirements(current)
        except PackageNotFoundError:
            continue
        if current in found:
            continue
        found.add(current)
        needed = (Requirement(line) for line in lines)
        waiting += [
            item.name for item in needed if not item.marker or item.marker.evaluate({"extra": ""})
        ]
    return found


def _requirements(name: str) -> list[str]:
    if name != "gridfold":
        return distribution(name).requires or []
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    return list(project["dependencies"])


def _megabytes(name: str) -> float:
    files = [Path(str(item.locate())) for item in distribution(name).files or []]
    if name == "gridfold":  # installed from this folder
        files = [path for path in (ROOT / "src").rglob("*") if path.is_file()]
    kept = (path for path in files if path.is_file() and path.suffix != ".pyc")
    return sum(path.stat().st_size for path in kept) / 1e6


def main() -> Section:
    """Measure and write the page."""
    section = measure()
    write("start.md", *section.tables, f"{machine()} `{section.command}`")
    return section


if __name__ == "__main__":
    print(main(), machine(), sep="\n\n")
