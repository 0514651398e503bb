"""The columns of a data set: what is drawn, the operating point, and the labels."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from gridfold.study.summary import column_types

#: Status of a sample without an operating point.
INFEASIBLE = "infeasible"
#: Figures of a run that are labels; their meaning is that of the columns of a study.
LABELS = (
    "status",
    "reason",
    "stable",
    "ended_at",
    "critical_machine",
    "largest_swing_deg",
    "largest_separation_deg",
    "separation_at",
    "lowest_voltage",
    "lowest_voltage_bus",
    "lowest_voltage_at",
    "highest_voltage",
    "nadir_hz",
    "nadir_at",
    "highest_hz",
    "islands",
    "lost_load_mw",
    "swing_hz",
    "damping_ratio",
    "critical_clearing_time",
    "clearing_time_bounded",
    "margin",
)
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
        name: Column(kind, "", "As in the table of a study", "label")
        for name, kind in column_types().items()
        if name in LABELS
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
