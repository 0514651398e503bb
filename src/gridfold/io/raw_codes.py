"""Codes of RAW files that have no meaning, and powers beyond the limits that stand beside them.

The manual of PSS/E gives every code its values. Another one is a fault here: what it would mean is
not said there, and a bus of type 9 that is read as a load bus is another grid. The base of a unit is
SBASE where it is blank; 0 is read like that too, but doubted, and less than 0 is a fault.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from gridfold.grid.doubts import Doubt, Usual, doubt_of
from gridfold.io.raw_fields import as_number
from gridfold.io.raw_layouts import layouts
from gridfold.io.raw_sections import THREE_WINDING, RawSections, fields_of
from gridfold.io.raw_shunts import block_faults

_STATUS = ("0", "1")
_UNITS = {"CW": ("1", "2", "3"), "CZ": ("1", "2", "3"), "CM": ("1", "2")}
#: Values of the codes on the first line of the records of each section.
CODES: Mapping[str, Mapping[str, tuple[str, ...]]] = {
    "BUS": {"IDE": ("1", "2", "3", "4")},
    "LOAD": {"STATUS": _STATUS},
    "FIXED SHUNT": {"STATUS": _STATUS},
    "GENERATOR": {"STAT": _STATUS},
    "BRANCH": {"ST": _STATUS},
    "SYSTEM SWITCHING DEVICE": {"STATUS": ("0", "1", "2", "3")},
    "TRANSFORMER": _UNITS | {"STAT": _STATUS},
    THREE_WINDING: _UNITS | {"STAT": ("0", "1", "2", "3", "4")},
    "SWITCHED SHUNT": {"STAT": _STATUS},
}
#: Power (MW) beyond a limit that is put down to rounding.
_ROUNDING_MW = 0.1

POWER_LIMITS = Usual(
    "file.power_limits",
    "active power PG",
    ((0, _ROUNDING_MW),),
    "MW beyond PB to PT",
    "limits of the unit in the same record; at a slack bus they are no matter of the file",
)
BASE = Usual(
    "file.base",
    "base MBASE",
    ((0.05, 20_000),),
    "MVA",
    "0 is read as SBASE, which the manual gives for a blank field alone",
)


@dataclass
class RawCodes:
    """What was found: faults, and doubts about values that only the file shows."""

    faults: list[str] = field(default_factory=list)
    doubts: list[Doubt] = field(default_factory=list)


def check_codes(sections: RawSections, revision: int, file: str) -> RawCodes:
    """Look at all codes, bases and limits of a RAW file.

    Parameters
    ----------
    sections : RawSections
        The file, every field written out (:mod:`gridfold.io.raw_records`).
    revision : int
        Its revision.
    file : str
        Its name, for messages.
    """
    found = RawCodes()
    for section, wanted in CODES.items():
        for number, given in _records(sections, section, revision):
            for name, values in wanted.items():
                text = given.get(name, "")
                if text and _whole(text) not in values:
                    known = ", ".join(values)
                    found.faults.append(
                        f"line {number}: {name} of a {section.lower()} is {text}; its codes are {known}"
                    )
    found.faults += block_faults(sections, revision)
    slack = {
        bus.get("I") for _, bus in _records(sections, "BUS", revision) if bus.get("IDE") == "3"
    }
    for number, unit in _records(sections, "GENERATOR", revision):
        bus = unit.get("I", "")
        name = f"generator {bus}:{unit.get('ID', '1')}"
        base = as_number(unit.get("MBASE", ""))
        if base is not None and base < 0:
            found.faults.append(
                f"line {number}: MBASE of {name} is {base:g}; it must be positive, or blank for SBASE"
            )
        if unit.get("STAT") == "1":
            limits = () if bus in slack else _beyond_limits(unit)
            told = [*([(BASE.name, "MBASE is 0; SBASE is taken")] if base == 0 else ()), *limits]
            found.doubts += doubt_of(name, f"{file}:{number}", told)
    return found


def _records(
    sections: RawSections, section: str, revision: int
) -> Iterator[tuple[int, dict[str, str]]]:
    """Line and fields by name of the first line of each record of a section."""
    lines = sections.text.split("\n")
    names = [column.name for column in layouts(revision).get(section, ((),))[0]]
    for number in sections.of(section):
        texts = (item.text.strip() for item in fields_of(lines[number - 1]))
        yield number, dict(zip(names, texts, strict=False))


def _beyond_limits(unit: Mapping[str, str]) -> Iterator[tuple[str, str]]:
    power = as_number(unit.get("PG", "")) or 0.0
    for limit_name, side in (("PT", 1), ("PB", -1)):
        limit = as_number(unit.get(limit_name, ""))
        if limit is not None and not POWER_LIMITS.holds(max(side * (power - limit), 0.0)):
            where = "above" if side > 0 else "below"
            text = f"active power PG is {power:g} MW, {where} {limit_name} {limit:g} MW"
            yield POWER_LIMITS.name, text


def _whole(text: str) -> str:
    """A code as a whole number, which some writers give as ``1.0``."""
    value = as_number(text)
    return f"{value:.0f}" if value is not None and value.is_integer() else text
