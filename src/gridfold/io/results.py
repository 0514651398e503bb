"""Result files. Each is written to a temporary name first: there is never half a file."""

from __future__ import annotations

import contextlib
import csv
import io
import json
import os
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from gridfold.errors import OutputError

if TYPE_CHECKING:
    import pandas as pd

METADATA_KEY = "gridfold"


def check_target(path: Path) -> None:
    """Refuse a path under which no file can be written; nothing is made there.

    Raises
    ------
    OutputError
        It is empty, a folder, a pipe or a device, or in no folder that can be written to.
    """
    try:
        _check_target(path)
    except (OSError, ValueError) as error:  # a name with a null character is a ValueError
        reason = getattr(error, "strerror", None) or error
        raise OutputError(f"{path}: cannot be written: {reason}") from None


def _check_target(path: Path) -> None:
    if path.exists() and not path.is_file():
        kind = "a folder" if path.is_dir() else "a pipe or a device"
        raise OutputError(f"{path}: cannot be written: it is {kind}, not a file")
    if not path.name or path.name == "..":
        raise OutputError(f"{path}: cannot be written: this is no name of a file")
    folder = next((place for place in path.absolute().parents if place.exists()), Path("/"))
    if not folder.is_dir():
        raise OutputError(f"{path}: cannot be written: {folder} is not a folder")
    if not os.access(folder, os.W_OK | os.X_OK):
        raise OutputError(f"{path}: cannot be written: {folder} cannot be written to")


@contextlib.contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A temporary path beside `path` that takes its name if nothing goes wrong."""
    check_target(path)
    temporary: Path | None = None
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(
            dir=path.parent, prefix=f".{path.stem}-", suffix=path.suffix
        )
        os.close(handle)
        temporary = Path(name)
        temporary.chmod(0o666 & ~_umask())
        yield temporary
        temporary.replace(path)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {error.strerror or error}") from None
    finally:
        if temporary is not None:
            temporary.unlink(missing_ok=True)


def write_new(path: Path, text: str) -> None:
    """Write a text to a file that is not there yet; an :class:`OutputError` otherwise."""
    check_target(path)
    if path.exists():
        raise OutputError(f"{path}: exists already; nothing was written")
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def write_json(path: Path, data: Any) -> None:
    """Write JSON with two spaces of indentation."""
    text = json_text(data)
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def write_csv(path: Path, frame: pd.DataFrame, metadata: Mapping[str, Any]) -> None:
    """Write a table as CSV, every digit kept, and its metadata as ``NAME.meta.json`` beside it."""
    import pyarrow as pa
    import pyarrow.csv as pc

    text = json_text(metadata)
    rows = pa.Table.from_pandas(frame, preserve_index=False)
    beside = path.with_name(path.name + ".meta.json")
    with replacing(beside) as notes, replacing(path) as table:
        with table.open("wb") as stream:
            stream.write(csv_line(frame.columns).encode())
            pc.write_csv(rows, stream, pc.WriteOptions(include_header=False))
        notes.write_text(text, encoding="utf-8")


def write_parquet(path: Path, frame: pd.DataFrame, metadata: Mapping[str, Any]) -> None:
    """Write a table as Parquet with the metadata in its schema, under the key ``gridfold``."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    table = pa.Table.from_pandas(frame, preserve_index=False)
    text = {METADATA_KEY: json.dumps(metadata)}
    table = table.replace_schema_metadata({**(table.schema.metadata or {}), **text})
    with replacing(path) as temporary:
        pq.write_table(table, temporary)


def write_npz(path: Path, arrays: Mapping[str, NDArray[Any]], metadata: Mapping[str, Any]) -> None:
    """Write arrays as a compressed NumPy archive with the metadata as JSON text."""
    content: dict[str, Any] = {**arrays, "metadata": np.array(json.dumps(metadata))}
    with replacing(path) as temporary, temporary.open("wb") as stream:
        np.savez_compressed(stream, **content)


def csv_line(cells: Iterable[str]) -> str:
    """A line of CSV; names with commas or quotes stand in quotes."""
    line = io.StringIO()
    csv.writer(line, lineterminator="\n").writerow(cells)
    return line.getvalue()


def json_text(data: Any) -> str:
    """JSON with two spaces of indentation."""
    return json.dumps(data, indent=2, allow_nan=False) + "\n"


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
