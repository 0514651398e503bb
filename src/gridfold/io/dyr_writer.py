"""Write dynamic data as a DYR file of PSS/E, which :mod:`gridfold.io.dyr` reads."""

from __future__ import annotations

import textwrap

from gridfold.grid.dynamic_records import DynamicData

#: Columns of a line.
_WIDTH = 100
#: Whole numbers up to here are written without a point, as flags have to be.
_WHOLE = 1e9


def dyr_text(data: DynamicData) -> str:
    """The text of a DYR file; numbers are written so that they are read back as they are."""
    lines = []
    for record in data.records:
        head = f"{record.bus} '{record.model}' '{record.id}'"
        text = " ".join([head, *(_value(value) for value in record.values), "/"])
        lines += textwrap.wrap(
            text, _WIDTH, subsequent_indent="    ", break_long_words=False, break_on_hyphens=False
        )
    return "\n".join([*lines, ""])


def _value(value: float | str) -> str:
    if isinstance(value, str):
        return f"'{value}'"
    whole = float(value).is_integer() and abs(value) < _WHOLE
    return str(int(value)) if whole else repr(float(value))
