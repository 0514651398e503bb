"""The sections of a PSS/E RAW file: where each record stands, and markers written out in full.

powerio finds a section by the words ``BEGIN ... DATA`` in the line that ends the one before. What
follows a bare ``0``, or a name that it does not know, it skips without a word. Here sections are
also found by their order, every marker is written with the name that powerio knows, and records are
counted, so that none can get lost unseen.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

from gridfold.io.raw_fields import Field, as_number, is_integer, split_fields

_ORDER = (
    "BUS",
    "LOAD",
    "FIXED SHUNT",
    "GENERATOR",
    "BRANCH",
    "SYSTEM SWITCHING DEVICE",  # since revision 34
    "TRANSFORMER",
    "AREA",
    "TWO-TERMINAL DC",
    "VSC DC LINE",
    "IMPEDANCE CORRECTION",
    "MULTI-TERMINAL DC",
    "MULTI-SECTION LINE",
    "ZONE",
    "INTER-AREA TRANSFER",
    "OWNER",
    "FACTS DEVICE",
    "SWITCHED SHUNT",
    "GNE",
    "INDUCTION MACHINE",
    "SUBSTATION",
)
_OLD_ORDER = (  # up to revision 30; shunts stand in the records of buses
    "BUS",
    "LOAD",
    "GENERATOR",
    "BRANCH",
    "TRANSFORMER",
    "AREA",
    "TWO-TERMINAL DC",
    "VSC DC LINE",
    "SWITCHED SHUNT",
    "IMPEDANCE CORRECTION",
    "MULTI-TERMINAL DC",
    "MULTI-SECTION LINE",
    "ZONE",
    "INTER-AREA TRANSFER",
    "OWNER",
    "FACTS DEVICE",
)
_ALIASES = {
    "NON-TRANSFORMER BRANCH": "BRANCH",
    "FIXED BUS SHUNT": "FIXED SHUNT",
    "GEN": "GENERATOR",
    "TWO TERMINAL DC": "TWO-TERMINAL DC",
    "2-TERMINAL DC": "TWO-TERMINAL DC",
    "VOLTAGE SOURCE CONVERTER": "VSC DC LINE",
    "FACTS CONTROL DEVICE": "FACTS DEVICE",
}
THREE_WINDING = "THREE-WINDING TRANSFORMER"
SYSTEM_WIDE = "SYSTEM-WIDE"
_NEEDED = {SYSTEM_WIDE, *_ORDER[: _ORDER.index("AREA")]}  # a file without Q must reach beyond
_TITLE_LINES = 2
_SETTING = re.compile(r"\s*(GENERAL|GAUSS|NEWTON|ADJUST|TYSL|SOLVER|RATING)\s*,")
_SWITCHING_DEVICES_SINCE = _SYSTEM_WIDE_SINCE = 34
_OLD_ORDER_UNTIL = 30
_THREE_LINES = ("TWO-TERMINAL DC", "VSC DC LINE")
_COUNTED_LINES = ("MULTI-TERMINAL DC", "GNE")
_VALUES_A_LINE = 10


@dataclass(frozen=True)
class RawSections:
    """A RAW file with complete markers.

    Parameters
    ----------
    text : str
        The file, line for line.
    header : int
        Line of the header, counted from 1; 0 if there is none.
    records : mapping of str to tuple of tuple of int
        Lines of each record, counted from 1, by section; transformers with three windings are a
        section of their own.
    named : frozenset of str
        Sections that markers name.
    lost_titles : tuple of int
        Lines that stand where a title belongs and read as a record.
    open_section : str
        Section within which the file breaks off; empty if it ends as it should.
    """

    text: str
    header: int
    records: Mapping[str, tuple[tuple[int, ...], ...]]
    named: frozenset[str]
    lost_titles: tuple[int, ...]
    open_section: str

    def of(self, *sections: str) -> tuple[int, ...]:
        """First lines of the records of these sections, one section after the other."""
        return tuple(lines[0] for name in sections for lines in self.records.get(name, ()))

    def lines_with(self, token: str, positions: Collection[int]) -> list[int]:
        """Lines with this field, without quotes, at one of these positions counted from 0."""
        found = []
        for number, line in enumerate(self.text.split("\n"), start=1):
            fields = [field.text.strip() for field in fields_of(line)]
            if any(at < len(fields) and fields[at] == token for at in positions):
                found.append(number)
        return found

    @property
    def doubts(self) -> list[str]:
        """Records that are lost as they stand where a title belongs, in words."""
        return [
            f"line {line} reads as a record but stands where one of the two lines of title belongs: "
            "it is taken for a title"
            for line in self.lost_titles
        ]


def find_sections(text: str, revision: int = 0) -> RawSections:
    """Find the sections and records in the text of a RAW file; 0 is an unknown revision."""
    lines = re.split(r"\r\n|\n|\r", text)  # names may hold what Unicode takes for ends of lines
    header = header_position(lines)
    found: dict[str, list[tuple[int, ...]]] = {}
    named: set[str] = set()
    ended = False
    first = _after_titles(lines, header)
    section, position = SYSTEM_WIDE, first
    while position < len(lines) and lines[position].strip().upper() != "Q":
        line = lines[position]
        if _is_marker(line):
            named.add(_introduced(line))
            following = _section_after(line, section, revision)
            if section != "SUBSTATION" and following:  # its inner blocks have markers of their own
                begin = "" if _nothing_after(lines, position) else f", BEGIN {following} DATA"
                lines[position] = f"0 / END OF {section} DATA{begin}"
            section = following or section
            ended = section not in _NEEDED
        elif not _is_blank(line):
            if section == SYSTEM_WIDE and _begins_buses(line, revision):
                section = "BUS"
            name, length = _record(line, section)
            record = _lines_of_record(lines, position, length)
            found.setdefault(name, []).append(tuple(at + 1 for at in record))
            position = record[-1]
            ended = False
        position += 1
    ended = ended or position < len(lines)
    return RawSections(
        text="\n".join(lines) + "\n",
        header=header + 1 if header < len(lines) else 0,
        records={name: tuple(at) for name, at in found.items()},
        named=frozenset(named),
        lost_titles=tuple(k + 1 for k in range(header + 1, first) if _reads_as_record(lines[k])),
        open_section="" if ended else section,
    )


def header_position(lines: Sequence[str]) -> int:
    """Position of the first line that is neither blank nor a comment."""
    return next((k for k, line in enumerate(lines) if not _is_blank(line)), len(lines))


def fields_of(line: str) -> list[Field]:
    """Fields of a line as far as they can be told; none where a quote is not closed."""
    try:
        return split_fields(line)
    except ValueError:
        return []


def _after_titles(lines: Sequence[str], header: int) -> int:
    """Position after the two lines of title; some writers leave one out."""
    end = min(header + 1 + _TITLE_LINES, len(lines))
    return next((k for k in range(header + 1, end) if _introduced(lines[k])), end)


def _begins_buses(line: str, revision: int) -> bool:
    """Whether a line of the section of settings is the first bus, which may have a wrong number."""
    if 0 < revision < _SYSTEM_WIDE_SINCE:
        return _SETTING.match(line) is None
    return re.match(r"\s*[\d,]", line) is not None


def _reads_as_record(line: str) -> bool:
    """Whether a line of title looks like a bus or like a setting of the system."""
    if _SETTING.match(line):
        return True
    fields = fields_of(line)
    return (
        len(fields) >= 4
        and is_integer(fields[0].text)
        and fields[1].quoted
        and as_number(fields[2].text) is not None
        and fields[3].text in ("1", "2", "3", "4")
    )


def _is_blank(line: str) -> bool:
    return not line.strip() or line.lstrip().startswith("@")


def _nothing_after(lines: Sequence[str], position: int) -> bool:
    following = (line.strip().upper() for line in lines[position + 1 :] if not _is_blank(line))
    return next(following, "Q") == "Q"


def _is_marker(line: str) -> bool:
    return re.match(r"\s*0\s*([,/\s]|$)", line) is not None


def _introduced(line: str) -> str:
    """The section that a marker introduces by name; empty if it names none."""
    if not _is_marker(line):
        return ""
    name = _between(line, "BEGIN") or _between(line, "START OF")
    return _canonical(name) if name else ""


def _between(line: str, opening: str) -> str:
    """What stands between a word and DATA; empty without them. Lines may be of any length."""
    words = " ".join(line.upper().split())
    name, ending, _ = words.partition(f"{opening} ")[2].partition(" DATA")
    return name if ending else ""


def _section_after(marker: str, section: str, revision: int) -> str:
    """The section that follows; empty after the last one."""
    if introduced := _introduced(marker):
        return introduced
    ended = _between(marker, "END OF")
    name = _canonical(ended) if ended else section
    if name == SYSTEM_WIDE:
        return "BUS"
    order = _OLD_ORDER if 0 < revision <= _OLD_ORDER_UNTIL else _ORDER
    rest = order[order.index(name) + 1 :] if name in order else ()
    if revision < _SWITCHING_DEVICES_SINCE:
        rest = tuple(item for item in rest if item != "SYSTEM SWITCHING DEVICE")
    return rest[0] if rest else ""


def _canonical(name: str) -> str:
    upper = " ".join(name.upper().split())
    known = (*_ALIASES, *_ORDER)
    match = max((k for k in known if upper.startswith(k)), key=len, default=upper)
    return _ALIASES.get(match, match)


def _record(line: str, section: str) -> tuple[str, int]:
    """Section under which a record is counted, and its number of lines."""
    if section in _THREE_LINES:
        return section, 3
    if section in _COUNTED_LINES:
        return section, 1 + _counted(fields_of(line), section)
    if section != "TRANSFORMER":
        return section, 1
    fields = fields_of(line)
    third = fields[2].text.strip() if len(fields) > 2 else ""
    return (section, 4) if third in ("", "0") else (THREE_WINDING, 5)


def _counted(fields: Sequence[Field], section: str) -> int:
    """Lines that the first one of a record announces."""
    if section == "MULTI-TERMINAL DC":  # converters, dc buses and dc links, a line each
        return sum(_count(fields, place) for place in (1, 2, 3))
    first = 3 + _count(fields, 2)  # numbers, whole numbers and texts, ten a line, behind the buses
    return sum(-(-_count(fields, place) // _VALUES_A_LINE) for place in range(first, first + 3))


def _count(fields: Sequence[Field], place: int) -> int:
    text = fields[place].text.strip() if place < len(fields) else ""
    return int(text) if re.fullmatch(r"\d{1,6}", text) else 0


def _lines_of_record(lines: Sequence[str], position: int, length: int) -> list[int]:
    """Positions of the lines of a record; it ends early where a section is introduced."""
    found = [position]
    following = position + 1
    while len(found) < length and following < len(lines) and not _introduced(lines[following]):
        if not _is_blank(lines[following]):
            found.append(following)
        following += 1
    return found
