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
from collections.abc import Collection, Mapping, Sequence
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from filelock import FileLock
from numpy.typing import NDArray

from gridfold.cards import Card
from gridfold.errors import OptionError, OutputError
from gridfold.io.study_damage import (
    LISTED,
    NEEDED,
    UNREADABLE,
    Content,
    Damage,
    examine,
    unpack,
)
from gridfold.io.study_folder import lock, require, telling
from gridfold.io.study_query import chosen_rows
from gridfold.io.study_schema import (
    FILE,
    FORMAT,
    connect,
    figure_columns,
    make_tables,
    seal_all,
    sql_types,
    study_query,
    write_about,
    write_contingency,
    write_result,
)

if TYPE_CHECKING:
    import pandas as pd

#: Noted by a repair that could not read the whole list of contingencies.
INCOMPLETE = "incomplete_list"

Curves = Mapping[str, NDArray[Any]]


class Result(NamedTuple):
    """What is kept of a contingency: its number, the figures by column, its curves."""

    number: int
    figures: Mapping[str, Any]
    curves: Curves | None = None


class StudyStore(Card):
    """The results of one study. Make it with :meth:`create`, :meth:`resume` or :meth:`read`.

    Of a store that is damaged :meth:`read` gives what is whole; `damage` says what is not.
    """

    def _facts(self) -> dict[str, object]:
        return {
            "folder": self.folder,
            "damage": len(self.damage) or "none",
        }

    def __init__(
        self,
        folder: Path,
        connection: sqlite3.Connection,
        lock: FileLock | None = None,
        content: Content | None = None,
    ):
        self.folder = folder
        self.damage: list[Damage] = [] if content is None else list(content.damage)
        self._connection = self._whole = connection
        self._lock = lock
        if content is not None and content.damage:
            self._whole = content.copy()

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
        with telling(folder):
            folder.mkdir(parents=True, exist_ok=True)
        held = lock(folder)
        try:
            if (folder / FILE).exists():
                raise OptionError(
                    f"{folder} holds a study already; go on with --resume, or take another folder"
                )
            # Under another name until it is complete: there is never half a store.
            unfinished = folder / f"{FILE}.new"
            with telling(folder):
                unfinished.unlink(missing_ok=True)
                with closing(connect(unfinished)) as connection, connection:
                    _write_new(connection, identity, contingencies, columns)
                unfinished.replace(folder / FILE)
                return cls(folder, connect(folder / FILE), held)
        except BaseException:
            held.release()
            raise

    @classmethod
    def resume(cls, folder: str | Path) -> StudyStore:
        """A store that is there, to go on writing.

        Raises
        ------
        OptionError
            There is none, another process works on it, it has another format, or it is damaged.
        """
        folder = Path(folder)
        require(folder)
        held = lock(folder)
        try:
            with telling(folder):
                connection = connect(folder / FILE)
                store = cls(folder, connection, held, examine(connection))._checked()
                if store.damage:
                    raise OptionError(
                        f"{folder}: the store is damaged ({store.damage[0]}); gridfold check {folder} "
                        "says what is whole, and with --repair goes on with that"
                    )
                with connection:
                    seal_all(connection)
                return store
        except BaseException:
            held.release()
            raise

    @classmethod
    def read(cls, folder: str | Path) -> StudyStore:
        """A store that is there, to read; another process may be writing.

        Raises
        ------
        OptionError
            There is none, or it has another format.
        OutputError
            Nothing of it can be read.
        """
        folder = Path(folder)
        require(folder)
        file = folder / FILE
        # Where it may be written what a killed process left unfinished can be taken back.
        mode = "rw" if os.access(file, os.W_OK) and os.access(folder, os.W_OK) else "ro"
        with telling(folder):
            address = file.resolve().as_uri()
            connection = sqlite3.connect(f"{address}?mode={mode}", uri=True, timeout=60)
            connection.execute("PRAGMA query_only = ON")
            return cls(folder, connection, None, examine(connection))._checked()

    def __enter__(self) -> StudyStore:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the file and let go of the lock."""
        self._connection.close()
        self._whole.close()
        if self._lock is not None:
            self._lock.release()

    @property
    def identity(self) -> dict[str, Any]:
        """What the study is about."""
        with telling(self.folder):
            rows = self._whole.execute("SELECT name, value FROM about").fetchall()
        return {name: json.loads(value) for name, value in rows}

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of all columns of :meth:`frame`."""
        with telling(self.folder):
            return ("number", "name", "kind", *figure_columns(self._whole))

    def require(self, *names: str) -> dict[str, Any]:
        """What the study is about; an OutputError unless all of `names` are there."""
        about = self.identity
        if missing := [name for name in names if name not in about]:
            why = next((str(item) for item in self.damage), "it was never written")
            raise OutputError(f"{self.folder / FILE}: {missing[0]!r} cannot be read: {why}")
        return about

    def tell(self, name: str, value: Any) -> None:
        """Note something further about the study, ready for JSON."""
        with telling(self.folder), self._connection as connection:
            write_about(connection, name, _json(value))

    def contingencies(self) -> list[dict[str, Any]]:
        """Records of all contingencies, by number."""
        with telling(self.folder):
            rows = self._whole.execute(
                "SELECT number, name, kind, events FROM contingency ORDER BY number"
            ).fetchall()
        return [
            {"number": number, "name": name, "kind": kind, "events": json.loads(events)}
            for number, name, kind, events in rows
        ]

    def done(self) -> set[int]:
        """Numbers of the contingencies that have a result."""
        with telling(self.folder):
            return {row[0] for row in self._whole.execute("SELECT number FROM result")}

    def failed(self) -> set[int]:
        """Numbers of the contingencies whose result is a failure."""
        with telling(self.folder):
            rows = self._whole.execute("SELECT number FROM result WHERE status = 'failed'")
            return {row[0] for row in rows}

    def add(self, results: Sequence[Result], again: Collection[int] = ()) -> None:
        """Write results. A contingency that has one is refused, but for those tried `again`."""
        with telling(self.folder), self._connection as connection:
            for result in results:
                if result.number in again:
                    for table in ("result", "curves"):
                        connection.execute(
                            f"DELETE FROM {table} WHERE number = ?", (result.number,)
                        )
                figures = {name: _plain(value) for name, value in result.figures.items()}
                write_result(connection, result.number, figures)
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
        query = study_query(figure_columns(self._whole))
        order = f"ORDER BY {order} IS NULL, {order} {'DESC' if descending else 'ASC'}, number"
        with telling(self.folder):
            if where is None:
                rows = self._whole.execute(f"SELECT * FROM ({query}) {order}").fetchall()
            else:
                rows = chosen_rows(self._whole, query, where, order, names)
        frame = pd.DataFrame.from_records(rows, columns=list(names))
        return frame.astype(
            {name: kind for name, kind in self._frame_types().items() if name in frame}
        )

    def _frame_types(self) -> dict[str, str]:
        kinds = {"bool": "boolean", "int": "Int64", "float": "Float64", "str": "string"}
        return {name: kinds[kind] for name, kind in self.identity["columns"].items()}

    def curves(self, number: int) -> dict[str, NDArray[Any]] | None:
        """Curves of a contingency, None if there are none, or if they are damaged."""
        try:
            row = self._connection.execute(
                "SELECT content FROM curves WHERE number = ?", (number,)
            ).fetchone()
            return None if row is None else unpack(row[0])
        except UNREADABLE as error:
            self.damage.append(Damage(f"curves of contingency {number}", str(error), number))
            return None

    @property
    def connection(self) -> sqlite3.Connection:
        """The connection to the file, for those that look at it as a whole."""
        return self._connection

    def complete_list(self, contingencies: Sequence[Mapping[str, Any]]) -> None:
        """Add what a repair could not read of the list of contingencies, if that is this list."""
        wanted = {item["number"]: json.loads(_json(item)) for item in contingencies}
        there = {item["number"]: item for item in self.contingencies()}
        if INCOMPLETE not in self.identity or not there.items() <= wanted.items():
            return
        with telling(self.folder), self._connection as connection:
            _write_list(connection, [wanted[k] for k in wanted.keys() - there.keys()])
            connection.execute("DELETE FROM about WHERE name = ?", (INCOMPLETE,))

    def _checked(self) -> StudyStore:
        try:
            found = self.require(*NEEDED)["format"]
        except OutputError:
            self.close()
            raise
        if found != FORMAT:
            self.close()
            raise OptionError(
                f"{self.folder}: the store has format {found}, this version of gridfold reads {FORMAT}"
            )
        return self


def _write_new(
    connection: sqlite3.Connection,
    identity: Mapping[str, Any],
    contingencies: Sequence[Mapping[str, Any]],
    columns: Mapping[str, type],
) -> None:
    about = {
        "format": FORMAT,
        "columns": {name: kind.__name__ for name, kind in columns.items()},
        LISTED: len(contingencies),
        **identity,
    }
    make_tables(connection, sql_types(columns), {name: _json(v) for name, v in about.items()})
    _write_list(connection, contingencies)


def _write_list(connection: sqlite3.Connection, contingencies: Sequence[Mapping[str, Any]]) -> None:
    for item in contingencies:
        row = (item["number"], item["name"], item["kind"], _json(item["events"]))
        write_contingency(connection, row)


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
