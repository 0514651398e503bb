"""A case while it is put together from the tables of a file."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from gridfold.grid.case import Case, Control, Record
from gridfold.grid.islands import island_labels

Row = Mapping[str, Any]

_SINGULAR = {"branches": "branch", "generators": "generator", "loads": "load", "shunts": "shunt"}


@dataclass
class Draft:
    """Records, where they come from, and what is to be told of them.

    Parameters
    ----------
    tables : mapping
        The tables of the file, by name.
    places : mapping of str to sequence of str
        File and line of each row, by table, where they are known.
    """

    tables: Mapping[str, Any]
    places: Mapping[str, Sequence[str]]
    records: dict[type, list[Any]] = field(default_factory=lambda: defaultdict(list))
    origins: dict[str, str] = field(default_factory=dict)
    unsupported: list[str] = field(default_factory=list)
    notices: list[str] = field(default_factory=list)

    def rows(self, table: str) -> Iterable[tuple[Row, str]]:
        """Rows of a table of powerio, each with its file and line if they are known."""
        places = self.places.get(table, ())
        for position, row in enumerate(self.tables.get(table) or ()):
            content = row["value"] if row.get("type") == "powerio.PartialTransformer3W" else row
            yield content, places[position] if position < len(places) else ""

    def add(self, record: Record, place: str) -> None:
        """Take a record; `place` is empty if it is not known."""
        self.records[type(record)].append(record)
        if place:
            self.origins.setdefault(str(record), place)


def free_id(taken: Collection[str]) -> str:
    """The first of 1, 2, 3 ... that is not taken."""
    return next(str(n) for n in range(1, len(taken) + 2) if str(n) not in taken)


def islands_without_slack(case: Case) -> list[list[int]]:
    """Bus numbers of each island in which no unit balances."""
    labels = island_labels(case)
    islands: dict[int, list[int]] = defaultdict(list)
    for bus, label in zip(case.buses, labels, strict=True):
        islands[int(label)].append(bus.number)
    balanced = {
        int(labels[case.bus_index[unit.bus]])
        for unit in case.generators
        if unit.in_service and unit.control is Control.SLACK
    }
    if not balanced:
        return []  # not a matter of one island: left to the check of the case
    return [buses for label, buses in islands.items() if label not in balanced]


def without_buses(case: Case, *groups: Sequence[int]) -> tuple[Case, list[str]]:
    """The case without groups of buses and what is connected to them, and what that was in each.

    What joins two groups is counted in the first.
    """
    group = {number: k for k, numbers in enumerate(groups) for number in numbers}
    gone: list[Counter[str]] = [Counter() for _ in groups]
    kept: dict[str, Any] = {
        "buses": tuple(bus for bus in case.buses if bus.number not in group),
        "devices": tuple(device for device in case.devices if device.bus not in group),
    }
    for table in _SINGULAR:
        staying = []
        for record in getattr(case, table):
            ends = (record.from_bus, record.to_bus) if table == "branches" else (record.bus,)
            inside = [group[end] for end in ends if end in group]
            if inside:
                gone[min(inside)][table] += 1
            else:
                staying.append(record)
        kept[table] = tuple(staying)
    kept["left_out"] = case.left_out | {unit.key for unit in case.generators if unit.bus in group}
    return replace(case, **kept), [_told(*each) for each in zip(groups, gone, strict=True)]


def _told(numbers: Sequence[int], counts: Mapping[str, int]) -> str:
    """Buses that are left out, and what goes with them."""
    gone = [f"{n} {table if n > 1 else _SINGULAR[table]}" for table, n in counts.items()]
    listed = ", ".join(str(number) for number in numbers)
    what = f"{'buses' if len(numbers) > 1 else 'bus'} {listed} left out"
    return f"{what}, with {', '.join(gone)}" if gone else what
