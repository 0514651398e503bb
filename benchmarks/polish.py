"""Reduced models of the Polish grid of RAPID: 2,383 buses, 327 machines, a zone as study area.

The case is read from ``polish/Data_POLISH.mat`` in the folder of public cases (GRIDFOLD_CASES).
"""

from __future__ import annotations

import os
import resource
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from folded_rows import (
    ANGLE_DEG,
    WHOLE_DEG,
    candidates,
    fault_table,
    score_table,
    step_table,
    warm_up,
)
from report import ROOT, Section, Table, machine, one_thread, write

from gridfold import (
    BusFault,
    ClearingTime,
    DetailedModel,
    Partition,
    RungeKutta4,
    build_model,
    critical_clearing_times,
    load_case,
    partition,
    simulate,
)
from gridfold.partition import study_buses

SOURCE = Path(os.environ.get("GRIDFOLD_CASES", ROOT / ".." / "shared" / "data"))
FILE = SOURCE / "polish" / "Data_POLISH.mat"

#: Study areas: of the large zones the one with the fewest tie lines, and the smallest of all.
ZONES = (5, 6)

#: Faults at the buses with the largest machines, in s; one more for a part of its clearing time.
BUSES, SHORT, SHARE, T_END = 3, 0.1, 0.9, 16.0
RESOLUTION, LONGEST = 0.02, 1.0

#: External machines that are retained.
RETAINED = 8
REPETITIONS = 5


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
    return faults, list(tried)


def grid_section(model: DetailedModel, seconds: float) -> Section:
    """Size, start and stability of the grid; its zones."""
    poles = np.linalg.eigvals(model.jacobian(model.x0))
    worst = max(poles[np.abs(poles) > 1e-6], key=lambda pole: (pole.real, pole.imag))
    facts = [
        ("buses, branches", f"{len(model.case.buses)}, {len(model.case.branches)}"),
        ("machines, states", f"{len(model.machines)}, {model.n_states}"),
        ("largest derivative at the start", f"{np.abs(model.compiled(model.x0)).max():.1e}"),
        ("rightmost eigenvalue", f"{worst.real:+.3f} +- {worst.imag:.3f}j 1/s"),
        ("seconds of reading, power flow, model and start", f"{seconds:.2f}"),
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


def clearing_text(tried: list[ClearingTime]) -> str:
    """Clearing times of the detailed model."""
    texts = [
        f"{item.fault.bus}: {'' if item.bounded else 'more than '}{item.seconds:.2f} s"
        for item in tried
    ]
    return f"Critical clearing times of the detailed model by bus: {', '.join(texts)}."


def step_text(model: DetailedModel, fault: BusFault) -> str:
    """How far the step of the detailed runs matters."""
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
    parts = partition(model, study_buses(model.case, zones=[zone]))
    faults, tried = find_faults(parts)
    found = candidates(parts, RETAINED)
    tables = (
        fault_table(found, faults, T_END, REPETITIONS),
        step_table(found),
        score_table(found.ranking, RETAINED),
    )
    sizes = (
        f"{len(parts.study_units)} machines in the study area, {len(parts.external_units)} in the "
        f"rest; {len(parts.tie_lines)} tie lines at {len(parts.boundary_buses)} boundary buses."
    )
    remarks = sizes, clearing_text(tried), step_text(model, faults[-1])
    return Section(f"Study area: zone {zone}", "polish.py", tables, remarks)


def measure() -> list[object]:
    """Everything, as parts of a page."""
    warm_up()
    began = time.process_time()
    model = build_model(load_case(FILE))
    seconds = time.process_time() - began
    general = (
        f"{machine()} Faults: {SHORT:g} s at the buses of the {BUSES} largest machines of the study "
        f"area, and {100 * SHARE:.0f} % of the critical clearing time at one of them. *linear*: all "
        f"machines outside the study area linear, folded behind ports; *retained*: {RETAINED} of "
        "them exact, those of largest score, or of largest column norm; *ladder*: the models between "
        f"which the adaptive algorithm switches, at {ANGLE_DEG:g} and {WHOLE_DEG:g} degrees; ports "
        "and orders are those of its areas. Off line: seconds of sample swings, ranking, reduction "
        f"and models. CPU time on one thread, medians of {REPETITIONS} interleaved runs and of the "
        "ratios in each round."
    )
    sections = [grid_section(model, seconds)]
    print(sections[-1], end="\n\n", flush=True)
    for zone in ZONES:
        sections.append(zone_section(model, zone))
        print(sections[-1], end="\n\n", flush=True)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    return [general, *sections, f"Largest memory of the process: {peak:.1f} GB."]


def main() -> str:
    """Measure and write the page; what is told at the end, or that the data are absent."""
    if not FILE.is_file():
        return f"{FILE} is absent; GRIDFOLD_CASES names the folder of public cases"
    general, *sections, memory = measure()
    write("polish.md", "# The Polish grid", general, *sections, memory)
    return str(memory)


if __name__ == "__main__":
    one_thread()
    print(main())
