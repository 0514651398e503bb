"""Studies of two public PSS/E cases: detailed, with the default model, and with the ladder.

The cases are read from the folder of public cases (GRIDFOLD_CASES).
"""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
import pandas as pd
from report import ROOT, Goal, Section, Table, machine, one_thread, write

from gridfold import Study, StudyStore, run_study
from gridfold.partition import study_buses
from gridfold.study import Progress
from gridfold.study.generate import list_contingencies
from gridfold.study.prepare import load_grid
from gridfold.study.study_file import parse_study

CASES = Path(os.environ.get("GRIDFOLD_CASES", ROOT / ".." / "shared" / "data")).resolve()
PAGE = "auto_studies.md"
#: Line faults, how long each lasts, and the end of each run, in s; rounds of all models in turn.
COUNT, CLEARING, T_END, ROUNDS = 80, 0.1, 16.0, 2
MODELS = ("detailed", "auto", "adaptive")
#: Most that the default may take of the detailed study, and the ladder where it is said to pay.
DEFAULT_SHARE, LADDER_SHARE = 1.1, 0.5


@dataclass(frozen=True)
class Grid:
    """A case with its study area, and whether the ladder is expected to pay."""

    name: str
    raw: str
    dyr: str
    area: int
    loads: str
    pays: bool

    def study(self, kind: str, contingencies: Iterable[dict[str, Any]] = ()) -> Study:
        """The study with a model; without contingencies it asks for every line of the area."""
        listed = list(contingencies)
        every = {"line_faults": "study area", "clearing_time": CLEARING}
        case = {
            "source": str(CASES / self.raw),
            "dyr": str(CASES / self.dyr),
            "loads": self.loads,
            "on_limit": "adjust",
            "unsupported": "classical",
            "without_data": "negative_load",
            "allow_unsupported_network": True,
        }
        return parse_study(
            {
                "name": self.name,
                "case": case,
                "study_area": {"areas": str(self.area)},
                "contingencies": {} if listed else every,
                "contingency": listed,
                "model": {"kind": kind},
                "run": {"t_end": T_END},
                "check": {"sample": 0},
            }
        )

    def contingencies(self) -> list[dict[str, Any]]:
        """Faults spread evenly over all ends of lines of the area, each cleared by its trip."""
        study = self.study("detailed")
        case = load_grid(study, Path())
        every = list_contingencies(study, case, study_buses(case, areas=[self.area]), Path())
        chosen = np.linspace(0, len(every) - 1, min(COUNT, len(every))).round().astype(int)
        records = [every[k].record() for k in chosen]
        return [{"name": record["name"], "events": record["events"]} for record in records]


GRIDS = (
    Grid(
        "WECC240",
        "wecc240/240busWECC_2018_PSS32_fixed_shunts.raw",
        "wecc240/240busWECC_2018_PSS.dyr",
        area=1,
        loads="z",
        pays=False,
    ),
    Grid(
        "ACTIVSg2000",
        "activsg2000/ACTIVSg2000.RAW",
        "activsg2000/ACTIVSg2000_dynamics.dyr",
        area=4,
        loads="z",
        pays=True,
    ),
)


@dataclass(frozen=True)
class Timed:
    """A study that was run: CPU seconds of all of it and off line, its rows and its settings."""

    seconds: float
    off_line: float
    rows: pd.DataFrame
    settings: dict[str, Any]

    @property
    def topologies(self) -> float:
        """Seconds in which models were built for topologies that contingencies lead to."""
        return float(self.rows["wall_reduction_s"].fillna(0.0).sum())

    @property
    def status(self) -> pd.Series[Any]:
        """What the contingencies came to, by name."""
        return self.rows.set_index("name")["status"]


def timed(study: Study) -> Timed:
    """Run a study with one worker."""
    marks: list[float] = []

    def watch(progress: Progress) -> None:
        if progress.done == 0:
            marks[:] = [time.process_time()]

    began = time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        run = run_study(study, Path(folder) / "a", count=1, on_progress=watch)
        seconds = time.process_time() - began
        with StudyStore.read(run.folder) as store:
            return Timed(seconds, marks[0] - began, store.frame(), store.identity["settings"])


def differing(first: Timed, other: Timed) -> list[str]:
    """Contingencies of which the two say different things."""
    apart = first.status != other.status
    return [str(name) for name in first.status.index[apart]]


def grid_section(grid: Grid) -> tuple[list[Table], list[Goal], list[str]]:
    """Seconds, choices and verdicts of one grid."""
    contingencies = grid.contingencies()
    rounds: dict[str, list[Timed]] = {kind: [] for kind in MODELS}
    for _ in range(ROUNDS):
        for kind in MODELS:
            rounds[kind].append(timed(grid.study(kind, contingencies)))
    rows, shares = [], {}
    detailed = rounds["detailed"]
    for kind, found in rounds.items():
        pairs = zip(found, detailed, strict=True)
        shares[kind] = median(one.seconds / base.seconds for one, base in pairs)
        best = min(found, key=lambda one: one.seconds)
        apart = differing(detailed[0], found[0])
        rows.append(
            (
                kind,
                str(best.settings["model"]),
                f"{best.seconds:.1f}",
                f"{shares[kind]:.2f}",
                f"{best.off_line:.1f}",
                f"{best.topologies:.1f}",
                f"{best.rows['stable'].sum():.0f} of {len(best.rows)}",
                f"{len(apart)}{': ' if apart else ''}{', '.join(apart[:3])}",
            )
        )
    heads = (
        "model asked for", "model used", "seconds", "/ detailed", "of them off line",
        "new topologies", "stable", "unlike detailed",
    )  # fmt: skip
    caption = f"{grid.name}, study area {grid.area}: {len(contingencies)} line faults:"
    goals = [Goal(f"{grid.name}: default over detailed", shares["auto"], DEFAULT_SHARE)]
    if grid.pays:
        goals.append(Goal(f"{grid.name}: ladder over detailed", shares["adaptive"], LADDER_SHARE))
    ladder = rounds["adaptive"][0]
    tables = [Table(caption, heads, rows), rung_table(grid, ladder)]
    return tables, goals, [told(grid, rounds["auto"][0])]


def rung_table(grid: Grid, ladder: Timed) -> Table:
    """What a step of each rung takes, and how long each model was in use."""
    steps, rows = ladder.settings["step_seconds"], []
    whole = ladder.rows["ended_at"].sum()
    for name, seconds in steps.items():
        column = f"{name.replace(' ', '_')}_s"
        used, wall = ladder.rows[column].sum() / whole, ladder.rows[f"wall_{column}"].sum()
        ratio = f"{seconds / steps['detailed']:.2f}"
        rows.append((name, f"{1e6 * seconds:.1f}", ratio, f"{100 * used:.0f}", f"{wall:.1f}"))
    heads = ("rung", "a step, microseconds", "/ detailed", "in use, %", "seconds")
    about = ladder.settings
    caption = (
        f"{grid.name}, the ladder: {about['external_machines']} external machines, "
        f"{len(about['kept'])} of them retained:"
    )
    return Table(caption, heads, rows)


def told(grid: Grid, auto: Timed) -> str:
    """Why the default chose its model."""
    about = auto.settings
    return (
        f"{grid.name}: {about['machines']} machines, {about['states']} states; the default chose "
        f"*{about['model']}*: {about['model_reason']}."
    )


def measure() -> Section:
    """Both grids."""
    tables: list[Table] = []
    goals: list[Goal] = []
    remarks: list[str] = []
    for grid in GRIDS:
        found, reached, reasons = grid_section(grid)
        print(*found, *reasons, sep="\n\n", end="\n\n", flush=True)
        tables += found
        goals += reached
        remarks += reasons
    remarks.append(
        f"Each fault lasts for {CLEARING:g} s at one end of a line or transformer of the study area "
        f"and is cleared by its trip; runs of {T_END:g} s, without checks. {COUNT} faults, spread "
        "evenly over all ends. Loads are constant impedances; dynamic models that gridfold has not "
        "are classical machines, machines without data negative loads, and limits that the start lies "
        "beyond move there. *seconds*: CPU time of the whole study from the files to the last row, by "
        f"one worker on one thread, the best of {ROUNDS} interleaved rounds; ratios are medians of "
        "those in each round. *new topologies*: equilibria, linearizations and models after trips, "
        "which are part of the seconds."
    )
    title = "The default model in studies"
    return Section(title, "auto_studies.py", tuple(tables), tuple(remarks), tuple(goals))


def main() -> Section | str:
    """Measure and write the page; a message if a case is absent."""
    missing = [grid.raw for grid in GRIDS if not (CASES / grid.raw).is_file()]
    if missing:
        return f"{missing[0]} is absent; GRIDFOLD_CASES names the folder of public cases"
    section = measure()
    write(PAGE, "# The default model", section, machine())
    return section


if __name__ == "__main__":
    one_thread()
    main()
