"""Records of a RAW file that gridfold has no model for: which of them are in service, and where.

A record that is out of service by its own status changes nothing and is told as a notice. Places of
fields are those of the PSS/E Program Operation Manual.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from gridfold.io.raw_fields import Field, as_number
from gridfold.io.raw_sections import RawSections, fields_of

Fields = Sequence[Field]


@dataclass(frozen=True)
class _Kind:
    """A section: what its records are, and how to tell them.

    Parameters
    ----------
    what : str
        What a record is.
    name : callable
        Its name.
    status : callable
        Place of the code that is 0 where the record is out of service.
    """

    what: str
    name: Callable[[Fields], str]
    status: Callable[[Fields], int]


def _first(fields: Fields) -> str:
    return f'"{_text(fields, 0)}"'


def _unit(fields: Fields) -> str:
    return f"{_text(fields, 0)}:{_text(fields, 1) or '1'}"


_KINDS = {
    "FACTS DEVICE": _Kind("FACTS device", _first, lambda fields: 3),
    "MULTI-TERMINAL DC": _Kind("dc line with more than two ends", _first, lambda fields: 4),
    # name, model, number of buses, the buses, three counts, status
    "GNE": _Kind("GNE device", _first, lambda fields: 6 + _whole(fields, 2)),
    "INDUCTION MACHINE": _Kind("induction machine", _unit, lambda fields: 2),
}
#: Sections that are looked at here.
SECTIONS = tuple(_KINDS)


def left_out(sections: RawSections) -> tuple[list[str], list[str]]:
    """Records in service, and records out of service, each in words with its line."""
    lines = sections.text.split("\n")
    live, idle = [], []
    for section, kind in _KINDS.items():
        for number in sections.of(section):
            fields = fields_of(lines[number - 1])
            record = f"{kind.what} {kind.name(fields)} (line {number})"
            if _out_of_service(fields, kind.status(fields)):
                idle.append(f"{record}, out of service, left out")
            else:
                live.append(record)
    return live, idle


def _out_of_service(fields: Fields, place: int) -> bool:
    """Whether the code there is 0; a blank one means in service."""
    return place < len(fields) and as_number(fields[place].text) == 0


def _text(fields: Fields, place: int) -> str:
    return fields[place].text.strip() if place < len(fields) else ""


def _whole(fields: Fields, place: int) -> int:
    value = as_number(_text(fields, place))
    return int(value) if value is not None and 0 <= value < len(fields) else 0
