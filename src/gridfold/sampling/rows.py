"""The columns of a data set: what is drawn, the operating point, and the labels."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from gridfold.study.summary import column_types

#: Status of a sample without an operating point.
INFEASIBLE = "infeasible"
#: Figures of a run that are labels: unit and meaning. They are those of a study.
LABELS: Mapping[str, tuple[str, str]] = {
    "status": ("", "`completed`, `lost synchronism`, `off speed`, `infeasible`, `failed`, ..."),
    "reason": ("", "Why it is infeasible or failed, or what ended the run early"),
    "stable": ("", "Whether it stays stable; missing where nothing can be said"),
    "ended_at": ("s", "End of the run"),
    "critical_machine": ("", "Machine that decided: that lost synchronism, else swung furthest"),
    "largest_angle_deg": ("deg", "Its largest angle from the centre of inertia"),
    "largest_angle_change_deg": ("deg", "How far that moved from the start"),
    "largest_separation_deg": ("deg", "Largest difference of two rotor angles in one island"),
    "separation_at": ("s", "When that was"),
    "lowest_voltage": ("p.u.", "Lowest voltage after the last event"),
    "lowest_voltage_bus": ("", "Number of its bus"),
    "lowest_voltage_at": ("s", "When that was"),
    "highest_voltage": ("p.u.", "Highest voltage after the last event"),
    "nadir_hz": ("Hz", "Lowest frequency of the centre of inertia of any island, if stable"),
    "nadir_at": ("s", "When that was"),
    "highest_hz": ("Hz", "Highest frequency of the same"),
    "islands": ("", "Parts of the network that have a machine, at the end"),
    "lost_load_mw": ("MW", "Load at buses that are de-energized at the end"),
    "swing_hz": ("Hz", "Frequency of the dominant swing of the critical machine"),
    "damping_ratio": ("", "Its damping ratio"),
    "critical_clearing_time": ("s", "If asked for; a bounded one is the longest that is stable"),
    "clearing_time_bounded": ("", "Whether a longer clearing time was found unstable"),
    "margin": ("s", "By what the critical clearing time exceeds the duration of the fault"),
}
_LOST = ("lost synchronism", "off speed")


@dataclass(frozen=True)
class Column:
    """A column: its type, its unit, what it says, and whether it is an input or a label."""

    kind: type
    unit: str
    meaning: str
    role: str = "input"


#: Columns of every data set beside what is drawn by a plan and the labels of studies.
COLUMNS: Mapping[str, Column] = {
    "number": Column(int, "", "Number of the sample, from 1", "key"),
    "contingency": Column(str, "", "Name of what happens"),
    "kind": Column(str, "", "`bus fault`, `line fault`, `machine trip`, else `events`"),
    "clearing_time": Column(float, "s", "Duration of the fault"),
    "load_mw": Column(float, "MW", "All load at the start"),
    "generation_mw": Column(float, "MW", "All generation at the start"),
    "slack_mw": Column(float, "MW", "Of which at slack buses"),
    "start_lowest_voltage": Column(float, "p.u.", "Lowest voltage of a bus at the start"),
    "start_highest_voltage": Column(float, "p.u.", "Highest voltage of a bus at the start"),
    "lost_at": Column(float, "s", "When synchronism was lost; missing if it was not", "label"),
    "lost_machine": Column(str, "", "Which machine lost it", "label"),
    **{
        name: Column(column_types()[name], unit, meaning, "label")
        for name, (unit, meaning) in LABELS.items()
    },
}


def data_columns(drawn: Iterable[str]) -> dict[str, Column]:
    """All columns of a data set in order; `drawn` has the names of what a plan draws."""
    first = ("number", "contingency", "kind", "clearing_time")
    columns = {name: COLUMNS[name] for name in first}
    columns |= {name: Column(float, "", "Drawn by the plan") for name in drawn}
    return {**columns, **COLUMNS}


def labels(figures: Mapping[str, Any]) -> dict[str, Any]:
    """The labels of a run, from its row of figures."""
    found = {name: figures[name] for name in LABELS}
    if found["status"] in _LOST:
        found |= {"lost_at": found["ended_at"], "lost_machine": found["critical_machine"]}
    return found
