"""Critical clearing times and verdicts of reduced models of NPCC against the detailed one."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import product

import numpy as np
from report import Section, Table, machine, one_thread, write

from gridfold import (
    BusFault,
    ClearingTime,
    DetailedModel,
    Partition,
    SmallModels,
    Status,
    SwitchingRule,
    SynchronismCriterion,
    build_model,
    critical_clearing_times,
    load_case,
    partition,
    simulate,
    simulate_adaptive,
    whole_system,
)
from gridfold.dynamics.area_model import BoundaryCoupling
from gridfold.equivalents.families import Mode, ModelFamily, reduce_external
from gridfold.runs.clearing.single import Simulator
from gridfold.runs.simulate import ModelStore

T_END, RESOLUTION = 16.0, 0.01
BUSES = tuple(range(1, 37))
DETAILED = "detailed"


def lagged(parts: Partition) -> ModelFamily:
    """The external area reduced, with the coupling of the paper."""
    return reduce_external(parts, coupling=BoundaryCoupling.LAGGED)


#: What is compared with the detailed model: how the family is built, and when it switches.
MODELS: dict[str, tuple[Callable[[Partition], ModelFamily], SwitchingRule]] = {
    "linear": (reduce_external, SwitchingRule(float("inf"))),
    "hybrid": (reduce_external, SwitchingRule(0.0)),
    "adaptive, partitioned": (reduce_external, SwitchingRule(67.0)),
    "adaptive, partitioned, lagged": (lagged, SwitchingRule(67.0)),
    "adaptive, whole": (whole_system, SwitchingRule(6.0)),
}

#: Clearing times of the verdicts, in ms from the critical one of the detailed model.
OFFSETS_MS = (-20, -10, 10, 20)

#: Whether a run is stable, by bus and distance in ms.
Verdicts = dict[tuple[int, int], bool]


@dataclass(frozen=True)
class Findings:
    """Clearing times, verdicts at those of the detailed model, and the seconds that both took."""

    times: dict[str, list[ClearingTime]]
    verdicts: dict[str, Verdicts]
    seconds: dict[str, float]

    def difference_ms(self, name: str) -> list[int]:
        """Clearing times of a model less those of the detailed one."""
        pairs = zip(self.times[name], self.times[DETAILED], strict=True)
        return [round(1000 * (found.seconds - true.seconds)) for found, true in pairs]

    def wrong(self, name: str, stable: bool) -> list[tuple[int, int]]:
        """Bus and distance where the model says `stable` and the detailed one the opposite."""
        truth, said = self.verdicts[DETAILED], self.verdicts[name]
        return [key for key in truth if said[key] is stable and truth[key] is not stable]


def simulators(model: DetailedModel) -> dict[str, Simulator]:
    """What simulates with each model; families are built once, before threads share them."""
    parts = partition(model, BUSES)
    built = {build: SmallModels(build(parts)) for build, _ in MODELS.values()}
    for small, mode in product(built.values(), (Mode.LINEAR, Mode.HYBRID)):
        small.get(model, mode)
    return {DETAILED: simulate} | {
        name: _simulator(built[build], rule) for name, (build, rule) in MODELS.items()
    }


def _simulator(small: SmallModels, rule: SwitchingRule) -> Simulator:
    return lambda model, *options: simulate_adaptive(model, small, rule, *options).trajectory


def find(model: DetailedModel) -> Findings:
    """Clearing times by every model, then the verdicts."""
    faults = [BusFault(bus) for bus in BUSES]
    times: dict[str, list[ClearingTime]] = {}
    verdicts: dict[str, Verdicts] = {}
    seconds = {}
    for name, simulator in simulators(model).items():
        began = time.perf_counter()
        found = critical_clearing_times(
            model, faults, resolution=RESOLUTION, t_end=T_END, simulator=simulator
        )
        times[name] = list(found)
        true = {bus: item.seconds for bus, item in zip(BUSES, times[DETAILED], strict=True)}
        verdicts[name] = judge(model, simulator, true)
        seconds[name] = time.perf_counter() - began
    return Findings(times, verdicts, seconds)


def judge(model: DetailedModel, simulator: Simulator, true: Mapping[int, float]) -> Verdicts:
    """Whether a fault at each bus is stable near the clearing time `true`, in seconds."""
    store: ModelStore = {model.state: model}
    cases = {
        (bus, offset): round(seconds + offset / 1000, 9)
        for bus, seconds in true.items()
        for offset in OFFSETS_MS
    }

    def stable(key: tuple[int, int]) -> bool:
        fault = BusFault(key[0], duration=cases[key])
        run = simulator(model, [fault], T_END, None, SynchronismCriterion(), store)
        return run.status is Status.COMPLETED

    keys = [key for key, seconds in cases.items() if seconds > 0]
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        return dict(zip(keys, pool.map(stable, keys), strict=True))


def bus_table(found: Findings) -> Table:
    """Clearing times by bus."""
    heads = ["bus", DETAILED]
    columns = [[str(bus) for bus in BUSES], _seconds(found.times[DETAILED])]
    for name in MODELS:
        heads += [name, "difference, ms"]
        columns += [_seconds(found.times[name]), [_signed(d) for d in found.difference_ms(name)]]
    caption = f"Critical clearing times in seconds, on a grid of {RESOLUTION:g} s:"
    return Table(caption, tuple(heads), list(zip(*columns, strict=True)))


def difference_table(found: Findings) -> Table:
    """How clearing times differ, by model."""
    rows = []
    for name in MODELS:
        difference = np.array(found.difference_ms(name))
        largest = _signed(int(difference[np.argmax(np.abs(difference))]))
        counts = (difference == 0, difference < 0, difference > 0)
        mean = f"{np.abs(difference).mean():.1f}"
        texts = [str(int(np.sum(count))) for count in counts]
        rows.append((name, *texts, mean, largest, f"{found.seconds[name]:.0f}"))
    heads = ("model", "equal", "shorter", "longer", "mean size, ms", "largest, ms", "seconds")
    caption = f"Differences of the {len(BUSES)} clearing times to the detailed ones:"
    return Table(caption, heads, rows)


def verdict_table(found: Findings) -> Table:
    """Numbers of wrong verdicts by model and clearing time."""
    rows = []
    for name in MODELS:
        wrong = found.wrong(name, True), found.wrong(name, False)
        texts = [
            " / ".join(str(sum(offset == at for _, offset in kind)) for kind in wrong)
            for at in OFFSETS_MS
        ]
        rows.append((name, *texts, " / ".join(str(len(kind)) for kind in wrong)))
    heads = ("model", *(f"{_signed(at)} ms" for at in OFFSETS_MS), "all")
    caption = (
        "Wrong verdicts with the fault cleared this far from the detailed model's critical "
        "clearing time, false-stable / false-unstable:"
    )
    return Table(caption, heads, rows)


def where_table(found: Findings) -> Table:
    """Buses of the wrong verdicts."""
    rows = []
    for name in MODELS:
        for kind, stable in (("false-stable", True), ("false-unstable", False)):
            wrong = found.wrong(name, stable)
            texts = [", ".join(str(bus) for bus, at in wrong if at == o) or "-" for o in OFFSETS_MS]
            rows.append((name, kind, *texts))
    heads = ("model", "verdict", *(f"{_signed(at)} ms" for at in OFFSETS_MS))
    return Table("Buses of the wrong verdicts:", heads, rows)


def _seconds(times: list[ClearingTime]) -> list[str]:
    return [f"{item.seconds:.2f}" if item.bounded else f"> {item.seconds:.2f}" for item in times]


def _signed(milliseconds: int) -> str:
    return f"{milliseconds:+d}" if milliseconds else "0"


def measure() -> Section:
    """Find everything."""
    began = time.perf_counter()
    found = find(build_model(load_case("npcc")))
    spent = time.perf_counter() - began
    truth = found.verdicts[DETAILED]
    counts = [sum(truth[key] for key in truth if key[1] == at) for at in OFFSETS_MS]
    stable = ", ".join(f"{n} at {_signed(at)} ms" for n, at in zip(counts, OFFSETS_MS, strict=True))
    remarks = (
        f"Faults at the {len(BUSES)} buses of the study area of npcc, runs of {T_END:g} s; "
        f"synchronism is lost at {SynchronismCriterion()}. Thresholds of the paper: 1 p.u., 67 and "
        "6 degrees; bound of the reduction 1e-5. A verdict is false-stable where the model keeps "
        "synchronism and the detailed one does not, false-unstable the other way round.",
        f"The detailed model was run at the same {len(truth)} clearing times; of them are stable: "
        f"{stable}.",
        f"Took {spent:.0f} s on {os.cpu_count()} threads. *seconds*: clearing times and verdicts; "
        f"{found.seconds[DETAILED]:.0f} s with the detailed model.",
    )
    tables = (difference_table(found), verdict_table(found), where_table(found), bus_table(found))
    return Section("Clearing times and verdicts", "verdicts.py", tables, remarks)


def main() -> Section:
    """Measure, and write the page."""
    section = measure()
    write("verdicts.md", "# Verdicts of the reduced models", section, machine())
    return section


if __name__ == "__main__":
    one_thread()
    print(main(), machine(), sep="\n\n")
