"""What a value with much in it shows of itself: one line, and a card in a notebook."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from html import escape

#: Items of a list that are shown.
_LISTED = 6


class Card(ABC):
    """Base of values whose fields are too much to read: ``repr`` and HTML give a few facts."""

    @abstractmethod
    def _facts(self) -> Mapping[str, object]:
        """Facts by name, in order; the first one says what the value is about."""

    def __repr__(self) -> str:
        title, *rest = self._facts().items()
        facts = ", ".join(f"{name} {value}" for name, value in rest)
        return f"<{type(self).__name__} {title[1]}{': ' if facts else ''}{facts}>"

    def _repr_html_(self) -> str:
        """The same as a table."""
        title, *rest = ((escape(name), escape(str(value))) for name, value in self._facts().items())
        rows = "".join(
            f'<tr><th style="text-align:left">{name}</th>'
            f'<td style="text-align:left">{value}</td></tr>'
            for name, value in rest
        )
        heading = f"<b>{escape(type(self).__name__)}</b> {title[1]}"
        return f'<table><caption style="text-align:left">{heading}</caption>{rows}</table>'


def first_few(items: Iterable[object]) -> str:
    """The first of some items, and how many more there are; "none" if there are none."""
    texts = [str(item) for item in items]
    more = f" and {len(texts) - _LISTED} more" if len(texts) > _LISTED else ""
    return (", ".join(texts[:_LISTED]) or "none") + more
