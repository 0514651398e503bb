"""The records of a RAW file with every field written out.

powerio takes a comma at the beginning of a line for nothing, has defaults of its own for blank fields,
and refuses numbers with the exponent D and quotes within names. So it is given a text in which all
fields that matter stand, one comma apart.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import inf, isfinite

from gridfold.io.raw_dc import TWO_TERMINAL, VSC, DcRecord
from gridfold.io.raw_fields import (
    Field,
    as_number,
    is_integer,
    plain_number,
    plain_real,
    split_fields,
)
from gridfold.io.raw_layouts import WRITTEN_SINCE, Base, Column, Layout, layouts
from gridfold.io.raw_sections import THREE_WINDING, RawSections
from gridfold.io.raw_shunts import blocks_in_service
from gridfold.io.raw_windings import refer_to_buses

_HEADER = {"IC": "0", "SBASE": "100.0", "REV": "33", "XFRRAT": "0", "NXFRAT": "0", "BASFRQ": "60.0"}
_UNITS = {"SBASE": "MVA", "BASFRQ": "Hz"}
_WHAT = {
    "BUS": "a bus",
    "LOAD": "a load",
    "FIXED SHUNT": "a fixed shunt",
    "GENERATOR": "a generator",
    "BRANCH": "a branch",
    "SYSTEM SWITCHING DEVICE": "a switching device",
    "TRANSFORMER": "a transformer",
    THREE_WINDING: "a transformer with three windings",
    "AREA": "an area",
    "SWITCHED SHUNT": "a switched shunt",
    TWO_TERMINAL: "a two-terminal dc line",
    VSC: "a VSC dc line",
}
#: Largest number of a bus that the rest of the program can hold.
LARGEST_NUMBER = 2**31 - 1
_IN_KILOVOLTS = "2"  # CW
#: Records of branches, in which a minus before a bus number says where power is metered.
_METERED = ("BRANCH", "TRANSFORMER", THREE_WINDING, "SYSTEM SWITCHING DEVICE")
_ENDS = {"I", "J", "K"}


@dataclass
class CompleteRecords:
    """A RAW file with complete records.

    Parameters
    ----------
    text : str
        The file, line for line.
    faults : list of str
        Fields that have no default and are blank, quotes that are not closed, and records that lack
        lines; with lines.
    notices : list of str
        Blank fields of the header that stand for a base.
    line_charging : list of float
        Field B of each line, in per unit; nan where it is no number.
    blanks : list of frozenset of str
        Fields of each generator that were blank.
    regulated, held_by_shunts : list of str
        Field IREG of each generator, and SWREM of each switched shunt.
    shunt_blocks : list of tuple of (int, float)
        Steps and Mvar a step of the blocks in service of each switched shunt.
    bus_shunts : list of (int, Mapping)
        Line and fields of each bus record that holds a shunt, up to revision 30.
    dc_records : list of DcRecord
        Records of dc lines with two ends.
    owners : list of int
        Owner of each bus.
    zone_names, owner_names : dict of int to str
        Names of zones and owners.
    """

    text: str = ""
    faults: list[str] = field(default_factory=list)
    notices: list[str] = field(default_factory=list)
    line_charging: list[float] = field(default_factory=list)
    blanks: list[frozenset[str]] = field(default_factory=list)
    regulated: list[str] = field(default_factory=list)
    held_by_shunts: list[str] = field(default_factory=list)
    shunt_blocks: list[tuple[tuple[int, float], ...]] = field(default_factory=list)
    bus_shunts: list[tuple[int, Mapping[str, str]]] = field(default_factory=list)
    dc_records: list[DcRecord] = field(default_factory=list)
    owners: list[int] = field(default_factory=list)
    zone_names: dict[int, str] = field(default_factory=dict)
    owner_names: dict[int, str] = field(default_factory=dict)


def complete_records(sections: RawSections, revision: int) -> CompleteRecords:
    """Write out every field of the header and the records of a file of this revision."""
    return _Writer(sections, revision).complete()


class _Writer:
    def __init__(self, sections: RawSections, revision: int):
        self.sections, self.layouts = sections, layouts(revision)
        self.revision = max(revision, WRITTEN_SINCE)
        self.written = layouts(self.revision)
        self.lines = sections.text.split("\n")
        self.done = CompleteRecords()
        self.kilovolts: dict[str, str] = {}
        self.base_mva = _HEADER["SBASE"]

    def complete(self) -> CompleteRecords:
        self._header()
        for section in ("BUS", *(name for name in self.sections.records if name != "BUS")):
            for record in self.sections.records.get(section, ()):
                if section in self.layouts:
                    self._record(section, record)
                else:
                    self._unknown(section, record)
        self.done.text = "\n".join(self.lines)
        self.done.faults.sort(key=lambda fault: int(fault.split()[1].rstrip(":")))
        return self.done

    def _header(self) -> None:
        if not self.sections.header:
            return
        fields = self._split(self.sections.header) or []
        texts = [plain_number(item.text.strip()) for item in fields] + [""] * len(_HEADER)
        given = dict(zip(_HEADER, texts, strict=False))
        given["REV"] = str(self.revision)
        for name, unit in _UNITS.items():
            if not given[name]:
                self.done.notices.append(
                    f"{name} of the header is blank: {float(_HEADER[name]):g} {unit}"
                )
        values = {name: given[name] or default for name, default in _HEADER.items()}
        for name in _UNITS:
            value = as_number(values[name])
            if value is None or not 0 < value < inf:
                fault = f"{name} of the header is {values[name]}; it must be a positive number"
                self.done.faults.append(f"line {self.sections.header}: {fault}")
        self.base_mva = values["SBASE"]
        self.lines[self.sections.header - 1] = ",".join(values.values())

    def _record(self, section: str, record: Sequence[int]) -> None:
        if len(record) < len(self.layouts[section]):
            needed = f"needs {len(self.layouts[section])} lines, and {len(record)} are there"
            self.done.faults.append(f"line {record[0]}: {_WHAT[section]} {needed}")
            return
        parts = [self._split(number) for number in record]
        if None in parts:
            return
        written: list[dict[str, str]] = []
        rests: list[list[str]] = []
        blanks: set[str] = set()
        lines = zip(record, self.layouts[section], parts, strict=False)
        for k, (number, layout, part) in enumerate(lines):
            fields = part or []
            given = _by_column(layout, fields)
            blanks |= {column.name for column in layout if given[column].blank}
            faults = (_fault(column, given[column], section) for column in layout)
            self.done.faults += [f"line {number}: {fault}" for fault in faults if fault]
            defaults = {Base.SYSTEM: self.base_mva, Base.WINDING: self._ratio(parts[0] or [], k)}
            written.append({c.name: _complete(c, given[c], defaults) for c in layout})
            rests.append([_number(item) for item in fields[len(layout) :]])
        if section in _METERED:
            for end in _ENDS & written[0].keys():
                written[0][end] = written[0][end].removeprefix("-")
        if section in ("TRANSFORMER", THREE_WINDING):
            refer_to_buses(written, self.kilovolts)
        self._remember(section, record, written, blanks)
        if section == "SWITCHED SHUNT":
            self.done.shunt_blocks.append(blocks_in_service(rests[0], self.revision))
        for number, completed, rest, layout in zip(
            record, written, rests, self.written[section], strict=False
        ):
            known = [completed.get(column.name, column.default) for column in layout]
            self.lines[number - 1] = ",".join([*map(str, known), *rest])

    def _ratio(self, first: Sequence[Field], line: int) -> str:
        """Ratio of a winding by default; those of a transformer begin in its third line."""
        winding = line - 2
        in_kilovolts = len(first) > 4 and first[4].text == _IN_KILOVOLTS
        return (
            self.kilovolts.get(first[winding].text, "1") if in_kilovolts and winding >= 0 else "1"
        )

    def _remember(
        self,
        section: str,
        record: Sequence[int],
        written: Sequence[Mapping[str, str]],
        blanks: set[str],
    ) -> None:
        values = written[0]
        if section == "BUS":
            self.done.owners.append(_whole(values["OWNER"]) or 1)
            if "BASKV" not in blanks:
                self.kilovolts[values["I"]] = values["BASKV"]
            self._bus_shunt(record[0], values)
        elif section in (TWO_TERMINAL, VSC):
            self.done.dc_records.append(DcRecord(section, tuple(record), tuple(written)))
        elif section == "BRANCH":
            self.done.line_charging.append(_float(values["B"]))
        elif section == "GENERATOR":
            self.done.blanks.append(frozenset(blanks))
            self.done.regulated.append(values["IREG"])
        elif section == "SWITCHED SHUNT":
            self.done.held_by_shunts.append(values["SWREM"])

    def _bus_shunt(self, number: int, values: Mapping[str, str]) -> None:
        given = {name: values.get(name, "0") for name in ("GL", "BL")}
        for name, text in given.items():
            if not isfinite(_float(text)):
                self.done.faults.append(f"line {number}: {name} of a bus is no number: {text}")
        if any(_float(text) for text in given.values()):
            self.done.bus_shunts.append((number, values))

    def _unknown(self, section: str, record: Sequence[int]) -> None:
        for number in record:
            try:
                fields = split_fields(self.lines[number - 1])
            except ValueError:
                continue
            if any(_number(item) != item.written for item in fields):
                self.lines[number - 1] = ",".join(_number(item) for item in fields)
            self._remember_name(section, fields)

    def _remember_name(self, section: str, fields: Sequence[Field]) -> None:
        """Name of a zone or an owner, of a record number, name."""
        names = {"ZONE": self.done.zone_names, "OWNER": self.done.owner_names}.get(section)
        if names is None or len(fields) < 2 or fields[1].blank:
            return
        number = _whole(fields[0].text)
        if number is not None:
            names[number] = fields[1].text.strip()

    def _split(self, number: int) -> list[Field] | None:
        try:
            return split_fields(self.lines[number - 1])
        except ValueError as error:
            self.done.faults.append(f"line {number}: {error}")
            return None


def _fault(column: Column, given: Field, section: str) -> str:
    """What is wrong with a field; empty where nothing is."""
    name = f"{column.name} of {_WHAT[section]}"
    if given.blank:
        return f"{name} is blank, and it has no default" if column.needed else ""
    if column.is_text:
        return ""
    value = as_number(given.text)
    if value is None or not isfinite(value):
        return f"{name} is no number: {given.text.strip()}"
    if column.least is None:
        return ""
    if section in _METERED and column.name in _ENDS:
        value = abs(value)
    if value.is_integer() and column.least <= value <= LARGEST_NUMBER:
        return ""
    return f"{name} is {given.text.strip()}; it must be a whole number of {column.least} or more"


def _by_column(layout: Layout, fields: Sequence[Field]) -> dict[Column, Field]:
    missing = [Field()] * max(0, len(layout) - len(fields))
    return dict(zip(layout, [*fields, *missing], strict=False))


def _complete(column: Column, given: Field, defaults: Mapping[Base, str]) -> str:
    """The field as it is written, or what it stands for where it is blank."""
    if not given.blank:
        if column.is_text:
            return Field(given.text, quoted=True).written
        return plain_number(given.text) if not given.quoted else given.written
    default = column.default
    value = defaults[default] if isinstance(default, Base) else default or ""
    return Field(value, quoted=True).written if column.is_text else value


def _number(item: Field) -> str:
    return item.written if item.quoted else plain_real(item.text)


def _whole(text: str) -> int | None:
    return int(text) if is_integer(text.strip()) else None


def _float(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return float("nan")
