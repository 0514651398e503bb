"""A case while it is put together from the tables of a file."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from gridfold.grid.case import Case, Control, Record
from gridfold.grid.flow_controls import FlowControl
from gridfold.grid.islands import island_labels

Row = Mapping[str, Any]

_SINGULAR = {"branches": "branch", "generators": "generator", "loads": "load", "shunts": "shunt"}
_NAMES = {"dc_lines": ("dc line", "dc lines")}


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
    faults: list[str] = field(default_factory=list)
    controls: list[FlowControl] = field(default_factory=list)

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


def with_swings_behind_dc(case: Case) -> tuple[Case, list[str]]:
    """The case with a swing unit in each island that has none and stands on a dc line, and its words.

    The largest unit that holds its voltage balances what the line leaves.
    """
    labels = island_labels(case)

    def island(bus: int) -> int:
        return int(labels[case.bus_index[bus]])

    lines = [line for line in case.dc_lines if line.in_service]
    ends = {bus for line in lines for bus in line.buses} & case.bus_index.keys()
    fed = {island(bus) for bus in ends}
    live = [unit for unit in case.generators if unit.in_service]
    fed -= {island(unit.bus) for unit in live if unit.control is Control.SLACK}
    units, texts = list(case.generators), []
    for label in sorted(fed):
        able = [u for u in live if island(u.bus) == label and u.control is Control.VOLTAGE]
        if able:
            chosen = max(able, key=lambda unit: unit.base_mva)
            units[units.index(chosen)] = replace(chosen, control=Control.SLACK)
            first = case.buses[labels.tolist().index(label)].number
            texts.append(
                f"the island of bus {first} has no swing unit and stands on a dc line: {chosen}, its "
                "largest, balances it"
            )
    return replace(case, generators=tuple(units)), texts


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
    kept["dc_lines"] = tuple(line for line in case.dc_lines if not group.keys() & set(line.buses))
    for line in case.dc_lines:
        if inside := [group[bus] for bus in line.buses if bus in group]:
            gone[min(inside)]["dc_lines"] += 1
    kept["left_out"] = case.left_out | {unit.key for unit in case.generators if unit.bus in group}
    return replace(case, **kept), [_told(*each) for each in zip(groups, gone, strict=True)]


def _told(numbers: Sequence[int], counts: Mapping[str, int]) -> str:
    """Buses that are left out, and what goes with them."""
    names = {table: (one, table) for table, one in _SINGULAR.items()} | _NAMES
    gone = [f"{n} {names[table][n > 1]}" for table, n in counts.items()]
    listed = ", ".join(str(number) for number in numbers)
    what = f"{'buses' if len(numbers) > 1 else 'bus'} {listed} left out"
    return f"{what}, with {', '.join(gone)}" if gone else what
