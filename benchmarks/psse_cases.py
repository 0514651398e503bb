"""Reduced and adaptive models of three public PSS/E cases: Kundur, New England, NPCC as converted.

The cases are read from the folder of public cases (GRIDFOLD_CASES).
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from report import ROOT, Section, Table, machine, one_thread, write
from timing import interleave

from gridfold import (
    BalancedTruncation,
    BusFault,
    Case,
    DetailedModel,
    Outputs,
    Partition,
    SmallModels,
    Status,
    SwitchingRule,
    Trajectory,
    Unreduced,
    build_model,
    compare,
    critical_clearing_time,
    partition,
    simulate,
    simulate_adaptive,
    small_signal,
    whole_system,
)
from gridfold.equivalents.adaptive import AdaptiveRun
from gridfold.equivalents.families import Mode, ReducedExternal, reduce_external
from gridfold.grid.case import UnitKey
from gridfold.partition import linearize_external
from gridfold.runs.loading import load_psse

CASES = Path(os.environ.get("GRIDFOLD_CASES", ROOT / ".." / "shared" / "data"))
PAGE = "psse_cases.md"
T_END, RESOLUTION, REPETITIONS = 10.0, 0.01, 5

#: Bound of the reduction; thresholds, and a finer bound, are those of the paper for NPCC.
TOLERANCE, FINER, PARTITIONED_DEG, WHOLE_DEG = 1e-2, 1e-5, 67.0, 6.0
#: A lower angle for comparison.
LOWER_DEG = 20.0

#: Clearing time of the usual fault in s; the other fault lasts as long as the system bears.
USUAL = 0.1

INFINITE = float("inf")


@dataclass(frozen=True)
class Study:
    """A case, its study area and the bus of its fault.

    The area is given by bus numbers, area 1 where there are none; the files are below the folder of
    public cases.
    """

    name: str
    raw: str
    dyr: str
    bus: int
    buses: tuple[int, ...] = ()
    drop: bool = False

    @property
    def paths(self) -> tuple[Path, Path]:
        """The RAW and the DYR file."""
        return CASES / self.raw, CASES / self.dyr

    def load(self) -> Case:
        """The case; where that is asked for, without what gridfold has no model for."""
        options = {"unsupported": "drop", "allow_unsupported_network": True} if self.drop else {}
        return load_psse(*self.paths, **options).case  # type: ignore[arg-type]

    def study_buses(self, case: Case) -> tuple[int, ...]:
        """Buses of the study area."""
        return self.buses or tuple(bus.number for bus in case.buses if bus.area == 1)

    @property
    def area(self) -> str:
        """The study area for people."""
        return "buses " + ", ".join(map(str, self.buses)) if self.buses else "area 1 of the file"


STUDIES = (
    Study("kundur", "kundur/kundur.raw", "kundur/kundur_full.dyr", bus=7),
    Study(
        "ieee39",
        "ieee39/IEEE39.raw",
        "ieee39/IEEE39.dyr",
        bus=16,
        buses=(15, 16, 19, 20, 21, 22, 23, 24, 33, 34, 35, 36),
        drop=True,
    ),
    Study("npcc_curent", "npcc/npcc_curent.raw", "npcc/npcc_curent.dyr", bus=23),
)

Choice = tuple[SmallModels, SwitchingRule]


@dataclass(frozen=True)
class Ready:
    """A study with its model, its areas, its reduced models and the seconds of the reduction."""

    study: Study
    model: DetailedModel
    parts: Partition
    family: ReducedExternal
    finer: ReducedExternal
    models: dict[str, Choice]
    seconds: float


def prepare(study: Study) -> Ready:
    """Build and reduce."""
    model = build_model(study.load())
    parts = partition(model, study.study_buses(model.case))
    began = time.perf_counter()
    family = reduce_external(parts, BalancedTruncation(tolerance=TOLERANCE))
    seconds = time.perf_counter() - began
    small = SmallModels(family)
    polar = SmallModels(replace(family, outputs=Outputs.POLAR))
    finer = reduce_external(parts, BalancedTruncation(tolerance=FINER))
    fine = SmallModels(finer)
    linear, hybrid = SwitchingRule(INFINITE), SwitchingRule(0.0)
    adaptive = SwitchingRule(PARTITIONED_DEG)
    models = {
        "linear": (small, linear),
        "linear, limits ignored": (small, replace(linear, limits=False)),
        "hybrid": (small, hybrid),
        "hybrid, finer": (fine, hybrid),
        "hybrid, not reduced": (SmallModels(reduce_external(parts, Unreduced())), hybrid),
        "adaptive": (small, adaptive),
        "adaptive, polar outputs": (polar, adaptive),
        f"adaptive at {LOWER_DEG:g}, finer": (fine, SwitchingRule(LOWER_DEG)),
        "adaptive, whole": (SmallModels(whole_system(parts)), SwitchingRule(WHOLE_DEG)),
    }
    return Ready(study, model, parts, family, finer, models, seconds)


def faults(ready: Ready) -> tuple[BusFault, BusFault]:
    """One of the usual length, and one that lasts for the critical clearing time."""
    usual = BusFault(ready.study.bus, duration=USUAL)
    found = critical_clearing_time(ready.model, usual, resolution=RESOLUTION, t_end=T_END)
    return usual, BusFault(ready.study.bus, duration=found.seconds)


def fact_table(all_ready: list[Ready]) -> Table:
    """Sizes, areas and modes of every case."""
    facts: dict[str, Callable[[Ready], str]] = {
        "machines / states": lambda r: f"{len(r.model.machines)} / {r.model.n_states}",
        "study area": lambda r: r.study.area,
        "machines of the study area": lambda r: str(len(r.parts.study_units)),
        "tie lines": lambda r: str(len(r.parts.tie_lines)),
        "external states": lambda r: str(r.family.reduction.system.p),
        "order r": lambda r: str(r.family.reduction.order),
        "bound (6)": lambda r: f"{r.family.reduction.bound:.2g}",
        f"order for a bound of {FINER:g}": lambda r: str(r.finer.reduction.order),
        "kept machines / external": lambda r: (
            f"{len(r.family.kept)} / {len(r.parts.external_units)}"
        ),
        "kept machines": lambda r: _names(r.family.kept),
        "largest real part of the modes, 1/s": lambda r: (
            f"{small_signal(r.model).rightmost.real:.4f}"
        ),
        "the same, external area alone": lambda r: (
            f"{linearize_external(r.parts).system.poles[0].real:.4f}"
        ),
        "modes kept exactly": lambda r: str(r.family.reduction.kept_exactly),
        "ms of the reduction": lambda r: f"{1000 * r.seconds:.0f}",
    }
    rows = [(name, *(fact(ready) for ready in all_ready)) for name, fact in facts.items()]
    return Table("The cases:", ("", *(ready.study.name for ready in all_ready)), rows)


def _names(units: tuple[UnitKey, ...]) -> str:
    return ", ".join(map(str, units)) or "none"


def fault_rows(ready: Ready, fault: BusFault) -> Iterator[tuple[str, ...]]:
    """Errors, time and use of the models for one fault."""
    events, model = [fault], ready.model
    where = f"{fault.duration:g} s"
    detailed = simulate(model, events, T_END)
    runs = {name: _run(model, choice, fault) for name, choice in ready.models.items()}
    actions: dict[str, Callable[[], object]] = {"detailed": lambda: simulate(model, events, T_END)}
    for name, choice in ready.models.items():
        actions[name] = lambda choice=choice: _run(model, choice, fault)  # type: ignore[misc]
    times = interleave(actions, REPETITIONS)
    yield where, "detailed", "", "", "", times.scaled("detailed", 1e-3), "", ""
    for name, run in runs.items():
        yield (
            where,
            name,
            *_errors(detailed, run.trajectory, ready.parts.study_units),
            times.scaled(name, 1e-3),
            str(times.ratio(name, "detailed")),
            _use(run),
        )


def _run(model: DetailedModel, choice: Choice, fault: BusFault) -> AdaptiveRun:
    return simulate_adaptive(model, *choice, [fault], T_END)


def _errors(detailed: Trajectory, run: Trajectory, units: tuple[UnitKey, ...]) -> tuple[str, ...]:
    """RMS of the worst machine, largest, and RMS against the centre of inertia, in degrees."""
    if run.status is not Status.COMPLETED:
        return f"{run.status.value} at {run.times[-1]:.2f} s", "", ""
    found = compare(detailed, run, units)
    largest = max(unit.largest_deg for unit in found.units)
    relative = max(unit.relative_rms_deg for unit in found.units)
    return f"{found.worst.rms_deg:.2g}", f"{largest:.2g}", f"{relative:.2g}"


def _use(run: AdaptiveRun) -> str:
    """Share of the run with each model in percent: detailed / hybrid / linear."""
    ends = [switch.time for switch in run.switches[1:]] + [float(run.trajectory.times[-1])]
    spent = dict.fromkeys(Mode, 0.0)
    for switch, end in zip(run.switches, ends, strict=True):
        spent[switch.after] += end - switch.time
    order = (Mode.DETAILED, Mode.HYBRID, Mode.LINEAR)
    return " / ".join(f"{100 * spent[mode] / ends[-1]:.0f}" for mode in order)


def error_table(ready: Ready) -> Table:
    """Both faults of one case."""
    usual, longest = faults(ready)
    rows = [*fault_rows(ready, usual), *fault_rows(ready, longest)]
    heads = (
        "cleared after",
        "model",
        "RMS",
        "largest",
        "RMS, COI",
        "ms, min / median",
        "/ detailed",
        "detailed / hybrid / linear, %",
    )
    caption = (
        f"{ready.study.name}, fault at bus {ready.study.bus}; errors of the worst study-area machine "
        "in degrees:"
    )
    return Table(caption, heads, rows)


def measure() -> Section:
    """Measure everything."""
    began = time.perf_counter()
    all_ready = [prepare(study) for study in STUDIES]
    tables = (fact_table(all_ready), *(error_table(ready) for ready in all_ready))
    spent = time.perf_counter() - began
    remarks = (
        f"Runs of {T_END:g} s with the Runge-Kutta method and its step of 0.01 s. The fault of each "
        f"case is cleared after {USUAL:g} s and after the critical clearing time on a grid of "
        f"{RESOLUTION:g} s. Bound of the reduction {TOLERANCE:g}, *finer* {FINER:g}; "
        f"column norm 1 p.u. and angles of {PARTITIONED_DEG:g} (partitioned) and {WHOLE_DEG:g} degrees "
        "(whole) as in the paper, not calibrated for these cases. *RMS*: root mean square of the rotor "
        "angle's error; *COI*: of the angle against the centre of inertia. *Limits ignored*: limits "
        "that are reached are told, but "
        "the run stays linear. Without *polar outputs* the states of linear machines are formed. "
        f"Took {spent:.0f} s.",
    )
    return Section("PSS/E cases", "psse_cases.py", tables, remarks)


def main() -> Section | str:
    """Measure and write the page; a message if a case is absent."""
    missing = [path for study in STUDIES for path in study.paths if not path.is_file()]
    if missing:
        return f"{missing[0]} is absent; GRIDFOLD_CASES names the folder of public cases"
    section = measure()
    write(PAGE, "# Reduced models of PSS/E cases", section, machine())
    return section


if __name__ == "__main__":
    one_thread()
    print(main())
