"""The tables of a MATPOWER file, as far as they are literal; nothing is run.

A known table is given once, as numbers: ``mpc.bus = [ ... ];``. Besides, whole columns may be
multiplied or divided by a number, as MATPOWER's files of distribution grids do for ohms and kilowatts.
Every other statement that could change the case is refused; see
:mod:`gridfold.io.matpower_statements`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Any

from gridfold.io.matlab_text import Row, statements
from gridfold.io.matlab_values import Table
from gridfold.io.matpower_statements import StatementReader

_WIDTHS = {"bus": 13, "gen": 10, "branch": 13, "dcline": 17, "storage": 17}  # the least of them
_STATUS = {"gen": 7, "branch": 10, "dcline": 2}  # columns, counted from 0
_ENDS = {"branch": 2, "dcline": 2}  # of records at more than one bus
_NO_TABLE = Table((), ())
_NEEDED = ("baseMVA", "bus", "gen", "branch")


@dataclass(frozen=True)
class MatpowerFile:
    """What a MATPOWER file says literally.

    Parameters
    ----------
    base_mva : float or None
        Base power in MVA; None if it is not given.
    tables : mapping of str to Table
        Tables of the network by field.
    bus_names : tuple of str
        Names in the order of the buses; empty if there are none.
    faults : tuple of str
        What makes the file unreadable, with lines.
    refused : tuple of str
        Statements that could change the case and are not evaluated, each with file and line.
    unread : tuple of str
        Fields that gridfold does not know, likewise.
    file : str
        Name of the file.
    """

    base_mva: float | None
    tables: Mapping[str, Table]
    bus_names: tuple[str, ...]
    faults: tuple[str, ...]
    refused: tuple[str, ...]
    unread: tuple[str, ...]
    file: str

    def places(self, records: Mapping[str, Sequence[Mapping[str, Any]]]) -> dict[str, list[str]]:
        """File and line of each of powerio's records; loads and shunts stand in the rows of buses."""
        at = {
            name: [f"{self.file}:{line}" for line in found.lines]
            for name, found in self.tables.items()
        }
        buses = dict(zip((row["id"] for row in records["buses"]), at["bus"], strict=True))
        return {
            "buses": at["bus"],
            "generators": at["gen"],
            "branches": at["branch"],
            "hvdc": at.get("dcline", []),
            "loads": [buses.get(row["bus"], "") for row in records["loads"]],
            "shunts": [buses.get(row["bus"], "") for row in records["shunts"]],
        }

    @property
    def text(self) -> str:
        """The tables alone, written plainly."""
        base = () if self.base_mva is None else (f"mpc.baseMVA = {_digits(self.base_mva)};",)
        names = ("'" + name.replace("'", "''") + "';" for name in self.bus_names)
        tables = {name: _switched(name, found.rows) for name, found in self.tables.items()}
        parts: list[Iterator[str] | Sequence[str]] = [
            ("function mpc = case", "mpc.version = '2';", *base),
            *(
                chain((f"mpc.{name} = [",), (_plain(row) for row in rows), ("];",))
                for name, rows in tables.items()
            ),
            ("mpc.bus_name = {", *names, "};") if self.bus_names else (),
        ]
        return "\n".join(chain.from_iterable(parts)) + "\n"


def read_matpower(text: str, file: str) -> MatpowerFile:
    """Read the text of a MATPOWER file; `file` is its name, for places."""
    reader = StatementReader()
    reader.read(statements(text))
    found = reader.workspace
    given = {*found.tables, *(() if found.base_mva is None else ("baseMVA",))}
    absent = [f"{found.struct}.{name}" for name in _NEEDED if name not in given]
    hint = "; in version 1 of the format? MATPOWER's savecase writes it anew"
    faults = [f"there is no {name}{hint if reader.is_version_1 else ''}" for name in absent]
    if reader.bus_names and len(reader.bus_names) != len(found.tables.get("bus", _NO_TABLE).rows):
        faults.append(f"{len(reader.bus_names)} names of buses do not go with their table")
    return MatpowerFile(
        found.base_mva,
        found.tables,
        reader.bus_names,
        (*reader.faults, *_faulty_rows(found.tables), *faults),
        tuple(f"{text} ({file}:{line})" for line, text in reader.refused),
        tuple(f"not read: {text} ({file}:{line})" for line, text in reader.unread.items()),
        file,
    )


def _faulty_rows(tables: Mapping[str, Table]) -> Iterator[str]:
    """Rows that are too short; buses, types and states of switches that have no meaning."""
    buses: set[float] = set()
    for name in sorted(tables, key=lambda name: name != "bus") if "bus" in tables else ():
        for row, line in zip(tables[name].rows, tables[name].lines, strict=True):
            if len(row) < _WIDTHS[name]:
                yield f"line {line}: {name} has {len(row)} columns, needs {_WIDTHS[name]}"
                break  # as all rows are
            if name != "bus":
                missing = (cell for cell in row[: _ENDS.get(name, 1)] if cell not in buses)
                yield from (f"line {line}: {name}: there is no bus {_digits(k)}" for k in missing)
                status = row[_STATUS[name]] if name in _STATUS else 0
                if name != "gen" and status not in (0, 1):
                    yield f"line {line}: {name}: status {_digits(status)} is neither 0 nor 1"
                continue
            if not row[0] >= 1 or row[0] % 1:
                yield f"line {line}: {_digits(row[0])} is no bus number"
            if row[0] in buses:
                yield f"line {line}: bus {_digits(row[0])} is given a second time"
            if row[1] not in (1, 2, 3, 4):
                yield f"line {line}: bus {_digits(row[0])} is of type {_digits(row[1])}, not 1 to 4"
            buses.add(row[0])


def _switched(name: str, rows: Sequence[Row]) -> Iterator[Row]:
    """Rows with the status of generators as 0 or 1: MATPOWER runs those with any positive number."""
    at = _STATUS["gen"]
    for row in rows:
        yield (*row[:at], float(row[at] > 0), *row[at + 1 :]) if name == "gen" else row


def _digits(value: float) -> str:
    """A number as MATLAB reads it, without loss."""
    if value != value:
        return "NaN"
    if value in (float("inf"), float("-inf")):
        return "Inf" if value > 0 else "-Inf"
    return f"{value:.0f}" if value == int(value) and abs(value) < 1e15 else repr(value)


def _plain(row: Row) -> str:
    return " ".join(map(_digits, row)) + ";"
