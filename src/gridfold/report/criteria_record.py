"""What the page of a study tells of its criteria."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

from gridfold.report.criteria_tables import close_by_checks

if TYPE_CHECKING:
    import pandas as pd

Record = dict[str, Any]
#: What the page takes of a finding; the rest follows from the names.
_TAKEN = ("verdict", "margin", "unit", "at", "told", "notes")


def criteria_record(frame: pd.DataFrame) -> Record | None:
    """Names of the criteria, and by number of the contingency what each of them found.

    None without criteria. A finding is a list: verdict, margin, its unit, time in s, words, notes.
    """
    found = {
        int(row["number"]): json.loads(row["criteria"])
        for row in frame[frame["criteria"].notna()].to_dict("records")
    }
    if not found:
        return None
    names = [item["name"] for item in next(iter(found.values()))]
    return {
        "names": names,
        "found": {
            number: [[_rounded(item[key]) for key in _TAKEN] for item in items]
            for number, items in found.items()
        },
        "close": close_by_checks(frame),
    }


def _rounded(value: Any) -> Any:
    return float(f"{value:.5g}") if isinstance(value, float) else value
