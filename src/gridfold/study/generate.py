"""The numbered list of contingencies that a study file asks for."""

from __future__ import annotations

import unicodedata
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gridfold.errors import CaseFileError, EventError, OptionError
from gridfold.grid.case import Branch, Case, UnitKey
from gridfold.grid.events import BranchFault, BusFault, Event, MachineTrip
from gridfold.grid.selection import LineEnd, select_buses, select_lines, select_machines
from gridfold.grid.selection_text import Word
from gridfold.grid.timeline import build_timeline
from gridfold.io.event_places import Numbering, any_name, numbering
from gridfold.io.event_records import event_from_record, event_record
from gridfold.io.tables import read_table
from gridfold.study.study_file import ContingencySection, Study


@dataclass(frozen=True)
class Contingency:
    """A contingency: its number in the study, its name, what kind it is, and its events."""

    number: int
    name: str
    kind: str
    events: tuple[Event, ...]

    def record(self) -> dict[str, Any]:
        """Ready for JSON."""
        events = [event_record(event) for event in self.events]
        return {"number": self.number, "name": self.name, "kind": self.kind, "events": events}


def contingency_from_record(record: dict[str, Any]) -> Contingency:
    """What :meth:`Contingency.record` has written."""
    events = tuple(event_from_record(event) for event in record["events"])
    return Contingency(record["number"], record["name"], record["kind"], events)


def list_contingencies(
    study: Study, case: Case, study_buses: frozenset[int], folder: Path
) -> tuple[Contingency, ...]:
    """All contingencies of a study, in the order of the file's keys.

    Parameters
    ----------
    study : Study
        What is asked for.
    case : Case
        The grid; every event is checked against it.
    study_buses : frozenset of int
        Bus numbers of the study area.
    folder : Path
        Where relative file names start.

    Raises
    ------
    CaseFileError
        A table cannot be read, or has faults: all of them.
    EventError
        An event does not fit the case.
    OptionError
        There are no contingencies, or two of one name.
    """
    wanted = study.contingencies
    start, duration = wanted.start, wanted.clearing_time

    buses = select_buses(wanted.bus_faults, case, "contingencies.bus_faults", study_buses)
    lines = select_lines(
        wanted.line_faults, case, "contingencies.line_faults", study_buses, Word.BUS
    )
    units = select_machines(
        wanted.machine_trips, case, "contingencies.machine_trips", study_buses, tripped_units(case)
    )
    found: list[tuple[str, str, tuple[Event, ...]]] = []
    found += bus_faults(case, buses, start, duration)
    found += line_faults(case, lines, start, duration)
    found += machine_trips(units, start)
    if wanted.csv is not None:
        found += from_table(folder / wanted.csv, numbering(case))
    found += [_explicit(section, numbering(case)) for section in study.contingency]
    if not found:
        raise OptionError(
            "the study has no contingencies: see the keys of [contingencies] and [[contingency]]"
        )
    # Names that look alike are one name to whoever reads a table.
    counts = Counter(_looks(name) for name, _, _ in found)
    if twice := [name for name, _, _ in found if counts[_looks(name)] > 1]:
        listed = ", ".join(repr(name) for name in dict.fromkeys(twice[:8]))
        raise OptionError(f"contingencies of one name: {listed}")
    result = []
    for number, (name, kind, events) in enumerate(found, start=1):
        try:
            build_timeline(case, events, study.run.t_end)
        except EventError as error:
            raise EventError(f"contingency {name!r}: {error}") from None
        result.append(Contingency(number, name, kind, events))
    return tuple(result)


def bus_faults(
    case: Case, buses: Iterable[int], start: float, duration: float
) -> Iterator[tuple[str, str, tuple[Event, ...]]]:
    """A fault at each of the buses, cleared by itself."""
    inside = set(buses)
    for bus in case.buses:
        if bus.number in inside:
            yield f"bus {bus.number}", "bus fault", (BusFault(bus.number, start, duration),)


def line_faults(
    case: Case, lines: Iterable[LineEnd], start: float, duration: float
) -> Iterator[tuple[str, str, tuple[Event, ...]]]:
    """A fault at both ends of each of the branches that is in service, cleared by tripping it."""
    for position in sorted({line.position for line in lines}):
        branch, name = case.branches[position], case.branch_names[position]
        if branch.in_service:
            for end, fraction in ((branch.from_bus, 0.0), (branch.to_bus, 1.0)):
                fault = BranchFault(name, start, duration, fraction)
                yield f"{_kind(branch)} {name} at {end}", "line fault", (fault,)


def tripped_units(case: Case) -> list[UnitKey]:
    """Machines in service, in the order of the case."""
    with_machine = {record.key for record in case.devices}
    return [u.key for u in case.generators if u.in_service and u.key in with_machine]


def machine_trips(
    units: Iterable[UnitKey], start: float
) -> Iterator[tuple[str, str, tuple[Event, ...]]]:
    """The trip of each of the machines."""
    for unit in units:
        yield f"machine {unit}", "machine trip", (MachineTrip(unit.bus, unit.id, start),)


def from_table(
    path: Path, number: Numbering = any_name
) -> Iterator[tuple[str, str, tuple[Event, ...]]]:
    """Contingencies from a CSV table, a row each; events of one are numbered in a column ``event``.

    Columns ``name`` and ``kind``, and fields of the events; an empty cell stands for the default.
    `number` gives the numbers of buses that are named.
    """
    table = read_table(path)
    taken: dict[tuple[str, str], int] = {}
    for needed in ("name", "kind"):
        if table.columns and needed not in table.columns:
            table.fault(table.header_line, f"column {needed!r} is missing")
    events: dict[str, list[Event]] = {}
    for line, cells in table.rows if not table.faults else ():
        record = {key: text for key, text in cells.items() if text and key not in ("name", "event")}
        name = cells["name"]
        if not name:
            table.fault(line, "name is empty")
            continue
        first = taken.setdefault((_looks(name), cells.get("event", "")), line)
        if first != line:
            table.fault(line, _named_before(name, first, "event" in table.columns))
            continue
        try:
            events.setdefault(name, []).append(event_from_record(record, name, number))
        except EventError as error:
            table.fault(line, str(error))
    if table.faults:
        raise CaseFileError(table.faults, str(path))
    for name, together in events.items():
        yield name, _kind_of(together), tuple(together)


def _looks(name: str) -> str:
    """A name without what cannot be seen of it."""
    shape = unicodedata.normalize("NFKC", name)
    seen = (c for c in shape if unicodedata.category(c) not in ("Cf", "Cc") or c.isspace())
    return " ".join("".join(seen).split())


def _named_before(name: str, line: int, numbered: bool) -> str:
    if numbered:
        return f"{name!r} has this event in line {line} already"
    return (
        f"{name!r} is the name in line {line} already; contingencies have names of their own, and the "
        "events of one are numbered in a column 'event'"
    )


def _explicit(section: ContingencySection, number: Numbering) -> tuple[str, str, tuple[Event, ...]]:
    where = f"contingency {section.name!r}"
    events = [event_from_record(record, where, number) for record in section.events]
    return section.name, _kind_of(events), tuple(events)


_KINDS: dict[type, Callable[[Any], str]] = {
    BusFault: lambda event: "bus fault with trip" if event.trip_bus else "bus fault",
    BranchFault: lambda event: "line fault",
    MachineTrip: lambda event: "machine trip",
}


def _kind_of(events: list[Event]) -> str:
    if len(events) == 1 and type(events[0]) in _KINDS:
        return _KINDS[type(events[0])](events[0])
    return "events"


def _kind(branch: Branch) -> str:
    transformer = branch.ratio != 1.0 or branch.shift_deg != 0.0
    return "transformer" if transformer else "line"
