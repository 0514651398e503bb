"""What is whole of a store, and what is not: read row by row, from both ends of each table."""

from __future__ import annotations

import io
import json
import sqlite3
import zipfile
import zlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gridfold.io.study_schema import (
    TABLES,
    figure_columns,
    make_tables,
    quoted,
    seal,
    study_query,
)

#: What a store says about its study; without one of these it cannot be told.
NEEDED = ("format", "columns")
_VERDICTS = ("completed", "lost synchronism", "not finite", "failed")
_TYPES: dict[str, tuple[type, ...]] = {"INTEGER": (int,), "REAL": (float,), "TEXT": (str,)}
#: What reading a damaged file raises.
UNREADABLE = (sqlite3.Error, UnicodeError, ValueError, OverflowError, MemoryError, RecursionError)


@dataclass(frozen=True)
class Damage:
    """Something that is not whole: what, why, and the number of the contingency if it is of one."""

    what: str
    why: str
    number: int | None = None

    def __str__(self) -> str:
        return f"{self.what}: {self.why}"


@dataclass
class Content:
    """What is whole of a store.

    Parameters
    ----------
    columns : dict
        Type in SQL of each figure.
    about : dict
        What the study is about, as JSON.
    contingencies : dict
        Name, kind and events (JSON) by number.
    results : dict
        Figures by number, in the order of `columns`.
    unsealed : int
        Results that were written before there were seals: a changed digit cannot be told.
    damage : list of Damage
        What is not whole.
    """

    columns: dict[str, str] = field(default_factory=dict)
    about: dict[str, str] = field(default_factory=dict)
    contingencies: dict[int, tuple[str, str, str]] = field(default_factory=dict)
    results: dict[int, tuple[Any, ...]] = field(default_factory=dict)
    unsealed: int = 0
    damage: list[Damage] = field(default_factory=list)

    def copy(self) -> sqlite3.Connection:
        """The same as tables in memory, with nothing that is damaged."""
        connection = sqlite3.connect(":memory:", check_same_thread=False)
        self.write(connection)
        return connection

    def write(self, connection: sqlite3.Connection) -> None:
        """Write it as the tables of an empty file, with the results sealed anew."""
        make_tables(connection, self.columns, self.about)
        connection.executemany(
            "INSERT INTO contingency VALUES (?, ?, ?, ?)",
            ((number, *item) for number, item in self.contingencies.items()),
        )
        marks = ", ".join("?" * (len(self.columns) + 1))
        connection.executemany(
            f"INSERT INTO result VALUES ({marks})",
            ((number, *row) for number, row in self.results.items()),
        )
        query = study_query(self.columns, "events")
        connection.executemany(
            "INSERT INTO seal VALUES (?, ?)",
            ((f"result/{row[0]}", seal(row)) for row in connection.execute(query).fetchall()),
        )
        connection.commit()


def examine(connection: sqlite3.Connection) -> Content:
    """Read a store as it is at one moment, its curves excepted.

    Raises
    ------
    sqlite3.Error
        Not even its tables can be found.
    """
    content = Content()
    _require_tables(connection)
    content.columns = figure_columns(connection)
    with suppress(sqlite3.Error):
        connection.execute("BEGIN")
    try:
        seals = _seals(connection, content)
        _read_about(connection, content, seals)
        _read_contingencies(connection, content)
        _read_results(connection, content, seals)
    finally:
        with suppress(sqlite3.Error):
            connection.rollback()
    return content


def damaged_curves(connection: sqlite3.Connection) -> Iterator[Damage]:
    """The curves that cannot be read."""
    numbers, faults = _scan(connection, "SELECT number FROM curves", "number")
    yield from (Damage("curves", fault) for fault in faults)
    for (number,) in numbers:
        try:
            row = connection.execute(
                "SELECT content FROM curves WHERE number = ?", (number,)
            ).fetchone()
            unpack(row[0])
        except CURVES_UNREADABLE as error:
            yield Damage(f"curves of contingency {number}", _reason(error), number)


def unpack(content: bytes) -> dict[str, NDArray[Any]]:
    """Arrays from the bytes of a NumPy archive."""
    with np.load(io.BytesIO(content), allow_pickle=False) as archive:
        return {name: archive[name] for name in archive.files}


#: What :func:`unpack` raises where the bytes are not those that were written.
CURVES_UNREADABLE = (
    *UNREADABLE, zipfile.BadZipFile, zlib.error, EOFError, OSError, KeyError, TypeError,
    AttributeError, NotImplementedError,
)  # fmt: skip


def _require_tables(connection: sqlite3.Connection) -> None:
    kinds = dict(connection.execute("SELECT name, type FROM sqlite_master").fetchall())
    for name in TABLES:
        if kinds.get(name) != "table":
            raise sqlite3.DatabaseError(f"it has no table {name!r}")


@dataclass(frozen=True)
class _Seals:
    """Seals by what they are of; `partial` where some may be missing."""

    known: Mapping[str, str]
    partial: bool

    def fault(self, what: str, values: Sequence[Any]) -> str | None:
        """Why these values are not whole."""
        known = self.known.get(what)
        if known == seal(values) or (known is None and self.partial):
            return None
        return "it is not what was written"


def _seals(connection: sqlite3.Connection, content: Content) -> _Seals:
    """All seals; none in a store that was made before there were any."""
    found = connection.execute("SELECT 1 FROM sqlite_master WHERE name = 'seal' AND type = 'table'")
    if found.fetchone() is None:
        return _Seals({}, partial=True)
    rows, faults = _scan(connection, "SELECT what, digest FROM seal", "rowid")
    content.damage += [Damage("seals", fault) for fault in faults]
    return _Seals({str(what): str(digest) for what, digest in rows}, partial=bool(faults))


def _read_about(connection: sqlite3.Connection, content: Content, seals: _Seals) -> None:
    rows, faults = _scan(connection, "SELECT name, value FROM about", "rowid")
    content.damage += [Damage("description of the study", fault) for fault in faults]
    for name, value in rows:
        try:
            if fault := seals.fault(f"about/{name}", [value]):
                raise ValueError(fault)
            json.loads(value)
            content.about[str(name)] = value
        except (*UNREADABLE, TypeError) as error:
            content.damage.append(Damage(f"description of the study, {name!r}", _reason(error)))


def _read_contingencies(connection: sqlite3.Connection, content: Content) -> None:
    query = "SELECT number, name, kind, events FROM contingency"
    rows, faults = _scan(connection, query, "number")
    content.damage += [Damage("list of contingencies", fault) for fault in faults]
    for number, *texts in rows:
        try:
            name, kind, events = texts
            if not (isinstance(name, str) and isinstance(kind, str)):
                raise ValueError("its name is no text")
            if not isinstance(json.loads(events), list):
                raise ValueError("its events are no list")
            content.contingencies[int(number)] = (name, kind, events)
        except (*UNREADABLE, TypeError) as error:
            content.damage.append(Damage(f"contingency {number}", _reason(error), number))


def _read_results(connection: sqlite3.Connection, content: Content, seals: _Seals) -> None:
    chosen = ", ".join(map(quoted, ["number", *content.columns]))
    rows, faults = _scan(connection, f"SELECT {chosen} FROM result", "number")
    content.damage += [Damage("results", fault) for fault in faults]
    for number, *row in rows:
        contingency = content.contingencies.get(number)
        fault = _fault(dict(zip(content.columns, row, strict=True)), content.columns)
        if contingency is None:
            fault = "its contingency is not in the list"
        elif fault is None:
            name, kind, events = contingency
            fault = seals.fault(f"result/{number}", [number, name, kind, *row, events])
        if fault is None:
            content.unsealed += f"result/{number}" not in seals.known
            content.results[int(number)] = tuple(row)
        else:
            content.damage.append(Damage(f"result of contingency {number}", fault, number))


def _fault(figures: Mapping[str, Any], columns: Mapping[str, str]) -> str | None:
    """What cannot be in a row of figures."""
    for name, value in figures.items():
        kinds = _TYPES.get(columns[name], ())
        if value is not None and kinds and not isinstance(value, kinds):
            return f"{name} is {value!r:.40}"
    status, stable = figures.get("status"), figures.get("stable")
    if status is None or (status in _VERDICTS and (stable is None) != (status == "failed")):
        return f"status {status!r} does not go with stable {stable!r}"
    return None


def _scan(
    connection: sqlite3.Connection, query: str, key: str
) -> tuple[list[tuple[Any, ...]], list[str]]:
    """All rows that can be read, and why not all can be.

    A table is read upwards until a page is damaged, then downwards to the same place.
    """
    found: dict[Any, tuple[Any, ...]] = {}
    faults: list[str] = []
    for direction in ("ASC", "DESC"):
        cursor = connection.cursor()
        cursor.row_factory = None
        try:
            cursor.execute(f"{query} ORDER BY {key} {direction}")
            while (row := cursor.fetchone()) is not None:
                found.setdefault(row[0], row)
        except UNREADABLE as error:
            if _reason(error) not in faults:
                faults.append(_reason(error))
        if not faults:
            break
    ordered: Sequence[tuple[Any, ...]] = list(found.values())
    if all(isinstance(row[0], int) for row in ordered):
        ordered = sorted(ordered, key=lambda row: row[0])
    return list(ordered), faults


def _reason(error: BaseException) -> str:
    return " ".join(f"{error}".split())[:200] or type(error).__name__
