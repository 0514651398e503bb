"""Runs on an NVIDIA GPU against runs on one core: how far apart they are, and how many a second.

Run it on a machine with a GPU: ``make test-cuda``. It takes some four minutes, and ends with a word
and code 2 where there is no GPU. The Polish grid is read from ``polish/Data_POLISH.mat`` in the folder
of public cases (GRIDFOLD_CASES), and left out without it.
"""

from __future__ import annotations

import os
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from report import Goal, Section, Table, machine, one_thread, write

import gridfold as gf
from gridfold.dynamics.cuda.precision import Precision
from gridfold.io.event_records import event_record
from gridfold.numerics.cuda_device import simulated, why_no_gpu
from gridfold.numerics.steppers import RungeKutta4
from gridfold.runs.batch import simulate_batch
from gridfold.runs.cuda import simulate_on_gpu
from gridfold.runs.trajectory import Trajectory
from gridfold.study.study_file import parse_study

PAGE = "cuda.md"
T_END, STEPPER = 16.0, RungeKutta4(0.01)
#: Degrees that rotor angles may be apart in double and in single precision.
APART, APART_SINGLE = 1e-8, 0.05
#: NPCC runs a second inside the launches and with rows in a store, and Polish runs a second.
INSIDE, STORED, POLISH = 30_000, 10_000, 300
#: Contingencies of the study.
ROWS = 10_000
#: Buses with machines up to which the network is solved by full matrices, to have either way.
WAYS = {"full": 10**6, "sparse": 0}


@dataclass(frozen=True)
class Grid:
    """A grid, how many runs are compared with the CPU, and how many are timed."""

    name: str
    model: gf.DetailedModel
    compared: int
    timed: int


@dataclass(frozen=True)
class Found:
    """What was measured of a grid in one way."""

    grid: str
    way: str
    precision: Precision
    inside: float
    rate: float
    apart: float

    @property
    def row(self) -> tuple[str, ...]:
        """The same as text."""
        digits = (f"{self.inside:.0f}", f"{self.rate:.0f}", f"{self.apart:.1e}")
        return self.grid, self.way, self.precision.value, *digits


def grids() -> Iterator[Grid]:
    """Those that there are files of."""
    yield Grid("NPCC", gf.build_model(gf.load_case("npcc")), 128, 8_000)
    file = Path(os.environ.get("GRIDFOLD_CASES", "")) / "polish" / "Data_POLISH.mat"
    if file.is_file():
        yield Grid("Polish", gf.build_model(gf.load_case(file)), 8, 1_000)


def disturbances(case: gf.Case, count: int) -> list[Sequence[gf.Event]]:
    """Trips of machines, and faults at all buses and lines with clearing times of their own."""
    found: list[Sequence[gf.Event]] = []
    machines = [unit for unit in case.generators if unit.in_service]
    lines = [branch for branch in case.branches if branch.in_service]
    k = 0
    while len(found) < count:
        duration = 0.05 + 0.01 * (k // len(case.buses) % 30)
        bus, line = case.buses[k % len(case.buses)], lines[k % len(lines)]
        name = f"{line.from_bus}-{line.to_bus}:{line.circuit}"
        if k < len(machines):
            found.append([gf.MachineTrip(machines[k].bus, machines[k].id, 0.1)])
        found.append([gf.BusFault(bus.number, 0.1, duration)])
        found.append([gf.BusFault(bus.number, 0.1, duration), gf.BranchTrip(name, 0.1 + duration)])
        k += 1
    return found[:count]


def measure(grid: Grid) -> Iterator[Found]:
    """Both ways to solve the network in both precisions, beside the CPU."""
    sample = disturbances(grid.model.case, grid.compared)
    many = disturbances(grid.model.case, grid.timed)
    alone = dict(simulate_batch(grid.model, sample, T_END, STEPPER))
    for way, terminals in WAYS.items():
        for precision in Precision:
            options = {"precision": precision, "full_terminals": terminals}
            there = dict(simulate_on_gpu(grid.model, sample, T_END, STEPPER, **options))
            apart = max(difference(there[number], run, precision) for number, run in alone.items())
            began, inside, count = time.perf_counter(), 0.0, 0
            for _, run in simulate_on_gpu(grid.model, many, T_END, STEPPER, **options):
                assert isinstance(run, Trajectory), run
                inside += run.simulation_seconds
                count += 1
            rate = count / (time.perf_counter() - began)
            yield Found(grid.name, way, precision, count / inside, rate, apart)


def difference(run: object, alone: object, precision: Precision) -> float:
    """The largest difference of a rotor angle in degrees; in double precision both end alike."""
    assert isinstance(run, Trajectory), run
    assert isinstance(alone, Trajectory), alone
    same = (run.status, len(run.times)) == (alone.status, len(alone.times))
    assert same or precision is Precision.SINGLE, alone.events
    rows = min(len(run.times), len(alone.times))
    apart = run.rotor_angle_deg()[:rows] - alone.rotor_angle_deg()[:rows]
    return float(np.nanmax(np.abs(apart)))


def stored(model: gf.DetailedModel) -> float:
    """Rows a second of a study of NPCC, everything included."""
    listed = [
        {"name": f"run {k}", "events": [event_record(event) for event in events]}
        for k, events in enumerate(disturbances(model.case, ROWS))
    ]
    study = parse_study(
        {
            "schema": 1,
            "case": {"source": "npcc"},
            "model": {"kind": "detailed"},
            "run": {"t_end": T_END, "step": STEPPER.step, "method": STEPPER.name},
            "contingency": listed,
            "outputs": {"curves": False},
        }
    )
    with tempfile.TemporaryDirectory() as folder:
        return gf.run_study(study, Path(folder) / "rows", device="cuda").per_second


def report() -> Section:
    """Measure all, and what the goals are."""
    from numba import cuda

    gpu = cuda.get_current_device().name
    gpu = gpu.decode() if isinstance(gpu, bytes) else gpu
    known = list(grids())
    found = [item for grid in known for item in measure(grid)]
    rows = stored(known[0].model)
    table = Table(
        f"Runs of {T_END:g} s by {STEPPER.name} at {STEPPER.step * 1000:g} ms on one {gpu}: inside the "
        "launches, with what goes to the GPU and back; and with networks and trajectories. A study of "
        f"NPCC with {ROWS} contingencies wrote {rows:.0f} rows a second, everything included.",
        ("grid", "network", "precision", "a second inside", "a second", "from the CPU, degrees"),
        [item.row for item in found],
    )
    return Section("Runs on a GPU", "make test-cuda", (table,), goals=tuple(goals(found, rows)))


def goals(found: Sequence[Found], rows: float) -> Iterator[Goal]:
    """What the figures should be."""
    for precision, limit in ((Precision.DOUBLE, APART), (Precision.SINGLE, APART_SINGLE)):
        worst = max(item.apart for item in found if item.precision is precision)
        yield Goal(f"of the degrees allowed in {precision.value} precision", worst / limit, 1.0, 3)
    for grid, wanted in (("NPCC", INSIDE), ("Polish", POLISH)):
        rates = [i.inside for i in found if i.grid == grid and i.precision is Precision.DOUBLE]
        if rates:
            yield Goal(f"milliseconds for a run of {grid}", 1e3 / max(rates), 1e3 / wanted, 3)
    yield Goal("milliseconds for a row in the store", 1e3 / rows, 1e3 / STORED, 3)


def main() -> Section:
    """Measure and write the page."""
    section = report()
    write(PAGE, section, machine())
    return section


if __name__ == "__main__":
    reason = "the simulator is no GPU" if simulated() else why_no_gpu()
    if reason is not None:
        print(f"runs on a GPU are not measured: {reason}", file=sys.stderr)
        raise SystemExit(2)
    one_thread()
    print(main())
