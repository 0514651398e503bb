"""Dynamic models of dc lines in DYR files: left out, since the ends stay as in the power flow."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence

from gridfold.grid.case import Case, UnitKey
from gridfold.grid.dynamic_records import SkippedRecord
from gridfold.grid.replacement import Replacement

_OUTCOME = "left out; both ends of the dc line stay as in the power flow"


def dc_replacements(case: Case, skipped: Sequence[SkippedRecord]) -> Iterator[Replacement]:
    """What became of records that begin with the name of a dc line in service of the case."""
    lines = {line.name: line for line in case.dc_lines if line.in_service}
    for record in skipped:
        named = re.match(r"\s*(['\"])(.*?)\s*\1", record.text)
        line = lines.get(named[2]) if named else None
        if line is not None and record.model and not record.is_comment:
            yield Replacement(record.model, _OUTCOME, (UnitKey(line.buses[0], line.name),))
