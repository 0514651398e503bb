"""Data that can be simulated, but are hardly meant: what is usual, and what is told beyond it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from math import inf


@dataclass(frozen=True)
class Usual:
    """A row of the tables of usual values.

    Parameters
    ----------
    name : str
        Name of the row, such as ``branch.ratio``.
    what : str
        What is looked at, in words.
    ranges : tuple of (float, float)
        Where it usually is: one of these ranges, ends included; an end may be infinite.
    unit : str
        Its unit; empty for a pure number.
    source : str
        Why.
    """

    name: str
    what: str
    ranges: tuple[tuple[float, float], ...]
    unit: str
    source: str

    def holds(self, value: float) -> bool:
        """Whether `value` is usual."""
        return any(lowest <= value <= highest for lowest, highest in self.ranges)

    @property
    def text(self) -> str:
        """The ranges in words, such as ``0.8 to 1.25``."""
        return " or ".join(_range_text(*ends) for ends in self.ranges)

    def doubt(self, value: float) -> str:
        """What is told of an unusual `value`."""
        return f"{self.what} is {_with_unit(f'{value:.6g}', self.unit)}, usually {self.text}"


@dataclass(frozen=True)
class Doubt:
    """What is unusual in one record.

    Parameters
    ----------
    record : str
        Name of the record, such as ``branch 1-2:1``.
    origin : str
        File and line; empty where they are not known.
    rows : tuple of str
        Rows of the tables of usual values.
    texts : tuple of str
        What is told, for each row.
    """

    record: str
    origin: str
    rows: tuple[str, ...]
    texts: tuple[str, ...]

    def __str__(self) -> str:
        place = f"{self.record} ({self.origin})" if self.origin else self.record
        return f"{place}: {'; '.join(self.texts)}"


def doubt_of(record: str, origin: str, found: Iterable[tuple[str, str]]) -> Iterator[Doubt]:
    """One doubt from (row, text) of a record; none if there is nothing."""
    pairs = tuple(found)
    if pairs:
        rows, texts = zip(*pairs, strict=True)
        yield Doubt(record, origin, rows, texts)


def various_first(doubts: Iterable[Doubt]) -> tuple[Doubt, ...]:
    """Those that bring a new row first, so that the first lines show every kind; else as they come."""
    seen: set[str] = set()
    new: list[Doubt] = []
    more: list[Doubt] = []
    for doubt in doubts:
        (more if seen.issuperset(doubt.rows) else new).append(doubt)
        seen.update(doubt.rows)
    return (*new, *more)


def _range_text(lowest: float, highest: float) -> str:
    if lowest == highest:
        return f"{lowest:g}"
    if lowest == -inf:
        return f"at most {highest:g}"
    return f"at least {lowest:g}" if highest == inf else f"{lowest:g} to {highest:g}"


def _with_unit(value: str, unit: str) -> str:
    return f"{value} {unit}" if unit else value
