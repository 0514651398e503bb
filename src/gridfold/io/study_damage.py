"""What is whole of a store, and what is not: read row by row, from both ends of each table."""

from __future__ import annotations

import io
import json
import sqlite3
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gridfold.io.study_schema import (
    SEAL,
    TABLES,
    figure_columns,
    is_sealed,
    make_tables,
    quoted,
    seal,
    write_contingency,
    write_result,
)

#: What a store says about its study; without one of these it cannot be told.
NEEDED = ("format", "columns")
#: What it says besides how long its list of contingencies is.
LISTED = "listed"
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
        for number, item in self.contingencies.items():
            write_contingency(connection, (number, *item))
        for number, row in self.results.items():
            write_result(connection, number, dict(zip(self.columns, row, strict=True)))
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
        sealed = is_sealed(connection)
        digest = SEAL if sealed else "NULL"
        _read_about(connection, content, digest)
        _require_columns(content)
        _read_contingencies(connection, content, digest)
        _read_results(connection, content, digest)
        content.unsealed = 0 if sealed else len(content.results)
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
            query = "SELECT content FROM curves WHERE number = ?"
            unpack(connection.execute(query, (number,)).fetchone()[0])
        except (*UNREADABLE, TypeError) as error:
            yield Damage(f"curves of contingency {number}", _reason(error), number)


def unpack(content: bytes) -> dict[str, NDArray[Any]]:
    """Arrays from the bytes of a NumPy archive; a ValueError where they are not whole."""
    try:
        with np.load(io.BytesIO(content), allow_pickle=False) as archive:
            return {name: archive[name] for name in archive.files}
    except Exception as error:  # whatever the layers of an archive make of foreign bytes
        raise ValueError(f"it is no archive of arrays: {error}") from None


def _require_tables(connection: sqlite3.Connection) -> None:
    kinds = dict(connection.execute("SELECT name, type FROM sqlite_master").fetchall())
    for name in TABLES:
        if kinds.get(name) != "table":
            raise sqlite3.DatabaseError(f"it has no table {name!r}")


def _require_columns(content: Content) -> None:
    """Raise where the figures have other names than those that were written."""
    written = content.about.get("columns")
    if written is not None and not content.columns.keys() <= json.loads(written).keys():
        raise sqlite3.DatabaseError("its columns are not those that were written")


def _broken(values: Sequence[Any], digest: Any, sealed: bool) -> str | None:
    """Why values are not those that were written."""
    return "it is not what was written" if sealed and digest != seal(values) else None


def _read_about(connection: sqlite3.Connection, content: Content, digest: str) -> None:
    rows, faults = _scan(connection, f"SELECT name, value, {digest} FROM about", "rowid")
    content.damage += [Damage("description of the study", fault) for fault in faults]
    for name, value, known in rows:
        try:
            if fault := _broken((name, value), known, digest == SEAL):
                raise ValueError(fault)
            json.loads(value)
            content.about[str(name)] = value
        except (*UNREADABLE, TypeError) as error:
            content.damage.append(Damage(f"description of the study, {name!r}", _reason(error)))


def _read_contingencies(connection: sqlite3.Connection, content: Content, digest: str) -> None:
    query = f"SELECT number, name, kind, events, {digest} FROM contingency"
    rows, faults = _scan(connection, query, "number")
    content.damage += [Damage("list of contingencies", fault) for fault in faults]
    for number, *texts, known in rows:
        try:
            name, kind, events = texts
            if not (isinstance(name, str) and isinstance(kind, str)):
                raise ValueError("its name is no text")
            if not isinstance(json.loads(events), list):
                raise ValueError("its events are no list")
            if fault := _broken((number, *texts), known, digest == SEAL):
                raise ValueError(fault)
            content.contingencies[int(number)] = (name, kind, events)
        except (*UNREADABLE, TypeError) as error:
            content.damage.append(Damage(f"contingency {number}", _reason(error), number))
    there, listed = len(content.contingencies), json.loads(content.about.get(LISTED, "0"))
    if there < listed:
        content.damage.append(Damage("list of contingencies", f"{there} of {listed} are there"))


def _read_results(connection: sqlite3.Connection, content: Content, digest: str) -> None:
    chosen = ", ".join(map(quoted, ["number", *content.columns]))
    rows, faults = _scan(connection, f"SELECT {chosen}, {digest} FROM result", "number")
    content.damage += [Damage("results", fault) for fault in faults]
    for number, *row, known in rows:
        contingency = content.contingencies.get(number)
        fault = _fault(dict(zip(content.columns, row, strict=True)), content.columns)
        if contingency is None:
            fault = "its contingency is not in the list"
        elif fault is None:
            name, kind, events = contingency
            fault = _broken((number, name, kind, *row, events), known, digest == SEAL)
        if fault is None:
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
