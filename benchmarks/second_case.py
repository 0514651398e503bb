"""Reduced models of a second, larger system: a chain of four NPCC grids, 192 machines."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

from chain import OFFSET, chain
from report import Section, Table, machine, one_thread
from timing import interleave

from gridfold import BusFault, DetailedModel, Trajectory, build_model, load_case, simulate
from gridfold.dynamics.area_model import Outputs
from gridfold.partition import Partition, couple, partition
from gridfold.reduction import BalancedTruncation
from gridfold.studies.adaptive import SwitchingRule, simulate_adaptive
from gridfold.studies.compare import compare
from gridfold.studies.reduced import ReducedExternal, reduce_external
from gridfold.studies.simulate import ModelStore
from gridfold.studies.small_models import SmallModels
from gridfold.systems.status import Status

COPIES, T_END = 4, 16.0

#: The study area is New England of the second copy.
STUDY_AREA = range(OFFSET + 1, OFFSET + 37)
FAULTS = tuple(BusFault(OFFSET + bus, duration=t) for bus, t in ((3, 0.3), (23, 0.15), (17, 0.03)))

#: Threshold of the column norm in siemens at 20 kV (that of NPCC), of the bound, and of the angle.
SIEMENS, TOLERANCE = 0.25, 1e-2
RULES = {
    "linear": SwitchingRule(float("inf")),
    "hybrid": SwitchingRule(0.0),
    "adaptive": SwitchingRule(67.0),
}

#: Every rule with the states of linear machines formed, as in the paper, and with polar outputs.
MODELS = {
    f"{name}, {outputs.value}": (rule, outputs)
    for outputs in Outputs
    for name, rule in RULES.items()
}


@dataclass(frozen=True)
class Prepared:
    """The system, its reduced models and the seconds they took."""

    model: DetailedModel
    parts: Partition
    threshold: float
    family: ReducedExternal
    small: dict[Outputs, SmallModels]
    seconds: float


def prepare() -> Prepared:
    """Build the chain, divide it and reduce the external area."""
    model = build_model(chain(load_case("npcc"), COPIES))
    began = time.perf_counter()
    parts = partition(model, STUDY_AREA)
    threshold = couple(parts).per_unit(SIEMENS)
    family = reduce_external(parts, BalancedTruncation(tolerance=TOLERANCE), threshold)
    seconds = time.perf_counter() - began
    small = {outputs: SmallModels(replace(family, outputs=outputs)) for outputs in Outputs}
    return Prepared(model, parts, threshold, family, small, seconds)


def fault_rows(ready: Prepared, fault: BusFault, store: ModelStore) -> list[tuple[str, ...]]:
    """Errors, switches and times of every model for one fault; all share what has been built."""
    model, where = ready.model, f"bus {fault.bus}, {fault.duration:g} s"

    def run(rule: SwitchingRule, outputs: Outputs) -> Trajectory:
        small, events = ready.small[outputs], (fault,)
        return simulate_adaptive(model, small, rule, events, T_END, store=store).trajectory

    detailed = simulate(model, (fault,), T_END, store=store)
    if detailed.status is not Status.COMPLETED:
        return [(where, "detailed", detailed.status.value, "", "")]
    reduced = {name: run(*chosen) for name, chosen in MODELS.items()}
    actions = {"detailed": lambda: simulate(model, (fault,), T_END, store=store)}
    actions |= {name: lambda chosen=chosen: run(*chosen) for name, chosen in MODELS.items()}
    times = interleave(actions, 5)
    rows = [(where, "detailed", "", times.scaled("detailed", 1e-3), "")]
    for name, found in reduced.items():
        error = found.status.value
        if found.status is Status.COMPLETED:
            error = f"{compare(detailed, found, ready.parts.study_units).worst.rms_deg:.2f}"
        ratio = str(times.ratio(name, "detailed"))
        rows.append((where, name, error, times.scaled(name, 1e-3), ratio))
    return rows


def measure() -> Section:
    """Measure everything."""
    ready = prepare()
    store: ModelStore = {}
    family = ready.family
    kept = ", ".join(str(unit) for unit in family.kept)
    facts = [
        ("machines", str(len(ready.model.machines))),
        ("machines of the study area", str(len(ready.parts.study_units))),
        ("external states", str(family.reduction.system.p)),
        ("order", str(family.reduction.order)),
        ("threshold of the column norm", f"{SIEMENS:g} S = {ready.threshold:g} p.u."),
        ("kept machines", kept),
        ("reference machine", str(family.reference_unit)),
        ("seconds off line", f"{ready.seconds:.1f}"),
    ]
    rows = [row for fault in FAULTS for row in fault_rows(ready, fault, store)]
    heads = ("fault", "model", "RMS error, degrees", "milliseconds, min / median", "/ detailed")
    tables = (
        Table("The system:", ("", ""), facts),
        Table("16 s, error of the worst study-area machine:", heads, rows),
    )
    remarks = (
        f"The study area is New England of the second of {COPIES} copies. Thresholds are those of "
        f"NPCC, not calibrated here; the bound of the reduction is {TOLERANCE:g}.",
    )
    return Section("A second case: NPCC in a chain", "second_case.py", tables, remarks)


if __name__ == "__main__":
    one_thread()
    print(measure(), machine(), sep="\n\n")
