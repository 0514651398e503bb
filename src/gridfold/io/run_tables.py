"""Tables of runs read back: CSV with its metadata beside it, or Parquet with them within."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gridfold.errors import CaseFileError
from gridfold.io.input_files import check_regular
from gridfold.io.results import METADATA_KEY

_TIME = "time"
_SUFFIXES = (".csv", ".parquet")


@dataclass(frozen=True)
class RunTable:
    """A table of a run: times in s (n,), its other columns (n,) by name, and the metadata if any."""

    path: Path
    times: NDArray[np.float64]
    values: Mapping[str, NDArray[np.float64]]
    metadata: Mapping[str, Any] = field(default_factory=dict)

    @property
    def columns_record(self) -> Mapping[str, Any]:
        """What the metadata say about the grid of the columns; empty without them."""
        record = self.metadata.get("columns", {})
        return record if isinstance(record, dict) else {}


def is_run_table(path: Path) -> bool:
    """Whether a path is named as a table of a run is."""
    return path.suffix.lower() in _SUFFIXES


def read_run_table(path: str | Path) -> RunTable:
    """Read a table that :meth:`gridfold.Trajectory.to_csv` or ``to_parquet`` has written.

    A CSV file of another program is read too, if it has a column ``time`` and numbers.

    Raises
    ------
    CaseFileError
        It cannot be read, has no column ``time``, or holds something else than numbers.
    """
    path = Path(path)
    if not is_run_table(path):
        known = " or ".join(_SUFFIXES)
        raise CaseFileError(f"a table of a run ends in {known}, not {path.suffix!r}", str(path))
    check_regular(path)
    table, metadata = _read(path)
    faults = [
        f"column {name!r} holds {table.schema.field(name).type}, not numbers"
        for name in table.column_names
        if not _is_number(table.schema.field(name).type)
    ]
    if _TIME not in table.column_names:
        faults.insert(0, f"there is no column {_TIME!r}")
    if not table.num_rows:
        faults.append("there is no row")
    if faults:
        raise CaseFileError(faults, str(path))
    values = {name: _numbers(table, name) for name in table.column_names}
    times = values.pop(_TIME)
    if not np.all(np.diff(times) >= 0):
        raise CaseFileError("the times do not ascend, or some are missing", str(path))
    return RunTable(path, times, values, metadata)


def _read(path: Path) -> tuple[Any, dict[str, Any]]:
    import pyarrow as pa
    import pyarrow.csv as pc
    import pyarrow.parquet as pq

    try:
        if path.suffix.lower() == ".parquet":
            table = pq.read_table(path)
            text = (table.schema.metadata or {}).get(METADATA_KEY.encode(), b"{}")
            return table, _metadata(text, path)
        table = pc.read_csv(path)
        beside = path.with_name(path.name + ".meta.json")
        return table, _metadata(beside.read_bytes(), beside) if beside.is_file() else {}
    except (pa.ArrowException, OSError) as error:
        raise CaseFileError(f"cannot be read: {error}", str(path)) from None


def _metadata(text: bytes, path: Path) -> dict[str, Any]:
    try:
        found = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise CaseFileError(f"the metadata are not JSON: {error}", str(path)) from None
    return found if isinstance(found, dict) else {}


def _is_number(kind: Any) -> bool:
    import pyarrow as pa

    types = pa.types
    return bool(types.is_floating(kind) or types.is_integer(kind) or types.is_null(kind))


def _numbers(table: Any, name: str) -> NDArray[np.float64]:
    import pyarrow as pa

    column = table.column(name).cast(pa.float64())
    return np.asarray(column.to_numpy(zero_copy_only=False), dtype=np.float64)
