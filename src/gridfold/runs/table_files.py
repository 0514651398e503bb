"""Tables of a run as files, written part by part."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from enum import Enum
from pathlib import Path

from gridfold.ceilings import require_disk
from gridfold.io.row_files import OpenRows, RowFile, csv_rows, parquet_rows
from gridfold.runs.monitor.columns import Columns, RowReader
from gridfold.runs.parts import Part

#: Rows of a table that are made and written together.
ROWS = 1024


class TableFormat(Enum):
    """Formats of tables."""

    CSV = "csv"
    PARQUET = "parquet"

    @property
    def open(self) -> OpenRows:
        """What opens a file of the format."""
        return {TableFormat.CSV: csv_rows, TableFormat.PARQUET: parquet_rows}[self]

    @property
    def bytes_a_number(self) -> int:
        """Length of a number in a file, roughly."""
        return {TableFormat.CSV: 20, TableFormat.PARQUET: 8}[self]


@dataclass(frozen=True)
class TableWriter:
    """Writes the rows of a run into a file, and its metadata at the end."""

    file: RowFile
    rows: RowReader

    def take(self, part: Part) -> None:
        """Write the next rows."""
        for block in part.blocks(ROWS):
            self.file.append(self.rows.take(block))


@dataclass(frozen=True)
class TableFile:
    """A table of a run: where, in which format, and with which columns."""

    path: Path
    format: TableFormat
    columns: Columns

    @contextmanager
    def open(self) -> Iterator[TableWriter]:
        """What writes it; the file takes its name at the end of the block."""
        with self.format.open(self.path, self.columns.header) as file:
            yield TableWriter(file, self.columns.reader())

    def check_size(self, samples: float) -> None:
        """Refuse a table of a run of so many rows that does not fit on its disk.

        Raises
        ------
        OutputError
            It does not.
        """
        count, samples = len(self.columns.header), samples / self.columns.every
        require_disk(
            self.path,
            f"a table of {samples:,.0f} rows and {count:,} columns",
            samples * count * self.format.bytes_a_number,
            "Fewer columns or rows (--monitor), a longer step or an earlier end take less.",
        )
