"""Reduced models of a second, larger system: a chain of four NPCC grids, 192 machines."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np
from chain import OFFSET, chain
from numpy.typing import NDArray
from report import Section, Table, machine, one_thread
from timing import interleave

from gridfold import (
    BusFault,
    DetailedModel,
    Trajectory,
    build_model,
    critical_clearing_times,
    load_case,
    simulate,
)
from gridfold.dynamics.area_model import Outputs
from gridfold.equivalents.adaptive import simulate_adaptive
from gridfold.equivalents.calibrate import Calibration, ThresholdKind, calibrate
from gridfold.equivalents.compare import compare
from gridfold.equivalents.families import ReducedExternal, reduce_external
from gridfold.equivalents.small_models import SmallModels
from gridfold.equivalents.switching import SwitchingRule
from gridfold.partition import Partition, couple, partition
from gridfold.reduction import BalancedTruncation, Reduction
from gridfold.runs.simulate import ModelStore
from gridfold.systems.linear import LinearSystem
from gridfold.systems.status import Status

COPIES, T_END = 4, 16.0

#: The study area is New England of the second copy.
STUDY_AREA = range(OFFSET + 1, OFFSET + 37)
FAULTS = tuple(BusFault(OFFSET + bus) for bus in (3, 23, 17))

#: Threshold of the column norm in siemens at 20 kV (that of NPCC), of the bound, and of the angle.
SIEMENS, TOLERANCE, ANGLE_DEG = 0.25, 1e-2, 67.0


@dataclass(frozen=True)
class Prepared:
    """The system, its faults, its reduced models and the seconds they took."""

    model: DetailedModel
    parts: Partition
    faults: tuple[BusFault, ...]
    threshold: float
    family: ReducedExternal
    small: dict[Outputs, SmallModels]
    seconds: float


def prepare() -> Prepared:
    """Build the chain, divide it, reduce the external area, and find the clearing times."""
    model = build_model(chain(load_case("npcc"), COPIES))
    began = time.perf_counter()
    parts = partition(model, STUDY_AREA)
    threshold = couple(parts).per_unit(SIEMENS)
    family = reduce_external(parts, BalancedTruncation(tolerance=TOLERANCE), threshold)
    seconds = time.perf_counter() - began
    found = critical_clearing_times(model, FAULTS, t_end=T_END)
    faults = tuple(item.fault for item in found if isinstance(item.fault, BusFault))
    return Prepared(model, parts, faults, threshold, family, _small(family), seconds)


def _small(family: ReducedExternal) -> dict[Outputs, SmallModels]:
    return {outputs: SmallModels(replace(family, outputs=outputs)) for outputs in Outputs}


@dataclass(frozen=True)
class Known:
    """A reducer that hands out what has been reduced before."""

    reduction: Reduction

    def reduce(self, system: LinearSystem, reference: NDArray[np.float64]) -> Reduction:
        """The known reduction."""
        return self.reduction


@dataclass(frozen=True)
class Calibrated:
    """Thresholds of the system's own with the models they belong to."""

    found: Calibration
    family: ReducedExternal

    @property
    def angle_deg(self) -> float:
        """Angle of the partitioned version."""
        value = self.found.thresholds[ThresholdKind.PARTITIONED].value
        if value is None:
            raise SystemExit(f"no angle brings all errors below {self.found.limit_deg:g} degrees")
        return value


def own_thresholds(ready: Prepared) -> Calibrated:
    """Calibrate column norm and angle with polar outputs, in which a run costs a fraction."""
    found = calibrate(
        ready.parts,
        ready.faults,
        T_END,
        reducer=Known(ready.family.reduction),
        what=(ThresholdKind.COLUMN_NORM, ThresholdKind.PARTITIONED),
        outputs=Outputs.POLAR,
    )
    return Calibrated(found, replace(ready.family, kept=found.kept))


Choice = tuple[SmallModels, SwitchingRule]


def models(ready: Prepared, own: Calibrated) -> dict[str, Choice]:
    """Every model with the states of linear machines formed, as in the paper, and polar outputs."""
    chosen: dict[str, Choice] = {}
    calibrated = _small(own.family)
    for outputs in Outputs:
        rules = {
            "linear": SwitchingRule(float("inf")),
            "hybrid": SwitchingRule(0.0),
            "adaptive": SwitchingRule(ANGLE_DEG),
        }
        chosen |= {f"{n}, {outputs.value}": (ready.small[outputs], r) for n, r in rules.items()}
        rule = SwitchingRule(own.angle_deg)
        chosen[f"adaptive calibrated, {outputs.value}"] = calibrated[outputs], rule
    return chosen


def fault_rows(
    ready: Prepared, chosen: dict[str, Choice], fault: BusFault, store: ModelStore
) -> list[tuple[str, ...]]:
    """Errors, switches and times of every model for one fault; all share what has been built."""
    model, where = ready.model, f"bus {fault.bus}, {fault.duration:g} s"

    def run(small: SmallModels, rule: SwitchingRule) -> Trajectory:
        return simulate_adaptive(model, small, rule, (fault,), T_END, store=store).trajectory

    detailed = simulate(model, (fault,), T_END, store=store)
    if detailed.status is not Status.COMPLETED:
        return [(where, "detailed", detailed.status.value, "", "")]
    reduced = {name: run(*choice) for name, choice in chosen.items()}
    actions = {"detailed": lambda: simulate(model, (fault,), T_END, store=store)}
    actions |= {name: lambda choice=choice: run(*choice) for name, choice in chosen.items()}
    times = interleave(actions, 5)
    rows = [(where, "detailed", "", times.scaled("detailed", 1e-3), "")]
    for name, found in reduced.items():
        error = found.status.value
        if found.status is Status.COMPLETED:
            error = f"{compare(detailed, found, ready.parts.study_units).worst.rms_deg:.2f}"
        ratio = str(times.ratio(name, "detailed"))
        rows.append((where, name, error, times.scaled(name, 1e-3), ratio))
    return rows


def system_table(ready: Prepared, own: Calibrated) -> Table:
    """Size, thresholds and kept machines."""
    family = ready.family
    norm = own.found.column_norm
    facts = [
        ("machines", str(len(ready.model.machines))),
        ("machines of the study area", str(len(ready.parts.study_units))),
        ("external states", str(family.reduction.system.p)),
        ("order", str(family.reduction.order)),
        ("reference machine", str(family.reference_unit)),
        ("threshold of the column norm", f"{SIEMENS:g} S = {ready.threshold:g} p.u."),
        ("kept machines", ", ".join(map(str, family.kept))),
        ("angle", f"{ANGLE_DEG:g} degrees"),
        ("calibrated column norm", f"{family.coupling.siemens(norm):.3g} S = {norm:g} p.u."),
        ("kept machines, calibrated", ", ".join(map(str, own.found.kept))),
        ("calibrated angle", f"{own.angle_deg:g} degrees"),
        ("seconds off line", f"{ready.seconds:.1f}"),
        ("seconds of calibration", f"{own.found.seconds:.1f}"),
    ]
    return Table("The system:", ("", ""), facts)


def _told(found: Calibration) -> str:
    """What bound each threshold, and the runs it took."""
    parts = []
    for kind, threshold in found.thresholds.items():
        worst, binding = threshold.worst, threshold.binding
        text = f"{kind.value}: {threshold.runs} runs"
        if worst is not None:
            text += f", largest error {worst.rms_deg:.2f} degrees (machine {worst.unit})"
        if binding is not None:
            text += f", {binding.rms_deg:.2f} at the value before"
        parts.append(text)
    return f"Found: {'; '.join(parts)}."


def measure() -> Section:
    """Measure everything."""
    ready = prepare()
    own = own_thresholds(ready)
    store: ModelStore = {}
    chosen = models(ready, own)
    rows = [row for fault in ready.faults for row in fault_rows(ready, chosen, fault, store)]
    heads = ("fault", "model", "RMS error, degrees", "milliseconds, min / median", "/ detailed")
    tables = (
        system_table(ready, own),
        Table("16 s, error of the worst study-area machine:", heads, rows),
    )
    remarks = (
        f"The study area is New England of the second of {COPIES} copies. Each fault lasts for its "
        "critical clearing time on a grid of 0.01 s. Except in the lines *calibrated* thresholds "
        f"are those of NPCC; the bound of the reduction is {TOLERANCE:g}.",
        "Calibrated: column norm and angle of the partitioned version for these faults, errors below "
        f"{own.found.limit_deg:g} degrees, as `gridfold calibrate` finds them in steps of 0.1 p.u. "
        "and 1 degree; with polar outputs, to save time. " + _told(own.found),
    )
    return Section("A second case: NPCC in a chain", "second_case.py", tables, remarks)


if __name__ == "__main__":
    one_thread()
    print(measure(), machine(), sep="\n\n")
