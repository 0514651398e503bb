"""Folded areas along a chain of NPCC grids: 48, 192 and 3,072 machines, the same study area."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass

from chain import OFFSET, chain
from folded_rows import ANGLE_DEG, WHOLE_DEG, candidates, fault_table, score_table, steps, warm_up
from report import Section, Table, machine, one_thread

from gridfold import BusFault, build_model, load_case, partition
from gridfold.equivalents.families import Mode

#: Copies of NPCC with the end of the runs (s): the long chain is run for a part of the time only.
LONG = 64
CHAINS = {1: 16.0, 4: 16.0, LONG: 4.0}
#: The study area is New England of the second copy, or of the only one.
STUDY_AREA = range(1, 37)
BUSES = (3, 23)
#: Duration of the faults in s; external machines that are retained; runs of each model.
DURATION, RETAINED, REPETITIONS = 0.1, 8, 5


@dataclass(frozen=True)
class Measured:
    """Tables of one chain, its number of machines, and seconds of a step by model."""

    tables: tuple[Table, ...]
    machines: int
    steps: Mapping[Mode, float]


def measure_chain(copies: int, t_end: float) -> Measured:
    """Size, times and errors of one chain."""
    shift = OFFSET if copies > 1 else 0
    began = time.process_time()
    model = build_model(chain(load_case("npcc"), copies))
    built = time.process_time() - began
    parts = partition(model, [shift + bus for bus in STUDY_AREA])
    faults = [BusFault(shift + bus, duration=DURATION) for bus in BUSES]
    found = candidates(parts, RETAINED, norms=copies < LONG)
    facts = [
        ("machines, states", f"{len(model.machines)}, {model.n_states}"),
        ("buses", str(len(model.case.buses))),
        ("machines of the study area", str(len(parts.study_units))),
        ("tie lines", str(len(parts.tie_lines))),
        ("seconds of power flow, model and start", f"{built:.1f}"),
    ]
    runs = fault_table(found, faults, t_end, REPETITIONS)
    size = Table(f"{copies} {'copy' if copies == 1 else 'copies'} of NPCC:", ("", ""), facts)
    tables = size, runs, score_table(found.ranking, RETAINED)
    return Measured(tables, len(model.machines), steps(found))


def step_table(chains: Mapping[int, Measured]) -> Table:
    """Microseconds of a step along the chain."""
    modes = list(chains[LONG].steps)
    rows = [
        (str(copies), str(one.machines), *(f"{1e6 * one.steps[mode]:.1f}" for mode in modes))
        for copies, one in chains.items()
    ]
    heads = ("copies", "machines", *(mode.value for mode in modes))
    return Table("A step of each model in microseconds, the fastest of some tries:", heads, rows)


def measure() -> Section:
    """Measure every chain."""
    warm_up()
    chains: dict[int, Measured] = {}
    for copies, t_end in CHAINS.items():
        chains[copies] = measure_chain(copies, t_end)
    tables = (step_table(chains), *(table for one in chains.values() for table in one.tables))
    remarks = (
        "The study area is New England of the second copy, or of the only one: the same machines, "
        "lines and faults in every chain. What a step of *linear* takes depends on the study area and "
        "the order of the folded rest, not on the length of the chain; that of *detailed* does. "
        f"Runs of the {LONG} copies last {CHAINS[LONG]:g} s, as one detailed run takes long; with "
        "a fault and set-up in the shorter time, ratios of whole runs are larger than those of steps. "
        f"*retained*: the {RETAINED} external machines of largest score exact; *ladder* switches at "
        f"{ANGLE_DEG:g} and {WHOLE_DEG:g} degrees; ports and orders are those of its areas. Off line: "
        "seconds of sample swings, ranking, reduction and models. CPU time on one thread, medians of "
        f"{REPETITIONS} interleaved runs and of the ratios in each round.",
    )
    return Section("NPCC in a chain", "second_case.py", tables, remarks)


if __name__ == "__main__":
    one_thread()
    print(measure(), machine(), sep="\n\n")
