"""Networks from PSS/E RAW files (revisions 29 to 35) and MATPOWER case files, read by powerio.

Conventions taken over from these files:

- A generator holds the stored voltage of its own bus, not its set point or a remote bus: units at
  a reactive limit then start where they are. At a PQ bus of MATPOWER it holds its stored power.
- Of several units at the slack bus the largest balances; the others keep their stored power.
- A transformer with three windings becomes a star bus, numbered from one above the largest bus
  number of the file, and three branches.
- Switched shunts are fixed shunts of their stored susceptance (id ``S`` and their own). Shunts at
  one end of a line and magnetizing admittances belong to the branch, and go out with it.
- In a RAW file a unit is in service if its status says so and its bus is of type 2 or 3. In a MATPOWER
  file the status alone counts.
- A leg of a star without impedance gets 1e-5 p.u. A line or switching device of a RAW file without
  resistance, and with no more reactance than THRSHZ of the file or 1e-4 p.u., joins its two buses.
- Impedances of transformers follow their correction tables, at the stored ratio or shift.
- Dc lines with two ends are taken over, but for those with capacitors (:mod:`gridfold.io.raw_dc`).
  An island without a swing unit that such a line feeds gets its largest unit as one.
- Isolated buses (type 4), and what is connected to them, are left out.
- Of a MATPOWER file only what is literal counts, :mod:`gridfold.io.matpower_file`.
- A blank field of a RAW file is what the manual of PSS/E says, :mod:`gridfold.io.raw_layouts`.

Owners are those of the buses. Inter-area transfers and groups of line sections are not read: no result
depends on them. Nor are the nodes of substations, which is told: what is switched within them is not
seen.
"""

from __future__ import annotations

import json
import re
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gridfold.errors import CaseFileError, OptionError
from gridfold.grid.case import Case
from gridfold.grid.validation import validate_case
from gridfold.io.matpower_file import read_matpower
from gridfold.io.powerio_records import Extras, convert_network
from gridfold.io.raw_beside import annotate, extras_of, skipped, transformer_line
from gridfold.io.raw_codes import check_codes
from gridfold.io.raw_dc import TWO_TERMINAL, VSC, read_dc_lines
from gridfold.io.raw_fields import INNER_QUOTE
from gridfold.io.raw_left_out import SECTIONS as LOOKED_AT
from gridfold.io.raw_left_out import left_out
from gridfold.io.raw_records import complete_records
from gridfold.io.raw_revision import check_revision, find_revision
from gridfold.io.raw_sections import THREE_WINDING, RawSections, find_sections
from gridfold.io.raw_settings import joining_threshold
from gridfold.io.tables import read_foreign_text

if TYPE_CHECKING:
    import powerio

_FORMATS = {".raw": "psse", ".m": "matpower"}
_SECTIONS = {  # sections of a RAW file by powerio's table
    "buses": ("BUS",),
    "loads": ("LOAD",),
    "shunts": ("FIXED SHUNT", "SWITCHED SHUNT"),
    "generators": ("GENERATOR",),
    "branches": ("BRANCH", "TRANSFORMER"),
    "switches": ("SYSTEM SWITCHING DEVICE",),
    "transformers_3w": (THREE_WINDING,),
    "hvdc": (TWO_TERMINAL,),
}
_NOT_NEEDED = {"ZONE", "OWNER", "INTER-AREA TRANSFER", "MULTI-SECTION LINE", "SUBSTATION", VSC}
_NOT_NEEDED |= {*LOOKED_AT}
_COUNTED = {  # names of sections whose records are counted for people
    "BUS": "buses",
    "LOAD": "loads",
    "GENERATOR": "generators",
    "BRANCH": "lines",
    "TRANSFORMER": "two-winding transformers",
    THREE_WINDING: "three-winding transformers",
    "FIXED SHUNT": "fixed shunts",
    "SWITCHED SHUNT": "switched shunts",
    "SYSTEM SWITCHING DEVICE": "switching devices",
    TWO_TERMINAL: "two-terminal dc lines",
    VSC: "VSC dc lines",
}
_HARMLESS = {  # findings of powerio: solver options, remote control, what convert_network looks at
    "READ.PSSE.FIELD_DROPPED",
    "READ.PSSE.REFERENCE_DROPPED",
    "READ.PSSE.RETAINED_SOURCE_ONLY",
    "READ.PSSE.VALUE_DEFAULTED",  # of fields that nothing depends on
}
_ADVICE = "--allow-unsupported-network (allow_unsupported_network=True) reads the file without them"


def read_network(
    path: str | Path, allow_unsupported: bool = False, raw_revision: int | None = None
) -> Case:
    """Read a PSS/E RAW or a MATPOWER file: network and stored operating point, no devices.

    Parameters
    ----------
    path : str or Path
        File with the suffix ``.raw`` (revisions 29 to 35) or ``.m``.
    allow_unsupported : bool
        Leave out what gridfold has no model for; ``Case.unsupported`` then lists it.
    raw_revision : int, optional
        Revision of a RAW file, 29 to 35, whatever its header says; by default that of the header or,
        where it gives none, the one that the fields of the records tell.

    Raises
    ------
    CaseFileError
        The file cannot be read, its data are wrong, or it holds records that gridfold has no model
        for; lists all of them, with lines where they are known.
    OptionError
        There is no such revision, or the file is not a RAW file.
    """
    check_revision(raw_revision)
    path = Path(path)
    file_format = _FORMATS.get(path.suffix.lower())
    if file_format is None:
        known = ".raw (PSS/E) and .m (MATPOWER)"
        raise CaseFileError(f"unknown suffix {path.suffix!r}; known: {known}", str(path))
    text = read_foreign_text(path)
    if file_format == "psse":
        return _checked(_read_raw(text, path, raw_revision), path, allow_unsupported)
    if raw_revision is not None:
        raise OptionError(f"raw_revision is for RAW files of PSS/E, not for {path}")
    return _checked(_read_matpower(text, path), path, allow_unsupported)


def _read_matpower(text: str, path: Path) -> Case:
    file = read_matpower(text, path.name)
    if file.faults:
        left_out = [f"not supported: {line}" for line in file.refused]
        raise CaseFileError([*file.faults, *left_out], str(path))
    data, diagnostics = _parse(file.text, "matpower", path)
    case = _converted(data, path, file.places(data))
    return replace(
        case,
        unsupported=(*file.refused, *_unsupported_findings(diagnostics), *case.unsupported),
        notices=(*file.unread, *case.notices),
        file_counts=_matpower_counts(data),
    )


def _read_raw(text: str, path: Path, wanted: int | None) -> Case:
    sections = find_sections(text, wanted or 0)
    try:
        revision, notices = find_revision(sections, str(path), wanted)
        sections = find_sections(text, revision)
        if sections.open_section:
            fault = f"the file breaks off in the {sections.open_section} section"
            raise CaseFileError(fault, str(path))
        records = complete_records(sections, revision)
        codes = check_codes(replace(sections, text=records.text), revision, path.name)
        threshold, unset = joining_threshold(sections)
        dc_lines = read_dc_lines(records.dc_records)
        live, idle = left_out(sections)
        if faults := [*unset, *records.faults, *codes.faults, *dc_lines.faults]:
            raise CaseFileError(faults, str(path))
        data, diagnostics = _parse(records.text, "psse", path, replace(sections, text=records.text))
        places = _places(data, sections, path)
        annotate(data, records, threshold)
        case = _converted(data, path, places, extras_of(dc_lines, records, path.name))
    except CaseFileError as error:
        raise CaseFileError([*error.faults, *sections.doubts], str(path), error.advice) from error
    return replace(
        case,
        unsupported=(*_unsupported_findings(diagnostics, sections), *live, *case.unsupported),
        notices=(
            *sections.doubts,
            *notices,
            *records.notices,
            *skipped(sections),
            *idle,
            *case.notices,
        ),
        doubts=tuple(codes.doubts),
        zone_names=records.zone_names,
        owner_names=records.owner_names,
        file_counts=_raw_counts(sections),
    )


def _converted(
    data: Mapping[str, Any],
    path: Path,
    places: Mapping[str, Sequence[str]],
    extras: Extras | None = None,
) -> Case:
    try:
        return convert_network(data, path.stem, places, extras or Extras())
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
        fault = f"a record has no meaning: {type(error).__name__}: {error}"
        raise CaseFileError(fault, str(path)) from error


def _checked(case: Case, path: Path, allow_unsupported: bool) -> Case:
    """The case, if it is sound and holds nothing without a model that may not be left out."""
    if case.unsupported and not allow_unsupported:
        faults = [f"not supported: {line}" for line in case.unsupported]
        raise CaseFileError(faults, str(path), [_ADVICE])
    if faults := validate_case(case):
        raise CaseFileError(faults, str(path))
    return case


def _parse(
    text: str, file_format: str, path: Path, sections: RawSections | None = None
) -> tuple[dict[str, Any], Sequence[powerio.Diagnostic]]:
    """Powerio's tables, with all that its typed records leave out, and its findings."""
    import powerio

    try:
        module = powerio.parse(text.encode(), format=file_format, name=path.name)
        document = json.loads(_with_quotes(powerio.serialize(module).text or ""))
        diagnostics = module.diagnostics
    except ValueError as error:  # powerio's errors, a caught panic among them
        message = re.sub(r"^[A-Z.]+: ", "", str(error))
        raise CaseFileError(message + _place_of(message, sections), str(path)) from None
    data = document.get("value", {}).get("data")
    if document.get("version") != 2 or not isinstance(data, dict) or "buses" not in data:
        raise CaseFileError("not a network", str(path))
    return data, diagnostics


def _with_quotes(document: str) -> str:
    """A JSON text with the quotes that were taken out of names, as a character or an escape."""
    return document.replace(INNER_QUOTE, "'").replace(json.dumps(INNER_QUOTE)[1:-1], "'")


def _raw_counts(sections: RawSections) -> dict[str, int]:
    """Records of the file by what they are; of dc links and rarer things only where there are some."""
    counts = {name: len(sections.of(section)) for section, name in _COUNTED.items()}
    usual = [*counts][: [*counts].index("switching devices")]
    return {name: count for name, count in counts.items() if count or name in usual}


def _matpower_counts(data: Mapping[str, Any]) -> dict[str, int]:
    transformers = sum(float(row["tap"]) != 0 for row in data["branches"])
    return {
        "buses": len(data["buses"]),
        "loads": len(data["loads"]),
        "generators": len(data["generators"]),
        "lines": len(data["branches"]) - transformers,
        "two-winding transformers": transformers,
        "fixed shunts": len(data["shunts"]),
    }


def _unsupported_findings(
    diagnostics: Sequence[powerio.Diagnostic], sections: RawSections | None = None
) -> list[str]:
    lines = []
    for finding in diagnostics:
        section = re.match(r"PSS/E (.+) section \((\d+) record line", finding.message)
        if section and section[1] not in _NOT_NEEDED:
            count = "1 record line" if section[2] == "1" else f"{section[2]} record lines"
            lines.append(f"{section[1]} section: {count}")
        elif not section and finding.code not in _HARMLESS:
            lines.append(finding.message + transformer_line(finding.message, sections))
    return lines


def _place_of(message: str, sections: RawSections | None) -> str:
    """Lines that hold the field or bus number of which powerio complains, as ``(line 12)``."""
    field = re.search(r'field `?(\d+)`? "(.*)" ', message)
    number = re.search(r"bus (?:id )?(\d+)", message)
    if sections is None or not (field or number):
        return ""
    if field:
        lines = sections.lines_with(field[2], (int(field[1]),))
    else:
        lines = sections.lines_with(number[1] if number else "", (0, 1, 2))
        if "duplicate" in message:
            lines = [line for line in lines if line in sections.of("BUS")]
    shown = ", ".join(str(line) for line in lines[:5])
    return f" (line{'s' if len(lines) > 1 else ''} {shown})" if lines else ""


def _places(data: Mapping[str, Any], sections: RawSections, path: Path) -> dict[str, list[str]]:
    """Where each row of powerio's tables stands; a record that was lost on the way is an error."""
    places: dict[str, list[str]] = defaultdict(list)
    faults = []
    for table, names in _SECTIONS.items():
        lines = sections.of(*names)
        if len(lines) != len(data[table]):
            faults.append(
                f"{' and '.join(names)}: the file has {len(lines)} records, but {len(data[table])} "
                "could be read"
            )
        places[table] = [f"{path.name}:{line}" for line in lines]
    if faults:
        raise CaseFileError(faults, str(path))
    return places
