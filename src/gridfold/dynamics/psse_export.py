"""From device records of a case to PSS/E dynamics data.

The way back is :mod:`gridfold.dynamics.psse_records`. The classical machine and the infinite bus are
GENCLS, whose impedance stands in the network as ZSORCE; so does the stator resistance of GENROU and
its like.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from gridfold.dynamics.device import Device, Role
from gridfold.dynamics.registry import DEVICES, NEGATIVE_LOAD
from gridfold.grid.case import LOAD_PREFIX, Case, DeviceRecord, UnitKey
from gridfold.grid.dynamic_records import DynamicData, DynamicRecord

_GENCLS = "gencls"
_AS_GENCLS = {"classical": "transient_reactance", "infinite_bus": "reactance", _GENCLS: "reactance"}
_NO_RECORD = "no model of PSS/E"


@dataclass(frozen=True)
class PsseData:
    """Records for a DYR file, and the network that goes with them.

    Parameters
    ----------
    data : DynamicData
        The records.
    network : Case
        The case with ZSORCE of its units as their machines say it.
    lost : tuple of (str, str)
        What the records cannot hold, and of which device.
    """

    data: DynamicData
    network: Case
    lost: tuple[tuple[str, str], ...] = ()


def psse_data(case: Case, devices: Mapping[str, Device] = DEVICES) -> PsseData:
    """Dynamics data of PSS/E for the devices of a case."""
    records: list[DynamicRecord] = []
    impedances: dict[UnitKey, complex] = {}
    lost: list[tuple[str, str]] = []
    sources = {unit.key: unit for unit in case.generators}
    for record in case.devices:
        device = devices.get(record.model)
        if record.model == NEGATIVE_LOAD:
            lost.append(("negative loads: --no-data negative-load reads them as such", str(record)))
        elif record.model in _AS_GENCLS:
            impedances[record.key] = complex(
                _given(record, devices, "resistance"),
                _given(record, devices, _AS_GENCLS[record.model]),
            )
            values = [record.parameters.get(name, 0.0) for name in ("inertia", "damping")]
            records.append(_record(_GENCLS, record, values))
        elif device is None or not device.psse_record:
            lost.append((f"{record.model}, {_NO_RECORD}", str(record.key)))
        else:
            held = set(device.psse_record)
            is_of_unit = device.role is not Role.LOAD
            if is_of_unit and "resistance" in {p.name for p in device.parameters} - held:
                held.add("resistance")
                reactance = sources[record.key].source_reactance
                impedances[record.key] = complex(_given(record, devices, "resistance"), reactance)
            defaults = {parameter.name: parameter.default for parameter in device.parameters}
            lost += [
                (f"{name} of {record.model.upper()}, which its record does not have", str(record))
                for name, value in record.parameters.items()
                if name not in held and value != defaults.get(name)
            ]
            values = [
                0.0 if name is None else _given(record, devices, name)
                for name in device.psse_record
            ]
            records.append(_record(record.model, record, values, is_of_unit))
    network = _with_impedances(case, impedances)
    return PsseData(DynamicData(case.name, tuple(records)), network, tuple(lost))


def _with_impedances(case: Case, impedances: Mapping[UnitKey, complex]) -> Case:
    """The case with these ZSORCE, in per unit of the unit."""
    units = []
    for unit in case.generators:
        own = impedances.get(unit.key, complex(unit.source_resistance, unit.source_reactance))
        units.append(replace(unit, source_resistance=own.real, source_reactance=own.imag))
    return replace(case, generators=tuple(units))


def _given(record: DeviceRecord, devices: Mapping[str, Device], name: str) -> float:
    """A parameter as it is given, or by default."""
    default = next(p.default for p in devices[record.model].parameters if p.name == name)
    return float(record.parameters.get(name, 0.0 if default is None else default))


def _record(
    model: str, record: DeviceRecord, values: list[float], is_of_unit: bool = True
) -> DynamicRecord:
    """A record of a unit, or of one load, whose model ends in BL."""
    if not is_of_unit:
        model, identifier = f"{model}BL", record.id.removeprefix(LOAD_PREFIX)
    else:
        identifier = record.id
    return DynamicRecord(model.upper(), record.bus, identifier, tuple(values), line=0)
