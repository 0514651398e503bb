"""Curves of a contingency for the report: rotor angles of the study area and of what decided."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gridfold.equivalents.adaptive import Switch
from gridfold.grid.case import UnitKey
from gridfold.runs.criteria import Finding
from gridfold.runs.trajectory import AngleReference, Trajectory
from gridfold.study.deciding import deciding_curves, deciding_units

#: Samples of a curve in the report.
POINTS = 200


def run_curves(
    run: Trajectory,
    beside: Mapping[str, Trajectory],
    switches: Sequence[Switch],
    findings: Sequence[Finding],
    inside: Sequence[UnitKey],
    critical: str | None,
) -> dict[str, NDArray[Any]]:
    """Curves of a run, with those of other runs of the same contingency.

    Parameters
    ----------
    run : Trajectory
        The run.
    beside : mapping
        ``detailed`` and ``linear``, where the run is checked.
    switches : sequence of Switch
        Changes of its model.
    findings : sequence of Finding
        What criteria say of it.
    inside : sequence of UnitKey
        Machines of the study area. Those that decided are drawn too, wherever they are.
    critical : str or None
        ``BUS:ID`` of the critical machine.
    """
    runs = {"run": run} | dict(beside)
    decided = deciding_units(runs.values(), [critical] if critical else [], findings)
    further = [unit for unit in decided if unit not in inside]
    curves = deciding_curves(run, findings, sampled_rows(run))
    for name, each in runs.items():
        curves |= _angles(each, name, [*inside, *further])
    if "detailed" in beside and len(beside["detailed"].times) == len(run.times):
        curves |= _largest_error(run, beside["detailed"], inside)
    return curves | {
        "units": np.array([str(unit) for unit in (*inside, *further)]),
        "units_outside": np.array([str(unit) for unit in further], dtype=np.str_),
        "switch_times": np.array([switch.time for switch in switches]),
        "switch_models": np.array([switch.after.value for switch in switches], dtype=np.str_),
        "switch_reasons": np.array([switch.reason for switch in switches], dtype=np.str_),
    }


def sampled_rows(run: Trajectory) -> NDArray[np.int64]:
    """Rows of at most :data:`POINTS` samples, the first and the last among them."""
    last = len(run.times) - 1
    return np.unique(np.linspace(0, last, min(POINTS, last + 1)).round().astype(np.int64))


def _angles(run: Trajectory, name: str, units: Sequence[UnitKey]) -> dict[str, NDArray[Any]]:
    """Rotor angles in degrees against the centre of inertia."""
    rows = sampled_rows(run)
    angles = run.rotor_angle_deg(units, AngleReference.CENTRE_OF_INERTIA)
    return {
        f"{name}_times": run.times[rows].astype(np.float32),
        f"{name}_angles": angles[rows].astype(np.float32),
    }


def _largest_error(
    run: Trajectory, detailed: Trajectory, units: Sequence[UnitKey]
) -> dict[str, NDArray[Any]]:
    """Largest error of a rotor angle in degrees along a run, of the units in service at its end."""
    there = [unit for unit in units if unit not in detailed.models[-1].state.units_out]
    if not there:
        return {}
    apart = run.rotor_angle_deg(there) - detailed.rotor_angle_deg(there)
    rows = sampled_rows(run)
    return {"error": np.nanmax(np.abs(apart[rows]), axis=1).astype(np.float32)}
