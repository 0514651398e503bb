"""Check a case: every fault is reported, not the first."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace

from gridfold.errors import CaseError
from gridfold.grid.case import (
    Branch,
    Bus,
    Case,
    Control,
    Generator,
    Load,
    Record,
    Shunt,
    number_fields,
)
from gridfold.grid.dc_checks import dc_faults
from gridfold.grid.islands import island_labels
from gridfold.grid.nodes import node_of_buses


def validate_case(case: Case) -> list[str]:
    """Every fault found in the case data, one line each; empty if there is none."""
    faults = [*_system_faults(case), *_record_faults(case), *_duplicate_faults(case)]
    faults += [*_reference_faults(case), *dc_faults(case)]
    if not faults:
        faults += _island_faults(case)
    return faults


def require_valid(case: Case) -> None:
    """Raise :class:`~gridfold.errors.CaseError` with every fault of the case."""
    faults = validate_case(case)
    if faults:
        raise CaseError(faults, f"case {case.name}")


def _system_faults(case: Case) -> Iterator[str]:
    for name in ("base_mva", "frequency_hz"):
        value = getattr(case, name)
        if not (_is_finite(value) and value > 0):
            yield f"{name} must be a positive number, not {value!r}"
    if not case.buses:
        yield "there is no bus"


def _records(case: Case) -> Iterator[Record]:
    yield from case.buses
    yield from case.branches
    yield from case.generators
    yield from case.loads
    yield from case.shunts
    yield from case.devices


def _record_faults(case: Case) -> Iterator[str]:
    for record in _records(case):
        parameters = getattr(record, "parameters", {})
        for name, value in {**number_fields(record), **parameters}.items():
            if not _is_finite(value):
                yield f"{case.locate(record)}: {name} is {value!r}, not a finite number"
        for fault in _range_faults(record):
            yield f"{case.locate(record)}: {fault}"


def _is_finite(value: float) -> bool:
    try:
        return math.isfinite(value)
    except OverflowError:  # a whole number beyond the floating-point range
        return False


_POSITIVE = {
    Bus: ("number", "base_kv", "voltage_pu"),
    Branch: ("ratio",),
    Generator: ("base_mva", "voltage_pu", "share"),
}


def _range_faults(record: Record) -> Iterator[str]:
    for name in _POSITIVE.get(type(record), ()):
        value = getattr(record, name)
        if value <= 0:
            yield f"{name} must be positive, not {value!r}"
    if isinstance(record, Branch):
        if record.from_bus == record.to_bus:
            yield "it joins a bus to itself"
        if record.resistance == 0 and record.reactance == 0 and not record.joins:
            yield "its impedance is zero, and a transformer's ratio or shift needs one"


def _duplicate_faults(case: Case) -> Iterator[str]:
    for table in (
        case.buses,
        case.branches,
        case.generators,
        case.loads,
        case.shunts,
        case.devices,
    ):
        for name, count in Counter(str(record) for record in table).items():
            if count > 1:
                yield f"{name} is given {count} times"
    names = {str(branch) for branch in case.branches}
    for branch in case.branches:
        reverse = str(Branch(branch.to_bus, branch.from_bus, branch.circuit))
        if branch.from_bus > branch.to_bus and reverse in names:
            yield f"{case.locate(branch)} and {reverse} are two circuits with one id"


def _reference_faults(case: Case) -> Iterator[str]:
    for branch in case.branches:
        for number in (branch.from_bus, branch.to_bus):
            if number not in case.bus_index:
                yield f"{case.locate(branch)}: there is no bus {number}"
    at_bus: tuple[Generator | Load | Shunt, ...] = (*case.generators, *case.loads, *case.shunts)
    for record in at_bus:
        if record.bus not in case.bus_index:
            yield f"{case.locate(record)}: there is no bus {record.bus}"
    units = {g.key for g in case.generators} | {load.key for load in case.loads}
    for device in case.devices:
        if device.key not in units:
            kind = "load" if device.id.startswith("load-") else "generator"
            yield f"{case.locate(device)}: there is no {kind} {device.key}"
    yield from _regulation_faults(case)


def _regulation_faults(case: Case) -> Iterator[str]:
    regulating: dict[int | str, Generator] = {}
    known = case.bus_index
    sound = tuple(b for b in case.branches if b.from_bus in known and b.to_bus in known)
    nodes = node_of_buses(replace(case, branches=sound)).tolist()
    node = {bus.number: at for bus, at in zip(case.buses, nodes, strict=True)}
    for generator in case.generators:
        if generator.control is Control.POWER or not generator.in_service:
            continue
        first = regulating.setdefault(node.get(generator.bus, str(generator)), generator)
        if first.voltage_pu != generator.voltage_pu:
            same = (
                "the same bus" if first.bus == generator.bus else "a bus that is joined to its own"
            )
            yield (
                f"{case.locate(generator)}: it holds {generator.voltage_pu} p.u. where "
                f"{case.locate(first)} holds {first.voltage_pu} p.u. at {same}"
            )


def _island_faults(case: Case) -> Iterator[str]:
    labels = island_labels(case)
    live = [generator for generator in case.generators if generator.in_service]
    powered = {labels[case.bus_index[generator.bus]] for generator in live}
    swings: set[int] = set()
    for generator in live:
        if generator.control is Control.SLACK:
            swings.add(labels[case.bus_index[generator.bus]])
    islands: dict[int, list[int]] = {}
    for bus, label in zip(case.buses, labels.tolist(), strict=True):
        islands.setdefault(label, []).append(bus.number)
    for island, members in sorted(islands.items()):
        name = f"the island of bus {members[0]} ({len(members)} buses)"
        if island not in powered:
            yield f"{name} has no generator in service"
        elif island not in swings:
            yield f"{name} has no slack generator"
