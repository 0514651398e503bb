"""What an operating point usually is, where it is not as stored in the case."""

from __future__ import annotations

from collections.abc import Iterator
from math import inf

import numpy as np

from gridfold.grid.case import Control
from gridfold.grid.doubts import Doubt, Usual, doubt_of
from gridfold.grid.plausible import NETWORK_ROWS, OVERLOAD
from gridfold.powerflow.result import PowerFlowResult

_STORED = next(row.usual for row in NETWORK_ROWS if row.usual.name == "bus.voltage")

VOLTAGE = Usual("start.voltage", "solved voltage", _STORED.ranges, "p.u.", _STORED.source)
BALANCE = Usual(
    "start.balance",
    "solved active power / base",
    ((-inf, OVERLOAD),),
    "",
    "what a slack unit has to make up for shows slips in loads and units; as generator.loading",
)


def flow_doubts(flow: PowerFlowResult) -> Iterator[Doubt]:
    """Solved voltages that are unusual where the stored ones are not, and overloaded slack units."""
    case = flow.case
    for bus, voltage in zip(case.buses, np.abs(flow.voltage).tolist(), strict=True):
        if _STORED.holds(bus.voltage_pu) and not VOLTAGE.holds(voltage):
            origin = case.origins.get(str(bus), "")
            yield from doubt_of(str(bus), origin, [(VOLTAGE.name, VOLTAGE.doubt(voltage))])
    for unit, power in zip(case.generators, flow.unit_power.tolist(), strict=True):
        part = power.real * case.base_mva / unit.base_mva
        slack = unit.in_service and unit.control is Control.SLACK
        if slack and unit.base_mva != case.base_mva and not BALANCE.holds(part):
            origin = case.origins.get(str(unit), "")
            yield from doubt_of(str(unit), origin, [(BALANCE.name, BALANCE.doubt(part))])
