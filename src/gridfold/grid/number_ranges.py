"""Numbers of buses and areas as text such as ``1-36,78``."""

from __future__ import annotations

import re
from collections.abc import Iterable

from gridfold.errors import OptionError


def parse_numbers(text: str, what: str = "buses") -> list[int]:
    """Numbers of buses, or of `what`, from text such as ``1-36,78``."""
    numbers: list[int] = []
    for part in text.split(","):
        match = re.fullmatch(r"\s*(\d+)\s*(?:-\s*(\d+)\s*)?", part)
        if match is None:
            raise OptionError(f"{what} are given as 3,7 or 1-36, not {part.strip()!r} in {text!r}")
        first, last = int(match[1]), int(match[2] or match[1])
        if last < first:
            raise OptionError(f"the range {part.strip()!r} ends before it starts")
        numbers += range(first, last + 1)
    return list(dict.fromkeys(numbers))


def as_ranges(numbers: Iterable[int]) -> str:
    """Numbers as text such as ``1-36,78``, in ascending order."""
    ranges: list[list[int]] = []
    for number in sorted(numbers):
        if ranges and number == ranges[-1][1] + 1:
            ranges[-1][1] = number
        else:
            ranges.append([number, number])
    return ",".join(str(a) if a == b else f"{a}-{b}" for a, b in ranges)
