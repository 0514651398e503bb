"""Tables I to IV of Osipov & Sun from our runs, and the claims of their text checked on them."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import pi
from statistics import median

import numpy as np

from gridfold.grid.case import UnitKey
from gridfold.grid.events import BranchFault, BusFault
from gridfold.paper import published
from gridfold.paper.runs import (
    OURS,
    PRINTED,
    BusRow,
    CaseStudy,
    Clearing,
    FaultErrors,
    SmallRun,
    fault_errors,
)
from gridfold.runs.clearing import Fault, critical_clearing_time
from gridfold.systems.status import Status

#: Times that each run of Table III is repeated.
REPETITIONS = 15
ADAPTIVE, ADAPTIVE_PRINTED = OURS[1:], PRINTED[1:]
DETAILED = "detailed"


@dataclass(frozen=True)
class Means:
    """Mean and largest of the rotor-angle errors of Table I, in degrees, and over how many rows."""

    mean: float
    largest: float
    largest_bus: int
    rows: int


def means(rows: Sequence[BusRow], kind: SmallRun, calibrated: bool = False) -> Means | None:
    """Mean and largest error of a run; rows without an error of it are left out."""
    found: dict[int, float] = {}
    for row in rows:
        errors = row.calibrated if calibrated else row.errors
        worst = None if errors is None else errors.worst_deg(kind)
        if worst is not None:
            found[row.bus] = worst
    if not found:
        return None
    bus = max(found, key=found.__getitem__)
    return Means(sum(found.values()) / len(found), found[bus], bus, len(found))


@dataclass(frozen=True)
class StateRow:
    """A row of Table II: root mean square error of one state by run, beside the paper's."""

    unit: UnitKey
    published: published.StateErrors
    errors: dict[SmallRun, float]

    def reduction_percent(self, kind: SmallRun) -> float | None:
        """By how much the error is below the linear run's, in percent."""
        linear = self.errors.get(SmallRun.LINEAR)
        if not linear or kind not in self.errors:
            return None
        return 100 * (1 - self.errors[kind] / linear)


def table_2(errors: FaultErrors) -> list[StateRow]:
    """Errors of all states of the worst machine at bus 23, from the runs after the bus-3 fault."""
    linear = errors.comparisons.get(SmallRun.LINEAR)
    if linear is None:
        return []
    at_bus = [item for item in linear.units if item.unit.bus == published.TABLE_2_BUS]
    unit = max(at_bus, key=lambda item: item.rms_deg).unit
    return [
        StateRow(
            unit,
            row,
            {
                kind: found.state_rms[f"{row.state}:{unit}"]
                for kind, found in errors.comparisons.items()
            },
        )
        for row in published.TABLE_2
    ]


@dataclass(frozen=True)
class Timing:
    """A column of Table III: median CPU seconds of a run by model, and their ratios to the detailed."""

    bus: int
    clearing: float
    seconds: dict[str, float]
    published: published.Times

    @property
    def ratios(self) -> dict[str, float]:
        """Seconds over those of the detailed run."""
        return {name: value / self.seconds[DETAILED] for name, value in self.seconds.items()}


def table_3(
    study: CaseStudy,
    clearing: Clearing = Clearing.OWN,
    repetitions: int = REPETITIONS,
    kinds: Sequence[SmallRun] = OURS,
) -> dict[str, Timing]:
    """Time the runs after the large and the small disturbance, all of them interleaved.

    Times and their ratios are named by the columns of the paper's table.

    Networks and reduced models are built before; integration, switching and the log are timed, the
    lifting of the states for output is not. The times are CPU seconds of the process, all its threads
    together, so that other work on the machine counts little.
    """
    buses = {
        "large": published.LARGE_DISTURBANCE_BUS,
        "small": published.SMALL_DISTURBANCE_BUS,
    }
    faults = {name: _cleared(study, BusFault(bus), clearing) for name, bus in buses.items()}
    calls: dict[tuple[str, str], Callable[[], object]] = {}
    for name, fault in faults.items():
        calls[name, DETAILED] = partial(study.detailed, (fault,))
        for kind in kinds:
            calls[name, kind.column] = partial(study.run, kind, (fault,))
    for call in calls.values():
        call()
    spent: dict[tuple[str, str], list[float]] = {key: [] for key in calls}
    order, rng = list(calls), np.random.default_rng(0)
    for _ in range(repetitions):
        rng.shuffle(order)  # what a run leaves in the memory costs the next one
        for key in order:
            began = time.process_time()
            calls[key]()
            spent[key].append(time.process_time() - began)
    return {
        name: Timing(
            fault.bus,
            fault.duration,
            {run: median(values) for (where, run), values in spent.items() if where == name},
            published.TABLE_3[name],
        )
        for name, fault in faults.items()
    }


def _cleared(study: CaseStudy, fault: BusFault, clearing: Clearing) -> BusFault:
    if clearing is Clearing.PAPER:
        return replace(fault, duration=published.TABLE_1[fault.bus].cct)
    found = critical_clearing_time(study.model, fault, t_end=published.T_END)
    return replace(fault, duration=found.seconds)


@dataclass(frozen=True)
class ConditionRow:
    """A row of Table IV: a fault, how it was cleared, and its errors.

    `own_clearing` tells that the detailed run loses synchronism when cleared at the critical clearing
    time of the temporary fault, so that the contingency's own was taken.
    """

    published: published.Table4Row
    errors: FaultErrors
    own_clearing: bool


def table_4(study: CaseStudy, clearing: Clearing = Clearing.OWN) -> list[ConditionRow]:
    """Faults at bus 3 that lead to a new operating condition, and the temporary one."""
    bus = published.LARGE_DISTURBANCE_BUS
    temporary = _cleared(study, BusFault(bus), clearing)
    faults: tuple[Fault, ...] = (
        temporary,
        BranchFault("3-2"),
        BranchFault("3-4"),
        BusFault(bus, trip_bus=True),
    )
    rows = []
    for row, fault in zip(published.TABLE_4, faults, strict=True):
        cleared = replace(fault, duration=temporary.duration)
        own = study.detailed([cleared]).status is not Status.COMPLETED and fault is not temporary
        if own:
            cleared = critical_clearing_time(study.model, fault, t_end=published.T_END).fault
        errors = fault_errors(study, [cleared], cleared.duration, ADAPTIVE)
        rows.append(ConditionRow(row, errors, own))
    return rows


@dataclass(frozen=True)
class Verdict:
    """A claim of the paper, whether it holds in our data, and what was found."""

    claim: str
    holds: bool
    found: str


def verdicts(rows: Sequence[BusRow]) -> list[Verdict]:
    """Check the claims of the paper's section III.A on the rows of Table I."""
    complete = [row for row in rows if row.errors.status is Status.COMPLETED]
    result = [] if not complete else [_largest_state(complete, unit) for unit in ("deg", "rad")]
    wanted = published.LARGE_DISTURBANCE_BUS
    for row in complete:
        if row.bus == wanted:
            result += [
                _worst_machine(row.errors, kind)
                for kind in PRINTED
                if kind in row.errors.comparisons
            ]
    if any(row.bus == wanted for row in complete) and len(complete) > 1:
        result += [_largest_disturbance(complete)]
        result += [_largest_error(complete, kind) for kind in PRINTED]
    return result


def _largest_state(rows: Sequence[BusRow], angle_unit: str) -> Verdict:
    """Whether the rotor angle's error is the largest of all states, numbers taken as printed."""
    scale = {"deg": 1.0, "rad": pi / 180}[angle_unit]
    total, broken = 0, []
    for row in rows:
        comparisons = row.errors.comparisons
        for kind, comparison in ((k, comparisons[k]) for k in PRINTED if k in comparisons):
            for item in comparison.units:
                total += 1
                angle = scale * comparison.state_rms[f"rotor_angle:{item.unit}"]
                name, value = max(
                    (
                        (key.split(":")[0], error)
                        for key, error in comparison.state_rms.items()
                        if key.endswith(f":{item.unit}") and not key.startswith("rotor_angle:")
                    ),
                    key=lambda pair: pair[1],
                )
                if value >= angle:
                    broken.append(f"{name} of {item.unit}, bus {row.bus}, {kind.value}")
    words = {"deg": "degrees and p.u., as in Table II", "rad": "rad and p.u."}[angle_unit]
    found = f"{total - len(broken)} of {total} machines and runs"
    found += f"; first exception: {broken[0]}" if broken else ""
    claim = f"the rotor angle has the largest error of all states (numbers in {words})"
    return Verdict(claim, not broken, found)


def _worst_machine(errors: FaultErrors, kind: SmallRun) -> Verdict:
    worst = errors.comparisons[kind].worst
    claim = f"bus 23's machine is worst after the bus-3 fault ({kind.value})"
    holds = worst.unit.bus == published.TABLE_2_BUS
    return Verdict(claim, holds, f"{worst.unit} with {worst.rms_deg:.2f} degrees")


def _largest_disturbance(rows: Sequence[BusRow]) -> Verdict:
    size = {row.bus: row.errors.largest_deviation_deg for row in rows}
    bus = max(size, key=size.__getitem__)
    here = published.LARGE_DISTURBANCE_BUS
    claim = "the bus-3 fault is the largest disturbance (largest angle deviation, detailed run)"
    found = f"bus {bus} with {size[bus]:.1f} degrees; bus {here}: {size[here]:.1f}"
    return Verdict(claim, bus == here, found)


def _largest_error(rows: Sequence[BusRow], kind: SmallRun) -> Verdict:
    claim = f"the bus-3 fault has the largest rotor-angle error ({kind.value})"
    found = means(rows, kind)
    if found is None:
        return Verdict(claim, False, "no run of it kept synchronism")
    text = f"bus {found.largest_bus} with {found.largest:.2f} degrees"
    return Verdict(claim, found.largest_bus == published.LARGE_DISTURBANCE_BUS, text)
