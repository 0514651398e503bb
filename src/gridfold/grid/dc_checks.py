"""Check the dc lines of a case."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import fields

from gridfold.grid.case import Case
from gridfold.grid.dc_lines import (
    DcControl,
    DcLine,
    ThyristorEnd,
    ThyristorLine,
    TransistorEnd,
    TransistorLine,
)

_POSITIVE = ("bridges", "base_kv", "transformer_ratio", "tap")
_NOT_NEGATIVE = (
    "resistance_ohm", "reactance_ohm", "margin", "loss_kw", "loss_kw_per_a", "least_loss_kw",
)  # fmt: skip


def dc_faults(case: Case) -> Iterator[str]:
    """Every fault of the dc lines, a line each."""
    for name, count in Counter(str(line) for line in case.dc_lines).items():
        if count > 1:
            yield f"{name} is given {count} times"
    for line in case.dc_lines:
        where = case.locate(line)
        for fault in _line_faults(case, line):
            yield f"{where}: {fault}"


def _line_faults(case: Case, line: DcLine) -> Iterator[str]:
    for bus in line.buses:
        if bus not in case.bus_index:
            yield f"there is no bus {bus}"
    if line.buses[0] == line.buses[1]:
        yield "both of its ends are at one bus"
    ends: tuple[ThyristorEnd | TransistorEnd, ...]
    if isinstance(line, ThyristorLine):
        ends = (line.rectifier, line.inverter)
    else:
        ends = (line.first, line.second)
    for record in (line, *ends):
        where = f"at bus {record.bus} " if isinstance(record, ThyristorEnd | TransistorEnd) else ""
        for field in fields(record):
            value = getattr(record, field.name)
            if isinstance(value, bool) or not isinstance(value, int | float):
                continue
            if not math.isfinite(value):
                yield f"{where}{field.name} is {value!r}, not a finite number"
            elif line.in_service and field.name in _POSITIVE and not value > 0:
                yield f"{where}{field.name} must be positive, not {value!r}"
            elif line.in_service and field.name in _NOT_NEGATIVE and value < 0:
                yield f"{where}{field.name} must be 0 or more, not {value!r}"
    if line.in_service:
        yield from _thyristor_faults(line) if isinstance(line, ThyristorLine) else _control(line)


def _thyristor_faults(line: ThyristorLine) -> Iterator[str]:
    if not line.voltage_kv > 0:
        yield f"the scheduled dc voltage must be positive, not {line.voltage_kv!r}"
    if not line.margin < 1:
        yield f"the margin must be less than 1, not {line.margin!r}"
    for end in (line.rectifier, line.inverter):
        least, most = end.angle_min_deg, end.angle_max_deg
        if not 0 <= least <= most <= 90:
            yield (
                f"at bus {end.bus} the limits of the angle must be 0 to 90 degrees in this order, not "
                f"{least!r} and {most!r}"
            )


def _control(line: TransistorLine) -> Iterator[str]:
    ends = (line.first, line.second)
    holding = [end for end in ends if end.control is DcControl.VOLTAGE]
    if len(holding) != 1:
        yield f"{len(holding)} of its converters hold the dc voltage, and one has to"
    for end in holding:
        if not end.setting > 0:
            yield f"at bus {end.bus} the dc voltage must be positive, not {end.setting!r}"
    for end in ends:
        if not (end.holds_voltage or 0 < abs(end.power_factor) <= 1):
            yield f"at bus {end.bus} the power factor must be 0 to 1 in size, not {end.power_factor!r}"
        if end.reactive_min_mvar > end.reactive_max_mvar:
            yield (
                f"at bus {end.bus} the least reactive power {end.reactive_min_mvar!r} Mvar is above "
                f"the most {end.reactive_max_mvar!r}"
            )
