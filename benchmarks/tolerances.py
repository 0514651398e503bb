"""Runs within a tolerance, on several grids: true errors, estimates, rungs in use and cost.

No threshold, order or list of machines is given: the tolerance is the only number. The large cases are
read from the folder of public cases (GRIDFOLD_CASES); those that are not there are left out. With
a part of a grid's name as argument only its section of the page is measured anew.
"""

from __future__ import annotations

import os
import sys
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path

import numpy as np
from chain import chain
from report import ROOT, Goal, Section, Table, machine, one_thread, sections_of, write

from gridfold import (
    BranchFault,
    BusFault,
    DetailedModel,
    Ladder,
    OnLimit,
    Partition,
    Status,
    build_model,
    compare,
    critical_clearing_time,
    load_case,
    partition,
    simulate,
)
from gridfold.equivalents.adaptive import AdaptiveRun, simulate_adaptive
from gridfold.equivalents.choice import ModelSettings
from gridfold.equivalents.families import Mode
from gridfold.equivalents.model_kind import ModelKind
from gridfold.equivalents.tolerant import TolerantModel
from gridfold.grid.events import Event
from gridfold.partition import study_buses

CASES = Path(os.environ.get("GRIDFOLD_CASES", ROOT / ".." / "shared" / "data")).resolve()
POLISH = CASES / "polish" / "Data_POLISH.mat"
WECC240 = "240busWECC_2018_PSS32_fixed_shunts.raw", "240busWECC_2018_PSS.dyr"
ACTIVSG2000 = "ACTIVSg2000.RAW", "ACTIVSg2000_dynamics.dyr"
PAGE, SCRIPT = "tolerances.md", "tolerances.py"
TOLERANCES = (0.1, 0.5, 2.0)
#: Parts of the critical clearing time, and how many faulted buses of the large grids are taken.
SHARES, BUSES = (0.5, 0.9, 1.0), 6
#: Random line faults with trips, and how long they last in s.
LINES, CLEARING = 100, 0.1
T_END, SEED = 16.0, 0
#: Goals: share of runs beyond the tolerance; how far median and most estimates are from the truth; time
#: of estimates and of attempts that fail, in parts of detailed runs.
BEYOND, MEDIAN, MOST, BESIDES = 0.05, 0.2, 2.0, 0.05

Disturbance = Sequence[Event]


@dataclass(frozen=True)
class Grid:
    """A partitioned grid and what is simulated on it."""

    name: str
    parts: Partition
    disturbances: tuple[Disturbance, ...]


@dataclass(frozen=True)
class Outcome:
    """A run: error and estimate in degrees, CPU seconds, rungs in use.

    Seconds of the run, of the same on the rung that was taken without a tolerance, and of the detailed
    run.
    """

    true: float
    estimate: float
    seconds: float
    ladder: float
    detailed: float
    spent: dict[str, float]


def main(part: str = "") -> None:
    """Measure the grids with this part of a name; the page is there after each."""
    one_thread()
    sections = sections_of(PAGE) if part else {}
    for name, make in grids():
        if part in name:
            sections[name] = str(section(make(name)))
            print(sections[name], flush=True)
            write(PAGE, "# Runs within a tolerance", *sections.values())


def grids() -> Iterator[tuple[str, Callable[[str], Grid]]]:
    """Names of all grids that are there, and what makes them."""
    yield "NPCC, faults at the 36 buses", partial(of_npcc, disturb=at_study_buses)
    yield f"NPCC, {LINES} random line faults with trips", partial(of_npcc, disturb=lines)
    yield "Chain of four NPCC", of_four
    if POLISH.exists():
        for zone in (5, 6):
            yield f"Polish grid, zone {zone}", partial(of_polish, zone=zone)
    for name, folder, area, files in (
        ("WECC240, area 1", "wecc240", 1, WECC240),
        ("ACTIVSg2000, area 4", "activsg2000", 4, ACTIVSG2000),
    ):
        if (CASES / folder).exists():
            yield name, partial(of_files, folder=CASES / folder, files=files, area=area)


def of_npcc(name: str, disturb: Callable[[Partition], tuple[Disturbance, ...]]) -> Grid:
    """The built-in case."""
    case = load_case("npcc")
    parts = partition(build_model(case), study_buses(case, areas=(1,)))
    return Grid(name, parts, disturb(parts))


def at_study_buses(parts: Partition) -> tuple[Disturbance, ...]:
    """Faults at all buses of the study area."""
    return faults(parts, sorted(parts.study_buses))


def of_four(name: str) -> Grid:
    """Four times the built-in case, the first one's area 1 as study area."""
    case = load_case("npcc")
    return of_chain(name, partition(build_model(chain(case, 4)), study_buses(case, areas=(1,))))


def of_polish(name: str, zone: int) -> Grid:
    """The Polish grid with a zone as study area."""
    model = polish_model()
    return of_chain(name, partition(model, study_buses(model.case, zones=(zone,))))


@cache
def polish_model() -> DetailedModel:
    """Its model."""
    return build_model(load_case(POLISH))


def of_files(name: str, folder: Path, files: tuple[str, str], area: int) -> Grid:
    """A grid in PSS/E's files."""
    return of_chain(name, of_psse(folder, files, area))


def of_psse(folder: Path, files: tuple[str, str], area: int) -> Partition:
    """A grid in PSS/E's files, what gridfold has no model of replaced, with one area as study area."""
    case = load_case(
        folder / files[0],
        folder / files[1],
        unsupported="classical",
        without_data="negative_load",
        allow_unsupported_network=True,
    )
    model = build_model(case, on_limit=OnLimit.ADJUST)
    return partition(model, study_buses(case, areas=(area,)))


def of_chain(name: str, parts: Partition) -> Grid:
    """Faults at the buses of the largest machines of the study area."""
    units = [g for g in parts.model.case.generators if g.key in set(parts.study_units)]
    buses = dict.fromkeys(g.bus for g in sorted(units, key=lambda g: -g.active_mw))
    return Grid(name, parts, faults(parts, list(buses)[:BUSES]))


def faults(parts: Partition, buses: Sequence[int]) -> tuple[Disturbance, ...]:
    """Bus faults of parts of their critical clearing times."""
    found = []
    for bus in buses:
        critical = critical_clearing_time(parts.model, BusFault(bus), t_end=T_END).seconds
        found += [(BusFault(bus, duration=max(0.01, round(s * critical, 2))),) for s in SHARES]
    return tuple(dict.fromkeys(found))


def lines(parts: Partition) -> tuple[Disturbance, ...]:
    """Faults at random lines of the whole grid, cleared by tripping them."""
    branches = [b for b in parts.model.case.branches if b.in_service]
    chosen = np.random.default_rng(SEED).choice(
        len(branches), min(LINES, len(branches)), replace=False
    )
    return tuple(
        (BranchFault(f"{b.from_bus}-{b.to_bus}:{b.circuit}", duration=CLEARING),)
        for b in (branches[k] for k in sorted(chosen))
    )


def section(grid: Grid) -> Section:
    """Tables of one grid."""
    rows, goals = [], []
    for tolerance in TOLERANCES:
        began = time.process_time()
        settings = ModelSettings(ModelKind.ADAPTIVE, tolerance_deg=tolerance)
        ladder = settings.build(grid.parts)
        assert isinstance(ladder, Ladder)
        model = TolerantModel(ladder, tolerance)
        offline = time.process_time() - began
        outcomes = [
            o for d in grid.disturbances if (o := outcome(grid.parts, model, d)) is not None
        ]
        true = np.array([o.true for o in outcomes]) / tolerance
        known = [o for o in outcomes if o.true > 0]
        ratio = np.array([o.estimate / o.true for o in known]) if known else np.ones(1)
        spent = Counter[str]()
        for item in outcomes:
            spent.update(item.spent)
        whole = sum(spent.values()) or 1.0
        detailed = sum(o.detailed for o in outcomes)
        cost = sum(o.seconds for o in outcomes) / detailed
        alone = sum(o.ladder for o in outcomes) / detailed
        used = ", ".join(f"{n} {100 * s / whole:.0f}" for n, s in spent.most_common())
        rows.append(
            (
                f"{tolerance:g}", str(len(outcomes)), f"{100 * np.mean(true <= 1):.0f}",
                *(f"{q:.2f}" for q in np.quantile(true, (0.5, 0.95, 1.0))),
                *(f"{q:.2f}" for q in np.quantile(ratio, (0.05, 0.5, 0.95))),
                used, f"{cost:.2f}", f"{alone:.2f}", f"{offline:.1f}",
                f"{ladder.areas[-1].bases.order}, {len(ladder.retained)}",
            )
        )  # fmt: skip
        spread = max(np.quantile(ratio, 0.975), 1 / max(np.quantile(ratio, 0.025), 1e-9))
        text = f"{tolerance:g} degree"
        goals += [
            Goal(f"{text}: share of runs beyond", float(np.mean(true > 1)), BEYOND),
            Goal(f"{text}: median estimate from truth", abs(float(np.median(ratio)) - 1), MEDIAN),
            Goal(f"{text}: factor that holds 95 % of the estimates", float(spread), MOST),
            Goal(f"{text}: CPU beyond the ladder's own / detailed", cost - alone, BESIDES),
        ]
    heads = (
        "tolerance, deg", "runs", "within, %", "error / tolerance: 50 %", "95 %", "largest",
        "estimate / error: 5 %", "50 %", "95 %", "models in use, % of time", "CPU / detailed",
        "ladder alone / detailed", "off line, s", "order, retained",
    )  # fmt: skip
    count = len(grid.disturbances)
    caption = f"{count} disturbances of {T_END:g} s; stable ones are compared"
    table = Table(caption, heads, rows)
    return Section(grid.name, SCRIPT, (table,), remarks=(machine(),), goals=tuple(goals))


def outcome(parts: Partition, model: TolerantModel, events: Disturbance) -> Outcome | None:
    """A run beside the detailed one; None where synchronism is lost."""
    began = time.thread_time()
    detailed = simulate(parts.model, events, T_END)
    between = time.thread_time()
    found = model.run(parts.model, events, T_END)
    seconds = time.thread_time() - between
    alone = between - began
    if found.attempts[-1].mode is not Mode.DETAILED:
        rule = model.rules[len(found.attempts) - 1]
        began_alone = time.thread_time()
        simulate_adaptive(parts.model, model.small, rule, events, T_END)
        alone = time.thread_time() - began_alone
    run = found.trajectory
    if run.status is not detailed.status:
        raise SystemExit(f"{events}: {run.status.value} instead of {detailed.status.value}")
    if detailed.status is not Status.COMPLETED:
        return None
    out = detailed.models[-1].state.units_out
    units = [unit for unit in parts.study_units if unit not in out]
    true = max(item.relative_rms_deg for item in compare(detailed, run, units).units)
    estimate = found.error_estimate_deg
    assert estimate is not None
    return Outcome(true, estimate, seconds, alone, between - began, spent_in(found))


def spent_in(found: AdaptiveRun) -> dict[str, float]:
    """Simulated seconds of each model."""
    spent: dict[str, float] = defaultdict(float)
    for mode, piece in zip(found.modes, found.trajectory.run.pieces, strict=True):
        spent[mode.value] += float(piece.times[-1] - piece.times[0])
    return dict(spent)


if __name__ == "__main__":
    main(*sys.argv[1:])
