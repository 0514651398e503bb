"""The results of a study: one folder with an SQLite file.

Every result is a transaction of its own that is on disk before :meth:`StudyStore.add` returns, so a
killed process loses no more than what it had not yet handed over. A lock of the operating system keeps
a second writer out; it goes with the process that holds it.
"""

from __future__ import annotations

import io
import json
import os
import sqlite3
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from filelock import FileLock, Timeout
from numpy.typing import NDArray

from gridfold.errors import OptionError, OutputError

if TYPE_CHECKING:
    import pandas as pd

#: Version of the tables. A store of another one is refused.
FORMAT = 1
FILE, LOCK = "study.sqlite", "study.lock"
_COLUMN_TYPES = {bool: "INTEGER", int: "INTEGER", float: "REAL", str: "TEXT"}

Curves = Mapping[str, NDArray[Any]]


class Result(NamedTuple):
    """What is kept of a contingency: its number, the figures by column, its curves."""

    number: int
    figures: Mapping[str, Any]
    curves: Curves | None = None


class StudyStore:
    """The results of one study. Make it with :meth:`create`, :meth:`resume` or :meth:`read`."""

    def __init__(self, folder: Path, connection: sqlite3.Connection, lock: FileLock | None):
        self.folder = folder
        self._connection = connection
        self._lock = lock

    @classmethod
    def create(
        cls,
        folder: str | Path,
        identity: Mapping[str, Any],
        contingencies: Sequence[Mapping[str, Any]],
        columns: Mapping[str, type],
    ) -> StudyStore:
        """A new store.

        Parameters
        ----------
        folder : str or Path
            Made if it is not there; must not hold a study.
        identity : mapping
            What the study is about, ready for JSON.
        contingencies : sequence of mapping
            Records with ``number``, ``name``, ``kind`` and ``events``.
        columns : mapping
            Type (bool, int, float, str) of each figure of a result.

        Raises
        ------
        OptionError
            The folder holds a study, or another process works on it.
        OutputError
            It cannot be written.
        """
        folder = Path(folder)
        with _telling(folder):
            folder.mkdir(parents=True, exist_ok=True)
        lock = _lock(folder)
        try:
            if (folder / FILE).exists():
                raise OptionError(
                    f"{folder} holds a study already; go on with --resume, or take another folder"
                )
            # Under another name until it is complete: there is never half a store.
            unfinished = folder / f"{FILE}.new"
            with _telling(folder):
                unfinished.unlink(missing_ok=True)
                with closing(_connect(unfinished)) as connection:
                    _make_tables(connection, identity, contingencies, columns)
                unfinished.replace(folder / FILE)
                return cls(folder, _connect(folder / FILE), lock)
        except BaseException:
            lock.release()
            raise

    @classmethod
    def resume(cls, folder: str | Path) -> StudyStore:
        """A store that is there, to go on writing.

        Raises
        ------
        OptionError
            There is none, another process works on it, or it has another format.
        """
        folder = Path(folder)
        _require(folder)
        lock = _lock(folder)
        try:
            with _telling(folder):
                return cls(folder, _connect(folder / FILE), lock)._checked()
        except BaseException:
            lock.release()
            raise

    @classmethod
    def read(cls, folder: str | Path) -> StudyStore:
        """A store that is there, to read; another process may be writing."""
        folder = Path(folder)
        _require(folder)
        file = folder / FILE
        # Where it may be written what a killed process left unfinished can be taken back.
        mode = "rw" if os.access(file, os.W_OK) and os.access(folder, os.W_OK) else "ro"
        with _telling(folder):
            address = file.resolve().as_uri()
            connection = sqlite3.connect(f"{address}?mode={mode}", uri=True, timeout=60)
            connection.execute("PRAGMA query_only = ON")
            return cls(folder, connection, None)._checked()

    def __enter__(self) -> StudyStore:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the file and let go of the lock."""
        self._connection.close()
        if self._lock is not None:
            self._lock.release()

    @property
    def identity(self) -> dict[str, Any]:
        """What the study is about."""
        with _telling(self.folder):
            rows = self._connection.execute("SELECT name, value FROM about").fetchall()
        return {name: json.loads(value) for name, value in rows}

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of all columns of :meth:`frame`."""
        with _telling(self.folder):
            found = self._connection.execute("SELECT * FROM study LIMIT 0")
        return tuple(item[0] for item in found.description)

    def tell(self, name: str, value: Any) -> None:
        """Note something further about the study, ready for JSON."""
        with _telling(self.folder), self._connection as connection:
            connection.execute("INSERT OR REPLACE INTO about VALUES (?, ?)", (name, _json(value)))

    def contingencies(self) -> list[dict[str, Any]]:
        """Records of all contingencies, by number."""
        with _telling(self.folder):
            rows = self._connection.execute(
                "SELECT number, name, kind, events FROM contingency ORDER BY number"
            ).fetchall()
        return [
            {"number": number, "name": name, "kind": kind, "events": json.loads(events)}
            for number, name, kind, events in rows
        ]

    def done(self) -> set[int]:
        """Numbers of the contingencies that have a result."""
        with _telling(self.folder):
            return {row[0] for row in self._connection.execute("SELECT number FROM result")}

    def failed(self) -> set[int]:
        """Numbers of the contingencies whose result is a failure."""
        with _telling(self.folder):
            rows = self._connection.execute("SELECT number FROM result WHERE status = 'failed'")
            return {row[0] for row in rows}

    def add(self, results: Sequence[Result], again: Collection[int] = ()) -> None:
        """Write results. A contingency that has one is refused, but for those tried `again`."""
        with _telling(self.folder), self._connection as connection:
            for result in results:
                if result.number in again:
                    for table in ("result", "curves"):
                        connection.execute(
                            f"DELETE FROM {table} WHERE number = ?", (result.number,)
                        )
                names = ["number", *result.figures]
                marks = ", ".join("?" * len(names))
                connection.execute(
                    f"INSERT INTO result ({', '.join(names)}) VALUES ({marks})",
                    (result.number, *(_plain(value) for value in result.figures.values())),
                )
                if result.curves is not None:
                    connection.execute(
                        "INSERT INTO curves VALUES (?, ?)", (result.number, _pack(result.curves))
                    )

    def frame(
        self, where: str | None = None, sort: str | None = None, descending: bool = False
    ) -> pd.DataFrame:
        """Results with the names and kinds of their contingencies, one a row.

        Parameters
        ----------
        where : str, optional
            A condition in SQL over the columns, such as ``stable = 0 AND lowest_voltage < 0.8``.
        sort : str, optional
            A column; by number if none is given. Rows without a value come last.
        descending : bool
            The largest first.

        Raises
        ------
        OptionError
            The condition or the column makes no sense.
        """
        import pandas as pd

        names = self.columns
        order = "number" if sort is None else sort
        if order not in names:
            raise OptionError(f"there is no column {order!r}; there are: {', '.join(names)}")
        query = "SELECT * FROM study"
        if where is not None:
            query += f" WHERE ({where})"
        query += f" ORDER BY {order} IS NULL, {order} {'DESC' if descending else 'ASC'}, number"
        try:
            rows = self._connection.execute(query).fetchall()
        except (sqlite3.OperationalError, sqlite3.Warning, sqlite3.ProgrammingError) as error:
            raise OptionError(f"the condition {where!r} cannot be used: {error}") from None
        frame = pd.DataFrame.from_records(rows, columns=list(names))
        return frame.astype(
            {name: kind for name, kind in self._frame_types().items() if name in frame}
        )

    def _frame_types(self) -> dict[str, str]:
        kinds = {"bool": "boolean", "int": "Int64", "float": "Float64", "str": "string"}
        return {name: kinds[kind] for name, kind in self.identity["columns"].items()}

    def curves(self, number: int) -> dict[str, NDArray[Any]] | None:
        """Curves of a contingency, None if there are none."""
        with _telling(self.folder):
            row = self._connection.execute(
                "SELECT content FROM curves WHERE number = ?", (number,)
            ).fetchone()
        return None if row is None else _unpack(row[0])

    def _checked(self) -> StudyStore:
        found = self.identity.get("format")
        if found != FORMAT:
            self.close()
            raise OptionError(
                f"{self.folder}: the store has format {found}, this version of gridfold reads {FORMAT}"
            )
        return self


def _connect(path: Path) -> sqlite3.Connection:
    connection = sqlite3.connect(path, timeout=60, check_same_thread=False)
    connection.execute("PRAGMA journal_mode = DELETE")
    connection.execute("PRAGMA synchronous = FULL")
    return connection


def _make_tables(
    connection: sqlite3.Connection,
    identity: Mapping[str, Any],
    contingencies: Sequence[Mapping[str, Any]],
    columns: Mapping[str, type],
) -> None:
    figures = ", ".join(f"{name} {_COLUMN_TYPES[kind]}" for name, kind in columns.items())
    about = {
        "format": FORMAT,
        "columns": {name: kind.__name__ for name, kind in columns.items()},
        **identity,
    }
    with connection:
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
        chosen = ", ".join(f"result.{name}" for name in columns)
        connection.execute(
            f"CREATE VIEW study AS SELECT result.number, name, kind, {chosen} "
            "FROM result JOIN contingency USING (number)"
        )
        connection.executemany(
            "INSERT INTO about VALUES (?, ?)", [(k, _json(v)) for k, v in about.items()]
        )
        connection.executemany(
            "INSERT INTO contingency VALUES (?, ?, ?, ?)",
            [(c["number"], c["name"], c["kind"], _json(c["events"])) for c in contingencies],
        )


def _require(folder: Path) -> None:
    if not (folder / FILE).is_file():
        raise OptionError(f"{folder} holds no study: there is no {FILE}")


def _lock(folder: Path) -> FileLock:
    lock = FileLock(folder / LOCK)
    try:
        with _telling(folder):
            lock.acquire(timeout=0)
    except Timeout:
        raise OptionError(f"another process is working on the study in {folder}") from None
    return lock


@contextmanager
def _telling(folder: Path) -> Iterator[None]:
    """Errors of the disk as :class:`OutputError` with the folder's name."""
    try:
        yield
    except sqlite3.DatabaseError as error:
        raise OutputError(f"{folder / FILE}: {error}{_room(folder)}") from None
    except Timeout:
        raise
    except OSError as error:
        raise OutputError(f"{folder}: cannot be written: {error.strerror or error}") from None


def _room(folder: Path) -> str:
    """A hint where the disk is full."""
    try:
        status = os.statvfs(folder)
    except (OSError, AttributeError):
        return ""
    free = status.f_bavail * status.f_frsize
    return f" ({free // 1024} KiB are free on that disk)" if free < 2**24 else ""


def _json(value: Any) -> str:
    return json.dumps(value, allow_nan=False)


def _plain(value: Any) -> Any:
    """A figure as SQLite takes it; what is not finite is left empty."""
    if isinstance(value, float | np.floating):
        return float(value) if np.isfinite(value) else None
    return value.item() if isinstance(value, np.generic) else value


def _pack(curves: Curves) -> bytes:
    stream, arrays = io.BytesIO(), dict[str, Any](curves)
    np.savez_compressed(stream, **arrays)
    return stream.getvalue()


def _unpack(content: bytes) -> dict[str, NDArray[Any]]:
    with np.load(io.BytesIO(content), allow_pickle=False) as archive:
        return {name: archive[name] for name in archive.files}
