"""Buses and branches of events by the names that a file gives them, such as ``bus="WEST 1"``."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from typing import Any

from gridfold.errors import EventError, OptionError
from gridfold.grid.case import Case
from gridfold.grid.selection import select_buses

#: The number of the bus that has a name.
Numbering = Callable[[str], int]

_END = r"(\"[^\"]*\"|'[^']*'|[^\W\d]\w*|[0-9]+)"
_BRANCH = re.compile(rf"\s*{_END}\s*-\s*{_END}\s*((?::\s*\S+)?)\s*")
_NUMBER = re.compile(r"\s*[+-]?[0-9][0-9.eE]*\s*")
_QUOTES = "\"'"


def numbering(case: Case) -> Numbering:
    """How names become numbers of buses of a case; EventError where one means none, or several."""

    def number(name: str) -> int:
        quote = "'" if '"' in name else '"'
        try:
            found = select_buses(f"{quote}{name}{quote}", case, "bus")
        except OptionError as error:
            raise EventError(str(error).removeprefix("bus: ")) from None
        if len(found) > 1:
            listed = ", ".join(map(str, found[:8])) + (" ..." if len(found) > 8 else "")
            raise EventError(f"{len(found)} buses have the name {name!r}, say which: {listed}")
        return found[0]

    return number


def any_name(name: str) -> int:
    """Take every name for a bus, where no case is there yet to hold it against."""
    return 0


def with_numbers(record: Mapping[str, Any], number: Numbering, where: str) -> dict[str, Any]:
    """The record of an event with numbers in the place of names of its bus and its branch.

    Raises
    ------
    EventError
        A name means no bus, or several; `where` is named.
    """
    found = dict(record)
    for field, numbered in (("bus", _bus), ("branch", _branch)):
        if isinstance(text := found.get(field), str):
            try:
                found[field] = numbered(text, number)
            except EventError as error:
                raise EventError(f"{where}: {field}: {error}") from None
    return found


def _bus(text: str, number: Numbering) -> str:
    return text if not text.strip() or _NUMBER.fullmatch(text) else str(number(_name(text)))


def _branch(text: str, number: Numbering) -> str:
    ends = _BRANCH.fullmatch(text)
    if ends is None:
        return text
    first, second = (end if end.isdigit() else str(number(_name(end))) for end in ends.groups()[:2])
    return f"{first}-{second}{ends[3]}"


def _name(text: str) -> str:
    """A name without the quotes around it."""
    text = text.strip()
    quoted = len(text) > 1 and text[0] == text[-1] and text[0] in _QUOTES
    return text[1:-1] if quoted else text
