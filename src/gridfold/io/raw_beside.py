"""What the records of a RAW file tell beside the tables of powerio."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from gridfold.io.flow_controls import bus_number
from gridfold.io.powerio_branches import JOINS, LINE_CHARGING
from gridfold.io.powerio_records import BLANK_FIELDS, OWNER, Extras
from gridfold.io.raw_dc import DcLines
from gridfold.io.raw_records import CompleteRecords
from gridfold.io.raw_sections import THREE_WINDING, RawSections, fields_of


def annotate(data: Mapping[str, Any], records: CompleteRecords, threshold: float) -> None:
    """Tell of buses, lines and generators what powerio does not."""
    for row, owner in zip(data["buses"], records.owners, strict=True):
        row[OWNER] = owner
    for row, charging in zip(data["branches"], records.line_charging, strict=False):
        row[LINE_CHARGING] = charging
        row[JOINS] = float(row["r"]) == 0 and abs(float(row["x"])) <= threshold
    for row in data["switches"]:
        row[JOINS] = abs(float(row["extras"].get("psse_xpu", 0.0))) <= threshold
    units = zip(data["generators"], records.blanks, records.regulated, strict=True)
    for row, blanks, bus in units:
        row[BLANK_FIELDS] = blanks
        row["regulated_bus"] = bus_number(bus)  # powerio drops one that is not in the file
    fixed = len(data["shunts"]) - len(records.held_by_shunts)
    shunts = zip(data["shunts"][fixed:], records.held_by_shunts, records.shunt_blocks, strict=True)
    for row, bus, blocks in shunts:
        if row.get("control"):
            row["control"]["control_bus"] = bus_number(bus)
            row["control"]["blocks"] = [{"steps": steps, "b": mvar} for steps, mvar in blocks]


def extras_of(dc_lines: DcLines, records: CompleteRecords, file: str) -> Extras:
    """What powerio does not tell, with its places."""
    return Extras(
        dc_lines=tuple((line, f"{file}:{number}") for line, number in dc_lines.lines),
        bus_shunts=tuple((fields, f"{file}:{at}") for at, fields in records.bus_shunts),
        unsupported=tuple(dc_lines.unsupported),
    )


def skipped(sections: RawSections) -> list[str]:
    """What is not read and might have been meant to count."""
    nodes = len(sections.of("SUBSTATION"))
    if not nodes:
        return []
    return [
        f"substations with their nodes are not read ({nodes} lines): buses are as in the BUS section"
    ]


def transformer_line(message: str, sections: RawSections | None) -> str:
    """The line of the transformer that powerio speaks of, as ``(line 12)``."""
    named = re.search(r'transformer (\d+)-(\d+)-(\d+) id "(.*?)"', message)
    if sections is None or named is None:
        return ""
    texts = sections.text.split("\n")
    for number in sections.of("TRANSFORMER", THREE_WINDING):
        fields = [item.text.strip().removeprefix("-") for item in fields_of(texts[number - 1])[:4]]
        buses = [text or "0" for text in fields[:3]]
        if buses == [*named.groups()][:3] and (fields[3:] or ["1"])[0] == named[4].strip():
            return f" (line {number})"
    return ""
