"""The sections of a PSS/E RAW file: where each record stands, and markers written out in full.

powerio finds a section by the words ``BEGIN ... DATA`` in the line that ends the one before. What
follows a bare ``0``, or a name that it does not know, it skips without a word. Here sections are
also found by their order, every marker is written with the name that powerio knows, and records are
counted, so that none can get lost unseen.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass

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
_SYSTEM_WIDE = "SYSTEM-WIDE"
_NEEDED = {_SYSTEM_WIDE, *_ORDER[: _ORDER.index("AREA")]}  # a file without Q must reach beyond
_TITLE_LINES = 2
_SWITCHING_DEVICES_SINCE = 34


@dataclass(frozen=True)
class RawSections:
    """A RAW file with complete markers.

    Parameters
    ----------
    text : str
        The file, line for line.
    lines : mapping of str to tuple of int
        First line of each record, counted from 1, by section; transformers with three windings are
        a section of their own.
    open_section : str
        Section within which the file breaks off; empty if it ends as it should.
    """

    text: str
    lines: Mapping[str, tuple[int, ...]]
    open_section: str

    def of(self, *sections: str) -> tuple[int, ...]:
        """First lines of the records of these sections, one section after the other."""
        return tuple(line for section in sections for line in self.lines.get(section, ()))

    def lines_with(self, token: str, positions: Collection[int]) -> list[int]:
        """Lines with this field, without quotes, at one of these positions counted from 0."""
        found = []
        for number, line in enumerate(self.text.split("\n"), start=1):
            fields = [field.strip(" '\"") for field in _fields(line)]
            if any(at < len(fields) and fields[at] == token for at in positions):
                found.append(number)
        return found

    def short_records(self) -> Iterator[tuple[int, str]]:
        """Lines and faults of branches without a reactance, for which no default makes sense."""
        lines = self.text.split("\n")
        for number in self.of("BRANCH"):
            if len(_fields(lines[number - 1])) < 5:
                yield number, "a branch needs resistance and reactance"
        for section, needed in (("TRANSFORMER", 2), (THREE_WINDING, 8)):
            for number in self.of(section):
                after = (line for line in lines[number:] if not _is_blank(line))
                if len(_fields(next(after, ""))) < needed:
                    yield number, "a transformer needs resistances and reactances"


def find_sections(text: str) -> RawSections:
    """Find the sections and records in the text of a RAW file."""
    lines = re.split(r"\r\n|\n|\r", text)  # names may hold what Unicode takes for ends of lines
    header = next((k for k, line in enumerate(lines) if not _is_blank(line)), len(lines))
    revision = _revision(lines[header]) if header < len(lines) else 0
    found: dict[str, list[int]] = {}
    ended = False
    section, position = _SYSTEM_WIDE, _after_titles(lines, header)
    while position < len(lines) and lines[position].strip().upper() != "Q":
        line = lines[position]
        if _is_marker(line):
            following = _section_after(line, section, revision)
            if section != "SUBSTATION" and following:  # its inner blocks have markers of their own
                lines[position] = f"0 / END OF {section} DATA, BEGIN {following} DATA"
            section = following or section
            ended = section not in _NEEDED
        elif not _is_blank(line):
            if section == _SYSTEM_WIDE and re.match(r"\s*\d", line):
                section = "BUS"
            name, length = _record(line, section)
            found.setdefault(name, []).append(position + 1)
            position = _last_line(lines, position, length)
            ended = False
        position += 1
    ended = ended or position < len(lines)
    if revision == 31 and not found.get("SWITCHED SHUNT"):
        lines[header] = _REVISION.sub(r"\g<1>32", lines[header])
    records = {name: tuple(at) for name, at in found.items()}
    return RawSections("\n".join(lines) + "\n", records, "" if ended else section)


_REVISION = re.compile(r"^([^,/]*,[^,/]*,\s*)(\d+)\b")


def _revision(header: str) -> int:
    found = _REVISION.match(header)
    return int(found[2]) if found and len(found[2]) < 4 else 0


def _after_titles(lines: Sequence[str], header: int) -> int:
    """Position after the two lines of title; some writers leave one out."""
    end = min(header + 1 + _TITLE_LINES, len(lines))
    return next((k for k in range(header + 1, end) if _introduced(lines[k])), end)


def _is_blank(line: str) -> bool:
    return not line.strip() or line.lstrip().startswith("@")


def _is_marker(line: str) -> bool:
    return re.match(r"\s*0\s*([,/\s]|$)", line) is not None


def _introduced(line: str) -> str:
    """The section that a marker introduces by name; empty if it names none."""
    found = re.search(r"(?:BEGIN|START OF)\s+(.*?)\s+DATA", line, re.IGNORECASE)
    return _canonical(found[1]) if found and _is_marker(line) else ""


def _section_after(marker: str, section: str, revision: int) -> str:
    """The section that follows; empty after the last one."""
    if introduced := _introduced(marker):
        return introduced
    ended = re.search(r"END OF\s+(.*?)\s+DATA", marker, re.IGNORECASE)
    name = _canonical(ended[1]) if ended else section
    if name == _SYSTEM_WIDE:
        return "BUS"
    rest = _ORDER[_ORDER.index(name) + 1 :] if name in _ORDER else ()
    if revision < _SWITCHING_DEVICES_SINCE:
        rest = tuple(item for item in rest if item != "SYSTEM SWITCHING DEVICE")
    return rest[0] if rest else ""


def _canonical(name: str) -> str:
    upper = " ".join(name.upper().split())
    known = (*_ALIASES, *_ORDER)
    match = max((k for k in known if upper.startswith(k)), key=len, default=upper)
    return _ALIASES.get(match, match)


def _fields(line: str) -> list[str]:
    """Fields without regard to quotes, which are not needed where this is used."""
    text = line.split("/")[0]
    return [field.strip() for field in text.split(",")] if "," in text else text.split()


def _record(line: str, section: str) -> tuple[str, int]:
    """Section under which a record is counted, and its number of lines."""
    if section == "TWO-TERMINAL DC":
        return section, 3
    if section != "TRANSFORMER":
        return section, 1
    fields = _fields(line)
    third = fields[2] if len(fields) > 2 else ""
    return (section, 4) if third in ("", "0") else (THREE_WINDING, 5)


def _last_line(lines: Sequence[str], position: int, length: int) -> int:
    """Position of the last line of a record; it ends early where a section is introduced."""
    while length > 1 and position + 1 < len(lines) and not _introduced(lines[position + 1]):
        position += 1
        length -= not _is_blank(lines[position])
    return position
