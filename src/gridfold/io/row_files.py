"""Tables that are written row by row, as CSV or Parquet. There is never half a file."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gridfold.io.results import METADATA_KEY, csv_line, json_text, replacing


@dataclass
class RowFile:
    """A table that grows. `metadata` are told of it at the end."""

    append: Callable[[NDArray[np.float64]], None]
    metadata: Mapping[str, Any] = field(default_factory=dict)


OpenRows = Callable[[Path, Sequence[str]], AbstractContextManager[RowFile]]


@contextlib.contextmanager
def csv_rows(path: Path, header: Sequence[str]) -> Iterator[RowFile]:
    """A CSV file, every digit kept, with its metadata as ``NAME.meta.json`` beside it.

    It takes its name at the end of the block, unless something goes wrong.
    """
    import pyarrow as pa
    import pyarrow.csv as pc

    beside = path.with_name(path.name + ".meta.json")
    with replacing(path) as table, replacing(beside) as notes:
        with table.open("wb") as stream:
            stream.write(csv_line(header).encode())

            def append(rows: NDArray[np.float64]) -> None:
                batch = _batch(pa, rows, header)
                pc.write_csv(batch, stream, pc.WriteOptions(include_header=False))

            file = RowFile(append)
            yield file
        notes.write_text(json_text(file.metadata), encoding="utf-8")


@contextlib.contextmanager
def parquet_rows(path: Path, header: Sequence[str]) -> Iterator[RowFile]:
    """A Parquet file with its metadata in the file's own, under the key ``gridfold``."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    schema = pa.schema([(name, pa.float64()) for name in header])
    with (
        replacing(path) as temporary,
        pq.ParquetWriter(temporary, schema, store_schema=False) as writer,
    ):
        file = RowFile(lambda rows: writer.write_batch(_batch(pa, rows, header)))
        yield file
        writer.add_key_value_metadata({METADATA_KEY: json.dumps(file.metadata)})


def _batch(pa: Any, rows: NDArray[np.float64], header: Sequence[str]) -> Any:
    """Rows as Arrow holds them; what is not a number is a gap."""
    columns = [pa.array(column, from_pandas=True) for column in np.asfortranarray(rows).T]
    return pa.record_batch(columns, names=list(header))
