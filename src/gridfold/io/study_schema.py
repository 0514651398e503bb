"""The tables of a study's store, and the seals by which a damaged row is known."""

from __future__ import annotations

import hashlib
import json
import sqlite3
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

#: Version of the tables. A store of another one is refused.
FORMAT = 1
#: The file of a store in its folder.
FILE = "study.sqlite"
#: Tables that a store must have.
TABLES = ("about", "contingency", "result", "curves")
#: Column of the digest by which a row is known to be the one that was written.
SEAL = "seal"
_COLUMN_TYPES = {bool: "INTEGER", int: "INTEGER", float: "REAL", str: "TEXT"}


def connect(path: Path) -> sqlite3.Connection:
    """A connection that writes; every transaction is on disk before it ends."""
    connection = sqlite3.connect(path, timeout=60, check_same_thread=False)
    connection.execute("PRAGMA journal_mode = DELETE")
    connection.execute("PRAGMA synchronous = FULL")
    return connection


def make_tables(
    connection: sqlite3.Connection, columns: Mapping[str, str], about: Mapping[str, str]
) -> None:
    """The empty tables, and what the study is about.

    Parameters
    ----------
    connection : sqlite3.Connection
        To an empty file.
    columns : mapping
        Type in SQL of each figure of a result.
    about : mapping
        What the study is about, as JSON.
    """
    figures = "".join(f"{quoted(name)} {kind}, " for name, kind in columns.items())
    connection.execute(
        f"CREATE TABLE about (name TEXT PRIMARY KEY, value TEXT NOT NULL, {SEAL} TEXT)"
    )
    connection.execute(
        "CREATE TABLE contingency (number INTEGER PRIMARY KEY, name TEXT NOT NULL, "
        f"kind TEXT NOT NULL, events TEXT NOT NULL, {SEAL} TEXT)"
    )
    connection.execute(
        f"CREATE TABLE result (number INTEGER PRIMARY KEY REFERENCES contingency, {figures}{SEAL} TEXT)"
    )
    connection.execute(
        "CREATE TABLE curves (number INTEGER PRIMARY KEY REFERENCES result, content BLOB)"
    )
    connection.execute(f"CREATE VIEW study AS {study_query(columns)}")
    for name, value in about.items():
        write_about(connection, name, value)


def is_sealed(connection: sqlite3.Connection) -> bool:
    """Whether the store is of a version that seals its rows."""
    return all(
        any(row[1] == SEAL for row in connection.execute(f"PRAGMA table_info({table})"))
        for table in ("about", "contingency", "result")
    )


def seal_all(connection: sqlite3.Connection) -> None:
    """Seal what a store of a version without seals has, within a transaction of the caller's."""
    if is_sealed(connection):
        return
    for table in ("about", "contingency", "result"):
        connection.execute(f"ALTER TABLE {table} ADD COLUMN {SEAL} TEXT")
    for name, value in connection.execute("SELECT name, value FROM about").fetchall():
        write_about(connection, name, value)
    query = "SELECT number, name, kind, events FROM contingency"
    for row in connection.execute(query).fetchall():
        connection.execute(
            f"UPDATE contingency SET {SEAL} = ? WHERE number = ?", (seal(row), row[0])
        )
    for (number,) in connection.execute("SELECT number FROM result").fetchall():
        _seal_result(connection, number)


def sql_types(columns: Mapping[str, type]) -> dict[str, str]:
    """Types of columns in SQL."""
    return {name: _COLUMN_TYPES[kind] for name, kind in columns.items()}


def study_query(columns: Iterable[str], *further: str) -> str:
    """The query for all results with the names and kinds of their contingencies."""
    chosen = ", ".join(["result.number", "name", "kind", *map(quoted, columns), *further])
    return f"SELECT {chosen} FROM result JOIN contingency USING (number)"


def write_about(connection: sqlite3.Connection, name: str, value: str) -> None:
    """Note something about the study with its seal, within a transaction of the caller's."""
    row = (name, value, seal((name, value)))
    connection.execute("INSERT OR REPLACE INTO about VALUES (?, ?, ?)", row)


def write_contingency(connection: sqlite3.Connection, row: tuple[int, str, str, str]) -> None:
    """Number, name, kind and events with their seal, within a transaction of the caller's."""
    connection.execute("INSERT INTO contingency VALUES (?, ?, ?, ?, ?)", (*row, seal(row)))


def write_result(connection: sqlite3.Connection, number: int, figures: Mapping[str, Any]) -> None:
    """A row of figures with its seal, within a transaction of the caller's."""
    names = ", ".join(map(quoted, ["number", *figures]))
    marks = ", ".join("?" * (len(figures) + 1))
    values = (number, *figures.values())
    connection.execute(f"INSERT INTO result ({names}) VALUES ({marks})", values)
    _seal_result(connection, number)


def _seal_result(connection: sqlite3.Connection, number: int) -> None:
    """Seal a row as it is read back: SQLite changes types to those of the columns."""
    query = study_query(figure_columns(connection), "events") + " WHERE result.number = ?"
    row = connection.execute(query, (number,)).fetchone()
    if row is not None:
        connection.execute(f"UPDATE result SET {SEAL} = ? WHERE number = ?", (seal(row), number))


def figure_columns(connection: sqlite3.Connection) -> dict[str, str]:
    """Types in SQL of the figures that the file has."""
    found = connection.execute("PRAGMA table_info(result)").fetchall()
    return {row[1]: row[2] for row in found if row[1] not in ("number", SEAL)}


def seal(values: Sequence[Any]) -> str:
    """What tells whether values are those that were written."""
    return hashlib.sha256(json.dumps(values, default=repr).encode()).hexdigest()


def quoted(name: str) -> str:
    """A name in SQL."""
    return '"' + name.replace('"', '""') + '"'
