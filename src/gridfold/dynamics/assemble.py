"""From the device records of a case to groups of units with parameters on the system base."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gridfold.dynamics.device import LIMITERS, Device, Role, Terms
from gridfold.dynamics.device_functions import parameter_faults
from gridfold.dynamics.layout import Block, Group, Layout
from gridfold.dynamics.limiters.regulator_input import REGULATOR_INPUT
from gridfold.dynamics.registry import DEVICES, NEGATIVE_LOAD
from gridfold.errors import CaseError
from gridfold.grid.case import Case, DeviceRecord, UnitKey


def assemble(
    case: Case, devices: Mapping[str, Device] = DEVICES, sound: Sequence[DeviceRecord] = ()
) -> list[Group]:
    """Groups of (device, units, parameter rows) of all generators and loads in service.

    `sound` are records of the same units and models that are known to be without faults: what the case
    has of them is not checked again, but for devices of loads, which hang on the load too.

    Raises
    ------
    CaseError
        Lists every fault of the device records: unknown models with their number, unknown, missing or
        impossible parameters, generators without a machine, two devices of one role.
    """
    faults = list(device_faults(case, devices, sound))
    if faults:
        raise CaseError(faults, f"case {case.name}, dynamic devices")
    groups: list[Group] = []
    ratings = _Ratings(case)
    live = [
        key for key, unit in zip(case.unit_keys, case.generators, strict=True) if unit.in_service
    ]
    live += [key for key, load in zip(case.load_keys, case.loads, strict=True) if load.in_service]
    of_models: dict[str, dict[UnitKey, DeviceRecord]] = {}
    for key, record in zip(case.device_keys, case.devices, strict=True):
        of_models.setdefault(record.model, {})[key] = record
    for device in devices.values():
        by_unit = of_models.get(device.model, {})
        units = [
            unit
            for unit in live
            if unit in by_unit and device.has_dynamics(by_unit[unit].parameters)
        ]
        if units:
            records = [by_unit[unit] for unit in units]
            bases = np.array([ratings.of(device, record) for record in records])
            groups.append((device, units, _parameter_rows(device, records, bases, case)))
    limited = {
        unit: None for device, units, _ in groups if device.role in LIMITERS for unit in units
    }
    if limited:
        speed = np.full((1, len(limited)), 2 * np.pi * case.frequency_hz)
        groups.append((REGULATOR_INPUT, list(limited), speed))
    return groups


def with_changed_records(
    layout: Layout, case: Case, before: Case, devices: Mapping[str, Device]
) -> Layout | None:
    """The layout of a case with the parameters of another one of the same network, units and models.

    Only records that are not those of `before` are looked at.

    Parameters
    ----------
    layout : Layout
        Of the case `before`, with the parameters that its records give.

    Returns
    -------
    Layout or None
        None where more has changed than parameters of devices of generators.

    Raises
    ------
    CaseError
        As :func:`assemble`.
    """
    changed: dict[str, list[int]] = {}
    for k, (old, new) in enumerate(zip(before.devices, case.devices, strict=True)):
        if new is not old:
            if (new.model, new.key) != (old.model, old.key):
                return None
            changed.setdefault(new.model, []).append(k)
    ratings = _Ratings(case)
    place = {block.device.model: at for at, block in enumerate(layout.blocks)}
    faults: list[str] = []
    blocks = list(layout.blocks)
    for model, records in changed.items():
        device = devices.get(model)
        if device is None or model not in place or device.role is Role.LOAD:
            return None
        for k in records:
            old, new = before.devices[k], case.devices[k]
            if device.has_dynamics(new.parameters) != device.has_dynamics(old.parameters):
                return None
            found = _record_faults(device, new, ratings)
            faults += [f"{case.locate(new)}: {fault}" for fault in found]
        if not faults:
            at = place[model]
            blocks[at] = _with_records(blocks[at], case, records, ratings)
    if faults:
        raise CaseError(faults, f"case {case.name}, dynamic devices")
    return replace(layout, blocks=tuple(blocks))


def _with_records(block: Block, case: Case, positions: Sequence[int], ratings: _Ratings) -> Block:
    """A block with the parameters of the records at some positions, of units that it has."""
    column_of = {unit: column for column, unit in enumerate(block.units)}
    positions = [k for k in positions if case.device_keys[k] in column_of]
    if not positions:
        return block
    records = [case.devices[k] for k in positions]
    bases = np.array([ratings.of(block.device, record) for record in records])
    columns = [column_of[case.device_keys[k]] for k in positions]
    parameters = block.parameters.copy()
    parameters[:, columns] = _parameter_rows(block.device, records, bases, case)
    return replace(block, parameters=parameters)


def load_characteristics(
    case: Case, devices: Mapping[str, Device] = DEVICES
) -> dict[UnitKey, Terms]:
    """Voltage dependence of loads in service that have a record of it."""
    found: dict[UnitKey, Terms] = {}
    live: set[UnitKey] | None = None
    for key, record in zip(case.device_keys, case.devices, strict=True):
        device = devices.get(record.model)
        if device is None or device.characteristic is None:
            continue
        if live is None:
            loads = zip(case.load_keys, case.loads, strict=True)
            live = {load_key for load_key, load in loads if load.in_service}
        if key in live:
            found[key] = device.characteristic(record.parameters)
    return found


class _Ratings:
    """Bases in MVA of devices of a case."""

    def __init__(self, case: Case):
        self.case = case
        bases = (generator.base_mva for generator in case.generators)
        self.units = dict(zip(case.unit_keys, bases, strict=True))
        self.loads = dict(zip(case.load_keys, case.loads, strict=True))

    def of(self, device: Device, record: DeviceRecord) -> float:
        """Base of a device: that of its generator, or what the device says of its load."""
        key = record.key
        if device.rating is None or key not in self.loads:
            return self.units.get(key, self.case.base_mva)
        return device.rating(record.parameters, self.drawn_mw(key))

    def drawn_mw(self, load: UnitKey) -> float:
        """Active power of a load at the stored voltage in MW."""
        return self.case.stored_power(self.loads[load]).real


def negative_loads(case: Case) -> frozenset[UnitKey]:
    """Generators that the dynamic model treats as negative loads."""
    return frozenset(record.key for record in case.devices if record.model == NEGATIVE_LOAD)


def _parameter_rows(
    device: Device, records: Sequence[DeviceRecord], bases: NDArray[np.float64], case: Case
) -> NDArray[np.float64]:
    known = [
        device.acting(record.parameters, base) for record, base in zip(records, bases, strict=True)
    ]
    rows = []
    for parameter in device.parameters:
        values = np.array([one.get(parameter.name, math.nan) for one in known], dtype=float)
        rows.append(values * (bases / case.base_mva) ** parameter.scaling.value)
    rows += [np.full(len(records), np.nan) for _ in device.set_points]
    rows.append(np.full(len(records), 2 * np.pi * case.frequency_hz))
    return np.ascontiguousarray(rows)


def device_faults(
    case: Case, devices: Mapping[str, Device] = DEVICES, sound: Sequence[DeviceRecord] = ()
) -> Iterator[str]:
    """Every fault of the device records of a case, as :func:`assemble` tells it."""
    checked = frozenset(map(id, sound))
    unknown = Counter(
        r.model for r in case.devices if r.model not in devices and r.model != NEGATIVE_LOAD
    )
    for model, count in unknown.items():
        first = next(record for record in case.devices if record.model == model)
        known = ", ".join((*devices, NEGATIVE_LOAD))
        yield (
            f"{model}: {count} units of an unknown model, first {case.locate(first)}; known: {known}; "
            "--devices FILE.py (devices=) gives models of your own"
        )
    ratings = _Ratings(case)
    for record in case.devices:
        device = devices.get(record.model)
        if id(record) in checked and (device is None or device.role is not Role.LOAD):
            continue
        if device is not None:
            for fault in _record_faults(device, record, ratings):
                yield f"{case.locate(record)}: {fault}"
        elif record.model == NEGATIVE_LOAD and record.parameters:
            names = ", ".join(record.parameters)
            yield f"{case.locate(record)}: it has no parameters, but {names} is given"
    if not sound:
        yield from _role_faults(case, devices)


def _record_faults(device: Device, record: DeviceRecord, ratings: _Ratings) -> Iterator[str]:
    if (device.role is Role.LOAD) != (record.key in ratings.loads):
        its, other = ("load", "generator") if device.role is Role.LOAD else ("generator", "load")
        yield f"it is a device of a {its}, but {record.key} is a {other}"
    known = [parameter.name for parameter in device.parameters]
    sound = True
    for name in record.parameters:
        if name not in known:
            sound = False
            yield f"unknown parameter {name!r}; known: {', '.join(known)}"
    values = {}
    for parameter in device.parameters:
        value = record.parameters.get(parameter.name, parameter.default)
        if value is None:
            sound = False
            yield f"{parameter.name} is missing"
        elif not parameter.bound.holds(value):
            sound = False
            yield f"{parameter.name} must be {parameter.bound.value}, not {value!r}"
        else:
            values[parameter.name] = value
    if not sound:
        return
    base_mva = ratings.of(device, record)
    if base_mva > 0:
        yield from parameter_faults(device, device.acting(values, base_mva))
    else:
        drawn = ratings.drawn_mw(record.key)
        yield f"its base is {base_mva:g} MVA and must be positive; the load draws {drawn:g} MW"


def _role_faults(case: Case, devices: Mapping[str, Device]) -> Iterator[str]:
    roles: dict[tuple[UnitKey, Role], list[str]] = {}
    for record in case.devices:
        if record.model == NEGATIVE_LOAD:
            roles.setdefault((record.key, Role.MACHINE), []).append(record.model)
        elif record.model in devices:
            role = devices[record.model].role
            roles.setdefault((record.key, role), []).append(record.model)
    for (unit, role), models in roles.items():
        if len(models) > 1:
            yield f"unit {unit} has {len(models)} devices of one role: {', '.join(models)}"
        if role is Role.LOAD:
            continue
        if (unit, Role.MACHINE) not in roles or (
            role is not Role.MACHINE and NEGATIVE_LOAD in roles[unit, Role.MACHINE]
        ):
            yield f"unit {unit} has {models[0]} but no machine"
    for generator in case.generators:
        if generator.in_service and (generator.key, Role.MACHINE) not in roles:
            yield (
                f"{case.locate(generator)} has no machine; give it one, or a {NEGATIVE_LOAD} record "
                "to treat its power as a negative load"
            )
