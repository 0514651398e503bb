"""Records and their values by name, as a person writes them: ``GENROU 101:1 H=4``.

A record is named by a word and a place: ``bus 101``, ``load 101:1``, ``shunt 101:1``,
``generator 101:1``, ``branch 101-103:1``, or a device by its model, ``GENROU 101:1``. The id and the
circuit may be left out where there is one alone. Any other place is a choice in the grammar of
:mod:`gridfold.grid.selection_text`, such as ``area:1 except kv<100``, and means all such records there.
A value is named as in gridfold's tables or by its symbol in PSS/E (:mod:`gridfold.editing.symbols`).
"""

from __future__ import annotations

import difflib
import re
import typing
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

from gridfold.dynamics.device import Device, Role
from gridfold.editing.symbols import KEYS, field_name, parameter_name
from gridfold.errors import OptionError
from gridfold.grid.case import (
    LOAD_PREFIX,
    Branch,
    Bus,
    Case,
    DeviceRecord,
    Generator,
    Load,
    Record,
    Shunt,
    UnitKey,
)
from gridfold.grid.event_checks import find_branch
from gridfold.grid.selection import select_buses, select_lines, select_machines
from gridfold.io.tables import parse_cell

_BUS, _BRANCH, _GENERATOR, _LOAD, _SHUNT = "bus", "branch", "generator", "load", "shunt"
#: What each kind of record is called, with the table and the type of such records.
KINDS: Mapping[str, tuple[str, type]] = {
    _BUS: ("buses", Bus),
    _BRANCH: ("branches", Branch),
    _GENERATOR: ("generators", Generator),
    _LOAD: ("loads", Load),
    _SHUNT: ("shunts", Shunt),
}
_SYNONYMS = {
    "line": _BRANCH,
    "transformer": _BRANCH,
    "gen": _GENERATOR,
    "machine": _GENERATOR,
    "unit": _GENERATOR,
}
#: Values of new records for which no default is right, with their symbols.
_NEEDED: Mapping[type, tuple[tuple[str, str], ...]] = {
    Bus: (("BASKV", "base_kv"),),
    Branch: (("X", "reactance"),),
    Generator: (("MBASE", "base_mva"),),
}
#: How names of load models end in PSS/E, where they are those of one load.
_OF_LOAD = "bl"
_STATEMENT = re.compile(r"\s*(\S+)\s+(\S.*?)(?:[\s,]+([^\s=<>]+\s*=.*?))?\s*", re.DOTALL)
_ASSIGNMENT = re.compile(
    r"""[\s,]*([^\s=]+?)\s*=\s*(?:"([^"]*)"|'([^']*)'|([^\s,=]+))(?=[\s,]|$)"""
)
_AT_BUS = re.compile(r"([0-9]{1,18})(?::(\S+))?")
_ENDS = re.compile(r"([0-9]{1,18})-([0-9]{1,18})(?::(\S+))?")


@dataclass(frozen=True)
class Statement:
    """What a text says of records.

    Parameters
    ----------
    kind : str
        A key of `KINDS`, or the name of a device model.
    place : str
        Where they are, as it was written.
    values : tuple of (str, str)
        Names and values, as they were written.
    """

    kind: str
    place: str
    values: tuple[tuple[str, str], ...] = ()

    @property
    def is_device(self) -> bool:
        """Whether it is about a device."""
        return self.kind not in KINDS

    @property
    def name(self) -> str:
        """The records, for messages."""
        return f"{self.kind} {self.place}"


class Found(NamedTuple):
    """A record of a case, and its position in a table."""

    table: str
    position: int
    record: Record


def parse_statement(text: str, devices: Mapping[str, Device]) -> Statement:
    """Read a text such as ``GENROU 101:1 H=4 D=0`` or ``branch 101-103``.

    Raises
    ------
    OptionError
        It has another form, or its first word means nothing.
    """
    match = _STATEMENT.fullmatch(text) if isinstance(text, str) else None
    if match is None:
        raise OptionError(
            "a record is written with a word and a place, such as GENROU 101:1, load 101:1 or "
            f"branch 101-103:1, not {text!r}"
        )
    word = match[1].lower()
    kind = _SYNONYMS.get(word, word)
    if kind not in devices and kind.removesuffix(_OF_LOAD) in devices:
        kind = kind.removesuffix(_OF_LOAD)
    if kind not in KINDS and kind not in devices:
        near = difflib.get_close_matches(word, [*KINDS, *_SYNONYMS, *devices], n=1)
        shown = [name if name in KINDS or name in _SYNONYMS else name.upper() for name in near]
        listed = f"known: {', '.join(KINDS)}, or a device model"
        hint = f"did you mean {shown[0]!r}?" if shown else listed
        raise OptionError(f"{match[1]!r} is no kind of record and no device model; {hint}")
    return Statement(kind, match[2], _assignments(match[3] or ""))


def _assignments(text: str) -> tuple[tuple[str, str], ...]:
    found: dict[str, str] = {}
    end = 0
    while match := _ASSIGNMENT.match(text, end):
        if match[1] in found:
            raise OptionError(f"{match[1]} is given twice")
        found[match[1]] = next(value for value in match.groups()[1:] if value is not None)
        end = match.end()
    if rest := text[end:].strip(" \t\r\n,"):
        raise OptionError(f"values are written NAME=VALUE, not {rest!r}")
    return tuple(found.items())


def split_statements(text: str, devices: Mapping[str, Device]) -> list[Statement]:
    """Statements about several records, such as ``branch 101-103:1, shunt 5``.

    A comma ends one where the word of another one follows.

    Raises
    ------
    OptionError
        As :func:`parse_statement`.
    """
    words = "|".join(map(re.escape, (*KINDS, *_SYNONYMS, *devices)))
    breaks = re.compile(rf",\s*(?=(?:{words})\s)", re.IGNORECASE)
    parts = breaks.split(text) if isinstance(text, str) else [text]
    return [parse_statement(part, devices) for part in parts]


def find_records(case: Case, statement: Statement) -> list[Found]:
    """The records that a statement names: one by its own name, or all that a choice means.

    Raises
    ------
    OptionError
        There is none, or several have the name; names what is there.
    """
    if statement.kind == _BRANCH:
        return _branches(case, statement)
    table = "devices" if statement.is_device else KINDS[statement.kind][0]
    rows = [
        Found(table, k, record)
        for k, record in enumerate(getattr(case, table))
        if not statement.is_device or record.model == statement.kind
    ]
    if not _AT_BUS.fullmatch(statement.place):
        return _chosen(case, statement, rows)
    bus, identifier = _at_bus(statement)
    at_bus = [row for row in rows if _bus_of(row.record) == bus]
    found = [row for row in at_bus if identifier is None or identifier in _ids(row.record)]
    if len(found) > 1:
        listed = ", ".join(f"{bus}:{getattr(row.record, 'id', '')}" for row in found)
        raise OptionError(f"{statement.name}: say which, one of {listed}")
    if not found:
        there = _there(case, statement, bus, at_bus, rows)
        raise OptionError(f"there is no {statement.name}; {there}")
    return found


def _ids(record: Record) -> tuple[str, ...]:
    """What the id of a record may be written as: a device of a load goes by that of the load too."""
    identifier = getattr(record, "id", "")
    return identifier, identifier.removeprefix(LOAD_PREFIX)


def _branches(case: Case, statement: Statement) -> list[Found]:
    if _ENDS.fullmatch(statement.place):
        positions = [find_branch(case, statement.place, statement.name)[0]]
    else:
        ends = select_lines(statement.place, case, statement.name)
        positions = list(dict.fromkeys(end.position for end in ends))
    return [Found("branches", k, case.branches[k]) for k in positions]


def _chosen(case: Case, statement: Statement, rows: Sequence[Found]) -> list[Found]:
    """The records at buses that a choice means."""
    if statement.kind == _GENERATOR or statement.is_device:
        keys = [UnitKey(_bus_of(row.record), row.record.id) for row in rows]  # type: ignore[union-attr]
        units = set(select_machines(statement.place, case, statement.name, among=keys))
        found = [row for row, key in zip(rows, keys, strict=True) if key in units]
    else:
        buses = set(select_buses(statement.place, case, statement.name))
        found = [row for row in rows if _bus_of(row.record) in buses]
    if not found:
        raise OptionError(f"there is no {statement.name} in case {case.name}")
    return found


def _at_bus(statement: Statement) -> tuple[int, str | None]:
    match = _AT_BUS.fullmatch(statement.place)
    if match is None or (statement.kind == _BUS and match[2]):
        form = "BUS" if statement.kind == _BUS else "BUS:ID"
        raise OptionError(f"a {statement.kind} is named by {form}, not by {statement.place!r}")
    return int(match[1]), match[2]


def _bus_of(record: Any) -> int:
    return int(record.number if isinstance(record, Bus) else record.bus)


def _there(
    case: Case, statement: Statement, bus: int, at_bus: Sequence[Found], rows: Sequence[Found]
) -> str:
    """What is at the place of a record that is not there, or the nearest one."""
    if at_bus:
        return f"at the bus: {', '.join(str(row.record) for row in at_bus)}"
    if statement.is_device:
        own = [record for record in case.devices if record.bus == bus]
        if own:
            return f"at the bus: {', '.join(f'{r.model.upper()} {r.key}' for r in own)}"
    near = min(rows, key=lambda row: abs(_bus_of(row.record) - bus), default=None)
    what = f"case {case.name} has none" if near is None else f"the nearest is {near.record}"
    return what if bus in case.bus_index else f"there is no bus {bus}; {what}"


def new_record(statement: Statement, devices: Mapping[str, Device]) -> Record:
    """The record that a statement describes, with defaults for what it does not say.

    Raises
    ------
    OptionError
        A name or a value means nothing.
    """
    if statement.kind == _BRANCH:
        match = _ENDS.fullmatch(statement.place)
        if match is None:
            raise OptionError(f"a branch is named FROM-TO:CIRCUIT, not {statement.place!r}")
        record: Record = Branch(int(match[1]), int(match[2]), match[3] or "1")
    else:
        bus, identifier = _at_bus(statement)
        kind = KINDS.get(statement.kind, ("", DeviceRecord))[1]
        if kind is Bus:
            record = Bus(bus)
        elif kind is DeviceRecord:
            unit = identifier or "1"
            if devices[statement.kind].role is Role.LOAD and not unit.startswith(LOAD_PREFIX):
                unit = f"{LOAD_PREFIX}{unit}"
            record = DeviceRecord(statement.kind, bus, unit)
        else:
            record = kind(bus, identifier or "1")
    return with_values(record, statement.values, devices)


def require_values(statement: Statement, record: Record) -> None:
    """Raise an OptionError unless a statement gives the values that have no default in a new record."""
    needed = _NEEDED.get(type(record), ())
    given = {field_name(type(record), name) for name, _ in statement.values} if needed else set()
    if missing := [f"{symbol} ({field})" for symbol, field in needed if field not in given]:
        raise OptionError(f"a new {record} needs {', '.join(missing)}")
    if isinstance(record, Load | Shunt) and not statement.values:
        raise OptionError(f"a new {record} needs its power, as NAME=VALUE")


def with_values(
    record: Record, values: Sequence[tuple[str, str]], devices: Mapping[str, Device]
) -> Record:
    """The record with other values.

    Raises
    ------
    OptionError
        It has no such value, or the text is none of its type: all of them.
    """
    faults: list[str] = []
    given: dict[str, Any] = {}
    for name, text in values:
        try:
            field, value = _value(record, name, text, devices)
        except (OptionError, ValueError) as error:
            faults.append(f"{record}: {name}: {error}")
            continue
        if field in given:
            faults.append(f"{record}: {name} is {field}, which is given already")
        given[field] = value
    if faults:
        raise OptionError("; ".join(faults))
    if isinstance(record, DeviceRecord):
        return replace(record, parameters={**record.parameters, **given})
    return replace(record, **given)


def _value(record: Record, name: str, text: str, devices: Mapping[str, Device]) -> tuple[str, Any]:
    if isinstance(record, DeviceRecord):
        field = parameter_name(devices[record.model], name)
        return field, parse_cell(text, float)
    field = field_name(type(record), name)
    if field in KEYS:
        raise OptionError("it names the record; add another one instead")
    return field, parse_cell(text, typing.get_type_hints(type(record))[field])
