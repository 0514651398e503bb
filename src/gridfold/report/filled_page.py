"""Pages that need no network: HTML with its style, its program, plotly.js and a record put in."""

from __future__ import annotations

import json
import re
from html import escape
from importlib.resources import files
from pathlib import Path
from typing import Any

from gridfold.io.results import replacing
from gridfold.report.plain import visible_lines

#: Places in a page that are filled.
_PLACE = re.compile(r"<!--gridfold:([a-z]+)-->|/\*gridfold:([a-z]+)\*/")
#: What could end a script in HTML, or a line in JavaScript.
_UNSAFE = {ord(sign): f"\\u{ord(sign):04x}" for sign in "<>&\u2028\u2029"}


def filled_page(name: str, title: str, record: dict[str, Any]) -> str:
    """The page of the template `name`, whose program draws `record`.

    Control characters of all texts are made visible.
    """
    from plotly.offline import get_plotlyjs

    parts = {
        "title": escape(visible_lines(title)),
        "style": _part("page.css"),
        "plotly": _as_script(get_plotlyjs()),
        "record": _as_json(_readable(record)),
        "program": _part("common.js") + _part(f"{name}.js"),
    }
    return _PLACE.sub(lambda found: parts[found[1] or found[2]], _part(f"{name}.html"))


def write_page(text: str, path: Path) -> None:
    """Write a page; a file that is there is replaced, an OutputError if that cannot be."""
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def _readable(item: Any) -> Any:
    if isinstance(item, str):
        return visible_lines(item)
    if isinstance(item, dict):
        return {_readable(key): _readable(value) for key, value in item.items()}
    return list(map(_readable, item)) if isinstance(item, list | tuple) else item


def _as_json(record: dict[str, Any]) -> str:
    """JSON that may stand in a script element of HTML: no text in it can end the element."""
    text = json.dumps(record, allow_nan=False, ensure_ascii=False, separators=(",", ":"))
    return text.translate(_UNSAFE)


def _as_script(program: str) -> str:
    """A program that may stand in a script element."""
    return re.sub(r"</(script)", r"<\\/\1", program, flags=re.IGNORECASE)


def _part(name: str) -> str:
    return files("gridfold.report").joinpath("page", name).read_text(encoding="utf-8")
