"""Data as text for people: names are never markup, and what is not printed is made visible.

Names of buses, files, contingencies come from files of others. A terminal obeys escape sequences, a
text that runs from right to left shows another name than the one that is there, and Rich, Plotly and
Matplotlib have markup of their own.
"""

from __future__ import annotations

import unicodedata
from collections.abc import Sequence
from typing import Any

from rich.console import Console, RenderableType
from rich.table import Table
from rich.text import Text

#: Unicode categories without a shape of their own: control and format characters, halves of pairs,
#: separators of lines, private use.
_HIDDEN = frozenset({"Cc", "Cf", "Cs", "Co", "Zl", "Zp"})
_SHORT = {"\n": "\\n", "\r": "\\r", "\t": "\\t"}


def visible(text: str) -> str:
    r"""`text` on one line, with control characters as escapes such as ``\x1b`` and ``\u202e``."""
    return text if text.isprintable() else "".join(map(_shown, text))


def visible_lines(text: str) -> str:
    """The same of a text of several lines, which stay lines."""
    return "\n".join(visible(line) for line in text.split("\n"))


def picture_text(text: str) -> str:
    """`text` for Matplotlib, to which a dollar begins mathematics."""
    return visible_lines(text).replace("$", r"\$")


class PlainTable(Table):
    """A table whose texts are data: title, headings, cells and caption have no markup."""

    def __init__(self, *, title: str | None = None, **options: Any):
        super().__init__(title=None if title is None else _text(title), **options)

    def add_column(self, header: RenderableType = "", *rest: Any, **options: Any) -> None:
        """Add a column; a heading may have several lines."""
        super().add_column(_text(header), *rest, **options)

    def add_row(self, *cells: RenderableType | None, **options: Any) -> None:
        """Add a row of cells of one line each, or of several by :func:`as_lines`."""
        super().add_row(*(Text(visible(c)) if isinstance(c, str) else c for c in cells), **options)

    def note(self, text: str) -> None:
        """Put a line under the table."""
        self.caption, self.caption_justify = _text(text), "left"


class PlainConsole(Console):
    """A console that prints texts as they are."""

    def print(self, *objects: Any, **options: Any) -> None:
        """Print texts without markup, and whatever Rich can render."""
        super().print(*map(_text, objects), **options)


def as_lines(texts: Sequence[str]) -> Text:
    """Texts as the lines of one cell: none of them can begin another one."""
    return Text("\n".join(map(visible, texts)))


def _text(item: Any) -> Any:
    return Text(visible_lines(item)) if isinstance(item, str) else item


def _shown(char: str) -> str:
    if unicodedata.category(char) not in _HIDDEN:
        return char
    code = ord(char)
    width, letter = (2, "x") if code < 0x100 else (4, "u") if code < 0x10000 else (8, "U")
    return _SHORT.get(char, f"\\{letter}{code:0{width}x}")
