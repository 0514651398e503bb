"""A case while it is put together from the tables of a file."""

from __future__ import annotations

from collections import defaultdict
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


def without_buses(case: Case, numbers: Sequence[int]) -> tuple[Case, str]:
    """The case without these buses and what is connected to them, and what that was."""
    gone = set(numbers)
    kept = replace(
        case,
        buses=tuple(bus for bus in case.buses if bus.number not in gone),
        branches=tuple(b for b in case.branches if not gone & {b.from_bus, b.to_bus}),
        generators=tuple(unit for unit in case.generators if unit.bus not in gone),
        loads=tuple(load for load in case.loads if load.bus not in gone),
        shunts=tuple(shunt for shunt in case.shunts if shunt.bus not in gone),
        left_out=case.left_out | {unit.key for unit in case.generators if unit.bus in gone},
    )
    counts = [
        f"{before - after} {table if before - after > 1 else _SINGULAR[table]}"
        for table in _SINGULAR
        if (before := len(getattr(case, table))) > (after := len(getattr(kept, table)))
    ]
    listed = ", ".join(str(number) for number in numbers)
    what = f"{'buses' if len(numbers) > 1 else 'bus'} {listed} left out"
    return kept, f"{what}, with {', '.join(counts)}" if counts else what
