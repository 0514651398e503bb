"""What is chosen of a grid, as text: numbers, ranges, areas, zones, owners, voltage levels, names.

A selection is a list of places, of which others may be taken away again::

    1001-1050, 78          buses, by numbers and ranges of them
    area:1,3  zone:2  owner:5      all buses of them; the word holds until the next one
    kv:230  kv:100-345  kv>=345    by the base voltage in kV
    "WEST 1"  area:"NORTH*"        by names as in the file; * stands for any letters
    101:1                  a machine
    line:101-103  line:101-103:2   branches between two buses, or one circuit
    area:1 to area:2       branches from the first place to the second
    all, none, study area
    area:1 except 1005, kv<100     what follows is taken away

This module knows the text alone; :mod:`gridfold.grid.selection` finds the records in a case.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum
from math import inf

from gridfold.errors import OptionError

#: Characters of a text that a message shows.
_SHOWN = 60
_WORDS = "bus(?:es)?|areas?|zones?|owners?|kv|lines?|branch(?:es)?"
_WORD = re.compile(
    rf"({_WORDS})\s*(?::\s*|\s+(?=[\d\"'])|(?=[<>=]))(.*)", re.IGNORECASE | re.DOTALL
)
_NUMBER = "[0-9]{1,18}"
_QUOTED = "\"[^\"]*\"|'[^']*'"
_END = rf"(?:{_NUMBER}|{_QUOTED})"
_RANGE = re.compile(rf"({_NUMBER})(?:\s*-\s*({_NUMBER}))?")
_LINE = re.compile(rf"({_END})\s*-\s*({_END})(?:\s*:\s*([^\s,:]+))?")
_UNIT = re.compile(rf"({_END})\s*:\s*([^\s,:]+)")
_LEVEL = re.compile(r"(>=|<=|>|<|=)?\s*([0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:\s*-\s*([0-9.]+))?")
_PIECES = re.compile(rf"(?:{_QUOTED}|[^,\"'])+|(?<=,)(?=,|$)")
_OUTSIDE_QUOTES = rf"((?:{_QUOTED}|[^\"'])*?)"
_EXCEPT = re.compile(
    rf"{_OUTSIDE_QUOTES}(?<![^\s,])except(?![^\s\"'])(.*)", re.IGNORECASE | re.DOTALL
)
_TO = re.compile(rf"{_OUTSIDE_QUOTES}\s+to\s+(.*)", re.IGNORECASE | re.DOTALL)
#: Relative distance within which two base voltages are the same level.
_SAME_LEVEL = 1e-3


class Word(Enum):
    """What numbers and names are those of."""

    BUS = "bus"
    AREA = "area"
    ZONE = "zone"
    OWNER = "owner"
    KV = "kv"
    LINE = "line"


class Named(Enum):
    """Places with a word of their own."""

    ALL = "all"
    NONE = "none"
    STUDY_AREA = "study area"

    def __str__(self) -> str:
        return self.value


@dataclass(frozen=True)
class Numbers:
    """Numbers `first` to `last` of buses, areas, zones or owners."""

    word: Word
    first: int
    last: int

    def __contains__(self, number: int) -> bool:
        return self.first <= number <= self.last

    def __str__(self) -> str:
        if self.first == self.last:
            return f"{self.word.value} {self.first}"
        return f"{self.word.value} in the range {self.first}-{self.last}"


@dataclass(frozen=True)
class Levels:
    """Base voltages from `low` to `high` in kV, without the ends where `open_ends`."""

    low: float
    high: float
    text: str
    open_ends: bool = False

    def __contains__(self, kv: float) -> bool:
        if self.open_ends:
            return self.low < kv < self.high
        return self.low * (1 - _SAME_LEVEL) <= kv <= self.high * (1 + _SAME_LEVEL)

    def __str__(self) -> str:
        return f"bus of {self.text} kV"


@dataclass(frozen=True)
class Name:
    """A name, or a pattern of names, of buses, areas, zones or owners."""

    word: Word
    pattern: str

    def __str__(self) -> str:
        return f"{self.word.value} {self.pattern!r}"


@dataclass(frozen=True)
class Unit:
    """A machine: its bus and its id."""

    bus: Numbers | Name
    id: str

    def __str__(self) -> str:
        return f"machine {_place(self.bus)}:{self.id}"


@dataclass(frozen=True)
class Line:
    """The branches between two buses, or one circuit of them."""

    first: Numbers | Name
    second: Numbers | Name
    circuit: str | None = None

    def __str__(self) -> str:
        circuit = "" if self.circuit is None else f":{self.circuit}"
        return f"line {_place(self.first)}-{_place(self.second)}{circuit}"


Place = Numbers | Levels | Name | Named


@dataclass(frozen=True)
class Ties:
    """The branches from a place to another one."""

    first: Place
    second: Place

    def __str__(self) -> str:
        return f"line from {self.first} to {self.second}"


Item = Place | Unit | Line | Ties


@dataclass(frozen=True)
class Selection:
    """What is chosen, and what is taken away again."""

    chosen: tuple[Item, ...]
    without: tuple[Item, ...] = ()


def parse_selection(text: str, what: str = "buses", word: Word = Word.BUS) -> Selection:
    """A selection from its text.

    Parameters
    ----------
    text : str
        The text; the module tells its grammar.
    what : str
        Where it is from, for messages.
    word : Word
        What numbers are those of before any word.

    Raises
    ------
    OptionError
        A part of the text is none of these; names all such parts.
    """
    pieces_of(text, what)
    reader = _Reader(what, text, word)
    parted = _EXCEPT.fullmatch(text)
    without: tuple[Item, ...] = ()
    if parted is None:
        chosen = reader.items(text)
    else:
        wanted = parted[1].strip().rstrip(",")
        chosen = reader.items(wanted) if wanted else (Named.ALL,)
        without = reader.items(parted[2], beside=True)
    if reader.faults:
        raise OptionError(f"{what}: {'; '.join(reader.faults)}")
    return Selection(chosen, without)


def pieces_of(text: str, what: str) -> list[str]:
    """The parts of a text between commas that do not stand in quotes, without blanks around.

    Raises
    ------
    OptionError
        A quote is not closed; `what` is where the text is from.
    """
    if re.search("[\"']", re.sub(_QUOTED, "", text)):
        raise OptionError(f"{what}: a quote is not closed: {_shown(text)}")
    return [piece.strip() for piece in _PIECES.findall(text)] or [""]


def as_ranges(numbers: Iterable[int]) -> str:
    """Numbers as text such as ``1-36,78``, in ascending order."""
    ranges: list[list[int]] = []
    for number in sorted(numbers):
        if ranges and number == ranges[-1][1] + 1:
            ranges[-1][1] = number
        else:
            ranges.append([number, number])
    return ",".join(str(a) if a == b else f"{a}-{b}" for a, b in ranges)


class _Reader:
    """Reads the parts of a text one after the other: a word holds until the next one."""

    def __init__(self, what: str, text: str, word: Word):
        self.what, self.text, self.word = what, text, word
        self.faults: list[str] = []

    def items(self, text: str, beside: bool = False) -> tuple[Item, ...]:
        """The items of a list; those `beside` another one say by a word what their numbers are."""
        unsaid = beside and self.word not in (Word.BUS, Word.LINE)
        found = []
        for piece in pieces_of(text, self.what):
            try:
                if unsaid and (_RANGE.fullmatch(piece) or re.fullmatch(_QUOTED, piece)):
                    raise _unclear(piece, self.word)
                found.append(self._item(piece))
                unsaid = False
            except ValueError as error:
                self.faults.append(str(error))
        return tuple(found)

    def _item(self, piece: str) -> Item:
        if ends := _TO.fullmatch(piece):
            return Ties(self._place(ends[1].strip()), self._place(ends[2].strip()))
        named = " ".join(piece.lower().split())
        if named in [place.value for place in Named]:
            return Named(named)
        if worded := _WORD.fullmatch(piece):
            self.word = _word(worded[1])
            piece = worded[2].strip()
        if line := _LINE.fullmatch(piece):
            if self.word is Word.LINE or line[3] or not _RANGE.fullmatch(piece):
                return Line(_end(line[1]), _end(line[2]), line[3])
        elif self.word is Word.LINE:
            if not piece or piece[0] in "0123456789\"'":
                raise ValueError(
                    f"a line is written 101-103 or 101-103:CIRCUIT, not {_shown(piece)}; "
                    "all lines of a bus are bus:101 to all"
                )
        elif unit := _UNIT.fullmatch(piece):
            return Unit(_end(unit[1]), unit[2])
        if self.word is Word.KV and (level := _LEVEL.fullmatch(piece)):
            return _levels(level)
        if re.fullmatch(_QUOTED, piece):
            return Name(self.word, piece[1:-1].strip())
        if numbers := _RANGE.fullmatch(piece):
            return _numbers(self.word, numbers, piece)
        raise ValueError(self._refusal(piece))

    def _place(self, text: str) -> Place:
        """One end of ties: its numbers are those of buses unless a word says otherwise."""
        line_before, self.word = self.word, Word.BUS
        try:
            item = self._item(text)
        finally:
            self.word = line_before
        if isinstance(item, Unit | Line | Ties):
            raise ValueError(f"{_shown(text)} is no place from which or to which branches lead")
        return item

    def _refusal(self, piece: str) -> str:
        where = f" in {_shown(self.text)}" if len(piece) < len(self.text.strip()) else ""
        forms = "3,7 or 1-36, area:1, kv>=345, names in quotes, 'study area', 'all', 'none'"
        return f"{_shown(piece)}{where} names nothing; what is chosen is written as {forms}"


def _word(text: str) -> Word:
    lower = text.lower()
    if lower.startswith("branch"):
        return Word.LINE
    return next(word for word in Word if lower.startswith(word.value))


def _end(text: str) -> Numbers | Name:
    if text[0] in "\"'":
        return Name(Word.BUS, text[1:-1].strip())
    return Numbers(Word.BUS, int(text), int(text))


def _numbers(word: Word, match: re.Match[str], piece: str) -> Numbers:
    first, last = int(match[1]), int(match[2] or match[1])
    if last < first:
        raise ValueError(f"the range {piece!r} ends before it starts")
    return Numbers(word, first, last)


def _levels(match: re.Match[str]) -> Levels:
    sign, value, text = match[1] or "=", float(match[2]), match[0].replace(" ", "")
    if match[3] is not None:
        if match[1] or match[3].count(".") > 1 or not match[3].strip("."):
            raise ValueError(f"{_shown(text)} is no range of voltages in kV")
        if float(match[3]) < value:
            raise ValueError(f"the range {text!r} ends before it starts")
        return Levels(value, float(match[3]), text)
    low, high = {"<": (-inf, value), ">": (value, inf), "=": (value, value)}[sign[0]]
    return Levels(low, high, text, open_ends=sign in "<>")


def _place(item: Numbers | Name) -> str:
    return str(item.first) if isinstance(item, Numbers) else repr(item.pattern)


def _unclear(piece: str, word: Word) -> ValueError:
    return ValueError(
        f"after 'except' say what {_shown(piece)} is: bus:{piece[:_SHOWN]} or "
        f"{word.value}:{piece[:_SHOWN]}"
    )


def _shown(text: str) -> str:
    return repr(text[:_SHOWN])
