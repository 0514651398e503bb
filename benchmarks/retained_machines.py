"""Which machines to retain in folded models of NPCC: by score or by column norm."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from report import Goal, Section, Table, machine, one_thread, write

from gridfold import (
    BusFault,
    Partition,
    SmallModels,
    Status,
    SwitchingRule,
    Trajectory,
    UnitKey,
    build_model,
    compare,
    critical_clearing_times,
    load_case,
    partition,
    simulate,
    simulate_adaptive,
)
from gridfold.equivalents.area_bases import PORT_TOLERANCE
from gridfold.equivalents.folded import fold
from gridfold.equivalents.ranking import Ranking, rank_retained
from gridfold.equivalents.swings import FAULT_SECONDS
from gridfold.runs.simulate import ModelStore

T_END = 16.0
STUDY_AREA = range(1, 37)
CASES = ("npcc", "npcc-pst")
COUNTS = (3, 5, 8)
NORM, SCORE = "column norm", "score: norm x power defect"
#: The folded model in use at all times but during faults, and its limits told alone.
RULE = SwitchingRule(0.0, limits=False)


@dataclass(frozen=True)
class Setting:
    """A partitioned system, its faults at their clearing times, and their detailed runs."""

    name: str
    parts: Partition
    faults: Sequence[BusFault]
    detailed: Sequence[Trajectory]
    store: ModelStore


@dataclass(frozen=True)
class Found:
    """A folded model: what was retained, ports, order, and the error after each fault.

    Errors in degrees, of the worst study-area machine; NaN for a run that did not reach the end.
    """

    retained: tuple[UnitKey, ...]
    ports: int
    order: int
    errors: NDArray[np.float64]

    @property
    def mean(self) -> float:
        """Mean error in degrees; NaN as soon as one run was lost."""
        return float(self.errors.mean())


def prepare(name: str) -> Setting:
    """Find the clearing times and simulate the detailed model."""
    model = build_model(load_case(name))
    store: ModelStore = {}
    found = critical_clearing_times(model, [BusFault(bus) for bus in STUDY_AREA], t_end=T_END)
    faults = [BusFault(c.fault.bus, duration=c.seconds) for c in found]  # type: ignore[union-attr]
    detailed = [simulate(model, [fault], T_END, store=store) for fault in faults]
    return Setting(name, partition(model, STUDY_AREA), faults, detailed, store)


def measure_model(setting: Setting, retained: Sequence[UnitKey]) -> Found:
    """Errors of the folded model that retains these machines."""
    family, errors = fold(setting.parts, retained), []
    small = SmallModels(family)
    for fault, detailed in zip(setting.faults, setting.detailed, strict=True):
        run = simulate_adaptive(
            setting.parts.model, small, RULE, [fault], T_END, store=setting.store
        ).trajectory
        complete = run.status is Status.COMPLETED
        worst = compare(detailed, run, setting.parts.study_units).worst if complete else None
        errors.append(np.nan if worst is None else worst.rms_deg)
    return Found(tuple(retained), len(family.ports.buses), family.bases.order, np.array(errors))


def orders(parts: Partition, ranking: Ranking) -> dict[str, tuple[UnitKey, ...]]:
    """Orders in which to retain the machines, by what they follow; the score comes last."""
    rotors = tuple(unit for unit in ranking.units if unit in set(parts.model.machines))
    inertia = dict(zip(rotors, parts.model.inertia(rotors), strict=True))
    per_inertia = np.array([1 / inertia.get(unit, np.inf) for unit in ranking.units])

    def falling(values: NDArray[np.float64]) -> tuple[UnitKey, ...]:
        return tuple(ranking.units[k] for k in np.argsort(-values, kind="stable"))

    return {
        NORM: falling(ranking.norms),
        "power defect": falling(ranking.power_defects),
        "norm x acceleration defect": falling(ranking.scores * per_inertia),
        SCORE: ranking.units,
    }


def error_table(setting: Setting, ranking: Ranking) -> tuple[Table, list[Goal]]:
    """Errors by number of machines and order of retaining; the goals are those of the column norm."""
    rows, goals = [_row("-", measure_model(setting, ()))], []
    known: dict[frozenset[UnitKey], Found] = {}
    for n in COUNTS:
        means = {}
        for by, units in orders(setting.parts, ranking).items():
            chosen = frozenset(units[:n])
            if chosen not in known:
                known[chosen] = measure_model(setting, units[:n])
            rows.append(_row(by, known[chosen]))
            means[by] = known[chosen].mean
        figure = f"{setting.name}: mean error with the {n} machines of largest score, degrees"
        goals.append(Goal(figure, means[SCORE], means[NORM], 3))
    heads = ("retained", "by", "ports", "order", "mean", "median", "largest", "lost")
    return Table(f"{setting.name}: error in degrees after the 36 faults.", heads, rows), goals


def _row(by: str, found: Found) -> tuple[str, ...]:
    lost = int(np.isnan(found.errors).sum())
    figures = (np.nanmean, np.nanmedian, np.nanmax)
    return (
        str(len(found.retained)), by, str(found.ports), str(found.order),
        *(f"{figure(found.errors):.3f}" for figure in figures), str(lost),
    )  # fmt: skip


def score_table(setting: Setting, ranking: Ranking) -> Table:
    """The machines of the highest scores."""
    near = orders(setting.parts, ranking)[NORM]
    columns = zip(ranking.units, ranking.scores, ranking.power_defects, ranking.norms, strict=True)
    rows = [
        (str(unit), f"{score:.3f}", f"{power:.3f}", f"{norm:.3f}", str(near.index(unit) + 1))
        for unit, score, power, norm in list(columns)[: max(COUNTS)]
    ]
    heads = ("machine", "score", "power defect, p.u.", "column norm, p.u.", "place by norm")
    return Table(f"{setting.name}: the {max(COUNTS)} machines of largest score.", heads, rows)


def measure() -> Section:
    """Run everything."""
    tables: list[Table] = []
    goals: list[Goal] = []
    for name in CASES:
        setting = prepare(name)
        ranking = rank_retained(setting.parts)
        errors, reached = error_table(setting, ranking)
        tables += [errors, score_table(setting, ranking)]
        goals += reached
    remarks = (
        f"Faults at the 36 buses of the study area, cleared at the critical clearing time of each on "
        f"a grid of 0.01 s; runs of {T_END:g} s. The error is (19) of the worst study-area machine. "
        f"The folded model is in use at all times but during the fault; its linear part is reduced to "
        f"the bound {PORT_TOLERANCE:g} p.u.",
        f"The score is the column norm times the root mean square of the power that the linearized "
        f"system misses at a machine's rotor, along swings of 3 s after faults of at most "
        f"{FAULT_SECONDS:g} s at the boundary buses. None of these swings is among those after which "
        f"errors are measured. The goals are the mean errors with as many machines of largest "
        f"column norm.",
        "*Power defect* leaves the column norm out of the score; *norm x acceleration defect* takes "
        "the missing acceleration, which is large for small machines, for the missing power.",
    )
    title = "Machines to retain in folded models"
    return Section(title, "retained_machines.py", tuple(tables), remarks, tuple(goals))


def main() -> Section:
    """Measure, and write the page."""
    section = measure()
    write("retained_machines.md", "# Retained machines", section, machine())
    return section


if __name__ == "__main__":
    one_thread()
    print(main(), machine(), sep="\n\n")
