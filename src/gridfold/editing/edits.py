"""Edits of a case as small records.

An edit says what becomes of a case: ``apply(case, devices)`` gives the changed one and what was done,
in words. To add one, write a frozen dataclass with that method and put it into :data:`EDITS`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, Protocol, TypeVar

from gridfold.dynamics.device import Device
from gridfold.editing.names import KINDS, find_record, new_record, parse_statement, with_values
from gridfold.errors import OptionError
from gridfold.grid.case import Bus, Case, DeviceRecord, Generator, Load, Record, Shunt
from gridfold.grid.event_checks import chosen_buses, place_text
from gridfold.grid.flow_controls import ShuntControl, UnitControl
from gridfold.grid.redispatch import Redispatch

_TABLES = {kind: table for table, kind in KINDS.values()} | {DeviceRecord: "devices"}
_STATES = {"in": True, "out": False}
_COMPONENTS = (
    "active_mw",
    "reactive_mvar",
    "current_active_mw",
    "current_reactive_mvar",
    "impedance_active_mw",
    "impedance_reactive_mvar",
)
Row = TypeVar("Row", bound=Record)


class Edited(NamedTuple):
    """A changed case, what was done in words, and the names of the records that are changed."""

    case: Case
    text: str
    names: tuple[str, ...]


class Edit(Protocol):
    """What all edits have."""

    def apply(self, case: Case, devices: Mapping[str, Device]) -> Edited:
        """The case with the edit; `devices` are all models by name.

        Raises
        ------
        GridfoldError
            It names what is not there, or a value has no meaning.
        """


@dataclass(frozen=True)
class ScaleLoad:
    """Loads in service are scaled, active and reactive power alike.

    Parameters
    ----------
    factor : float, optional
        What they are multiplied by; 0 or more.
    active_mw : float, optional
        Or what they draw together then at stored voltages, in MW.
    buses, areas, zones : str
        Where they are, such as ``1-36,78``; all that one of them names. Without any: everywhere.
    """

    factor: float | None = None
    active_mw: float | None = None
    buses: str = ""
    areas: str = ""
    zones: str = ""

    def apply(self, case: Case, devices: Mapping[str, Device]) -> Edited:
        """All components of the loads are multiplied."""
        buses = None
        where = "everywhere"
        if self.buses or self.areas or self.zones:
            where = f"in {place_text(self.buses, self.areas, self.zones)}"
            buses = chosen_buses("loads", case, self.buses, self.areas, self.zones)
        chosen = [
            load for load in case.loads if load.in_service and (buses is None or load.bus in buses)
        ]
        if not chosen:
            raise OptionError(f"there is no load in service {where}")
        before = sum(case.stored_power(load).real for load in chosen)
        factor = self._factor(before, where)
        names = {str(load) for load in chosen}
        loads = tuple(_scaled(load, factor) if str(load) in names else load for load in case.loads)
        count = "1 load" if len(chosen) == 1 else f"{len(chosen)} loads"
        text = f"{count} {where} from {before:.6g} to {factor * before:.6g} MW"
        return Edited(replace(case, loads=loads), text, tuple(sorted(names)))

    def _factor(self, before: float, where: str) -> float:
        if (self.factor is None) == (self.active_mw is None):
            raise OptionError("give factor or active_mw, one of the two")
        if self.factor is not None:
            if not (math.isfinite(self.factor) and self.factor >= 0):
                raise OptionError(f"factor must be 0 or more, not {self.factor!r}")
            return self.factor
        wanted = self.active_mw or 0.0
        if not (math.isfinite(wanted) and wanted >= 0):
            raise OptionError(f"active_mw must be 0 or more, not {wanted!r}")
        if before <= 0:
            raise OptionError(
                f"loads {where} draw {before:.6g} MW: no factor brings them to {wanted:g} MW"
            )
        return wanted / before


@dataclass(frozen=True)
class Set:
    """Values of one record are set.

    Parameters
    ----------
    record : str
        The record and its new values, such as ``GENROU 101:1 H=4 D=0`` or ``branch 101-103 X=0.1``.
    """

    record: str

    def apply(self, case: Case, devices: Mapping[str, Device]) -> Edited:
        """The record has these values."""
        statement = parse_statement(self.record, devices)
        if not statement.values:
            raise OptionError(f"{statement.name}: say what is set, as NAME=VALUE")
        found = find_record(case, statement)
        after = with_values(found.record, statement.values, devices)
        text = f"{after}: {', '.join(_differences(found.record, after)) or 'as it was'}"
        changed = _put(case, found.table, found.position, after)
        return Edited(_with_set_point(changed, found.record, after), text, (str(after),))


@dataclass(frozen=True)
class Switch:
    """Branches, units, loads or shunts are switched in or out.

    Parameters
    ----------
    record : str
        Which, such as ``branch 101-103:1``; several are separated by commas.
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
        for part in self.record.split(","):
            statement = parse_statement(part.strip(), devices)
            if statement.values:
                raise OptionError(f"{statement.name}: only set and add give values")
            found = find_record(case, statement)
            if isinstance(found.record, Bus | DeviceRecord):
                raise OptionError(
                    f"{found.record} cannot be switched; branches, generators, loads and shunts can"
                )
            after = replace(found.record, in_service=_STATES[self.state])
            case = _put(case, found.table, found.position, after)
            names.append(str(after))
        return Edited(case, f"{', '.join(names)} {self.state}", tuple(names))


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
        record = self.record
        if isinstance(record, str):
            record = new_record(parse_statement(record, devices), devices)
        table = _TABLES.get(type(record))
        if table is None:
            raise OptionError(f"{record!r} is no record of a case")
        rows = getattr(case, table)
        if any(str(row) == str(record) for row in rows):
            raise OptionError(f"{record} is there already")
        return Edited(_with_table(case, table, (*rows, record)), f"{record} added", (str(record),))


@dataclass(frozen=True)
class Remove:
    """A record is taken out of the case, such as an exciter that another one is to replace.

    Parameters
    ----------
    record : str
        Which, such as ``SEXS 101:1``.
    """

    record: str

    def apply(self, case: Case, devices: Mapping[str, Device]) -> Edited:
        """The record is gone; what hangs on it is told by the check of the case."""
        statement = parse_statement(self.record, devices)
        if statement.values:
            raise OptionError(f"{statement.name}: only set and add give values")
        found = find_record(case, statement)
        rows = getattr(case, found.table)
        kept = rows[: found.position] + rows[found.position + 1 :]
        after = _with_table(case, found.table, kept)
        if isinstance(found.record, Generator | Shunt):
            after = _without_control(after, found.record)
        return Edited(after, f"{found.record} removed", ())


@dataclass(frozen=True)
class Dispatch(Redispatch):
    """The event :class:`gridfold.Redispatch`, as a change of the case itself."""

    def apply(self, case: Case, devices: Mapping[str, Device]) -> Edited:
        """Units give so much more power."""
        after = self.dispatched(case)
        pairs = zip(case.generators, after.generators, strict=True)
        names = tuple(str(new) for old, new in pairs if new != old)
        (change,) = self.changes(case)
        return Edited(after, change.label, names)


#: Name of each kind of edit in files.
EDITS: Mapping[str, type] = {
    "scale-load": ScaleLoad,
    "set": Set,
    "switch": Switch,
    "redispatch": Dispatch,
    "add": Add,
    "remove": Remove,
}


def _scaled(load: Load, factor: float) -> Load:
    values: dict[str, Any] = {name: getattr(load, name) * factor for name in _COMPONENTS}
    return replace(load, **values)


def _put(case: Case, table: str, position: int, record: Record) -> Case:
    """The case with another record at a position of a table."""
    rows: Sequence[Record] = getattr(case, table)
    return _with_table(case, table, (*rows[:position], record, *rows[position + 1 :]))


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


def _without_control(case: Case, record: Generator | Shunt) -> Case:
    """The case without the control of a record that is gone."""
    kind = UnitControl if isinstance(record, Generator) else ShuntControl
    own = (record.bus, record.id)
    kept = (c for c in case.flow_controls if not (isinstance(c, kind) and (c.bus, c.id) == own))
    return replace(case, flow_controls=tuple(kept))


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
