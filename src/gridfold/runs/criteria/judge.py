"""A run held against criteria, in one pass over its rows."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gridfold.grid.criteria import (
    AngleSeparation,
    Criterion,
    FrequencyBand,
    LeastDamping,
    VoltageDip,
    VoltageRecovery,
)
from gridfold.grid.criterion_checks import check_criteria, judged_buses, judged_machines
from gridfold.runs.criteria.angle import AngleWatch
from gridfold.runs.criteria.course import APPROXIMATE, Course, course_of, outside
from gridfold.runs.criteria.damping import damping_finding
from gridfold.runs.criteria.finding import Finding, Verdict
from gridfold.runs.criteria.frequency import FrequencyWatch
from gridfold.runs.criteria.voltage import VoltageWatch
from gridfold.runs.parts import Part
from gridfold.runs.summary import Summary, summarize
from gridfold.runs.trajectory import Trajectory

#: Rows whose voltages are looked at together.
_ROWS = 128


def judge(
    run: Trajectory, criteria: Sequence[Criterion], study_buses: Collection[int] | None = None
) -> tuple[Finding, ...]:
    """Hold a run against criteria.

    Parameters
    ----------
    run : Trajectory
        A run of the detailed or a reduced model. What a reduced model stands for is approximate outside
        the study area; findings that rest on it have a note.
    criteria : sequence of Criterion
        What is asked.
    study_buses : collection of int, optional
        Bus numbers of the study area; those of the run by default.

    Returns
    -------
    tuple of Finding
        One for each criterion. Those that a run which ended too early leaves open are
        :attr:`Verdict.OPEN`.

    Raises
    ------
    OptionError
        A criterion does not fit the case.
    """
    study = run.study_buses if study_buses is None else study_buses
    check_criteria(criteria, run.model.case, study)
    course = course_of(run)
    watches = [_watch(criterion, run, course, study) for criterion in criteria]
    voltages = [watch for watch in watches if isinstance(watch, VoltageWatch)]
    for part in run.parts:
        if len(part):
            for watch in watches:
                if isinstance(watch, AngleWatch | FrequencyWatch):
                    watch.take(part)
            _take_voltages(part, voltages)
    needed = any(isinstance(criterion, LeastDamping) for criterion in criteria)
    summary = summarize(run) if needed else None
    found = [
        _finding(watch, criterion, run, summary, course)
        for watch, criterion in zip(watches, criteria, strict=True)
    ]
    # What is open has no margin: the rest of the run could have used it up.
    return tuple(
        replace(item, margin=None, share=None) if item.verdict is Verdict.OPEN else item
        for item in found
    )


Watch = AngleWatch | FrequencyWatch | VoltageWatch | None


def _watch(
    criterion: Criterion, run: Trajectory, course: Course, study: Collection[int] | None
) -> Watch:
    """What takes the rows of a run for a criterion; None where it looks at the whole."""
    case = run.model.case
    if isinstance(criterion, AngleSeparation):
        machines = judged_machines(criterion, case, run.model.machines, study)
        return AngleWatch(criterion, machines, course)
    if isinstance(criterion, FrequencyBand):
        return FrequencyWatch(criterion, course, case.frequency_hz)
    if isinstance(criterion, VoltageDip | VoltageRecovery):
        buses = judged_buses(criterion, case, study)
        levels = np.full(len(buses), criterion.level)
        if criterion.of_initial:
            initial = np.abs(course.start.power_flow.voltage)
            levels = criterion.level * initial[[case.bus_index[bus] for bus in buses]]
        return VoltageWatch(criterion, buses, levels, course)
    return None


def _take_voltages(part: Part, watches: Sequence[VoltageWatch]) -> None:
    """Hand the magnitudes of a part to the watches; those of de-energized buses are missing."""
    if not watches:
        return
    index = part.model.case.bus_index
    numbers = sorted({bus for watch in watches for bus in watch.buses})
    place = {bus: k for k, bus in enumerate(numbers)}
    at = np.array([index[bus] for bus in numbers])
    dark = ~part.model.equations.islands.energized[at]
    columns = [np.array([place[bus] for bus in watch.buses]) for watch in watches]
    for block in part.blocks(_ROWS):
        sizes: NDArray[np.float64] = np.abs(block.model.bus_voltages(block.states, at))
        sizes[:, dark] = np.nan
        for watch, chosen in zip(watches, columns, strict=True):
            watch.take(block.times, sizes[:, chosen])


def _finding(
    watch: Watch,
    criterion: Criterion,
    run: Trajectory,
    summary: Summary | None,
    course: Course,
) -> Finding:
    if isinstance(criterion, LeastDamping):
        assert summary is not None
        return damping_finding(criterion, run, summary, course)
    assert watch is not None
    finding = watch.finding()
    if isinstance(watch, FrequencyWatch):
        return finding
    if isinstance(watch, AngleWatch):
        buses, what = [unit.bus for unit in watch.machines], "machines"
    else:
        buses, what = list(watch.buses), "buses"
    if not (count := outside(run, buses)):
        return finding
    return finding.noted(f"{count} of the {len(buses)} {what} lie {APPROXIMATE}")
