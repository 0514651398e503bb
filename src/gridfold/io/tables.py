"""Tables in CSV files, read into records with file and line kept for every error."""

from __future__ import annotations

import csv
import difflib
import tomllib
import types
import typing
from collections.abc import Callable, Sequence
from dataclasses import MISSING, dataclass, field, fields
from enum import Enum
from pathlib import Path
from typing import Any

from gridfold.errors import CaseFileError
from gridfold.io.input_files import read_content

_TRUE = {"1", "true", "yes"}
_FALSE = {"0", "false", "no"}


@dataclass
class Table:
    """Rows of a CSV file as (line number, cells by column); `faults` collects what is wrong."""

    path: Path
    columns: list[str] = field(default_factory=list)
    header_line: int = 1
    rows: list[tuple[int, dict[str, str]]] = field(default_factory=list)
    faults: list[str] = field(default_factory=list)

    def fault(self, line: int, message: str) -> None:
        """Note a fault at a line."""
        self.faults.append(f"{self.path}:{line}: {message}")


def read_text(path: Path) -> str:
    """Text of a UTF-8 file; :class:`CaseFileError` names the file and the reason otherwise."""
    try:
        return _content(path).decode("utf-8")
    except UnicodeDecodeError as error:
        raise CaseFileError(f"not UTF-8 text: {error}", str(path)) from None


def read_foreign_text(path: Path) -> str:
    """Text of another program's file; what is not UTF-8 is read byte by byte."""
    content = _content(path).rstrip(b"\x1a")  # an old mark of the end
    try:
        return content.decode("utf-8")
    except UnicodeDecodeError:
        return content.decode("latin-1")


def _content(path: Path) -> bytes:
    """Bytes of a file without the mark of its encoding."""
    return read_content(path).removeprefix(b"\xef\xbb\xbf")


def read_toml(path: Path) -> dict[str, Any]:
    """Content of a TOML file."""
    text = read_text(path)
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # numbers too long, tables too deep
        raise CaseFileError(f"not TOML: {error}", str(path)) from None


def read_table(path: Path) -> Table:
    """Split a CSV file with a header line into rows; blank lines and lines after # are skipped."""
    table = Table(path)
    reader = csv.reader(read_text(path).splitlines(), strict=True, skipinitialspace=True)
    try:
        for cells in reader:
            cells = [cell.strip() for cell in cells]
            if not any(cells) or cells[0].startswith("#"):
                continue
            if not table.columns:
                table.columns, table.header_line = cells, reader.line_num
                for name in {c for c in cells if cells.count(c) > 1}:
                    table.fault(reader.line_num, f"column {name!r} is given twice")
            elif len(cells) != len(table.columns):
                expected = len(table.columns)
                table.fault(reader.line_num, f"{len(cells)} cells, but {expected} columns")
            else:
                row = dict(zip(table.columns, cells, strict=True))
                table.rows.append((reader.line_num, row))
    except csv.Error as error:
        table.fault(reader.line_num, f"not a CSV line: {error}")
    if not table.columns:
        table.fault(1, "there is no header line")
    return table


def suggest(name: str, known: Sequence[str]) -> str:
    """A hint at the known name nearest to `name`, or the list of known names."""
    close = difflib.get_close_matches(name, known, n=1)
    return f"did you mean {close[0]!r}?" if close else f"known: {', '.join(known)}"


def parse_cell(text: str, kind: Any) -> Any:
    """Convert a cell to a field's type; raises ValueError with a readable reason."""
    if isinstance(kind, types.UnionType):
        kind = next(option for option in typing.get_args(kind) if option is not type(None))
    if kind is str:
        return text
    if kind is bool:
        if text.lower() in _TRUE | _FALSE:
            return text.lower() in _TRUE
        raise ValueError(f"{text!r} is neither true nor false")
    if isinstance(kind, type) and issubclass(kind, Enum):
        options = [member.value for member in kind]
        if text not in options:
            raise ValueError(f"{text!r} is not one of {', '.join(options)}")
        return kind(text)
    names: dict[Any, str] = {int: "a whole number", float: "a number"}
    try:
        if "_" in text:  # Python would read 1_0 as 10
            raise ValueError
        return kind(text)
    except ValueError:
        raise ValueError(f"{text!r} is not {names[kind]}") from None


def read_records(
    table: Table, record_type: Callable[..., Any], kinds: dict[str, Any]
) -> list[tuple[int, Any]]:
    """Build a record from each row, as (line, record); faults go into ``table.faults``.

    An empty cell stands for the field's default.
    """
    required = [f.name for f in fields(record_type) if _is_required(f)]  # type: ignore[arg-type]
    for name in table.columns:
        if name not in kinds:
            table.fault(table.header_line, f"unknown column {name!r}; {suggest(name, list(kinds))}")
    for name in required:
        if table.columns and name not in table.columns:
            table.fault(table.header_line, f"column {name!r} is missing")
    if table.faults:
        return []
    records = []
    for line, cells in table.rows:
        values = parse_row(table, line, cells, kinds, required)
        if values is not None:
            records.append((line, record_type(**values)))
    return records


def parse_row(
    table: Table, line: int, cells: dict[str, str], kinds: dict[str, Any], required: Sequence[str]
) -> dict[str, Any] | None:
    """Convert the cells of one row; None if any of them is at fault."""
    values: dict[str, Any] = {}
    sound = True
    for name, text in cells.items():
        if not text:
            if name in required:
                table.fault(line, f"{name} is empty")
                sound = False
            continue
        try:
            values[name] = parse_cell(text, kinds[name])
        except ValueError as error:
            table.fault(line, f"{name}: {error}")
            sound = False
    return values if sound else None


def _is_required(item: Any) -> bool:
    return item.default is MISSING and item.default_factory is MISSING
