"""Curves of what decided a contingency: they show what its verdicts say."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gridfold.grid.case import UnitKey
from gridfold.grid.criteria import FrequencyBand, VoltageDip, VoltageRecovery
from gridfold.runs.criteria import Finding
from gridfold.runs.island_figures import island_frequencies
from gridfold.runs.trajectory import Trajectory
from gridfold.systems.status import Status

#: Curves that are kept of each contingency.
KEPT = 8


def deciding_units(
    runs: Iterable[Trajectory], critical: Iterable[str], findings: Sequence[Finding]
) -> list[UnitKey]:
    """Machines whose angles decided: those that were lost, the critical ones, those of criteria."""
    names = dict.fromkeys(critical)
    machines: dict[str, UnitKey] = {}
    for run in runs:
        machines |= {str(unit): unit for unit in run.model.machines}
        if run.status in (Status.LOST_SYNCHRONISM, Status.OFF_SPEED) and run.culprit is not None:
            names[run.culprit.partition(":")[2]] = None
    for finding in findings:
        for signal in filter(None, finding.signal.split(",")):
            kind, _, unit = signal.partition(":")
            if kind == "angle_coi_deg":
                names[unit] = None
    return [machines[name] for name in names if name in machines]


def deciding_curves(
    run: Trajectory, findings: Sequence[Finding], rows: NDArray[np.int64]
) -> dict[str, NDArray[Any]]:
    """Speeds, voltages and frequencies that decided, at some `rows` of a run and when they did.

    Returns
    -------
    dict
        ``decided_names`` (m,), ``decided_values`` (m, n_rows), ``decided_times`` (n_rows,) in s;
        ``limit_names`` (k,) and ``limit_values`` (k,): what they are held against, by the first word of
        the names. Empty where nothing but rotor angles decided.
    """
    curves: dict[str, NDArray[np.float64]] = {}
    limits: dict[tuple[str, float], None] = {}
    if run.status is Status.OFF_SPEED and run.culprit is not None:
        unit = run.culprit.partition(":")[2]
        curves[f"speed_pu:{unit}"] = run.signal("speed", [unit])[:, 0]
        if run.criterion is not None:
            limit = run.criterion.speed_limit
            limits |= {("speed_pu", 1 - limit): None, ("speed_pu", 1 + limit): None}
    for finding in findings:
        curves |= _curves_of(run, finding)
        limits |= dict.fromkeys(_limits_of(run, finding))
    if not curves:
        return {}
    names = list(curves)[:KEPT]
    rows = _with_instants(run, rows, [f.at for f in findings if f.at is not None])
    return {
        "decided_names": np.array(names),
        "decided_values": np.stack([curves[name][rows] for name in names]).astype(np.float32),
        "decided_times": run.times[rows].astype(np.float32),
        "limit_names": np.array([kind for kind, _ in limits], dtype=np.str_),
        "limit_values": np.array([value for _, value in limits], dtype=float),
    }


def _curves_of(run: Trajectory, finding: Finding) -> dict[str, NDArray[np.float64]]:
    kind, _, place = finding.signal.partition(":")
    if kind == "voltage_pu":
        return {finding.signal: np.abs(run.bus_voltage([int(place)])[:, 0])}
    if kind == "frequency_hz":
        low, high = _frequencies(run)
        return {"island_hz:lowest": low, "island_hz:highest": high}
    return {}


def _limits_of(run: Trajectory, finding: Finding) -> list[tuple[str, float]]:
    """What is drawn as limits of a criterion, by kind of curve."""
    criterion = finding.criterion
    if isinstance(criterion, FrequencyBand):
        ends = (criterion.lowest_hz, criterion.highest_hz)
        return [("island_hz", float(end)) for end in ends if end is not None]
    if isinstance(criterion, VoltageDip | VoltageRecovery) and finding.signal:
        level = criterion.level
        if criterion.of_initial:
            bus = run.model.case.bus_index[int(finding.signal.partition(":")[2])]
            level *= float(abs(run.models[0].power_flow.voltage[bus]))
        return [("voltage_pu", level)]
    return []


def _frequencies(run: Trajectory) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Lowest and highest frequency of all islands in Hz along a run, each (n_times,)."""
    low, high = np.full(len(run.times), np.nan), np.full(len(run.times), np.nan)
    for (rows, _), part in zip(run.stages, run.parts, strict=True):
        here = island_frequencies(part)
        if here.size:
            low[rows], high[rows] = here.min(axis=1), here.max(axis=1)
    return low, high


def _with_instants(
    run: Trajectory, rows: NDArray[np.int64], instants: Sequence[float]
) -> NDArray[np.int64]:
    """Rows with those at and around some instants."""
    at = np.searchsorted(run.times, np.array(instants) - 1e-9)
    around = np.concatenate([at - 1, at, at + 1]).astype(np.int64)
    return np.union1d(rows, around[(around >= 0) & (around < len(run.times))])
