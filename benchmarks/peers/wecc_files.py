"""WECC240 with the four changes that make it one case to ANDES and to PSS/E's models.

Each is a change of the files, so that both programs read the same:

- the voltage set point of every generator is the stored voltage of its bus: ANDES starts from set
  points;
- REGCA1 has no low-voltage power logic (Lvplsw = 0) and no limit of the recovery of power (Rrpwr),
  which ANDES takes on the system base;
- REPCA1 controls no active power (Fflag = 0): ANDES measures none where a record names no branch;
- there are no IEEEST.
"""

from __future__ import annotations

import re
from pathlib import Path

#: So fast that it is no limit, p.u./s.
NO_LIMIT = "9999.0"
#: Fields of the records in question, counted from 0: voltage of a bus, set point of a generator.
BUS_VOLTAGE, SET_POINT = 7, 6
#: Parameters by model, counted from 0 behind the id, and what stands there instead.
REPLACED = {"REGCA1": {0: "0", 2: NO_LIMIT}, "REPCA1": {6: "0"}}
LEFT_OUT = "IEEEST"


def write_changed(raw: Path, dyr: Path, folder: Path) -> tuple[Path, Path]:
    """Write both files with the changes into a folder; their paths."""
    paths = folder / raw.name, folder / dyr.name
    paths[0].write_text(stored_set_points(raw.read_text(encoding="utf-8")), encoding="utf-8")
    paths[1].write_text(changed_records(dyr.read_text(encoding="utf-8")), encoding="utf-8")
    return paths


def stored_set_points(text: str) -> str:
    """A RAW file in which generators hold the stored voltages of their buses."""
    lines = text.splitlines()
    ends = [k for k, line in enumerate(lines) if re.match(r"\s*0\s*(/.*)?$", line) and k > 2]
    voltages = {}
    for line in lines[3 : ends[0]]:
        fields = line.split(",")
        voltages[int(fields[0])] = fields[BUS_VOLTAGE]
    for k in range(ends[2] + 1, ends[3]):
        fields = lines[k].split(",")
        fields[SET_POINT] = voltages[int(fields[0])]
        lines[k] = ",".join(fields)
    return "\n".join(lines) + "\n"


def changed_records(text: str) -> str:
    """A DYR file with parameters replaced, and without the stabilizers."""
    kept = []
    for record in text.split("/"):
        fields = re.findall(r"'[^']*'|[^\s,]+", record)
        if len(fields) < 3:
            continue
        model = fields[1].strip("'")
        for place, value in REPLACED.get(model, {}).items():
            fields[3 + place] = value
        if model != LEFT_OUT:
            kept.append(" ".join(fields) + " /")
    return "\n".join(kept) + "\n"
