"""What criteria say, for the terminal."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from gridfold.report.plain import PlainTable
from gridfold.runs.criteria import BETWEEN, Finding, Verdict

if TYPE_CHECKING:
    import pandas as pd

_STYLES = {Verdict.KEPT: "", Verdict.VIOLATED: "bold red", Verdict.OPEN: "yellow"}
#: Errors that checks know, by the unit of what a criterion is about, and the factor to that unit.
_CHECKED_ERRORS = {
    "p.u.": ("error_lowest_voltage", 1.0),
    "Hz": ("error_nadir_hz", 1.0),
    "%": ("error_damping_ratio", 100.0),
}
#: Criteria that a line names.
_NAMED = 3


def criteria_table(findings: Sequence[Finding]) -> PlainTable:
    """Each criterion with its verdict, its margin and what decided."""
    table = PlainTable(title="Criteria", title_justify="left")
    table.add_column("criterion", overflow="fold")
    table.add_column("verdict", no_wrap=True)
    table.add_column("margin", justify="right", no_wrap=True)
    table.add_column("what decides", overflow="fold")
    for item in findings:
        margin = "" if item.margin is None else f"{item.margin:+.3g} {item.unit}"
        told = "; ".join((item.told, *item.notes))
        style = _STYLES[item.verdict] or None
        table.add_row(item.name, item.verdict.value, margin, told, style=style)
    return table


def violating(frame: pd.DataFrame) -> int | None:
    """How many rows of a study violate a criterion; None if there are no criteria."""
    if "violated" not in frame or not frame["violated"].notna().any():
        return None
    return int((frame["violated"].fillna("") != "").sum())


def criteria_facts(frame: pd.DataFrame) -> dict[str, str]:
    """How many rows of a study violate which criteria, and what else is to be known of them."""
    count = violating(frame)
    if count is None:
        return {}
    judged = int(frame["violated"].notna().sum())
    facts = {"Criteria": f"{count} of {judged} violate some{_listed(frame, 'violated')}"}
    for column, words in (
        ("not_judged", "not judged, since the run ended too early"),
        ("close", "within the estimated error"),
    ):
        some = int((frame[column].fillna("") != "").sum())
        if some:
            facts[f"Criteria {words.partition(',')[0]}"] = f"in {some}{_listed(frame, column)}"
    if near := close_by_checks(frame):
        facts["Criteria within the errors of checked runs"] = f"in {len(near)} contingencies"
    if other := list(other_criteria(frame)):
        facts["Other criteria in detail"] = "; ".join(other)
    return facts


def close_by_checks(frame: pd.DataFrame) -> dict[int, str]:
    """Criteria whose verdict could turn by the largest error of the runs that were checked.

    By number of the contingency, those that have such criteria. Contingencies that were checked
    themselves are left out: of these the verdict of the detailed run is known.
    """
    largest = {
        unit: factor * float(errors.abs().max())
        for unit, (column, factor) in _CHECKED_ERRORS.items()
        if len(errors := frame[column].dropna())
    }
    close: dict[int, str] = {}
    if not largest:
        return close
    rows = frame[frame["criteria"].notna() & frame["checked"].isna()]
    for row in rows.to_dict("records"):
        names = [
            item["name"]
            for item in json.loads(row["criteria"])
            if item["margin"] is not None and abs(item["margin"]) < largest.get(item["unit"], 0.0)
        ]
        if names:
            close[int(row["number"])] = BETWEEN.join(names)
    return close


def other_criteria(frame: pd.DataFrame) -> Iterator[str]:
    """Rows that violate other criteria than the detailed run of the same contingency."""
    both = frame[frame["checked_violated"].notna() & frame["violated"].notna()]
    for row in both.to_dict("records"):
        ours, right = (_names(row[name]) for name in ("violated", "checked_violated"))
        if ours != right:
            apart = BETWEEN.join(sorted(ours ^ right))
            yield f"{row['name']} ({apart})"


def _names(text: str) -> set[str]:
    return {name for name in text.split(BETWEEN) if name}


def _listed(frame: pd.DataFrame, column: str) -> str:
    """The criteria that a column names most often, with how often."""
    counts = Counter(name for text in frame[column].dropna() for name in _names(text))
    if not counts:
        return ""
    named = [f"{name} ({count})" for name, count in counts.most_common(_NAMED)]
    if len(counts) > _NAMED:
        named.append(f"and {len(counts) - _NAMED} more")
    return f": {', '.join(named)}"
