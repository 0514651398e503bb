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
#: Tables that a store must have, and those of one that was made before there were seals.
TABLES = ("about", "contingency", "result", "curves")
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
    figures = ", ".join(f"{quoted(name)} {kind}" for name, kind in columns.items())
    connection.execute("CREATE TABLE about (name TEXT PRIMARY KEY, value TEXT NOT NULL)")
    connection.execute(
        "CREATE TABLE contingency (number INTEGER PRIMARY KEY, name TEXT NOT NULL, "
        "kind TEXT NOT NULL, events TEXT NOT NULL)"
    )
    connection.execute(
        f"CREATE TABLE result (number INTEGER PRIMARY KEY REFERENCES contingency, {figures})"
    )
    connection.execute(
        "CREATE TABLE curves (number INTEGER PRIMARY KEY REFERENCES result, content BLOB)"
    )
    make_seals(connection)
    connection.execute(f"CREATE VIEW study AS {study_query(columns)}")
    for name, value in about.items():
        write_about(connection, name, value)


def make_seals(connection: sqlite3.Connection) -> None:
    """The table of seals where it is not there yet."""
    connection.execute(
        "CREATE TABLE IF NOT EXISTS seal (what TEXT PRIMARY KEY, digest TEXT NOT NULL)"
    )


def sql_types(columns: Mapping[str, type]) -> dict[str, str]:
    """Types of columns in SQL."""
    return {name: _COLUMN_TYPES[kind] for name, kind in columns.items()}


def study_query(columns: Iterable[str], *further: str) -> str:
    """The query for all results with the names and kinds of their contingencies."""
    chosen = ", ".join(["result.number", "name", "kind", *map(quoted, columns), *further])
    return f"SELECT {chosen} FROM result JOIN contingency USING (number)"


def write_about(connection: sqlite3.Connection, name: str, value: str) -> None:
    """Note something about the study with its seal, within a transaction of the caller's."""
    connection.execute("INSERT OR REPLACE INTO about VALUES (?, ?)", (name, value))
    _write_seal(connection, f"about/{name}", [value])


def write_result(connection: sqlite3.Connection, number: int, figures: Mapping[str, Any]) -> None:
    """A row of figures with its seal, within a transaction of the caller's."""
    names = ", ".join(map(quoted, ["number", *figures]))
    marks = ", ".join("?" * (len(figures) + 1))
    values = (number, *figures.values())
    connection.execute(f"INSERT INTO result ({names}) VALUES ({marks})", values)
    # Sealed as it is read back: SQLite changes types to those of the columns.
    query = study_query(figure_columns(connection), "events") + " WHERE result.number = ?"
    row = connection.execute(query, (number,)).fetchone()
    if row is not None:
        _write_seal(connection, f"result/{number}", row)


def figure_columns(connection: sqlite3.Connection) -> dict[str, str]:
    """Types in SQL of the figures that the file has."""
    found = connection.execute("PRAGMA table_info(result)").fetchall()
    return {row[1]: row[2] for row in found if row[1] != "number"}


def seal(values: Sequence[Any]) -> str:
    """What tells whether values are those that were written."""
    return hashlib.sha256(json.dumps(values, default=repr).encode()).hexdigest()


def quoted(name: str) -> str:
    """A name in SQL."""
    return '"' + name.replace('"', '""') + '"'


def _write_seal(connection: sqlite3.Connection, what: str, values: Sequence[Any]) -> None:
    connection.execute("INSERT OR REPLACE INTO seal VALUES (?, ?)", (what, seal(values)))
