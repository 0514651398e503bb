"""Dc lines as records of a RAW file, the way back of :mod:`gridfold.io.raw_dc`."""

from __future__ import annotations

from collections.abc import Iterator

from gridfold.grid.dc_lines import (
    DcControl,
    LineControl,
    ThyristorEnd,
    ThyristorLine,
    TransistorEnd,
    TransistorLine,
)
from gridfold.io.raw_text import Texts, real, reals

_LINE_CODES = {LineControl.BLOCKED: 0, LineControl.POWER: 1, LineControl.CURRENT: 2}
_DC_CODES = {DcControl.OUT: 0, DcControl.VOLTAGE: 1, DcControl.POWER: 2}


def thyristor_lines(line: ThyristorLine, texts: Texts) -> Iterator[str]:
    """The three lines of a two-terminal dc line."""
    values = (line.resistance_ohm, line.setting, line.voltage_kv, line.switch_kv)
    rest = reals(*values, line.compounding_ohm, line.margin)
    yield f"{texts.name(line.name, line)},{_LINE_CODES[line.control]},{rest},I,0.0,20,1.0"
    yield _thyristor_end(line.rectifier)
    yield _thyristor_end(line.inverter)


def _thyristor_end(end: ThyristorEnd) -> str:
    angles = (end.angle_max_deg, end.angle_min_deg)
    impedance = (end.resistance_ohm, end.reactance_ohm)
    values = reals(*angles, *impedance, end.base_kv, end.transformer_ratio, end.tap)
    return f"{end.bus},{end.bridges},{values},1.5,0.51,0.00625,0,0,0,'1',0.0"


def transistor_lines(line: TransistorLine, texts: Texts) -> Iterator[str]:
    """The three lines of a dc line with voltage-source converters."""
    name = texts.name(line.name, line)
    yield f"{name},{int(line.in_service)},{real(line.resistance_ohm)},1,1.0"
    yield _transistor_end(line.first)
    yield _transistor_end(line.second)


def _transistor_end(end: TransistorEnd) -> str:
    held = end.voltage_pu if end.holds_voltage else end.power_factor
    losses = reals(end.loss_kw, end.loss_kw_per_a, end.least_loss_kw)
    limits = reals(end.reactive_max_mvar, end.reactive_min_mvar)
    head = f"{end.bus},{_DC_CODES[end.control]},{1 if end.holds_voltage else 2}"
    settings = reals(end.setting, held)
    return f"{head},{settings},{losses},0.0,0.0,1.0,{limits},{end.regulated_bus},100.0"
