"""Edits of records: values, in and out of service, new ones, and ones that go."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from gridfold.dynamics.device import Device
from gridfold.editing.edit import Edited
from gridfold.editing.names import (
    KINDS,
    Found,
    find_records,
    new_record,
    parse_statement,
    require_values,
    split_statements,
    with_values,
)
from gridfold.errors import OptionError
from gridfold.grid.case import Bus, Case, DeviceRecord, Generator, Record
from gridfold.grid.flow_controls import FlowControl, UnitControl

_TABLES = {kind: table for table, kind in KINDS.values()} | {DeviceRecord: "devices"}
_STATES = {"in": True, "out": False}
#: Records that a line about an edit names.
_SHOWN = 6


@dataclass(frozen=True)
class Set:
    """Values of a record are set, or of all that a choice means.

    Parameters
    ----------
    record : str
        The record and its new values, such as ``GENROU 101:1 H=4 D=0``, ``branch 101-103 X=0.1`` or
        ``SEXS area:1 K=50``.
    """

    record: str

    def apply(self, case: Case, devices: Mapping[str, Device]) -> Edited:
        """The records have these values."""
        statement = parse_statement(self.record, devices)
        if not statement.values:
            raise OptionError(f"{statement.name}: say what is set, as NAME=VALUE")
        texts, names = [], []
        for found in find_records(case, statement):
            after = with_values(found.record, statement.values, devices)
            changes = ", ".join(_differences(found.record, after)) or "as it was"
            case = _with_set_point(_put(case, found, after), found.record, after)
            texts.append(f"{after}: {changes}")
            names.append(str(after))
        return Edited(case, _shortened("; ", texts), tuple(names))


@dataclass(frozen=True)
class Switch:
    """Branches, units, loads or shunts are switched in or out.

    Parameters
    ----------
    record : str
        Which, such as ``branch 101-103:1`` or ``line area:1 to area:2, unit 101:1``.
    state : {"in", "out"}
        What they are then.
    """

    record: str
    state: str

    def apply(self, case: Case, devices: Mapping[str, Device]) -> Edited:
        """The records are in service, or out of it."""
        if self.state not in _STATES:
            raise OptionError(f"state is 'in' or 'out', not {self.state!r}")
        names = []
        for found in _named(case, self.record, devices):
            if isinstance(found.record, Bus | DeviceRecord):
                raise OptionError(
                    f"{found.record} cannot be switched; branches, generators, loads and shunts can"
                )
            after = replace(found.record, in_service=_STATES[self.state])
            case = _put(case, found, after)
            names.append(str(after))
        return Edited(case, f"{_shortened(', ', names)} {self.state}", tuple(names))


@dataclass(frozen=True)
class Add:
    """A record is added.

    Parameters
    ----------
    record : str or record
        For example ``load 101:2 PL=50 QL=10``, ``SEXS 101:1 K=100 ...``, or a record such as
        :class:`gridfold.Bus`.
    """

    record: str | Record

    def apply(self, case: Case, devices: Mapping[str, Device]) -> Edited:
        """The record stands at the end of its table."""
        statement = None
        record = self.record
        if isinstance(record, str):
            statement = parse_statement(record, devices)
            record = new_record(statement, devices)
        table = _TABLES.get(type(record))
        if table is None:
            raise OptionError(f"{record!r} is no record of a case")
        record = _with_plain_numbers(record)
        rows = getattr(case, table)
        if any(str(row) == str(record) for row in rows):
            raise OptionError(f"{record} is there already")
        if statement is not None:
            require_values(statement, record)
        return Edited(_with_table(case, table, (*rows, record)), f"{record} added", (str(record),))


@dataclass(frozen=True)
class Remove:
    """Records are taken out of the case, such as an exciter that another one is to replace.

    Parameters
    ----------
    record : str
        Which, such as ``SEXS 101:1``; as in :class:`Switch`.
    """

    record: str

    def apply(self, case: Case, devices: Mapping[str, Device]) -> Edited:
        """The records are gone; what hangs on them is told by the check of the case."""
        gone: dict[str, dict[int, Record]] = {}
        for found in _named(case, self.record, devices):
            gone.setdefault(found.table, {})[found.position] = found.record
        for table, records in gone.items():
            rows = enumerate(getattr(case, table))
            case = _with_table(case, table, tuple(row for k, row in rows if k not in records))
        names = [str(record) for records in gone.values() for record in records.values()]
        case = replace(case, flow_controls=tuple(_controls_of(case)))
        return Edited(case, f"{_shortened(', ', names)} removed", ())


def _named(case: Case, text: str, devices: Mapping[str, Device]) -> list[Found]:
    """Records that a text without values names."""
    statements = split_statements(text, devices)
    for statement in statements:
        if statement.values:
            raise OptionError(f"{statement.name}: only set and add give values")
    return [found for statement in statements for found in find_records(case, statement)]


def _with_plain_numbers(record: Record) -> Record:
    """The record with numbers of Python in place of those of NumPy, which print otherwise."""
    if isinstance(record, DeviceRecord):
        values = {name: float(value) for name, value in record.parameters.items()}
        return replace(record, parameters=values)
    scalars = {k: v.item() for k, v in vars(record).items() if isinstance(v, np.generic)}
    return replace(record, **scalars)


def _shortened(separator: str, texts: Sequence[str]) -> str:
    """Texts in a line; of many the first."""
    more = f"{separator}and {len(texts) - _SHOWN} more" if len(texts) > _SHOWN else ""
    return separator.join(texts[:_SHOWN]) + more


def _put(case: Case, found: Found, record: Record) -> Case:
    """The case with another record in the place of one that was found."""
    rows: Sequence[Record] = getattr(case, found.table)
    before, after = rows[: found.position], rows[found.position + 1 :]
    return _with_table(case, found.table, (*before, record, *after))


def _with_table(case: Case, table: str, rows: tuple[Record, ...]) -> Case:
    changed: dict[str, Any] = {table: rows}
    return replace(case, **changed)


def _with_set_point(case: Case, before: Record, after: Record) -> Case:
    """The case with the set point of a unit's control moved with the voltage that it holds."""
    if not (isinstance(before, Generator) and isinstance(after, Generator)):
        return case
    if before.voltage_pu == after.voltage_pu:
        return case
    controls = tuple(
        item._replace(set_point_pu=after.voltage_pu)
        if isinstance(item, UnitControl) and (item.bus, item.id) == after.key
        else item
        for item in case.flow_controls
    )
    return replace(case, flow_controls=controls)


def _controls_of(case: Case) -> Iterator[FlowControl]:
    """Controls of units and shunts that are there."""
    units = {unit.key for unit in case.generators}
    shunts = {(shunt.bus, shunt.id) for shunt in case.shunts}
    for control in case.flow_controls:
        if (control.bus, control.id) in (units if isinstance(control, UnitControl) else shunts):
            yield control


def _differences(before: Record, after: Record) -> list[str]:
    """Values that differ, in words."""
    old, new = _values(before), _values(after)
    return [
        f"{name} {_text(old.get(name))} -> {_text(value)}"
        for name, value in new.items()
        if old.get(name) != value
    ]


def _values(record: Record) -> dict[str, Any]:
    if isinstance(record, DeviceRecord):
        return dict(record.parameters)
    return vars(record)


def _text(value: Any) -> str:
    if value is None:
        return "by default"
    if isinstance(value, float):
        return f"{value:g}"
    return str(getattr(value, "value", value))
