"""From records of load models in PSS/E dynamics data to device records of loads.

A record speaks of one load, or of all at a bus, of an owner, of a zone, of an area, or of all: its
model ends in BL, OW, ZN, AR or AL. Its first item is the number of that, 0 for AL; its third one
the id of a load, or ``*`` for any. Area, zone and owner are those of the load. Where several
records speak of a load the one in the first of these scopes counts; two in the same scope are a
fault.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from gridfold.dynamics.device import Device
from gridfold.dynamics.psse_models import LOAD_SUFFIXES
from gridfold.dynamics.psse_parameters import named_parameters
from gridfold.dynamics.psse_replacements import covers, load_suffix
from gridfold.grid.case import Case, DeviceRecord, Load
from gridfold.grid.dynamic_records import DynamicRecord

_WHAT = {"BL": "bus", "OW": "owner", "ZN": "zone", "AR": "area"}


@dataclass
class LoadDevices:
    """Devices of loads, and what was noticed on the way.

    Parameters
    ----------
    records : list of DeviceRecord
        For the case.
    origins : dict of str to str
        File and line of each, by its name.
    faults, notices, unplaced : list of str
        What is wrong, what has no effect, and records that speak of no load, in words.
    """

    records: list[DeviceRecord] = field(default_factory=list)
    origins: dict[str, str] = field(default_factory=dict)
    faults: list[str] = field(default_factory=list)
    notices: list[str] = field(default_factory=list)
    unplaced: list[str] = field(default_factory=list)


def load_devices(
    case: Case, records: Sequence[DynamicRecord], supported: Mapping[str, Device], file: str
) -> LoadDevices:
    """Devices of the loads in service.

    Parameters
    ----------
    case : Case
        The network.
    records : sequence of DynamicRecord
        Records of load models that are all among those `supported`.
    supported : mapping
        Device models by the names of PSS/E.
    file : str
        Name of the file, for messages.
    """
    found = LoadDevices()
    by_load: dict[Load, list[DynamicRecord]] = defaultdict(list)
    parameters: dict[DynamicRecord, dict[str, float]] = {}
    for record in records:
        place = f"{record} ({file}:{record.line})"
        parameters[record] = named_parameters(record, supported[record.model], place, found.faults)
        meant = [load for load in case.loads if covers(case, record.model, record.key, load)]
        live = [load for load in meant if load.in_service]
        if not meant:
            found.unplaced.append(f"{place}: {_why_unplaced(case, record)}")
        elif not live:
            found.notices.append(
                f"{file}: {record} (line {record.line}): its loads are out of service"
            )
        for load in live:
            by_load[load].append(record)
    idle: dict[DynamicRecord, list[Load]] = defaultdict(list)
    for load, several in by_load.items():
        record = _first(several)
        same = [r for r in several if load_suffix(r.model) == load_suffix(record.model)]
        if len(same) > 1:
            listed = ", ".join(f"{r.model} (line {r.line})" for r in same)
            found.faults.append(f"{load} has {len(same)} load models: {listed}")
            continue
        device = supported[record.model]
        given = parameters[record]
        if device.rating is not None and case.stored_power(load).real <= 0:
            idle[record].append(load)
            continue
        made = DeviceRecord(device.model, load.bus, load.key.id, given)
        found.records.append(made)
        found.origins[str(made)] = f"{file}:{record.line}"
    found.notices += _idle_texts(idle, file)
    return found


def _first(records: Sequence[DynamicRecord]) -> DynamicRecord:
    return min(records, key=lambda record: LOAD_SUFFIXES.index(load_suffix(record.model)))


def _idle_texts(idle: Mapping[DynamicRecord, Sequence[Load]], file: str) -> Iterator[str]:
    for record, loads in idle.items():
        count = "1 load draws" if len(loads) == 1 else f"{len(loads)} loads draw"
        yield (
            f"{file}: {record} (line {record.line}): {count} no active power, so that no motor runs "
            f"there, first {loads[0]}"
        )


def _why_unplaced(case: Case, record: DynamicRecord) -> str:
    scope = load_suffix(record.model)
    if scope == "BL" and record.bus in case.bus_index:
        there = ", ".join(repr(load.id) for load in case.loads if load.bus == record.bus)
        return f"bus {record.bus} has no load {record.id!r}" + (f", but {there}" if there else "")
    if scope == "BL":
        return f"there is no bus {record.bus}"
    if scope == "AL":
        return (
            f"the number of all loads is 0, not {record.bus}; there is none with id {record.id!r}"
        )
    which = "" if record.id == "*" else f" with id {record.id!r}"
    return f"{_WHAT[scope]} {record.bus} has no load{which}"
