"""The folder of a clearing-time map: what it is about, and a line of JSON for each place.

A line is there whole or not at all: what a kill has left of one is dropped, and its place is done
again.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TextIO

from filelock import FileLock

from gridfold.errors import CaseFileError, OptionError
from gridfold.io.input_files import is_there
from gridfold.io.results import json_text, replacing, write_json
from gridfold.io.study_folder import lock, telling
from gridfold.io.tables import read_text

#: What the map is about, and its rows.
IDENTITY, ROWS = "clearing.json", "clearing_times.jsonl"
#: What a row has at least.
_NEEDED = frozenset({"number", "cct_s", "bounded", "runs"})


def holds_clearing_times(folder: Path) -> bool:
    """Whether a folder holds a clearing-time map."""
    return is_there(folder / IDENTITY)


class ClearingStore:
    """A map in a folder. Make it with :meth:`create`, :meth:`resume` or :meth:`read`."""

    def __init__(self, folder: Path, identity: Mapping[str, Any], held: FileLock | None = None):
        self.folder, self.identity = folder, identity
        self._lock = held
        self._stream: TextIO | None = None

    @classmethod
    def create(cls, folder: str | Path, identity: Mapping[str, Any]) -> ClearingStore:
        """A new map; `identity` is what it is about, ready for JSON.

        Raises
        ------
        OptionError
            The folder holds one, or another process works on it.
        OutputError
            It cannot be written.
        """
        folder = Path(folder)
        with telling(folder):
            folder.mkdir(parents=True, exist_ok=True)
        held = lock(folder, "clearing times")
        try:
            if holds_clearing_times(folder):
                raise OptionError(
                    f"{folder} holds clearing times already; go on with --resume (resume=True)"
                )
            write_json(folder / IDENTITY, identity)
            return cls(folder, json.loads(json_text(identity)), held)._opened([])
        except BaseException:
            held.release()
            raise

    @classmethod
    def resume(cls, folder: str | Path) -> ClearingStore:
        """A map that is there, to go on writing; an OptionError if there is none."""
        store = cls.read(folder)
        store._lock = lock(store.folder, "clearing times")
        return store._opened(store.rows())

    @classmethod
    def read(cls, folder: str | Path) -> ClearingStore:
        """A map that is there, to look at; an OptionError if there is none."""
        folder = Path(folder)
        if not holds_clearing_times(folder):
            raise OptionError(f"{folder} holds no clearing times: there is no {IDENTITY}")
        file = folder / IDENTITY
        try:
            identity = json.loads(read_text(file))
        except ValueError as error:
            raise CaseFileError(f"not JSON: {error}", str(file)) from None
        wanted = {"case", "fingerprint", "settings", "faults", "map"}
        if not isinstance(identity, dict) or not wanted <= identity.keys():
            raise CaseFileError("it does not tell what the clearing times are about", str(file))
        return cls(folder, identity)

    def __enter__(self) -> ClearingStore:
        return self

    def __exit__(self, *error: object) -> None:
        if self._stream is not None:
            self._stream.close()
        if self._lock is not None:
            self._lock.release()

    def rows(self) -> list[dict[str, Any]]:
        """The rows that are whole, by number; of several for one place the last."""
        file = self.folder / ROWS
        if not is_there(file):
            return []
        found: dict[int, dict[str, Any]] = {}
        for line in read_text(file).splitlines():
            try:
                row = json.loads(line)
            except ValueError:
                continue
            if isinstance(row, dict) and row.keys() >= _NEEDED:
                found[row["number"]] = row
        return [found[number] for number in sorted(found)]

    def add(self, row: Mapping[str, Any]) -> None:
        """Write the row of a place; it has its `number`."""
        assert self._stream is not None
        with telling(self.folder):
            self._stream.write(_line(row))
            self._stream.flush()

    def _opened(self, rows: list[dict[str, Any]]) -> ClearingStore:
        """Ready to be written to, with `rows` in it and nothing else."""
        file = self.folder / ROWS
        with replacing(file) as temporary:
            temporary.write_text("".join(map(_line, rows)), encoding="utf-8")
        with telling(self.folder):
            self._stream = file.open("a", encoding="utf-8")
        return self


def _line(row: Mapping[str, Any]) -> str:
    return json.dumps(row, allow_nan=False) + "\n"
