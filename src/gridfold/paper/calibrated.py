"""Table I with thresholds of our own calibration beside those of the paper."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

from gridfold.equivalents.calibrate import Calibration, ThresholdKind, calibrate
from gridfold.equivalents.contingency_errors import Progress
from gridfold.grid.events import BusFault
from gridfold.paper import published
from gridfold.paper.runs import BusRow, CaseStudy, Thresholds, fault_errors
from gridfold.paper.tables import ADAPTIVE_PRINTED


def calibrate_study(
    study: CaseStudy,
    rows: Sequence[BusRow],
    on_progress: Callable[[Progress], None] | None = None,
    workers: int | None = None,
) -> Calibration:
    """Calibrate the thresholds as the paper does: all faults at their critical clearing times."""
    return calibrate(
        study.parts,
        [BusFault(row.bus, duration=row.cct) for row in rows if row.cct > 0],
        t_end=published.T_END,
        reducer=study.external.reducer,
        limit_deg=published.LARGEST_ERROR_DEG,
        workers=workers,
        on_progress=on_progress,
    )


def calibrated_study(study: CaseStudy, calibration: Calibration) -> CaseStudy:
    """The study with calibrated thresholds; an angle is None if none satisfied."""
    partitioned = calibration.thresholds[ThresholdKind.PARTITIONED].value
    whole = calibration.thresholds[ThresholdKind.WHOLE].value
    return study.with_thresholds(Thresholds(calibration.column_norm, partitioned, whole))


def calibrated_rows(
    calibrated: CaseStudy, rows: Sequence[BusRow], workers: int | None = None
) -> list[BusRow]:
    """The rows with the adaptive errors that the calibrated thresholds give, on all cores.

    A version without a threshold is left out.
    """
    angles = (calibrated.thresholds.partitioned_deg, calibrated.thresholds.whole_deg)
    kinds = [
        kind for kind, angle in zip(ADAPTIVE_PRINTED, angles, strict=True) if angle is not None
    ]

    def add(row: BusRow) -> BusRow:
        found = fault_errors(calibrated, row.errors.events, row.errors.clearing, kinds)
        return replace(row, calibrated=found)

    with ThreadPoolExecutor(workers or os.cpu_count()) as pool:
        return list(pool.map(add, rows))
