"""Reduced models of three public PSS/E cases: Kundur, New England, NPCC as converted.

The cases are read from the folder of public cases (GRIDFOLD_CASES).
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from folded_rows import LADDER, LINEAR, RETAINED, error_texts, ready, shares
from report import ROOT, Section, Table, machine, one_thread, write
from timing import interleave

from gridfold import (
    BusFault,
    Case,
    DetailedModel,
    Ladder,
    Partition,
    SmallModels,
    SwitchingRule,
    build_model,
    critical_clearing_time,
    partition,
    simulate,
    simulate_adaptive,
    small_signal,
    whole_system,
)
from gridfold import reduce as printed
from gridfold.equivalents.adaptive import AdaptiveRun
from gridfold.equivalents.choice import ModelSettings
from gridfold.equivalents.folded import FoldedArea
from gridfold.equivalents.model_kind import ModelKind
from gridfold.grid.case import UnitKey
from gridfold.partition import linearize_external
from gridfold.runs.loading import load_psse

CASES = Path(os.environ.get("GRIDFOLD_CASES", ROOT / ".." / "shared" / "data"))
PAGE = "psse_cases.md"
T_END, RESOLUTION, REPETITIONS = 10.0, 0.01, 5

#: Thresholds of the paper for NPCC, in degrees.
PARTITIONED_DEG, WHOLE_DEG = 67.0, 6.0

#: Clearing time of the usual fault in s; the other fault lasts as long as the system bears.
USUAL = 0.1


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
    """A study with its model, its areas, its reduced models and the seconds of the ladder."""

    study: Study
    model: DetailedModel
    parts: Partition
    ladder: Ladder
    models: dict[str, Choice]
    seconds: float


def prepare(study: Study) -> Ready:
    """Build and reduce; the ladder's areas are also used on their own."""
    model = build_model(study.load())
    parts = partition(model, study.study_buses(model.case))
    began = time.process_time()
    ladder = ModelSettings(ModelKind.ADAPTIVE).build(parts)
    assert isinstance(ladder, Ladder)
    small = ready(ladder, parts)
    seconds = time.process_time() - began
    near, far = (ready(Ladder((area,)), parts) for area in ladder.areas)
    models = {
        "linear": (far, LINEAR),
        "linear, limits ignored": (far, SwitchingRule(LINEAR.angle_deg, limits=False)),
        "retained": (near, RETAINED),
        "ladder": (small, LADDER),
        "printed, adaptive": (SmallModels(printed(parts)), SwitchingRule(PARTITIONED_DEG)),
        "printed, whole": (SmallModels(whole_system(parts)), SwitchingRule(WHOLE_DEG)),
    }
    return Ready(study, model, parts, ladder, models, seconds)


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
        "external states": lambda r: str(len(r.parts.states_of(r.parts.external_units))),
        "ports, retained / linear": lambda r: _pair(r, lambda area: len(area.ports.buses)),
        "order, retained / linear": lambda r: _pair(r, lambda area: area.bases.order),
        "retained machines / external": lambda r: (
            f"{len(r.ladder.retained)} / {len(r.parts.external_units)}"
        ),
        "retained machines": lambda r: _names(r.ladder.retained),
        "rungs in use": lambda r: ", ".join(mode.value for mode in r.ladder.modes),
        "largest real part of the modes, 1/s": lambda r: (
            f"{small_signal(r.model).rightmost.real:.4f}"
        ),
        "the same, external area alone": lambda r: (
            f"{linearize_external(r.parts).system.poles[0].real:.4f}"
        ),
        "ms of the ladder off line": lambda r: f"{1000 * r.seconds:.0f}",
    }
    rows = [(name, *(fact(ready) for ready in all_ready)) for name, fact in facts.items()]
    return Table("The cases:", ("", *(ready.study.name for ready in all_ready)), rows)


def _pair(found: Ready, figure: Callable[[FoldedArea], int]) -> str:
    return " / ".join(str(figure(area)) for area in found.ladder.areas)


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
    yield where, "detailed", "", "", times.scaled("detailed", 1e-3), "", ""
    for name, run in runs.items():
        yield (
            where,
            name,
            *error_texts(detailed, run.trajectory, ready.parts.study_units),
            times.scaled(name, 1e-3),
            str(times.ratio(name, "detailed")),
            shares(run.trajectory, run.modes),
        )


def _run(model: DetailedModel, choice: Choice, fault: BusFault) -> AdaptiveRun:
    return simulate_adaptive(model, *choice, [fault], T_END)


def error_table(ready: Ready) -> Table:
    """Both faults of one case."""
    usual, longest = faults(ready)
    rows = [*fault_rows(ready, usual), *fault_rows(ready, longest)]
    heads = (
        "cleared after",
        "model",
        "RMS, COI",
        "RMS, unshifted",
        "ms, min / median",
        "/ detailed",
        "models, %",
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
        f"{RESOLUTION:g} s. *linear*, *retained* and *ladder* are the models of these names with "
        "their defaults: machines are retained whose column norm is 1 p.u. or more, or whose limits "
        "act in sample swings. *printed*: as in the paper, with the states of linear machines formed; "
        f"column norm 1 p.u. and angles of {PARTITIONED_DEG:g} (partitioned) and {WHOLE_DEG:g} degrees "
        "(whole), not calibrated for these cases. *RMS*: root mean square of the rotor angle's error; "
        "*COI*: of the angle against the centre of inertia. *Limits ignored*: limits that are reached "
        "are told, but the run stays linear. *ladder* uses of the rungs those that are measured to be "
        "cheaper than the one above them. "
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
