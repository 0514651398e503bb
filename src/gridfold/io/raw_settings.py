"""Settings of the system-wide section of a RAW file, there since revision 34.

Of them gridfold takes THRSHZ, the reactance up to which a line without resistance joins its buses. The
others steer PSS/E's own solution, or name sets of ratings.
"""

from __future__ import annotations

import re

from gridfold.io.raw_fields import as_number
from gridfold.io.raw_sections import SYSTEM_WIDE, RawSections

#: Threshold of PSS/E where the file gives none, in p.u.
USUAL_THRESHOLD = 1e-4


def joining_threshold(sections: RawSections) -> tuple[float, list[str]]:
    """Reactance in p.u. up to which a line without resistance joins its buses, and faults."""
    lines = sections.text.split("\n")
    for number in sections.of(SYSTEM_WIDE):
        given = re.search(r"\bTHRSHZ\s*=\s*([^,/\s]*)", lines[number - 1], re.IGNORECASE)
        if given is not None:
            value = as_number(given[1])
            if value is None or not 0 <= value < 1:
                fault = f"THRSHZ must be 0 to 1 p.u., not {given[1] or 'blank'}"
                return USUAL_THRESHOLD, [f"line {number}: {fault}"]
            return value, []
    return USUAL_THRESHOLD, []
