"""Reduced models of three public PSS/E cases: Kundur, New England, NPCC as converted.

The cases are read from the folder of public cases (GRIDFOLD_CASES).
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from folded_rows import Candidate, Candidates, candidates, fault_table, warm_up
from report import ROOT, Section, Table, machine, one_thread, write

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
    small_signal,
    whole_system,
)
from gridfold import reduce as printed
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
    retained: int
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
    Study("kundur", "kundur/kundur.raw", "kundur/kundur_full.dyr", bus=7, retained=1),
    Study(
        "ieee39",
        "ieee39/IEEE39.raw",
        "ieee39/IEEE39.dyr",
        bus=16,
        retained=3,
        buses=(15, 16, 19, 20, 21, 22, 23, 24, 33, 34, 35, 36),
        drop=True,
    ),
    Study("npcc_curent", "npcc/npcc_curent.raw", "npcc/npcc_curent.dyr", bus=23, retained=5),
)


@dataclass(frozen=True)
class Ready:
    """A study with its model, its areas and its reduced models."""

    study: Study
    model: DetailedModel
    parts: Partition
    found: Candidates

    @property
    def ladder(self) -> Ladder:
        """The ladder."""
        family = next(one.small.family for one in self.found.models if one.name == "ladder")
        assert isinstance(family, Ladder)
        return family


def prepare(study: Study) -> Ready:
    """Build and reduce; the printed models form the states of linear machines."""
    model = build_model(study.load())
    parts = partition(model, study.study_buses(model.case))
    found = candidates(parts, study.retained, norms=False)
    far = found.models[0]
    ignored = SwitchingRule(far.rule.angle_deg, limits=False)
    printed_small = SmallModels(printed(parts)), SmallModels(whole_system(parts))
    models = (
        *found.models,
        replace(far, name="linear, limits ignored", rule=ignored),
        Candidate("printed, adaptive", printed_small[0], SwitchingRule(PARTITIONED_DEG)),
        Candidate("printed, whole", printed_small[1], SwitchingRule(WHOLE_DEG)),
    )
    return Ready(study, model, parts, replace(found, models=models))


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
    }
    rows = [(name, *(fact(ready) for ready in all_ready)) for name, fact in facts.items()]
    return Table("The cases:", ("", *(ready.study.name for ready in all_ready)), rows)


def _names(units: tuple[UnitKey, ...]) -> str:
    return ", ".join(map(str, units)) or "none"


def error_table(ready: Ready) -> Table:
    """Both faults of one case."""
    table = fault_table(ready.found, faults(ready), T_END, REPETITIONS)
    caption = f"{ready.study.name}, fault at bus {ready.study.bus}; {table.caption}"
    return replace(table, caption=caption)


def measure() -> Section:
    """Measure everything."""
    began = time.perf_counter()
    warm_up()
    all_ready = [prepare(study) for study in STUDIES]
    tables = (fact_table(all_ready), *(error_table(ready) for ready in all_ready))
    spent = time.perf_counter() - began
    remarks = (
        f"Runs of {T_END:g} s with the Runge-Kutta method and its step of 0.01 s. The fault of each "
        f"case is cleared after {USUAL:g} s and after the critical clearing time on a grid of "
        f"{RESOLUTION:g} s. *linear*, *retained* and *ladder* are the models of these names, "
        "machines of largest score retained as the table tells. *printed*: as in the paper, with the "
        f"states of linear machines formed; column norm 1 p.u. and angles of {PARTITIONED_DEG:g} "
        f"(partitioned) and {WHOLE_DEG:g} degrees (whole), not calibrated for these cases. *RMS*: "
        "root mean square of the rotor angle's error; *COI*: of the angle against the centre of "
        "inertia. *Limits ignored*: limits that are reached are told, but the run stays linear. "
        "*ladder* uses of the rungs those that are measured to be cheaper than the one above them. "
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
