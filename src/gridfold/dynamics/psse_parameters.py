"""From the numbers of a record of dynamics data to parameters by name."""

from __future__ import annotations

from gridfold.dynamics.device import Device
from gridfold.dynamics.psse_models import CLASSICAL_COLUMNS
from gridfold.grid.case import Generator
from gridfold.grid.dynamic_records import DynamicRecord

_CLASSICAL_NAMES = ("inertia", "damping", "reactance")
_SOURCE = {"resistance": "source_resistance", "reactance": "source_reactance"}


def named_parameters(
    record: DynamicRecord, device: Device, place: str, faults: list[str]
) -> dict[str, float]:
    """Parameters of a record, in the order of `device`.

    Values at the end may be absent where the model has defaults for them. A wrong number of values
    and texts in the place of numbers are `faults`; `place` names the record in them.
    """
    columns, values = device.psse_record, record.values
    if record.announced is not None:
        icons, cons = record.announced
        expected = device.psse_icons, len(columns) - device.psse_icons
        if icons != expected[0] or icons + cons != len(values):
            faults.append(
                f"{place}: it announces {icons} ICONs and {cons} CONs and has {len(values)} values; "
                f"{device.model} takes {expected[0]} ICONs and {expected[1]} CONs"
            )
            return {}
    optional = {parameter.name for parameter in device.parameters if parameter.default is not None}
    needed = [k for k, name in enumerate(columns, start=1) if name and name not in optional]
    least = max(needed, default=0)
    if not least <= len(values) <= len(columns):
        count = f"{len(columns)}" if least == len(columns) else f"{least} to {len(columns)}"
        faults.append(f"{place}: expected {count} values, found {len(values)}")
        return {}
    for position, value in enumerate(values[: device.psse_icons], start=1):
        if not isinstance(value, str) and not float(value).is_integer():
            faults.append(
                f"{place}: value {position} is {value:g}, an ICON, which is a whole number"
            )
    return {
        name: _number(record, position, place, faults)
        for position, (name, _) in enumerate(zip(columns, values, strict=False))
        if name
    }


def classical_parameters(record: DynamicRecord, place: str, faults: list[str]) -> dict[str, float]:
    """Parameters of a classical machine in place of one that gridfold does not have: H, D, X'd."""
    columns = CLASSICAL_COLUMNS[record.model]
    if len(record.values) <= max(columns):
        found = len(record.values)
        faults.append(f"{place}: expected at least {max(columns) + 1} values, found {found}")
        return {}
    return {
        name: _number(record, position, place, faults)
        for name, position in zip(_CLASSICAL_NAMES, columns, strict=True)
    }


def source_impedance(device: Device, generator: Generator) -> dict[str, float]:
    """What a machine takes from the generator's ZSORCE: what it needs and its record lacks."""
    names = {parameter.name for parameter in device.parameters} - set(device.psse_record)
    return {name: getattr(generator, source) for name, source in _SOURCE.items() if name in names}


def _number(record: DynamicRecord, position: int, place: str, faults: list[str]) -> float:
    value = record.values[position]
    if isinstance(value, str):
        faults.append(f"{place}: value {position + 1} is {value!r}, not a number")
        return 0.0
    return value
