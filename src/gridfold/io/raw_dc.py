"""Dc lines with two ends from the records of a RAW file.

Names of fields are those of the PSS/E Program Operation Manual, two-terminal dc and voltage source
converter data.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TypeVar

from gridfold.grid.dc_lines import (
    DcControl,
    DcLine,
    LineControl,
    ThyristorEnd,
    ThyristorLine,
    TransistorEnd,
    TransistorLine,
)
from gridfold.io.raw_fields import as_number

TWO_TERMINAL, VSC = "TWO-TERMINAL DC", "VSC DC LINE"
Fields = Mapping[str, str]
Meaning = TypeVar("Meaning")

_LINE_CONTROLS = {0: LineControl.BLOCKED, 1: LineControl.POWER, 2: LineControl.CURRENT}
_DC_CONTROLS = {0: DcControl.OUT, 1: DcControl.VOLTAGE, 2: DcControl.POWER}
_HOLDS_VOLTAGE = {1: True, 2: False}


@dataclass(frozen=True)
class DcRecord:
    """A record of a dc line: its section, the number of each of its lines, their fields by name."""

    section: str
    numbers: tuple[int, ...]
    lines: tuple[Fields, ...]


@dataclass
class DcLines:
    """What the records say.

    Parameters
    ----------
    lines : list of (DcLine, int)
        Each with the line of the file in which it begins.
    faults : list of str
        Fields that are no numbers, and codes that have no meaning, with lines.
    unsupported : list of str
        Lines in service that gridfold has no model for.
    """

    lines: list[tuple[DcLine, int]] = field(default_factory=list)
    faults: list[str] = field(default_factory=list)
    unsupported: list[str] = field(default_factory=list)


def read_dc_lines(records: Sequence[DcRecord]) -> DcLines:
    """The dc lines of a file."""
    found = DcLines()
    for record in records:
        parts = [
            _Fields(number, fields, found.faults)
            for number, fields in zip(record.numbers, record.lines, strict=True)
        ]
        before = len(found.faults)
        line: DcLine = (_thyristors if record.section == TWO_TERMINAL else _transistors)(*parts)
        if len(found.faults) > before:
            continue
        capacitors = [part.number for part in parts[1:] if part.value("XCAP") > 0]
        if capacitors and line.in_service:
            found.unsupported.append(
                f"{line}: capacitors between converters and transformers (line {capacitors[0]})"
            )
            continue
        found.lines.append((line, record.numbers[0]))
    return found


@dataclass(frozen=True)
class _Fields:
    """One line of a record; what cannot be read goes to `faults`."""

    number: int
    fields: Fields
    faults: list[str]

    def text(self, name: str) -> str:
        return self.fields.get(name, "").strip("'").strip()

    def value(self, name: str) -> float:
        text = self.fields.get(name, "")
        if not text:
            return 0.0  # a field that has no default is told where records are completed
        value = as_number(text)
        if value is None:
            self.faults.append(f"line {self.number}: {name} of a dc line is no number: {text}")
            return 0.0
        return value

    def whole(self, name: str) -> int:
        value = self.value(name)
        if not value.is_integer():
            self.faults.append(
                f"line {self.number}: {name} of a dc line is no whole number: {value:g}"
            )
            return 0
        return int(value)

    def code(self, name: str, meanings: Mapping[int, Meaning]) -> Meaning:
        value = self.whole(name)
        if value not in meanings:
            known = ", ".join(str(code) for code in meanings)
            self.faults.append(
                f"line {self.number}: {name} of a dc line is {value}; its codes are {known}"
            )
        return meanings.get(value, next(iter(meanings.values())))


def _thyristors(line: _Fields, rectifier: _Fields, inverter: _Fields) -> ThyristorLine:
    return ThyristorLine(
        name=line.text("NAME"),
        control=line.code("MDC", _LINE_CONTROLS),
        setting=line.value("SETVL"),
        resistance_ohm=line.value("RDC"),
        voltage_kv=line.value("VSCHD"),
        compounding_ohm=line.value("RCOMP"),
        switch_kv=line.value("VCMOD"),
        margin=line.value("DELTI"),
        rectifier=_thyristor_end(rectifier),
        inverter=_thyristor_end(inverter),
    )


def _thyristor_end(part: _Fields) -> ThyristorEnd:
    return ThyristorEnd(
        bus=part.whole("IP"),
        bridges=part.whole("NB"),
        angle_max_deg=part.value("ANMX"),
        angle_min_deg=part.value("ANMN"),
        resistance_ohm=part.value("RC"),
        reactance_ohm=part.value("XC"),
        base_kv=part.value("EBAS"),
        transformer_ratio=part.value("TR"),
        tap=part.value("TAP"),
    )


def _transistors(line: _Fields, first: _Fields, second: _Fields) -> TransistorLine:
    return TransistorLine(
        name=line.text("NAME"),
        in_service=line.code("MDC", {0: False, 1: True}),
        resistance_ohm=line.value("RDC"),
        first=_transistor_end(first),
        second=_transistor_end(second),
    )


def _transistor_end(part: _Fields) -> TransistorEnd:
    holds_voltage = part.code("MODE", _HOLDS_VOLTAGE)
    setting = part.value("ACSET")
    return TransistorEnd(
        bus=part.whole("IBUS"),
        control=part.code("TYPE", _DC_CONTROLS),
        setting=part.value("DCSET"),
        holds_voltage=holds_voltage,
        power_factor=1.0 if holds_voltage else setting,
        voltage_pu=setting if holds_voltage else 1.0,
        regulated_bus=part.whole("REMOT"),
        loss_kw=part.value("ALOSS"),
        loss_kw_per_a=part.value("BLOSS"),
        least_loss_kw=part.value("MINLOSS"),
        reactive_max_mvar=part.value("MAXQ"),
        reactive_min_mvar=part.value("MINQ"),
    )
