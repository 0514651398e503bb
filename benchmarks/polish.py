"""Reduced models of the Polish grid of RAPID: 2,383 buses, 327 machines, a zone as study area.

The case is read from ``polish/Data_POLISH.mat`` in the folder of public cases (GRIDFOLD_CASES).
"""

from __future__ import annotations

import os
import resource
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from report import ROOT, Section, Table, machine, one_thread, write
from second_case import Known
from timing import interleave

from gridfold import (
    BusFault,
    ClearingTime,
    DetailedModel,
    Outputs,
    Partition,
    RungeKutta4,
    SmallModels,
    Status,
    SwitchingRule,
    Trajectory,
    build_model,
    compare,
    critical_clearing_times,
    load_case,
    partition,
    simulate,
    simulate_adaptive,
)
from gridfold.equivalents.compare import UnitError
from gridfold.equivalents.families import ReducedExternal, reduce_external, slow_modes
from gridfold.partition import linearize_external
from gridfold.partition.areas import study_buses
from gridfold.reduction import BalancedTruncation, Reduction
from gridfold.runs.simulate import ModelStore
from gridfold.systems.statemap import StateMap

SOURCE = Path(os.environ.get("GRIDFOLD_CASES", ROOT / ".." / "shared" / "data"))
FILE = SOURCE / "polish" / "Data_POLISH.mat"

#: Study areas: of the large zones the one with the fewest tie lines, and the smallest of all.
ZONES = (5, 6)

#: Faults at the buses with the largest machines, in s; one more for a part of its clearing time.
BUSES, SHORT, SHARE, T_END = 3, 0.1, 0.9, 16.0
RESOLUTION, LONGEST = 0.02, 1.0

#: Threshold of the column norm in siemens at 20 kV and of the angle (those of NPCC).
SIEMENS, ANGLE_DEG = 0.25, 67.0

#: Bound to which the external area is balanced, and those of the models, in parts of that at order 0.
FINEST, RELATIVE = 0.1, (0.1, 0.01)

#: Modes of the whole grid that decay more slowly than this (1/s) are kept by half of the models.
DECAY = 0.05
REPETITIONS = 3

Clock = dict[str, float]
Choice = tuple[SmallModels, SwitchingRule]


@contextmanager
def clocked(seconds: Clock, name: str) -> Iterator[None]:
    """Put the seconds spent inside into `seconds`."""
    began = time.perf_counter()
    yield
    seconds[name] = time.perf_counter() - began


@dataclass(frozen=True)
class Ready:
    """A study area: its finest reduction, models, faults, and seconds by what was done.

    `families` are by order, `slow` the same with the slow modes besides.
    """

    parts: Partition
    finest: Reduction
    families: dict[int, ReducedExternal]
    slow: dict[int, ReducedExternal]
    faults: list[BusFault]
    tried: list[ClearingTime]
    seconds: Clock


def prepare(model: DetailedModel, zone: int) -> Ready:
    """Everything that is done once, with its seconds."""
    seconds: Clock = {}
    with clocked(seconds, "linearization"):
        parts = partition(model, study_buses(model.case, zones=[zone]))
        linear = linearize_external(parts)
    with clocked(seconds, f"modes of the whole that decay more slowly than {DECAY:g} 1/s"):
        modes = slow_modes(model, model.x0, DECAY)[linear.state_index]
    with clocked(seconds, "unstable modes, Gramians, balancing"):
        finest = BalancedTruncation(tolerance=FINEST).reduce(linear.system, linear.x0, modes)
    tails = bounds(finest)
    families: dict[int, ReducedExternal] = {}
    slow: dict[int, ReducedExternal] = {}
    for part in RELATIVE:
        order = int(np.sum(tails > part * tails[0])) + finest.kept_exactly
        for found, include in ((families, None), (slow, modes)):
            what = "" if include is None else " and slow modes"
            with clocked(seconds, f"truncation to order {order}{what}, modal form"):
                family = reduce_external(parts, Known(truncated(finest, order, include)))
            kept = family.coupling.kept(family.coupling.per_unit(SIEMENS))
            found[order] = replace(family, kept=kept)
    return Ready(parts, finest, families, slow, *find_faults(parts), seconds)


def find_faults(parts: Partition) -> tuple[list[BusFault], list[ClearingTime]]:
    """Faults at the largest machines, and the clearing times there."""
    units = [g for g in parts.model.case.generators if g.key in set(parts.study_units)]
    buses = dict.fromkeys(g.bus for g in sorted(units, key=lambda g: -g.active_mw))
    faults = [BusFault(bus, duration=SHORT) for bus in list(buses)[:BUSES]]
    tried = critical_clearing_times(
        parts.model, faults, resolution=RESOLUTION, longest=LONGEST, t_end=T_END
    )
    first = min(tried, key=lambda item: item.seconds)
    if first.bounded and SHARE * first.seconds > SHORT:
        faults.append(replace(first.fault, duration=round(SHARE * first.seconds, 2)))
    return faults, tried


def bounds(reduction: Reduction) -> NDArray[np.float64]:
    """The bound (6) by number of stable states kept."""
    return np.append(2 * np.cumsum(reduction.hankel_values[::-1])[::-1], 0.0)


def truncated(fine: Reduction, order: int, modes: NDArray[np.float64] | None) -> Reduction:
    """A smaller model from a larger one: truncating a balanced model twice is truncating it once."""
    outer = fine.state_map
    include = None if modes is None else outer.restrict_matrix @ modes
    again = BalancedTruncation(order=order).reduce(fine.system, np.zeros(fine.order), include)
    inner = again.state_map
    states = StateMap(
        outer.reference,
        outer.lift_matrix @ inner.lift_matrix,
        inner.restrict_matrix @ outer.restrict_matrix,
    )
    bound = float(bounds(fine)[order - fine.kept_exactly])
    return replace(fine, system=again.system, state_map=states, bound=bound)


def models(ready: Ready) -> dict[str, Choice]:
    """Every model with polar outputs; the linear one of the largest order also with states formed."""
    chosen: dict[str, Choice] = {}
    rules = (("linear", np.inf), ("hybrid", 0.0), ("adaptive", ANGLE_DEG))
    for found in (ready.families, ready.slow):
        for family in found.values():
            small = SmallModels(replace(family, outputs=Outputs.POLAR))
            text = (
                f"r = {family.reduction.order}{'' if found is ready.families else ', slow modes'}"
            )
            for name, angle in rules:
                chosen[f"{name}, polar, {text}"] = small, SwitchingRule(angle)
    order = max(ready.families)
    small = SmallModels(replace(ready.families[order], outputs=Outputs.STATES))
    chosen[f"linear, states, r = {order}"] = small, SwitchingRule(np.inf)
    return chosen


def fault_rows(
    ready: Ready, chosen: dict[str, Choice], fault: BusFault, store: ModelStore
) -> list[tuple[str, ...]]:
    """Errors and times of every model for one fault."""
    model, where = ready.parts.model, f"bus {fault.bus}, {fault.duration:g} s"

    def run(small: SmallModels, rule: SwitchingRule) -> Trajectory:
        return simulate_adaptive(model, small, rule, (fault,), T_END, store=store).trajectory

    actions: dict[str, Callable[[], Trajectory]] = {
        "detailed": lambda: simulate(model, (fault,), T_END, store=store)
    }
    actions |= {name: lambda choice=choice: run(*choice) for name, choice in chosen.items()}
    times = interleave(actions, REPETITIONS)
    detailed = actions["detailed"]()
    rows = [(where, "detailed", "", "", "", times.scaled("detailed", 1e-3), "")]
    for name in chosen:
        found = actions[name]()
        errors = (found.status.value, "", "")
        if found.status is detailed.status is Status.COMPLETED:
            errors = error_texts(compare(detailed, found, ready.parts.study_units).units)
        ratio = str(times.ratio(name, "detailed"))
        rows.append((where, name, *errors, times.scaled(name, 1e-3), ratio))
    return rows


def error_texts(units: tuple[UnitError, ...]) -> tuple[str, str, str]:
    """Worst machine by RMS error, largest error, RMS error against the centre of inertia."""
    worst = max(units, key=lambda error: error.rms_deg)
    largest = max(error.largest_deg for error in units)
    relative = max(error.relative_rms_deg for error in units)
    return f"{worst.rms_deg:.3f} ({worst.unit})", f"{largest:.3f}", f"{relative:.3f}"


def grid_section(model: DetailedModel, seconds: Clock) -> Section:
    """Size, start and stability of the grid; its zones."""
    poles = np.linalg.eigvals(model.jacobian(model.x0))
    worst = max(poles[np.abs(poles) > 1e-6], key=lambda pole: (pole.real, pole.imag))
    facts = [
        ("buses, branches", f"{len(model.case.buses)}, {len(model.case.branches)}"),
        ("machines, states", f"{len(model.machines)}, {model.n_states}"),
        ("largest derivative at the start", f"{np.abs(model.compiled(model.x0)).max():.1e}"),
        ("rightmost eigenvalue", f"{worst.real:+.3f} +- {worst.imag:.3f}j 1/s"),
        *((f"seconds of {name}", f"{value:.2f}") for name, value in seconds.items()),
    ]
    rows = []
    zone = {bus.number: bus.zone for bus in model.case.buses}
    for number in sorted(set(zone.values())):
        parts = partition(model, study_buses(model.case, zones=[number]))
        units = [g for g in model.case.generators if zone[g.bus] == number]
        counts = len(parts.study_buses), len(units), sum(unit.active_mw for unit in units)
        edges = len(parts.tie_lines), len(parts.boundary_buses)
        rows.append((str(number), *(f"{count:.0f}" for count in (*counts, *edges))))
    heads = ("zone", "buses", "machines", "MW", "tie lines", "boundary buses")
    tables = Table("The grid:", ("figure", "value"), facts), Table("Its zones:", heads, rows)
    notices = "; ".join(model.case.notices)
    return Section("The grid", "polish.py", tables, (f"The reader notes: *{notices}*.",))


def reduction_table(ready: Ready) -> Table:
    """Sizes of the areas, orders, bounds and kept machines."""
    parts, finest = ready.parts, ready.finest
    facts = [
        (
            "machines of the study area, of the rest",
            f"{len(parts.study_units)}, {len(parts.external_units)}",
        ),
        ("tie lines, boundary buses", f"{len(parts.tie_lines)}, {len(parts.boundary_buses)}"),
        ("external states, inputs", f"{len(finest.state_map.reference)}, {finest.system.m}"),
        ("states of unstable modes, kept as they are", str(finest.kept_exactly)),
    ]
    for part, (order, family) in zip(RELATIVE, ready.families.items(), strict=True):
        text = f"r = {order}, bound {family.reduction.bound:.3g}"
        facts.append((f"order for {part:g} of the bound at order 0", text))
    kept = ", ".join(map(str, family.kept)) or "none"
    facts.append((f"machines nonlinear in *hybrid* ({SIEMENS:g} S or more)", kept))
    return Table("The external area:", ("figure", "value"), facts)


def value_table(reduction: Reduction) -> Table:
    """Singular values and the bound (6)."""
    values, tails = reduction.hankel_values, bounds(reduction)
    counts = [k for k in (0, 10, 20, 50, 100, 200, 400, 800) if k < len(values)]
    rows = [(str(k), f"{values[k]:.3g}", f"{tails[k]:.3g}") for k in counts]
    heads = ("stable states kept", "largest singular value left out", "bound (6)")
    return Table("Hankel singular values:", heads, rows)


def seconds_table(ready: Ready, chosen: dict[str, Choice]) -> Table:
    """What is done once."""
    built = {id(small): small.seconds for small, _ in chosen.values()}
    rows = [(name, f"{value:.1f}") for name, value in ready.seconds.items()]
    rows.append((f"linear and hybrid models ({len(built)} pairs)", f"{sum(built.values()):.1f}"))
    return Table("Set-up, once for all faults:", ("work", "seconds"), rows)


def clearing_text(tried: list[ClearingTime]) -> str:
    """Clearing times of the detailed model."""
    texts = [
        f"{item.fault.bus}: {'' if item.bounded else 'more than '}{item.seconds:.2f} s"
        for item in tried
    ]
    return f"Critical clearing times of the detailed model by bus: {', '.join(texts)}."


def step_text(model: DetailedModel, fault: BusFault) -> str:
    """How far RK4 at 10 ms is from 2.5 ms."""
    coarse, fine = (
        simulate(model, (fault,), T_END, RungeKutta4(step)).rotor_angle_deg()
        for step in (0.01, 0.0025)
    )
    return (
        f"All runs are stepped by RK4 at 10 ms; for the fault of {fault.duration:g} s at bus "
        f"{fault.bus} the detailed rotor angles differ by at most "
        f"{np.abs(coarse - fine[::4]).max():.1e} degrees from those at 2.5 ms."
    )


def zone_section(model: DetailedModel, zone: int) -> Section:
    """All tables of one study area."""
    ready = prepare(model, zone)
    chosen = models(ready)
    store: ModelStore = {}
    rows = [row for fault in ready.faults for row in fault_rows(ready, chosen, fault, store)]
    errors = "RMS error (machine)", "largest", "RMS against the centre of inertia"
    heads = ("fault", "model", *errors, "ms, min / median", "/ detailed")
    tables = (
        reduction_table(ready),
        value_table(ready.finest),
        seconds_table(ready, chosen),
        Table(f"{T_END:g} s, worst study-area machine, errors in degrees:", heads, rows),
    )
    remarks = clearing_text(ready.tried), step_text(model, ready.faults[-1])
    return Section(f"Study area: zone {zone}", "polish.py", tables, remarks)


def measure() -> list[object]:
    """Everything, as parts of a page."""
    seconds: Clock = {}
    with clocked(seconds, "reading, power flow, model and start"):
        model = build_model(load_case(FILE))
    general = (
        f"{machine()} Faults: {SHORT:g} s at the buses of the {BUSES} largest machines of the study "
        f"area, and {100 * SHARE:.0f} % of the critical clearing time at one of them. Thresholds are "
        f"those of NPCC: {SIEMENS:g} S, and {ANGLE_DEG:g} degrees (*adaptive*). *states* forms all "
        "states of the linear machines, *polar* only what they cause at the boundary. The external "
        f"area is balanced once, to a bound of {FINEST:g}; models are truncated from that. *slow "
        f"modes* keeps the modes of the whole grid that decay more slowly than {DECAY:g} 1/s, or "
        "grow, exact."
    )
    sections = [grid_section(model, seconds)]
    for zone in ZONES:
        print(sections[-1], end="\n\n", flush=True)
        sections.append(zone_section(model, zone))
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    return [general, *sections, f"Largest memory of the process: {peak:.1f} GB."]


def main() -> str:
    """Measure and write the page; what is told at the end, or that the data are absent."""
    if not FILE.is_file():
        return f"{FILE} is absent; GRIDFOLD_CASES names the folder of public cases"
    general, *sections, memory = measure()
    write("polish.md", "# The Polish grid", general, *sections, memory)
    return f"{sections[-1]}\n\n{memory}"


if __name__ == "__main__":
    one_thread()
    print(main())
