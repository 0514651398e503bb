"""All that was reproduced as one value, and as a record for JSON.

A figure that was not asked for, or that does not exist, is null.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from gridfold.equivalents.calibrate import Calibration, Threshold
from gridfold.paper import published
from gridfold.paper.runs import OURS, BusRow, CaseStudy, Clearing, FaultErrors, SmallRun
from gridfold.paper.tables import (
    ADAPTIVE,
    ADAPTIVE_PRINTED,
    ConditionRow,
    Means,
    StateRow,
    Timing,
    Verdict,
    means,
)


@dataclass(frozen=True)
class SystemFacts:
    """Counts and thresholds of the partitioned system, named as in the JSON record."""

    generators: int
    external_generators: int
    external_states: int
    nonlinear_functions: int
    linearized_functions: int
    kept_generator_buses: tuple[int, ...]
    reference_generator_bus: int
    order: int
    hankel_bound: float | None
    column_norm_threshold: float
    angle_threshold_partitioned_deg: float | None
    angle_threshold_whole_deg: float | None
    nonlinear_functions_whole: int


#: The paper's own, as far as they are printed.
PUBLISHED_FACTS = {
    "generators": published.GENERATORS,
    "external_generators": published.EXTERNAL_GENERATORS,
    "external_states": published.EXTERNAL_STATES,
    "nonlinear_functions": published.NONLINEAR_FUNCTIONS,
    "linearized_functions": published.LINEARIZED_FUNCTIONS,
    "order": published.ORDER,
    "hankel_bound": published.HANKEL_BOUND,
    "column_norm_threshold": published.COLUMN_NORM,
    "angle_threshold_partitioned_deg": published.ANGLE_PARTITIONED_DEG,
    "angle_threshold_whole_deg": published.ANGLE_WHOLE_DEG,
    "nonlinear_functions_whole": published.NONLINEAR_FUNCTIONS_WHOLE,
}


def system_facts(study: CaseStudy) -> SystemFacts:
    """Count machines, states and functions; four functions a machine, as the paper counts."""
    parts, external = study.parts, study.external
    per_machine = published.FUNCTIONS_PER_GENERATOR
    outside, kept = len(parts.external_units), len(external.kept)
    machines = outside + len(parts.study_units)
    return SystemFacts(
        generators=machines,
        external_generators=outside,
        external_states=len(parts.states_of(parts.external_units)),
        nonlinear_functions=per_machine * outside,
        linearized_functions=per_machine * (outside - kept),
        kept_generator_buses=tuple(sorted({unit.bus for unit in external.kept})),
        reference_generator_bus=study.reference_unit.bus,
        order=external.reduction.order,
        hankel_bound=external.reduction.bound,
        column_norm_threshold=study.thresholds.column_norm,
        angle_threshold_partitioned_deg=study.thresholds.partitioned_deg,
        angle_threshold_whole_deg=study.thresholds.whole_deg,
        nonlinear_functions_whole=per_machine * machines,
    )


@dataclass(frozen=True)
class Reproduction:
    """What was reproduced; a part that was not asked for is None."""

    system: SystemFacts
    clearing: Clearing
    system_calibrated: SystemFacts | None = None
    table1: tuple[BusRow, ...] | None = None
    table2: tuple[StateRow, ...] | None = None
    table3: dict[str, Timing] | None = None
    table3_printed: dict[str, Timing] | None = None
    table4: tuple[ConditionRow, ...] | None = None
    verdicts: tuple[Verdict, ...] | None = None
    calibration: Calibration | None = None

    def record(self) -> dict[str, Any]:
        """All of it for JSON."""
        rows = self.table1
        return {
            "clearing": self.clearing.value,
            "system": _facts(self.system),
            "system_published": PUBLISHED_FACTS,
            "system_calibrated": _facts(self.system_calibrated),
            "calibration": None
            if self.calibration is None
            else {
                kind.value: _threshold(item) for kind, item in self.calibration.thresholds.items()
            },
            "table1": None if rows is None else [_row_1(row) for row in rows],
            "table1_summary": None if rows is None else _summary(rows),
            "table2": None if self.table2 is None else [_row_2(row) for row in self.table2],
            "table3": _timings(self.table3),
            "table3_printed": _timings(self.table3_printed),
            "table4": None if self.table4 is None else [_row_4(row) for row in self.table4],
            "verdicts": None if self.verdicts is None else [asdict(item) for item in self.verdicts],
        }


def _facts(facts: SystemFacts | None) -> dict[str, Any] | None:
    return None if facts is None else asdict(facts)


def _threshold(item: Threshold) -> dict[str, Any]:
    binding = item.binding
    return {
        "value": item.value,
        "largest_error_deg": None if item.worst is None else item.worst.rms_deg,
        "binding_bus": None if binding is None else getattr(binding.contingency[0], "bus", None),
        "binding_generator": None if binding is None else str(binding.unit),
        "runs": item.runs,
        "seconds": item.seconds,
    }


def _worst(errors: FaultErrors | None, kinds: tuple[SmallRun, ...]) -> dict[str, float | None]:
    return {kind.value: None if errors is None else errors.worst_deg(kind) for kind in kinds}


def _row_1(row: BusRow) -> dict[str, Any]:
    paper = published.TABLE_1.get(row.bus)
    unit = row.errors.worst_unit(SmallRun.LINEAR)
    return {
        "bus": row.bus,
        "generator": None if unit is None else str(unit),
        "paper_generator": None if paper is None else paper.generator,
        "cct_s": row.cct,
        "margin_ms": row.margin_ms,
        "paper_cct_s": None if paper is None else paper.cct,
        "lost_synchronism": list(row.errors.lost_synchronism),
        "rmse_deg": _worst(row.errors, tuple(SmallRun)),
        "rmse_deg_calibrated": {
            kind.column: None if row.calibrated is None else row.calibrated.worst_deg(kind)
            for kind in ADAPTIVE_PRINTED
        },
        "paper_rmse_deg": None if paper is None else paper.errors._asdict(),
    }


def _summary(rows: tuple[BusRow, ...]) -> dict[str, Any]:
    def text(item: Means | None) -> dict[str, Any] | None:
        return None if item is None else asdict(item)

    return {
        "rmse_deg": {kind.value: text(means(rows, kind)) for kind in SmallRun},
        "rmse_deg_calibrated": {
            kind.column: text(means(rows, kind, calibrated=True)) for kind in ADAPTIVE_PRINTED
        },
        "paper_mean_rmse_deg": paper_means()._asdict(),
    }


def paper_means() -> published.Errors:
    """Means of the errors in the paper's Table I."""
    columns = zip(*(row.errors for row in published.TABLE_1.values()), strict=True)
    return published.Errors(*(sum(column) / len(column) for column in columns))


def _row_2(row: StateRow) -> dict[str, Any]:
    return {
        "state": row.published.state,
        "unit": row.published.unit,
        "generator": str(row.unit),
        **{kind.value: row.errors.get(kind) for kind in OURS},
        "paper": row.published.errors._asdict(),
    }


def _timings(columns: dict[str, Timing] | None) -> dict[str, Any] | None:
    return None if columns is None else {name: _timing(item) for name, item in columns.items()}


def _timing(item: Timing) -> dict[str, Any]:
    paper = item.published._asdict()
    return {
        "bus": item.bus,
        "clearing_s": item.clearing,
        "seconds": item.seconds,
        "ratios": item.ratios,
        "paper": {
            "seconds": paper,
            "ratios": {name: value / item.published.detailed for name, value in paper.items()},
        },
    }


def _row_4(row: ConditionRow) -> dict[str, Any]:
    return {
        "fault": row.published.fault,
        "clearing_s": row.errors.clearing,
        "own_clearing_time": row.own_clearing,
        "lost_synchronism": list(row.errors.lost_synchronism),
        **_worst(row.errors, ADAPTIVE),
        "paper": {kind.value: getattr(row.published, kind.value) for kind in ADAPTIVE},
    }
