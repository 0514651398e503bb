"""Dynamic data of PSS/E: DYR files.

A record is ``bus 'MODEL' id value value ... /``, over as many lines as it takes. Values are separated
by blanks, tabs, line ends and at most one comma; what follows the ``/`` is a comment to the end of
the line, and so is a line that begins with ``@!``. Texts may stand in quotes. Numbers are written as
in Fortran: ``.5``, ``5.``, ``+1``, ``1.5D-2``.

User-written models (``USRMDL`` and its like), whose third item behind the bus is the name of a model
and whose next six are IC, IT and the numbers of ICONs, CONs, states and VARs, are collected. So are
records that do not begin with a bus number, and what reads as a record behind the ``/`` of another one.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from gridfold.errors import CaseFileError
from gridfold.grid.case import UnitKey
from gridfold.grid.dynamic_records import DynamicData, DynamicRecord, SkippedRecord
from gridfold.io.tables import read_foreign_text

_LINE_END = re.compile(r"\r\n|\n|\r")
_ITEM = re.compile(r"""'(?P<one>[^']*)'|"(?P<two>[^"]*)"|(?P<mark>[,/'"])|(?P<bare>[^\s,/'"]+)""")
_NUMBER = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eEdD][+-]?[0-9]+)?")
_BUS = re.compile(r"[0-9]{1,9}")
_BEGIN = re.compile(r"\s*[0-9]+[\s,]*'\s*[A-Za-z]\w{2,}\s*'")
_COMMENTED = re.compile(
    r"""\s*[0-9]+[\s,]+('\s*[A-Za-z]\w{2,}\s*'|"\s*[A-Za-z]\w{2,}\s*"|[A-Z][A-Z0-9]{2,})"""
    r"""[\s,]+('[^']*'|"[^"]*"|[^\s,/]+)[\s,]+[+-]?\.?[0-9]"""
)
_USER_WRITTEN, _OF_MACHINES = "USR", "USRMDL"
_HEADER = ("bus number", "model name", "id")
_SHOWN = 60


@dataclass(frozen=True)
class _Item:
    text: str
    quoted: bool
    empty_before: bool  # two commas, or one at the beginning, with nothing between

    @property
    def is_number(self) -> bool:
        return not self.quoted and _NUMBER.fullmatch(self.text) is not None


@dataclass
class _OpenRecord:
    """The items of a record that has begun, and its first line."""

    line: int = 0
    items: list[_Item] = field(default_factory=list)
    commas: int = 0

    @property
    def begun(self) -> bool:
        return bool(self.items or self.commas)

    @property
    def user_written(self) -> bool:
        return len(self.items) > 1 and self.items[1].text.upper().startswith(_USER_WRITTEN)

    def add(self, text: str, quoted: bool) -> None:
        allowed = 1 if self.items else 0
        self.items.append(_Item(text.strip(), quoted, self.commas > allowed))
        self.commas = 0

    @property
    def text(self) -> str:
        """Its beginning, for messages."""
        shown = " ".join(f"'{i.text}'" if i.quoted else i.text for i in self.items)
        return shown if len(shown) <= _SHOWN else shown[:_SHOWN] + " ..."

    @property
    def name(self) -> str:
        """Line, bus, model and id, for messages."""
        begin = " ".join(item.text for item in self.items[:3])[:_SHOWN]
        return f"line {self.line}: record {begin!r}"


class _RecordError(Exception):
    """What is wrong with a record."""


def read_dyr(path: str | Path) -> DynamicData:
    """Read a DYR file.

    Raises
    ------
    CaseFileError
        The file cannot be read, or records are malformed: names line and record of each.
    """
    path = Path(path)
    faults: list[str] = []
    records: list[DynamicRecord] = []
    skipped: list[SkippedRecord] = []
    for record in _split(read_foreign_text(path), faults):
        if isinstance(record, SkippedRecord):
            skipped.append(record)
            continue
        try:
            parsed = _parse(record)
        except _RecordError as error:
            faults.append(f"{record.name}: {error}")
            continue
        if isinstance(parsed, DynamicRecord):
            records.append(parsed)
        else:
            skipped.append(parsed)
    if faults:
        raise CaseFileError(faults, str(path))
    return DynamicData(path.name, tuple(records), tuple(skipped))


def _split(text: str, faults: list[str]) -> Iterator[_OpenRecord | SkippedRecord]:
    """The records of a text; what is wrong with their form goes into `faults`."""
    record = _OpenRecord()
    for number, line in enumerate(_LINE_END.split(text), start=1):
        if line.lstrip().startswith("@!"):
            continue
        if record.begun and not record.user_written and _BEGIN.match(line):
            faults.append(f"{record.name} is not ended by / before the record of line {number}")
            record = _OpenRecord()
        for found in _ITEM.finditer(line):
            if not record.begun:
                record.line = number
            kind, content = found.lastgroup, found[found.lastgroup or 0]
            if kind != "mark":
                record.add(content, quoted=kind != "bare")
            elif content == ",":
                record.commas += 1
            elif content == "/":
                if record.begun:
                    yield record
                    yield from _commented(line[found.end() :], number)
                record = _OpenRecord()
                break
            else:
                faults.append(f"line {number}: a quote is not closed: {line[found.start() :][:40]}")
                break
    if record.begun:
        faults.append(f"{record.name} is not ended by /")


def _commented(comment: str, number: int) -> Iterator[SkippedRecord]:
    """What reads as a record in the comment behind a record."""
    for part in comment.split("/"):
        if _COMMENTED.match(part):
            yield SkippedRecord(number, part.strip()[:_SHOWN], is_comment=True)


def _parse(record: _OpenRecord) -> DynamicRecord | SkippedRecord:
    items = record.items
    if not items:
        raise _RecordError("it holds commas alone")
    if items[0].empty_before:
        raise _RecordError("the bus number is empty")
    if not items[0].is_number:
        model = items[1].text.upper() if len(items) > 1 else ""
        return SkippedRecord(record.line, record.text, model=model)
    _check_header(items)
    model, bus, unit_id = items[1].text.upper(), int(items[0].text), items[2].text
    if record.user_written:
        known = None
        if model == _OF_MACHINES:
            with suppress(_RecordError):
                known = _user_written(record, UnitKey(bus, unit_id))
        return SkippedRecord(record.line, record.text, UnitKey(bus, unit_id), user_written=known)
    values = tuple(_value(k, item) for k, item in enumerate(items[3:], start=1))
    if record.commas > 1:
        raise _RecordError(f"value {len(values) + 1} is empty")
    return DynamicRecord(model, bus, unit_id, values, record.line)


def _user_written(record: _OpenRecord, unit: UnitKey) -> DynamicRecord | None:
    """A ``USRMDL`` record by the name of its model; None where it does not have that form."""
    name, items = record.items[3:4], record.items[4:]
    counts = [_number_of(item.text) if item.is_number else -0.5 for item in items[:6]]
    if not name or name[0].is_number or not name[0].text or len(counts) < 6:
        return None
    if not all(count.is_integer() and count >= 0 for count in counts):
        return None
    values = tuple(_value(k, item) for k, item in enumerate(items[6:], start=1))
    announced = int(counts[2]), int(counts[3])
    return DynamicRecord(name[0].text.upper(), unit.bus, unit.id, values, record.line, announced)


def _check_header(items: list[_Item]) -> None:
    for name, item in zip(_HEADER, items, strict=False):
        if item.empty_before or not item.text:
            raise _RecordError(f"the {name} is empty")
    if not _BUS.fullmatch(items[0].text):
        raise _RecordError(f"{items[0].text[:_SHOWN]!r} is not a bus number")
    if len(items) < len(_HEADER):
        raise _RecordError(f"the {_HEADER[len(items)]} is missing")
    if items[1].is_number:
        raise _RecordError(f"a model name is expected, not {items[1].text[:_SHOWN]!r}")


def _value(position: int, item: _Item) -> float | str:
    if item.empty_before:
        raise _RecordError(f"value {position} is empty")
    if not item.is_number:
        return item.text
    value = _number_of(item.text)
    if not math.isfinite(value):
        raise _RecordError(f"value {position} is beyond the range of numbers: {item.text[:_SHOWN]}")
    return value


def _number_of(text: str) -> float:
    return float(re.sub("[dD]", "e", text))
