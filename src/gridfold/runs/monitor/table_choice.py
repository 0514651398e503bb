"""The monitor language on a table that was written: which of its columns a text means."""

from __future__ import annotations

import difflib
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from functools import cached_property
from typing import Any

from gridfold.errors import OptionError
from gridfold.grid.case import Branch, Bus, Case, Generator, UnitKey
from gridfold.grid.selection import (
    line_name,
    select_buses,
    select_lines,
    select_machines,
    select_numbers,
)
from gridfold.grid.selection_text import Numbers, parse_selection, pieces_of
from gridfold.runs.monitor.text import (
    BUS_KINDS,
    GROUP_KINDS,
    LINE_KINDS,
    Statement,
    parse_monitor,
)

_PREFIXES = {
    "angle": ("angle_deg",),
    "angle_coi": ("angle_coi_deg",),
    "speed": ("speed_pu",),
    "generation": ("generation_mw", "generation_mvar"),
    "voltage": ("voltage_pu",),
    "voltage_angle": ("voltage_angle_deg",),
    "frequency": ("frequency_hz",),
    "load": ("load_mw", "load_mvar"),
    "flow": ("p_mw", "q_mvar"),
    "current": ("current_pu",),
    "interface": ("interface_mw", "interface_mvar"),
    **{
        group: tuple(f"{group}_{what}_mw" for what in ("generation", "load", "interchange"))
        for group in GROUP_KINDS
    },
}
_LINE = re.compile(r"(\d{1,18})-(\d{1,18})(?::(\S+))?")
_UNIT = re.compile(r"(\d{1,18}):(\S+)")


@dataclass(frozen=True)
class TableChoice:
    """The columns that were chosen, and that each how many-th row counts."""

    names: tuple[str, ...]
    every: int = 1


def choose_columns(
    names: Sequence[str], record: Mapping[str, Any], text: str, what: str = "monitor"
) -> TableChoice:
    """Columns of a table that a monitor means.

    Parameters
    ----------
    names : sequence of str
        The columns of the table beside the time.
    record : mapping
        What its metadata say about their grid (:mod:`gridfold.runs.monitor.record`); empty if nothing:
        then they are chosen by numbers alone.
    text : str
        The monitor, or names and patterns of columns such as ``p_mw:*``.
    what : str
        Where the text is from, for messages.

    Raises
    ------
    OptionError
        A part of the text has no meaning, or means no column.
    """
    table = _Table(tuple(names), record)
    chosen: dict[str, None] = {}
    rest = []
    for piece in pieces_of(text, what):
        direct = [piece] if piece in names else [n for n in names if fnmatchcase(n, piece)]
        if piece == "interface":
            direct = table.of_kind("interface")
        if direct:
            chosen |= dict.fromkeys(direct)
        else:
            rest.append(piece)
    every = 1
    if rest:
        monitor = parse_monitor(", ".join(rest), what)
        every = monitor.every
        faults = []
        for statement in monitor.statements:
            try:
                chosen |= dict.fromkeys(table.columns(statement))
            except OptionError as error:
                faults.append(str(error))
            except (ArithmeticError, AttributeError, TypeError, ValueError) as error:
                faults.append(f"the metadata of the table have no meaning: {error}")
        if faults and not record:
            faults.append("without its metadata a table knows numbers alone")
        if faults:
            raise OptionError(f"{what}: {'; '.join(faults)}")
    return TableChoice(tuple(chosen) or tuple(names), every)


@dataclass(frozen=True)
class _Table:
    names: tuple[str, ...]
    record: Mapping[str, Any]

    def of_kind(self, kind: str) -> list[str]:
        prefixes = _PREFIXES.get(kind, (kind,))
        return [name for name in self.names if name.partition(":")[0] in prefixes]

    def columns(self, asked: Statement) -> list[str]:
        there = self.of_kind(asked.kind)
        if not there:
            raise OptionError(self._none(asked.kind))
        if asked.places == "all":
            return there
        labels = {name.partition(":")[2] for name in there}
        wanted = self._labels(asked, labels)
        found = [n for label in wanted for n in there if n.partition(":")[2] == label]
        if not found:
            raise OptionError(f"{asked.kind}: the table has no column of {asked.places!r}")
        return found

    def _labels(self, asked: Statement, labels: set[str]) -> list[str]:
        study = self._study
        if asked.kind in BUS_KINDS:
            return [str(n) for n in select_buses(asked.places, self._grid, asked.kind, study)]
        if asked.kind == "interface":
            return [asked.label or asked.places]
        if asked.kind in LINE_KINDS:
            lines = select_lines(asked.places, self._grid, asked.kind, study)
            return [name for line in lines for name in self._spelled(line_name(self._grid, line))]
        if asked.kind in GROUP_KINDS:
            numbers = [int(label) for label in labels if label.isdecimal()]
            groups = tuple(replace(Bus(n), **_is(asked.kind, n)) for n in numbers)
            grid = self._named(Case("of the table", groups, (), ()))
            found = select_numbers(asked.places, grid, asked.kind, asked.word)
            return [str(number) for number in found]
        units = [UnitKey(int(m[1]), m[2]) for m in map(_UNIT.fullmatch, sorted(labels)) if m]
        return [str(u) for u in select_machines(asked.places, self._grid, asked.kind, study, units)]

    def _spelled(self, name: str) -> list[str]:
        """A line as the table has it: with or without the only circuit."""
        ends, _, circuit = name.partition(":")
        return [name] if circuit else [ends, *(f"{ends}:{c}" for c in self._circuits.get(ends, ()))]

    def _none(self, kind: str) -> str:
        kinds = dict.fromkeys(self._kind_of(name) for name in self.names)
        close = difflib.get_close_matches(kind, kinds, n=1)
        told = f"did you mean {close[0]!r}?" if close else f"it has: {', '.join(kinds)}"
        return f"the table has no {kind!r}; {told}"

    def _kind_of(self, name: str) -> str:
        prefix = name.partition(":")[0]
        return next((kind for kind, known in _PREFIXES.items() if prefix in known), prefix)

    @cached_property
    def _study(self) -> set[int] | None:
        text = self.record.get("study_buses")
        return None if text is None else set(_among(str(text), self._numbers))

    @cached_property
    def _numbers(self) -> list[int]:
        """Numbers of all buses that columns are about."""
        found: set[int] = set()
        for name in self.names:
            prefix, _, label = name.partition(":")
            kind = self._kind_of(name)
            if kind in BUS_KINDS and label.isdecimal():
                found.add(int(label))
            elif kind in ("flow", "current") and (line := _LINE.fullmatch(label)):
                found |= {int(line[1]), int(line[2])}
            elif prefix and (unit := _UNIT.fullmatch(label)):
                found.add(int(unit[1]))
        return sorted(found)

    @cached_property
    def _circuits(self) -> dict[str, list[str]]:
        """Circuits of lines by the ends that columns name."""
        found: dict[str, list[str]] = {}
        for name in (*self.of_kind("flow"), *self.of_kind("current")):
            ends, _, circuit = name.partition(":")[2].partition(":")
            if circuit and circuit not in found.setdefault(ends, []):
                found[ends].append(circuit)
        return found

    @cached_property
    def _grid(self) -> Case:
        """The grid as far as columns and metadata tell of it."""
        buses = {n: Bus(n, base_kv=0.0, area=0, zone=0, owner=0) for n in self._numbers}
        for number, name in self.record.get("names", {}).items():
            if int(number) in buses:
                buses[int(number)] = replace(buses[int(number)], name=str(name))
        for key in (*GROUP_KINDS, "kv"):
            for value, text in self.record.get(key, {}).items():
                for number in _among(str(text), self._numbers):
                    buses[number] = replace(buses[number], **_is(key, value))
        grid = Case("of the table", tuple(buses.values()), self._branches(), self._units())
        return self._named(grid)

    def _named(self, grid: Case) -> Case:
        """A grid with the names of areas, zones and owners that the metadata tell."""
        area, zone, owner = (
            {int(number): str(name) for number, name in self.record.get(f"{key}_names", {}).items()}
            for key in GROUP_KINDS
        )
        return replace(grid, area_names=area, zone_names=zone, owner_names=owner)

    def _branches(self) -> tuple[Branch, ...]:
        lines: dict[tuple[frozenset[int], str], Branch] = {}
        for name in (*self.of_kind("flow"), *self.of_kind("current")):
            if line := _LINE.fullmatch(name.partition(":")[2]):
                first, second, circuit = int(line[1]), int(line[2]), line[3] or "1"
                lines.setdefault(
                    (frozenset((first, second)), circuit), Branch(first, second, circuit)
                )
        return tuple(lines.values())

    def _units(self) -> tuple[Generator, ...]:
        labels = dict.fromkeys(name.partition(":")[2] for name in self.names)
        found = [unit for unit in map(_UNIT.fullmatch, labels) if unit]
        return tuple(Generator(int(unit[1]), unit[2]) for unit in found)


def _is(key: str, value: Any) -> dict[str, Any]:
    """The field of a bus that tells its area, zone, owner or level."""
    return {"base_kv": float(value)} if key == "kv" else {key: int(value)}


def _among(text: str, numbers: Sequence[int]) -> list[int]:
    """Those of the numbers that lie in ranges given as text."""
    spans = [s for s in parse_selection(text, "metadata").chosen if isinstance(s, Numbers)]
    return [number for number in numbers if any(number in span for span in spans)]
