"""Blocks of switched shunts in RAW files: so many steps of so many Mvar each.

They stand behind the other fields of a record, since revision 35 each with its status. PSS/E Program
Operation Manual, switched shunt data.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import isfinite

from gridfold.io.raw_fields import as_number
from gridfold.io.raw_layouts import layouts
from gridfold.io.raw_sections import RawSections, fields_of

_STATUS_SINCE = 35
#: Steps of a block; PSS/E has up to 9, others write more.
_MOST_STEPS = 1000


def blocks_in_service(texts: Sequence[str], revision: int) -> tuple[tuple[int, float], ...]:
    """Steps and Mvar a step of the blocks in service; the first without steps or Mvar ends them."""
    with_status = revision >= _STATUS_SINCE
    values = [as_number(text) if text.strip() else None for text in texts]
    width = 3 if with_status else 2
    blocks = []
    for at in range(0, len(values), width):
        block = [*values[at : at + width], None, None][:width]
        steps, mvar = block[-2] or 0.0, block[-1] or 0.0
        if not (steps and mvar and isfinite(steps)):  # what is no number is told elsewhere
            break
        if not with_status or block[0] != 0:
            blocks.append((int(steps), mvar))
    return tuple(blocks)


def block_faults(sections: RawSections, revision: int) -> Iterator[str]:
    """Numbers of steps of the blocks of switched shunts that cannot be counted, each with its line."""
    lines = sections.text.split("\n")
    first = len(layouts(revision)["SWITCHED SHUNT"][0])
    with_status = revision >= _STATUS_SINCE
    for number in sections.of("SWITCHED SHUNT"):
        blocks = fields_of(lines[number - 1])[first:]
        for k, item in enumerate(blocks[int(with_status) :: 3 if with_status else 2], start=1):
            steps = as_number(item.text) if not item.blank else 0.0
            if steps is None or not (steps.is_integer() and 0 <= steps <= _MOST_STEPS):
                yield (
                    f"line {number}: N{k} of a switched shunt is {item.text}; "
                    f"it must be a whole number of 0 to {_MOST_STEPS} steps"
                )
