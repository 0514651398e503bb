"""Studies: contingencies a second, gain of two cores, memory over thousands of contingencies."""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any

import pandas as pd
from report import Goal, Section, Table, machine, one_thread, write

from gridfold.io.study_store import StudyStore
from gridfold.study import Progress, Study, StudyRun, run_study
from gridfold.study.study_file import parse_study, template
from gridfold.study.summary import WALL

ROUNDS = 5
#: Every bus fault of the study area and both ends of every line of it, as the template asks for.
MODELS = ("detailed", "adaptive")


@dataclass(frozen=True)
class Way:
    """A way to run a study: its name and the options."""

    name: str
    options: Mapping[str, Any]


ONE = Way("1 thread", {"count": 1})
WAYS = (
    ONE,
    Way("2 threads", {"count": 2}),
    Way("2 processes", {"workers": "processes", "count": 2}),
    Way("Dask, 2 local workers", {"cluster": "local", "count": 2}),
)


def study(kind: str, **changes: Any) -> Study:
    """The study that `gridfold init` writes, with another model."""
    import tomllib

    return parse_study(tomllib.loads(template()) | {"model": {"kind": kind}} | changes)


@dataclass(frozen=True)
class Timed:
    """A study that has been run: seconds from the first hand-out to the last row, and its rows."""

    run: StudyRun
    working: float
    rows: pd.DataFrame


def timed(wanted: Study, way: Way) -> Timed:
    """Run a study; the off-line work and the start of workers do not count as working."""
    began = 0.0
    ended = 0.0

    def watch(progress: Progress) -> None:
        nonlocal began, ended
        ended = time.perf_counter()
        if progress.done == 0:
            began = ended

    with tempfile.TemporaryDirectory() as folder:
        run = run_study(wanted, Path(folder) / "a", on_progress=watch, **way.options)
        with StudyStore.read(run.folder) as store:
            frame = store.frame()
    rows = frame[[name for name in frame if not name.startswith(WALL)]]
    return Timed(run, ended - began, rows)


def rates() -> Section:
    """Contingencies a second, and the ratio of one thread's time to that of each way."""
    lines, goals = [], []
    for kind in MODELS:
        wanted = study(kind)
        found: dict[str, list[Timed]] = {way.name: [] for way in WAYS}
        for _ in range(ROUNDS):
            for way in WAYS:
                found[way.name].append(timed(wanted, way))
        first = found[ONE.name][0].rows
        for way in WAYS:
            for each in found[way.name]:
                pd.testing.assert_frame_equal(each.rows, first)
            best = min(found[way.name], key=lambda each: each.working)
            pairs = zip(found[ONE.name], found[way.name], strict=True)
            gain = median(one.working / this.working for one, this in pairs)
            whole = min(each.run.seconds for each in found[way.name])
            lines.append(
                (
                    kind,
                    way.name,
                    f"{best.run.total / best.working:.1f}",
                    f"{gain:.2f}",
                    f"{whole:.1f}",
                )
            )
            if way.name == "2 threads":
                goals.append(Goal(f"{kind}: 1 thread over 2, inverse", 1 / gain, 1 / 1.7))
    heads = ("model", "workers", "contingencies a second", "gain over 1 thread", "whole run (s)")
    caption = (
        f"The study of `gridfold init`: {len(first)} contingencies of 16 s, each with its summary and "
        f"curves, ten of them checked by a detailed and a linear run. Rates: best of {ROUNDS} "
        "interleaved rounds; gains: median of the ratios in each round. All ways gave the same rows "
        "to the last digit."
    )
    return Section("Rate", "studies.py", (Table(caption, heads, lines),), goals=tuple(goals))


def resident_mb() -> float:
    """Memory of this process in MB."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


def memory() -> Section:
    """Resident memory while thousands of contingencies come in."""
    marks = (100, 1000, 2000, 3000, 4000, 5000)
    seen: dict[int, float] = {}

    def watch(progress: Progress) -> None:
        if progress.latest is not None and progress.done in marks:
            seen[progress.done] = resident_mb()

    wanted = study(
        "detailed",
        contingencies={"csv": "faults.csv"},
        run={"t_end": 4.0},
        outputs={"curves": False},
    )
    with tempfile.TemporaryDirectory() as folder:
        rows = [
            f"{bus} {ms},bus-fault,{bus},{ms / 1000}"
            for ms in range(10, 46)
            for bus in range(1, 141)
        ]
        (Path(folder) / "faults.csv").write_text(
            "name,kind,bus,duration\n" + "\n".join(rows) + "\n"
        )
        run = run_study(wanted, Path(folder) / "a", folder=folder, on_progress=watch)
    lines = [(str(mark), f"{seen[mark]:.0f}") for mark in marks]
    caption = f"{run.total} faults, detailed model, summaries only, {run.workers}."
    table = Table(caption, ("contingencies done", "resident memory (MB)"), lines)
    growth = Goal("memory at 5000 over that at 1000", seen[5000] / seen[1000], 1.05)
    return Section("Memory", "studies.py", (table,), goals=(growth,))


if __name__ == "__main__":
    one_thread()
    sections: Sequence[Callable[[], Section]] = (rates, memory)
    write("studies.md", "# Studies", *(section() for section in sections), machine())
