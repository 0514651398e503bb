"""Numbers of buses, areas and zones as text such as ``1-36,78``."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from enum import Enum

from gridfold.errors import OptionError
from gridfold.grid.case import Bus, Case

_RANGE = re.compile(r"\s*([0-9]{1,18})\s*(?:-\s*([0-9]{1,18})\s*)?")
#: Characters of a text that a message shows.
_SHOWN = 60


class Numbered(Enum):
    """What has numbers in a case."""

    BUS = "bus"
    AREA = "area"
    ZONE = "zone"

    def of(self, bus: Bus) -> int:
        """That number of a bus."""
        return {Numbered.BUS: bus.number, Numbered.AREA: bus.area, Numbered.ZONE: bus.zone}[self]


def parse_ranges(text: str, what: str = "buses") -> tuple[range, ...]:
    """Ranges of numbers of buses, or of `what`, from text such as ``1-36,78``.

    Raises
    ------
    OptionError
        A part is no number and no range of numbers.
    """
    ranges = []
    for part in text.split(","):
        match = _RANGE.fullmatch(part)
        if match is None:
            shown = f"{part.strip()[:_SHOWN]!r} in {text[:_SHOWN]!r}"
            raise OptionError(f"{what} are given as 3,7 or 1-36, not {shown}")
        first, last = int(match[1]), int(match[2] or match[1])
        if last < first:
            raise OptionError(f"the range {part.strip()!r} ends before it starts")
        ranges.append(range(first, last + 1))
    return tuple(ranges)


def numbers_in(
    case: Case, text: str, what: str = "buses", kind: Numbered = Numbered.BUS
) -> list[int]:
    """Numbers of buses, areas or zones of a case from text such as ``1-36,78``.

    A range stands for the numbers of the case that lie in it, however long it is.

    Parameters
    ----------
    case : Case
        The case.
    text : str
        Numbers and ranges of numbers.
    what : str
        Where the text is from, for messages.
    kind : Numbered
        What the numbers are those of.

    Returns
    -------
    list of int
        Each number once, in the order of the text; those of a range in ascending order.

    Raises
    ------
    OptionError
        A part is no number and no range of numbers, or has no number of the case in it.
    """
    known = sorted({kind.of(bus) for bus in case.buses})
    found: dict[int, None] = {}
    for part in parse_ranges(text, what):
        inside = [number for number in known if number in part]
        if not inside:
            name = f"{part[0]}" if len(part) == 1 else f"in the range {part[0]}-{part[-1]}"
            raise OptionError(f"{what}: there is no {kind.value} {name} in case {case.name}")
        found |= dict.fromkeys(inside)
    return list(found)


def lies_in(number: int, ranges: Sequence[range]) -> bool:
    """Whether one of the ranges holds the number."""
    return any(number in part for part in ranges)


def as_ranges(numbers: Iterable[int]) -> str:
    """Numbers as text such as ``1-36,78``, in ascending order."""
    ranges: list[list[int]] = []
    for number in sorted(numbers):
        if ranges and number == ranges[-1][1] + 1:
            ranges[-1][1] = number
        else:
            ranges.append([number, number])
    return ",".join(str(a) if a == b else f"{a}-{b}" for a, b in ranges)
