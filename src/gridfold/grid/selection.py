"""Buses, machines and branches of a case that a text chooses.

The grammar is that of :mod:`gridfold.grid.selection_text`. A range stands for what the case has in it,
however long it is; only what names nothing at all is an error, which tells what is nearest.
"""

from __future__ import annotations

import difflib
import unicodedata
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from functools import cached_property
from typing import NamedTuple

from gridfold.errors import OptionError
from gridfold.grid.case import Bus, Case, UnitKey
from gridfold.grid.selection_text import (
    Item,
    Levels,
    Line,
    Name,
    Named,
    Numbers,
    Place,
    Ties,
    Unit,
    Word,
    parse_selection,
)

#: Values that a message lists; of more it tells the nearest alone.
_LISTED = 12


class LineEnd(NamedTuple):
    """A branch, by its position in the case, and the bus number of the end that is named first."""

    position: int
    bus: int


def select_buses(
    text: str,
    case: Case,
    what: str = "buses",
    study: Collection[int] | None = None,
    word: Word = Word.BUS,
) -> tuple[int, ...]:
    """Numbers of buses that a text chooses, each once, in the order of the text.

    Parameters
    ----------
    text : str
        For example ``1001-1050, area:2 except kv<100``.
    case : Case
        The case.
    what : str
        Where the text is from, for messages.
    study : collection of int, optional
        Buses of the study area, if there is one.
    word : Word
        What numbers are those of before any word of the text.

    Raises
    ------
    OptionError
        A part of the text has no meaning, or names nothing: all such parts, and what is nearest.
    """
    return _Finder(case, what, study).buses(text, word)


def select_numbers(text: str, case: Case, what: str, word: Word) -> tuple[int, ...]:
    """Numbers of areas, zones or owners (`word`) of the buses that a text chooses, ascending."""
    chosen = set(select_buses(text, case, what, word=word))
    return tuple(sorted({_number(bus, word) for bus in case.buses if bus.number in chosen}))


def select_machines(
    text: str,
    case: Case,
    what: str = "machines",
    study: Collection[int] | None = None,
    among: Collection[UnitKey] | None = None,
) -> tuple[UnitKey, ...]:
    """Machines that a text chooses, by ``BUS:ID`` or all of them at buses, in the order of the text.

    `among` are those that may be chosen, all units of the case by default. The rest is as for
    :func:`select_buses`.
    """
    units = [unit.key for unit in case.generators] if among is None else list(among)
    return _Finder(case, what, study).machines(text, units)


def select_lines(
    text: str,
    case: Case,
    what: str = "lines",
    study: Collection[int] | None = None,
    word: Word = Word.LINE,
) -> tuple[LineEnd, ...]:
    """Branches that a text chooses, those out of service among them.

    A line that is named from both of its ends comes twice. Lines are chosen by name, ``101-103`` or
    ``101-103:CIRCUIT``, by the places that they join,
    ``area:1 to area:2``, or as all those with both ends in the buses that are chosen. Transformers
    count as lines. The rest is as for :func:`select_buses`.
    """
    return _Finder(case, what, study).lines(text, word)


def line_name(case: Case, line: LineEnd) -> str:
    """``FROM-TO`` from the end that is named first, with the circuit where there are several."""
    branch, name = case.branches[line.position], case.branch_names[line.position]
    if branch.from_bus == line.bus:
        return name
    _, parallel, circuit = name.partition(":")
    return f"{branch.to_bus}-{branch.from_bus}{parallel}{circuit}"


@dataclass(frozen=True)
class _Finder:
    """Finds items in a case. All that are not there are told together."""

    case: Case
    what: str
    study: Collection[int] | None

    def buses(self, text: str, word: Word) -> tuple[int, ...]:
        selection = parse_selection(text, self.what, word)
        faults: list[str] = []
        chosen = self._union(selection.chosen, faults)
        without = self._union(selection.without, faults)
        self._refuse(faults)
        return tuple(number for number in chosen if number not in without)

    def machines(self, text: str, units: Sequence[UnitKey]) -> tuple[UnitKey, ...]:
        selection = parse_selection(text, self.what)
        faults: list[str] = []
        chosen, without = (
            dict.fromkeys(unit for item in items for unit in self._machines_of(item, units, faults))
            for items in (selection.chosen, selection.without)
        )
        self._refuse(faults)
        return tuple(unit for unit in chosen if unit not in without)

    def lines(self, text: str, word: Word) -> tuple[LineEnd, ...]:
        selection = parse_selection(text, self.what, word)
        faults: list[str] = []
        chosen, inside = self._named_lines(selection.chosen, faults)
        without, outside = self._named_lines(selection.without, faults)
        self._refuse(faults)
        named = {end.position for end in chosen}
        taken = {end.position for end in without}
        for k, (first, second) in enumerate(self._ends):
            if k not in named and first in inside and second in inside:
                chosen[LineEnd(k, first)] = None
        if not chosen and inside and not selection.without:
            raise OptionError(
                f"{self.what}: no line of case {self.case.name} lies within {text!r}; those that lead "
                "out of a place are written as bus:101 to all"
            )
        return tuple(
            end
            for end in chosen
            if end.position not in taken and not outside.intersection(self._ends[end.position])
        )

    def _refuse(self, faults: Sequence[str]) -> None:
        if faults:
            raise OptionError(f"{self.what}: {'; '.join(dict.fromkeys(faults))}")

    # Buses.

    def _union(self, items: Iterable[Item], faults: list[str]) -> dict[int, None]:
        found: dict[int, None] = {}
        for item in items:
            if isinstance(item, Unit | Line | Ties):
                faults.append(f"{item} is no bus, and buses are chosen here")
            else:
                found |= dict.fromkeys(self._buses_of(item, faults))
        return found

    def _buses_of(self, place: Place, faults: list[str]) -> list[int]:
        if isinstance(place, Named):
            return self._named(place, faults)
        found = [bus.number for bus in self._sorted if self._fits(bus, place)]
        if not found:
            faults.append(f"there is no {place} in case {self.case.name}{self._nearest(place)}")
        return found

    def _named(self, place: Named, faults: list[str]) -> list[int]:
        if place is Named.NONE:
            return []
        if place is Named.ALL:
            return [bus.number for bus in self.case.buses]
        if self.study is None:
            faults.append("no study area is given here")
            return []
        return [bus.number for bus in self.case.buses if bus.number in self.study]

    def _fits(self, bus: Bus, place: Numbers | Levels | Name) -> bool:
        if isinstance(place, Levels):
            return bus.base_kv in place
        if isinstance(place, Numbers):
            return _number(bus, place.word) in place
        return fnmatchcase(_plain(self._name(bus, place.word)), _plain(place.pattern))

    def _name(self, bus: Bus, word: Word) -> str:
        if word is Word.BUS:
            return bus.name
        names = {
            Word.AREA: self.case.area_names,
            Word.ZONE: self.case.zone_names,
            Word.OWNER: self.case.owner_names,
        }
        return names[word].get(_number(bus, word), "") if word in names else ""

    def _nearest(self, place: Numbers | Levels | Name) -> str:
        """What is nearest to a place that is not there."""
        if isinstance(place, Name):
            names = sorted({self._name(bus, place.word) for bus in self.case.buses} - {""})
            by_look = {_plain(name): name for name in names}
            close = difflib.get_close_matches(_plain(place.pattern), by_look, n=1, cutoff=0.5)
            if close:
                return f"; did you mean {by_look[close[0]]!r}?"
            return f"; known: {_listed(map(repr, names))}" if names else ", which has no such names"
        if isinstance(place, Levels):
            return (
                f"; known: {_listed(f'{kv:g}' for kv in sorted({b.base_kv for b in self._sorted}))}"
            )
        known = sorted({_number(bus, place.word) for bus in self.case.buses})
        if place.word is not Word.BUS and len(known) <= _LISTED:
            return f"; known: {_listed(map(str, known))}{self._or_bus(place)}"
        middle = (place.first + place.last) / 2
        near = min(known, key=lambda number: abs(number - middle), default=None)
        return f"; the nearest is {near}{self._or_bus(place)}" if near is not None else ""

    def _or_bus(self, place: Numbers) -> str:
        """A hint at a bus of that number, where an area, say, was understood."""
        if place.word is Word.BUS or place.first not in self.case.bus_index:
            return ""
        return f"; the bus is written bus:{place.first}"

    @cached_property
    def _sorted(self) -> list[Bus]:
        return sorted(self.case.buses, key=lambda bus: bus.number)

    # Machines.

    def _machines_of(
        self, item: Item, units: Sequence[UnitKey], faults: list[str]
    ) -> Iterator[UnitKey]:
        if isinstance(item, Line | Ties):
            faults.append(f"{item} is no machine, and machines are chosen here")
            return
        before = len(faults)
        buses = dict.fromkeys(self._buses_of(item.bus if isinstance(item, Unit) else item, faults))
        if len(faults) > before:
            return
        at_buses = [unit for unit in units if unit.bus in buses]
        found = [u for u in at_buses if not isinstance(item, Unit) or u.id == item.id]
        if not found and not isinstance(item, Named):
            faults.append(_no_machine(item, at_buses))
        order = {bus: k for k, bus in enumerate(buses)}
        yield from sorted(found, key=lambda unit: order[unit.bus])

    # Lines.

    def _named_lines(
        self, items: Iterable[Item], faults: list[str]
    ) -> tuple[dict[LineEnd, None], set[int]]:
        """Lines that are named, with the end named first, and buses that are."""
        found: dict[LineEnd, None] = {}
        buses: set[int] = set()
        for item in items:
            if isinstance(item, Unit):
                faults.append(f"{item} is no line, and lines are chosen here")
            elif isinstance(item, Line | Ties):
                found |= dict.fromkeys(self._lines_of(item, faults))
            else:
                buses.update(self._buses_of(item, faults))
        return found, buses

    def _lines_of(self, item: Line | Ties, faults: list[str]) -> list[LineEnd]:
        before = len(faults)
        first = set(self._buses_of(item.first, faults))
        second = set(self._buses_of(item.second, faults)) - first
        if len(faults) > before:
            return []
        circuit = item.circuit if isinstance(item, Line) else None
        joining = [
            LineEnd(k, one)
            for k, ends in enumerate(self._ends)
            for one, other in (ends, ends[::-1])
            if one in first and other in second
        ]
        found = [e for e in joining if circuit in (None, self.case.branches[e.position].circuit)]
        if not found:
            faults.append(self._no_line(item, [k for k, _ in joining], first))
        return found

    @cached_property
    def _ends(self) -> list[tuple[int, int]]:
        return [(branch.from_bus, branch.to_bus) for branch in self.case.branches]

    def _no_line(self, item: Line | Ties, parallel: Sequence[int], first: set[int]) -> str:
        text = f"there is no {item} in case {self.case.name}"
        if parallel:
            circuits = _listed(self.case.branches[k].circuit for k in parallel)
            return f"{text}; its circuits: {circuits}"
        if isinstance(item, Ties):
            return text
        others = {b if a in first else a for a, b in self._ends if a in first or b in first}
        return f"{text}; lines from there lead to {_listed(map(str, sorted(others)))}"


def _no_machine(item: Place | Unit, at_bus: Sequence[UnitKey]) -> str:
    if not isinstance(item, Unit):
        return f"there is no machine at {item}"
    return f"there is no {item}; at its bus: {_listed(map(str, at_bus)) or 'none'}"


def _number(bus: Bus, word: Word) -> int:
    getters: dict[Word, Callable[[Bus], int]] = {
        Word.BUS: lambda bus: bus.number,
        Word.AREA: lambda bus: bus.area,
        Word.ZONE: lambda bus: bus.zone,
        Word.OWNER: lambda bus: bus.owner,
    }
    return getters[word](bus)


def _plain(name: str) -> str:
    """A name as it is compared: no blanks around or twice, no capitals."""
    return " ".join(unicodedata.normalize("NFKC", name).casefold().split())


def _listed(values: Iterable[str]) -> str:
    shown = list(values)
    return ", ".join(shown[:_LISTED]) + (" ..." if len(shown) > _LISTED else "")
