"""The folder of a data set: Parquet files of chunks, what it is about, and its card.

A file of a chunk is there whole or not at all, so that a kill at any time loses chunks that were worked
on, and nothing else.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pyarrow as pa
import pyarrow.parquet as pq
from filelock import FileLock

from gridfold.errors import CaseFileError, OptionError
from gridfold.io.input_files import is_there
from gridfold.io.results import json_text, replacing, write_json
from gridfold.io.study_folder import lock, telling
from gridfold.io.tables import read_text

if TYPE_CHECKING:
    import pandas as pd

#: What the data set is about; the folders of samples and curves; the card.
IDENTITY, SAMPLES, CURVES = "plan.json", "samples", "trajectories"
CARD_TEXT, CARD_RECORD = "card.md", "card.json"
_PART = "part-{:06d}.parquet"
_TYPES = {int: pa.int64(), float: pa.float64(), str: pa.string(), bool: pa.bool_()}


def require_free(folder: Path) -> None:
    """Raise an OptionError if a folder holds samples."""
    if is_there(folder / IDENTITY):
        raise OptionError(f"{folder} holds samples already; go on with --resume (resume=True)")


class SampleStore:
    """A data set in a folder. Make it with :meth:`create`, :meth:`resume` or :meth:`read`."""

    def __init__(self, folder: Path, identity: Mapping[str, Any], held: FileLock | None = None):
        self.folder = folder
        self.identity = identity
        self._lock = held

    @classmethod
    def create(cls, folder: str | Path, identity: Mapping[str, Any]) -> SampleStore:
        """A new data set; `identity` is what it is about, ready for JSON.

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
        held = lock(folder, "samples")
        try:
            require_free(folder)
            write_json(folder / IDENTITY, identity)
            return cls(folder, json.loads(json_text(identity)), held)._tidied()
        except BaseException:
            held.release()
            raise

    @classmethod
    def resume(cls, folder: str | Path) -> SampleStore:
        """A data set that is there, to go on writing; an OptionError if there is none."""
        store = cls.read(folder)
        store._lock = lock(store.folder, "samples")
        return store._tidied()

    @classmethod
    def read(cls, folder: str | Path) -> SampleStore:
        """A data set that is there, to look at; an OptionError if there is none."""
        folder = Path(folder)
        if not is_there(folder / IDENTITY):
            raise OptionError(f"{folder} holds no samples: there is no {IDENTITY}")
        try:
            identity = json.loads(read_text(folder / IDENTITY))
        except ValueError as error:
            raise CaseFileError(f"not JSON: {error}", str(folder / IDENTITY)) from None
        if not isinstance(identity, dict) or "plan" not in identity:
            raise CaseFileError("there is no plan in it", str(folder / IDENTITY))
        return cls(folder, identity)

    def __enter__(self) -> SampleStore:
        return self

    def __exit__(self, *error: object) -> None:
        if self._lock is not None:
            self._lock.release()

    def tell(self, **identity: Any) -> None:
        """Write down what is another value now in what it is about."""
        self.identity = {**self.identity, **json.loads(json_text(identity))}
        write_json(self.folder / IDENTITY, self.identity)

    def counts(self) -> dict[int, int]:
        """How many samples each chunk has that is whole, by position."""
        found = {}
        for path in sorted((self.folder / SAMPLES).glob("part-*.parquet")):
            try:
                rows = pq.read_metadata(path).num_rows
            except (pa.ArrowException, OSError):
                continue
            found[int(path.stem.removeprefix("part-"))] = rows
        return found

    def table(self, position: int, columns: Sequence[str]) -> list[dict[str, Any]]:
        """Some columns of the samples of a chunk."""
        path = self.folder / SAMPLES / _PART.format(position)
        rows: list[dict[str, Any]] = pq.read_table(path, columns=list(columns)).to_pylist()
        return rows

    def write(
        self,
        position: int,
        rows: Sequence[Mapping[str, Any]],
        columns: Mapping[str, type],
        curves: bytes | None,
    ) -> None:
        """Write a chunk: `rows` with the types of `columns`, and curves as a Parquet file."""
        name = _PART.format(position)
        if curves is not None:
            with replacing(self.folder / CURVES / name) as temporary:
                temporary.write_bytes(curves)
        schema = pa.schema([(column, _TYPES[kind]) for column, kind in columns.items()])
        table = pa.Table.from_pylist([dict(row) for row in rows], schema=schema)
        with replacing(self.folder / SAMPLES / name) as temporary:
            pq.write_table(table, temporary, compression="zstd")

    def frame(self, columns: Sequence[str] | None = None) -> pd.DataFrame:
        """All samples, or some `columns` of them, by number; what does not apply is missing."""
        import pandas as pd

        parts = [
            pq.read_table(self.folder / SAMPLES / _PART.format(position), columns=columns)
            for position in sorted(self.counts())
        ]
        if not parts:
            return pd.DataFrame(columns=list(columns or ()))
        nullable = {pa.int64(): pd.Int64Dtype(), pa.bool_(): pd.BooleanDtype()}
        frame: pd.DataFrame = pa.concat_tables(parts).to_pandas(types_mapper=nullable.get)
        return frame

    def write_card(self, text: str, record: Mapping[str, Any]) -> None:
        """Write the data card, for people and for programs."""
        write_json(self.folder / CARD_RECORD, record)
        with replacing(self.folder / CARD_TEXT) as temporary:
            temporary.write_text(text, encoding="utf-8")

    def _tidied(self) -> SampleStore:
        """Without what a kill has left of files that were being written."""
        with telling(self.folder):
            for place in (SAMPLES, CURVES):
                for path in (self.folder / place).glob(".part-*"):
                    path.unlink()
        return self
