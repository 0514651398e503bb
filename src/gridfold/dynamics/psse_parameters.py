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
    optional = {parameter.name for parameter in device.parameters if parameter.default is not None}
    needed = [k for k, name in enumerate(columns, start=1) if name and name not in optional]
    if not max(needed, default=0) <= len(values) <= len(columns):
        faults.append(f"{place}: expected {len(columns)} values, found {len(values)}")
        return {}
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
