"""The report of a study: one page that needs no network.

The page is `page/page.html` with its style, its program, plotly.js and the record of the study put in.
The figures are drawn in the browser, from the record alone.
"""

from __future__ import annotations

import json
import re
from html import escape
from importlib.resources import files
from pathlib import Path
from typing import Any

from gridfold.io.results import replacing
from gridfold.io.study_store import StudyStore
from gridfold.report.plain import visible_lines
from gridfold.report.study_record import study_record

#: Places in the page that are filled.
_PLACE = re.compile(r"<!--gridfold:([a-z]+)-->|/\*gridfold:([a-z]+)\*/")
#: What could end a script in HTML, or a line in JavaScript.
_UNSAFE = {ord(sign): f"\\u{ord(sign):04x}" for sign in "<>&\u2028\u2029"}


def write_report(store: StudyStore, path: Path) -> None:
    """Write the report of a study as one HTML file.

    Parameters
    ----------
    store : StudyStore
        The results; the study may be unfinished.
    path : Path
        The page; a file that is there is replaced.

    Raises
    ------
    OutputError
        The page cannot be written, or the store cannot be read.
    """
    text = page(_readable(study_record(store)))
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def page(record: dict[str, Any]) -> str:
    """The page of the record of a study."""
    from plotly.offline import get_plotlyjs

    parts = {
        "title": escape(f"{record['study']}: contingency study"),
        "style": _part("page.css"),
        "plotly": _as_script(get_plotlyjs()),
        "record": as_json(record),
        "program": _part("page.js"),
    }
    return _PLACE.sub(lambda found: parts[found[1] or found[2]], _part("page.html"))


def _readable(item: Any) -> Any:
    """The record with control characters of all its texts made visible."""
    if isinstance(item, str):
        return visible_lines(item)
    if isinstance(item, dict):
        return {_readable(key): _readable(value) for key, value in item.items()}
    return list(map(_readable, item)) if isinstance(item, list | tuple) else item


def as_json(record: dict[str, Any]) -> str:
    """JSON that may stand in a script element of HTML: no text in it can end the element."""
    text = json.dumps(record, allow_nan=False, ensure_ascii=False, separators=(",", ":"))
    return text.translate(_UNSAFE)


def _as_script(program: str) -> str:
    """A program that may stand in a script element."""
    return re.sub(r"</(script)", r"<\\/\1", program, flags=re.IGNORECASE)


def _part(name: str) -> str:
    return files("gridfold.report").joinpath("page", name).read_text(encoding="utf-8")
