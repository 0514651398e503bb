"""Five public PSS/E cases as they are: start, rest, a bus fault, a line trip, and their time.

Nothing is replaced but what the files lack. The cases are read from the folder of public cases
(GRIDFOLD_CASES).
"""

from __future__ import annotations

import os
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import rhs_families
from report import ROOT, Goal, Section, Table, machine, one_thread, write

from gridfold import (
    AngleReference,
    BranchTrip,
    BusFault,
    DetailedModel,
    OnLimit,
    Status,
    Trajectory,
    build_model,
    choose_stepper,
    simulate,
)
from gridfold.grid.events import Event
from gridfold.runs.basis import basis_of
from gridfold.runs.loading import load_psse

CASES = Path(os.environ.get("GRIDFOLD_CASES", ROOT / ".." / "shared" / "data"))
PAGE, FAMILIES_PAGE = "public_cases.md", "rhs_families.md"
T_END, T_TIMED, REPETITIONS = 10.0, 16.0, 3
#: What a start should be better than, and the time of the largest case on one core in s.
RESIDUAL, LONGEST = 1e-6, 10.0


@dataclass(frozen=True)
class PublicCase:
    """Files below the folder of public cases, options that they need, and what happens.

    The fault is at a bus for some seconds, the trip is of a branch; both begin at 0.1 s.
    """

    name: str
    raw: str
    dyr: str
    fault: tuple[int, float]
    trip: str
    options: Mapping[str, Any] = field(default_factory=dict)
    why: str = ""

    @property
    def paths(self) -> tuple[Path, Path]:
        """The RAW and the DYR file."""
        return CASES / self.raw, CASES / self.dyr

    def build(self) -> DetailedModel:
        """The model; a limit that the start is beyond is moved there, and counted."""
        case = load_psse(*self.paths, **self.options).case
        return build_model(case, on_limit=OnLimit.ADJUST)

    @property
    def bus_fault(self) -> BusFault:
        """The fault as an event."""
        bus, duration = self.fault
        return BusFault(bus, start=0.1, duration=duration)


PUBLIC_CASES = (
    PublicCase("kundur", "kundur/kundur.raw", "kundur/kundur_full.dyr", (8, 0.1), "7-8:1"),
    PublicCase(
        "ieee39",
        "ieee39/IEEE39.raw",
        "ieee39/IEEE39.dyr",
        (16, 0.1),
        "16-17",
        {"allow_unsupported_network": True},
        "an island without a slack unit is left out",
    ),
    PublicCase("npcc_curent", "npcc/npcc_curent.raw", "npcc/npcc_curent.dyr", (3, 0.1), "2-3"),
    PublicCase(
        "WECC240",
        "wecc240/240busWECC_2018_PSS32_fixed_shunts.raw",
        "wecc240/240busWECC_2018_PSS.dyr",
        (2408, 0.05),
        "2401-2404:1",
    ),
    PublicCase(
        "ACTIVSg2000",
        "activsg2000/ACTIVSg2000.RAW",
        "activsg2000/ACTIVSg2000_dynamics.dyr",
        (7099, 0.1),
        "5120-5045",
        {"without_data": "typical"},
        "98 units without a machine get typical data, wind plants among them are negative loads",
    ),
)


@dataclass(frozen=True)
class Ready:
    """A case with its model, and the seconds of reading, power flow and start."""

    case: PublicCase
    model: DetailedModel
    seconds: float

    def run(self, events: Sequence[Event] = ()) -> Trajectory:
        """Ten seconds by the method that is chosen."""
        return simulate(self.model, events, T_END)


def prepare(case: PublicCase) -> Ready:
    """Read and build once untimed, so that everything is compiled, then timed."""
    case.build()
    began = time.process_time()
    model = case.build()
    return Ready(case, model, time.process_time() - began)


def largest_movement(run: Trajectory) -> tuple[float, float]:
    """How far any rotor angle (degrees, against the centre of inertia) and any voltage (p.u.) move."""
    angles = run.rotor_angle_deg(None, AngleReference.CENTRE_OF_INERTIA)
    sizes = np.abs(run.bus_voltage())
    return float(np.abs(angles - angles[0]).max()), float(np.abs(sizes - sizes[0]).max())


def ending(run: Trajectory) -> str:
    """How a run ends: in synchronism, with what rotor angles have moved by at most; or who lost it."""
    if run.status is not Status.COMPLETED:
        return f"{run.status.value}: {run.culprit} at {run.times[-1]:.2f} s"
    return f"in synchronism, moved by {largest_movement(run)[0]:.1f} degrees"


def fact_table(cases: Sequence[Ready]) -> Table:
    """Start, rest, fault and trip of every case."""
    columns = []
    for ready in cases:
        model, basis = ready.model, basis_of(ready.model).record()
        angle, voltage = largest_movement(ready.run())
        bus, duration = ready.case.fault
        moved = basis["limits_moved"]
        columns.append(
            {
                "buses / machines / states": (
                    f"{len(model.case.buses)} / {len(model.machines)} / {model.n_states}"
                ),
                "options": ", ".join(f"{k}={v}" for k, v in ready.case.options.items()) or "none",
                "read, power flow and start, CPU s": f"{ready.seconds:.2f}",
                "largest derivative at the start": f"{model.residual:.1e}",
                "limits moved to the start": str(len(moved)),
                "10 s without an event: angle, degrees": f"{angle:.1e}",
                "voltage, p.u.": f"{voltage:.1e}",
                "fault": f"bus {bus}, {duration:g} s",
                "after 10 s": ending(ready.run([ready.case.bus_fault])),
                "trip": ready.case.trip,
                "after it": ending(ready.run([BranchTrip(ready.case.trip, time=0.1)])),
                "method": choose_stepper(model).stepper.name,
                "validated": str(basis["validated"]).lower(),
            }
        )
    rows = [(name, *(column[name] for column in columns)) for name in columns[0]]
    return Table("The cases:", ("", *(ready.case.name for ready in cases)), rows)


def moved_table(ready: Ready) -> Table:
    """How many limits of each model were moved to the start."""
    counts: dict[tuple[str, str], int] = {}
    for text in basis_of(ready.model).record()["limits_moved"]:
        model, _, rest = text.partition(" ")
        limit = rest.partition(": ")[2].partition(" is ")[0]
        counts[model, limit] = counts.get((model, limit), 0) + 1
    rows = [(*key, str(count)) for key, count in sorted(counts.items())]
    return Table(
        f"Limits of {ready.case.name} that its operating point is beyond, by model:",
        ("model", "limit", "units"),
        rows,
    )


def time_of_run(ready: Ready) -> tuple[Goal, str]:
    """CPU seconds of 16 s with the fault, the least of some runs, against the goal; and the method."""
    store: dict[Any, Any] = {}
    seconds = []
    for _ in range(REPETITIONS):
        began = time.process_time()
        run = simulate(ready.model, [ready.case.bus_fault], T_TIMED, store=store)
        seconds.append(time.process_time() - began)
    figure = f"{T_TIMED:g} s of {ready.case.name} with the fault, CPU s on one core"
    return Goal(figure, min(seconds), LONGEST), str(run.method_reason)


def measure(cases: Sequence[Ready]) -> Section:
    """Measure all cases, the largest one last."""
    began = time.perf_counter()
    largest = cases[-1]
    goal, reason = time_of_run(largest)
    tables = (fact_table(cases), moved_table(largest))
    residual = Goal(
        "largest derivative at a start, 1e-6", 1e6 * max(r.model.residual for r in cases), 1
    )
    remarks = (
        "Loads are constant impedances, those with a model of their own aside. "
        + " ".join(f"{case.name}: {case.why}." for case in PUBLIC_CASES if case.why),
        f"Method of {largest.case.name}: {reason}.",
        f"Took {time.perf_counter() - began:.0f} s.",
    )
    return Section("Public cases", "make bench-public", tables, remarks, (goal, residual))


def main() -> Section | str:
    """Measure and write the page; a message if a case is absent."""
    missing = [path for case in PUBLIC_CASES for path in case.paths if not path.is_file()]
    if missing:
        return f"{missing[0]} is absent; GRIDFOLD_CASES names the folder of public cases"
    cases = [prepare(case) for case in PUBLIC_CASES]
    section = measure(cases)
    families = rhs_families.measure(cases[-1].model)
    write(PAGE, "# Public cases", section, machine())
    write(FAMILIES_PAGE, "# Families of devices", families, machine())
    return section


if __name__ == "__main__":
    one_thread()
    print(main())
