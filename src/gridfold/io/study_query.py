"""Conditions of a user's on the results of a study: read only, and never for long."""

from __future__ import annotations

import re
import sqlite3
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from gridfold.errors import OptionError

#: Seconds that a condition may take.
SECONDS = 5.0
#: Longest text or binary value that it may make, characters of the condition, and of a pattern in it.
_LONGEST_VALUE, _LONGEST_QUERY, _LONGEST_PATTERN = 1_000_000, 100_000, 1_000
#: Steps of SQLite's machine between two looks at the clock.
_STEPS = 10_000
#: A quoted text or name, whole or without its end; a comment; a word; any other sign.
_TOKEN = re.compile(
    r"""'(?:[^']|'')*'?|"(?:[^"]|"")*"?|`[^`]*`?|\[[^\]]*\]?|--|/\*|\w+|\S""", re.ASCII
)
_ENDS = {'"': '"', "`": "`", "[": "]"}


def chosen_rows(
    connection: sqlite3.Connection, query: str, where: str, order: str, columns: Sequence[str]
) -> list[Any]:
    """Rows of `query` of which the condition `where` holds.

    Raises
    ------
    OptionError
        It is no condition over the columns, or takes too long.
    """
    refuse_more_than_condition(where, columns)
    text = f"SELECT * FROM ({query}) WHERE ({where}) {order}"
    with _guarded(connection):
        try:
            return connection.execute(text).fetchall()
        except (sqlite3.Error, sqlite3.Warning, MemoryError, ValueError) as error:
            reason = str(error) or "it needs too much memory"
    if reason == "interrupted":
        reason = f"it takes longer than {SECONDS:g} s"
    if "no such column" in reason:
        reason += f"; there are: {', '.join(columns)}"
    raise OptionError(f"the condition {where!r} cannot be used: {reason}")


def refuse_more_than_condition(where: str, columns: Sequence[str]) -> None:
    """Raise an OptionError unless `where` is one expression over columns.

    SQLite takes an unknown name in quotes for a text: it would compare that, and say nothing.
    """
    depth, known = 0, {name.lower() for name in columns}
    for token in _TOKEN.findall(where):
        fault = None
        if token[0] in "'\"`[":
            end = _ENDS.get(token[0], "'")
            if len(token) < 2 or token[-1] != end:
                fault = f"{token[:20]!r} has no end"
            elif token[0] != "'" and token[1:-1].lower() not in known:
                fault = f"no such column: {token[1:-1]}; there are: {', '.join(columns)}"
        elif token in ("--", "/*", ";"):
            fault = f"{token!r} has no place in a condition"
        elif token.lower() in ("select", "with", "values"):
            fault = f"{token!r} has no place in a condition, which is about one row"
        depth += (token == "(") - (token == ")")
        if fault is None and depth < 0:
            fault = "a bracket is closed that was not opened"
        if fault is not None:
            raise OptionError(f"the condition {where!r} cannot be used: {fault}")


@contextmanager
def _guarded(connection: sqlite3.Connection) -> Iterator[None]:
    """Let the connection read the results alone, for a while, and make no large values."""
    limits = {
        sqlite3.SQLITE_LIMIT_LENGTH: _LONGEST_VALUE,
        sqlite3.SQLITE_LIMIT_SQL_LENGTH: _LONGEST_QUERY,
        sqlite3.SQLITE_LIMIT_LIKE_PATTERN_LENGTH: _LONGEST_PATTERN,
    }
    before = {kind: connection.setlimit(kind, value) for kind, value in limits.items()}
    end = time.monotonic() + SECONDS
    connection.set_progress_handler(lambda: time.monotonic() > end, _STEPS)
    connection.set_authorizer(_allowed)
    try:
        yield
    finally:
        connection.set_authorizer(None)
        connection.set_progress_handler(None, 0)
        for kind, value in before.items():
            connection.setlimit(kind, value)


def _allowed(action: int, first: str | None, second: str | None, *where: str | None) -> int:
    reading = action == sqlite3.SQLITE_READ and first in ("result", "contingency")
    calling = action == sqlite3.SQLITE_FUNCTION and second != "load_extension"
    allowed = reading or calling or action == sqlite3.SQLITE_SELECT
    return sqlite3.SQLITE_OK if allowed else sqlite3.SQLITE_DENY
