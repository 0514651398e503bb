"""Studies whose contingencies advance together against the same studies one by one, on one core.

The Polish grid is read from ``polish/Data_POLISH.mat`` in the folder of public cases (GRIDFOLD_CASES).
"""

from __future__ import annotations

import os
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from statistics import median

import pandas as pd
from report import ROOT, Goal, Section, Table, machine, one_thread, write

from gridfold.io.study_store import StudyStore
from gridfold.study import Progress, Stage, run_study
from gridfold.study.study_file import parse_study
from gridfold.study.summary import WALL

CASES = Path(os.environ.get("GRIDFOLD_CASES", ROOT / ".." / "shared" / "data"))
PAGE = "batch.md"
ROUNDS = 3
POLISH = str(CASES / "polish" / "Data_POLISH.mat")
#: Figures of a fit, which makes more of what rounding leaves.
SWINGS = ("swing_hz", "damping_ratio")
#: Rate together over that one by one: what was asked for.
GAIN = 2.0


@dataclass(frozen=True)
class Grid:
    """A grid, its case, the buses of the faults, and the model."""

    name: str
    source: str
    buses: str
    method: str = "auto"
    loads: str = "z"
    kind: str = "detailed"
    zones: str | None = None


GRIDS = (
    Grid("NPCC", "npcc", "1-140"),
    Grid("NPCC, abm4", "npcc", "1-140", "abm4"),
    Grid("NPCC, loads 0.2,0.2,0.6", "npcc", "1-140", loads="0.2,0.2,0.6"),
    Grid("NPCC, retained", "npcc", "1-140", kind="retained"),
    Grid("NPCC, linear", "npcc", "1-140", kind="linear"),
    Grid("Polish", POLISH, "1-64"),
    Grid("Polish, zone 5, retained", POLISH, "1-64", kind="retained", zones="5"),
)


@dataclass(frozen=True)
class Timed:
    """CPU seconds from the first hand-out to the last row that is kept, and the rows."""

    seconds: float
    rows: pd.DataFrame

    @property
    def rate(self) -> float:
        """Contingencies a second."""
        return len(self.rows) / self.seconds


def timed(grid: Grid, batch: str) -> Timed:
    """Run the study; what is done once for all contingencies does not count."""
    began = ended = 0.0

    def watch(progress: Progress) -> None:
        nonlocal began, ended
        if progress.stage is Stage.RUNNING:
            began, ended = began or time.process_time(), time.process_time()

    study = parse_study(
        {
            "schema": 1,
            "case": {"source": grid.source, "loads": grid.loads},
            "contingencies": {"bus_faults": grid.buses},
            "model": {"kind": grid.kind},
            "run": {"batch": batch, "method": grid.method},
            "check": {"sample": 0},
        }
        | ({} if grid.zones is None else {"study_area": {"zones": grid.zones}})
    )
    with tempfile.TemporaryDirectory() as folder:
        run = run_study(study, Path(folder) / "a", count=1, on_progress=watch)
        with StudyStore.read(run.folder) as store:
            frame = store.frame()
    return Timed(ended - began, frame[[name for name in frame if not name.startswith(WALL)]])


def row(grid: Grid) -> tuple[tuple[str, ...], Goal]:
    """Rates of both ways on a grid, and the gain."""
    for batch in ("off", "auto"):
        timed(grid, batch)
    pairs = [(timed(grid, "off"), timed(grid, "auto")) for _ in range(ROUNDS)]
    alone, together = pairs[0]
    steady = [name for name in alone.rows if name not in SWINGS]
    pd.testing.assert_frame_equal(alone.rows[steady], together.rows[steady], rtol=1e-9, atol=1e-9)
    pd.testing.assert_frame_equal(alone.rows, together.rows, rtol=1e-6, atol=1e-9)
    gain = median(one.seconds / both.seconds for one, both in pairs)
    stable = int((alone.rows["stable"] == True).sum())  # noqa: E712  (nullable)
    cells = (
        grid.name,
        f"{len(alone.rows)}, {stable} stable",
        f"{max(one.rate for one, _ in pairs):.1f}",
        f"{max(both.rate for _, both in pairs):.1f}",
        f"{gain:.2f}",
    )
    print(*cells, sep=" | ", flush=True)
    return cells, Goal(f"{grid.name}: one by one over together, inverse", 1 / gain, 1 / GAIN)


def measure() -> Section:
    """All grids."""
    found = [row(grid) for grid in GRIDS if grid.source == "npcc" or Path(grid.source).is_file()]
    heads = ("grid", "runs of 16 s", "one by one, a second", "together, a second", "gain")
    caption = (
        "Bus faults of 0.1 s on the detailed model or a reduced one, one core, all included: networks, "
        f"steps, figures, curves and the rows on disk. CPU time, best of {ROUNDS} interleaved rounds; "
        "gains are medians of the ratios in each round. Rows agree to 1e-9, damping to 1e-6."
    )
    table = Table(caption, heads, [cells for cells, _ in found])
    return Section("Side by side", "batch.py", (table,), goals=tuple(goal for _, goal in found))


def main() -> Section:
    """Measure and write the page."""
    section = measure()
    write(PAGE, section, machine())
    return section


if __name__ == "__main__":
    one_thread()
    print(main())
