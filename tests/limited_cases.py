"""NPCC with exciters that have limits, some way off their start."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import gridfold as gf

#: External machines whose functions are linear in both small models.
LIMITED = ("48:1", "68:1", "71:1", "72:1")


def npcc_with_sexs(
    npcc: gf.DetailedModel, room: float, units: Sequence[str] = LIMITED, exciter_time: float = 0.1
) -> gf.Case:
    """SEXS at `units`; the limits are `room` (p.u.) above and below the field voltage of the start."""

    def changed(record: gf.DeviceRecord) -> gf.DeviceRecord:
        if record.model != "ieee_type1" or str(record.key) not in units:
            return record
        start = float(npcc.x0[npcc.slots("field_voltage", (record.key,))[0]])
        values = {
            "lead_lag_ratio": 1.0,
            "lag_time": 1.0,
            "regulator_gain": 60.0,
            "exciter_time": exciter_time,
            "field_voltage_minimum": start - room,
            "field_voltage_maximum": start + room,
        }
        return gf.DeviceRecord("sexs", record.bus, record.id, values)

    return replace(npcc.case, devices=tuple(changed(record) for record in npcc.case.devices))


def npcc_with_ieeet1(npcc: gf.DetailedModel, room: float, unit: str, **changes: float) -> gf.Case:
    """IEEET1 without saturation at one unit; VRMAX and VRMIN are `room` off the start."""

    def changed(record: gf.DeviceRecord) -> gf.DeviceRecord:
        if record.model != "ieee_type1" or str(record.key) != unit:
            return record
        start = float(npcc.x0[npcc.slots("field_voltage", (record.key,))[0]])
        values = {
            "measuring_time": 0.02,
            "regulator_gain": 60.0,
            "regulator_time": 0.05,
            "regulator_maximum": start + room,
            "regulator_minimum": start - room,
            "exciter_gain": 1.0,
            "exciter_time": 0.3,
            "feedback_gain": 0.05,
            "feedback_time": 0.5,
            **dict.fromkeys(("saturation_voltage_1", "saturation_1"), 0.0),
            **dict.fromkeys(("saturation_voltage_2", "saturation_2"), 0.0),
        }
        return gf.DeviceRecord("ieeet1", record.bus, record.id, values | changes)

    return replace(npcc.case, devices=tuple(changed(record) for record in npcc.case.devices))
