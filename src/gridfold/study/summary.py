"""The figures of one contingency, a row of the study's table."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from itertools import repeat
from typing import Any, get_args, get_type_hints

import numpy as np

from gridfold.equivalents.families import Mode
from gridfold.grid.case import UnitKey
from gridfold.numerics.rows import widest_row
from gridfold.runs.dominant_swing import dominant_swing
from gridfold.runs.extremes import Extreme
from gridfold.runs.island_figures import FrequencyRange
from gridfold.runs.summary import summarize
from gridfold.runs.synchronism import angle_frame
from gridfold.runs.trajectory import AngleReference, Trajectory
from gridfold.systems.status import Status

#: Columns that tell times of the machine; all others are the same whatever ran the study.
WALL = "wall_"
_DARK = "no machine is left; everything is de-energized"


@dataclass(frozen=True, kw_only=True)
class Figures:
    """What an engineer asks for first. What does not apply is missing.

    Parameters
    ----------
    status : str
        ``completed``, ``lost synchronism``, ``off speed``, ``not finite`` or ``failed``.
    stable : bool
        Completed, with something energized at the end; missing if nothing can be said.
    ended_at : float
        End of the run in seconds; where it was lost, when.
    reason : str
        What ended it early.
    critical_machine : str
        ``BUS:ID`` of the machine that lost synchronism or was off speed, else of the one whose angle
        went furthest from where it was at the start.
    largest_angle_deg : float
        Its angle from the centre of inertia of its island where that is largest, in degrees.
    largest_angle_change_deg : float
        How far this angle went from where it was at the start, in degrees.
    largest_separation_deg, separation_at : float
        Largest difference of two rotor angles in one island, in degrees, and when (s).
    lowest_voltage, highest_voltage : float
        In p.u., of energized buses after the last event; with bus and time (s).
    nadir_hz, nadir_at : float
        Lowest frequency of the centre of inertia of any island, and when (s); of a run that ended
        early nothing is told, since it ended before the nadir.
    highest_hz : float
        Highest frequency of the same.
    islands : int
        Parts of the network that have a machine, at the end of the run.
    islanded_mw : float
        Generation before the disturbance of the units outside the island with the most buses, MW.
    lost_load_mw : float
        Load before the disturbance at the buses that are de-energized at the end, MW.
    swing_hz, damping_ratio : float
        Of the dominant swing of the critical machine after the last event.
    critical_clearing_time, margin : float
        In seconds; the margin is what it exceeds the fault's duration by. A clearing time beyond the
        longest tried is given as that, with `clearing_time_bounded` false.
    violations : int
        How many of the study's criteria the run violates; missing without criteria.
    violated, not_judged : str
        Names of the study's criteria that the run violates, and of those that it leaves open because it
        ended too early; by semicolons, empty if there are none, missing without criteria.
    close : str
        Names of criteria whose verdict the estimated error of the reduced model could turn.
    least_margin : float
        The smallest margin of a criterion as a part of its limit; negative if one is violated.
    criteria : str
        All of them with value, margin, place and time, a JSON list.
    checked : str
        How the detailed run of the same contingency ended; missing if there was none.
    checked_violated : str
        Names of the criteria that it violates.
    error_rms_deg, error_coi_deg, error_largest_deg : float
        Errors of rotor angles of the study area against it: equation (19) of Osipov & Sun for the
        worst machine (`error_machine`), the same of angles against the centre of inertia, and the
        largest at any time.
    error_damping_ratio, error_nadir_hz, error_lowest_voltage : float
        What damping of the dominant swing, lowest frequency (Hz) and lowest voltage (p.u.) are too high
        against the detailed run.
    error_estimate_deg : float
        Estimate of `error_coi_deg`, where the study has a tolerance; 0 for a detailed run.
    error_truncation_deg, error_linearization_deg, error_jump_deg : float
        What of the estimate each cause makes alone; they need not add up.
    detailed_s, retained_s, hybrid_s, linear_s, linear_whole_s : float
        Simulated seconds for which each model was in use.
    switches, steps : int
        Changes of model, time steps.
    wall_detailed_s, wall_retained_s, wall_hybrid_s, wall_linear_s, wall_linear_whole_s : float
        Seconds on the machine that integration took with each model.
    wall_reduction_s, wall_run_s, wall_check_s, wall_s : float
        Seconds on the machine: of building reduced models, of the run with them, of the same run on
        the detailed model, of all.
    notices : str
        What else the reader should know, a JSON list of times (s) and texts.
    """

    status: str
    stable: bool | None = None
    ended_at: float | None = None
    reason: str | None = None
    critical_machine: str | None = None
    largest_angle_deg: float | None = None
    largest_angle_change_deg: float | None = None
    largest_separation_deg: float | None = None
    separation_at: float | None = None
    lowest_voltage: float | None = None
    lowest_voltage_bus: int | None = None
    lowest_voltage_at: float | None = None
    highest_voltage: float | None = None
    highest_voltage_bus: int | None = None
    highest_voltage_at: float | None = None
    nadir_hz: float | None = None
    nadir_at: float | None = None
    highest_hz: float | None = None
    islands: int | None = None
    islanded_mw: float | None = None
    lost_load_mw: float | None = None
    swing_hz: float | None = None
    damping_ratio: float | None = None
    critical_clearing_time: float | None = None
    clearing_time_bounded: bool | None = None
    margin: float | None = None
    violations: int | None = None
    violated: str | None = None
    not_judged: str | None = None
    close: str | None = None
    least_margin: float | None = None
    criteria: str | None = None
    checked: str | None = None
    checked_violated: str | None = None
    error_rms_deg: float | None = None
    error_coi_deg: float | None = None
    error_largest_deg: float | None = None
    error_machine: str | None = None
    error_damping_ratio: float | None = None
    error_nadir_hz: float | None = None
    error_lowest_voltage: float | None = None
    error_estimate_deg: float | None = None
    error_truncation_deg: float | None = None
    error_linearization_deg: float | None = None
    error_jump_deg: float | None = None
    detailed_s: float | None = None
    retained_s: float | None = None
    hybrid_s: float | None = None
    linear_s: float | None = None
    linear_whole_s: float | None = None
    switches: int | None = None
    steps: int | None = None
    wall_detailed_s: float | None = None
    wall_retained_s: float | None = None
    wall_hybrid_s: float | None = None
    wall_linear_s: float | None = None
    wall_linear_whole_s: float | None = None
    wall_reduction_s: float | None = None
    wall_run_s: float | None = None
    wall_check_s: float | None = None
    wall_s: float | None = None
    notices: str | None = None


def column_types() -> dict[str, type]:
    """Type of each column: bool, int, float or str."""
    hints = get_type_hints(Figures)
    return {
        item.name: next((k for k in get_args(hints[item.name]) if k is not type(None)), str)
        for item in fields(Figures)
    }


def trajectory_figures(run: Trajectory) -> dict[str, Any]:
    """The figures that follow from the trajectory of a run."""
    summary = summarize(run)
    critical, change = _critical(run, summary.swings)
    result: dict[str, Any] = {
        "status": _name(run.status),
        "stable": run.status is Status.COMPLETED and not summary.dark,
        "ended_at": float(run.times[-1]),
        "reason": _DARK if summary.dark else _reason(run),
        "critical_machine": None if critical is None else str(critical),
        "largest_angle_deg": None if critical is None else _largest_angle(run, critical),
        "largest_angle_change_deg": change,
        "steps": run.run.step_count,
        "notices": json.dumps([[round(n.time, 6), n.text] for n in run.notices]),
    }
    result |= asdict(summary.cut_off) | _separation(run)
    if run.status is Status.COMPLETED:
        result |= _frequency(summary.frequency)
    result |= _voltage("lowest_voltage", summary.lowest_voltage)
    result |= _voltage("highest_voltage", summary.highest_voltage)
    if critical is not None and run.status is Status.COMPLETED:
        result |= _damping(run, critical)
    return result


def time_per_model(run: Trajectory, modes: Sequence[Mode] = ()) -> dict[str, float]:
    """Simulated seconds with each model, and seconds that the machine took for them.

    `modes` tells the model of each piece; all are detailed without it.
    """
    simulated, wall = dict.fromkeys(Mode, 0.0), dict.fromkeys(Mode, 0.0)
    for piece, mode in zip(run.run.pieces, modes or repeat(Mode.DETAILED), strict=False):
        simulated[mode] += float(piece.times[-1] - piece.times[0])
        wall[mode] += piece.seconds
    names = {mode: f"{mode.value.replace(' ', '_')}_s" for mode in Mode}
    return {names[mode]: seconds for mode, seconds in simulated.items()} | {
        WALL + names[mode]: seconds for mode, seconds in wall.items()
    }


def _critical(run: Trajectory, swings: Any) -> tuple[UnitKey | None, float | None]:
    if run.status in (Status.LOST_SYNCHRONISM, Status.OFF_SPEED) and run.culprit is not None:
        name = run.culprit.partition(":")[2]
        for swing in swings:
            if str(swing.unit) == name:
                return swing.unit, swing.largest_angle_deg
    return (swings[0].unit, swings[0].largest_angle_deg) if swings else (None, None)


def _largest_angle(run: Trajectory, unit: UnitKey) -> float:
    """Angle of a machine in degrees from the centre of inertia of its island where it is largest."""
    angle = run.rotor_angle_deg([unit], AngleReference.CENTRE_OF_INERTIA)[:, 0]
    return float(angle[np.nanargmax(np.abs(angle))])


def _reason(run: Trajectory) -> str | None:
    if run.status is Status.COMPLETED:
        return None
    return f"{_name(run.status)}: {run.culprit} at {float(run.times[-1]):g} s"


def _name(status: Status) -> str:
    return status.value.replace("_", " ")


def _separation(run: Trajectory) -> dict[str, float]:
    """Largest difference of two rotor angles in one island."""
    largest, at = 0.0, 0.0
    for part in run.parts:
        frame = angle_frame(part.model)
        angles, islands = part.states_at(frame.slots), len(frame.fixed)
        for island in range(islands):
            here = angles if islands == 1 else angles[:, frame.island == island]
            spread, row = widest_row(here)
            if spread > largest:
                largest, at = spread, float(part.times[row])
    return {"largest_separation_deg": float(np.rad2deg(largest)), "separation_at": at}


def _frequency(found: FrequencyRange | None) -> dict[str, float]:
    if found is None:
        return {}
    return {
        "nadir_hz": found.lowest_hz,
        "nadir_at": found.lowest_at,
        "highest_hz": found.highest_hz,
    }


def _voltage(name: str, found: Extreme | None) -> dict[str, Any]:
    if found is None:
        return {}
    return {name: found.value, f"{name}_bus": found.bus, f"{name}_at": found.at_seconds}


def _damping(run: Trajectory, unit: UnitKey) -> dict[str, float | None]:
    """Damping of the swing of `unit` after the last event."""
    found = dominant_swing(run, unit)
    if found is None:
        return {}
    return {"swing_hz": found.frequency_hz, "damping_ratio": found.damping_ratio}
