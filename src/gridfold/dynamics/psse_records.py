"""From PSS/E dynamics data to device records of a case.

A record belongs to the generator with its bus and id. What the file lacks comes from the network: the
stator resistance of GENROU and GENSAL and the whole impedance of GENCLS are ZSORCE of the generator.
A GENCLS with H = 0 is an infinite bus.

A record of a unit out of service has no effect, and is a notice. One that names a unit which the
network does not have is told as *unplaced*: most are slips of the pen, and the unit that is meant
lacks the device. Identifiers are compared as they stand, but for blanks around them: ``01`` is not
``1``, as in PSS/E.

A device model of a user's own is asked like those of the package, and before them; it also answers
user-written records (``USRMDL``) of the model names that it says.

A model that gridfold does not have is never replaced in silence. By default it is an error; on request
(:class:`Unsupported`) it is left out, and :class:`Replacement` tells what that touches:

- an exciter: the field voltage stays constant; a governor: the mechanical power does; stabilizers,
  compensators, limiters, relays and controls: nothing stands in their place; a limiter of excitation
  is left out too where its exciter takes the signal at a gate;
- a machine: GENCLS with H, D and X'd of its record, or a negative load with all its controllers;
- a converter, and a model of which nothing is known at a unit without a machine: a negative load;
- a load model: loads stay what they are in the study.

A generator without a machine in the file is an error too, or on request (:class:`WithoutData`) a
negative load, or a unit with typical data (:mod:`gridfold.dynamics.typical_data`); wind and solar
plants have none.

Controls of converters take their places from the converter outwards; one whose outputs nothing takes
is left out. One that measures at another bus than its own is an error too, and measures at the
terminals of its unit on request.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum

from gridfold.dynamics.device import CONVERTER_ROLES, LIMITERS, Device
from gridfold.dynamics.own_models import answering, answering_user_written
from gridfold.dynamics.psse_loads import load_devices
from gridfold.dynamics.psse_models import CLASSICAL_COLUMNS, Kind, kind_of
from gridfold.dynamics.psse_parameters import (
    classical_parameters,
    named_parameters,
    source_impedance,
)
from gridfold.dynamics.psse_replacements import Tally, replacement
from gridfold.dynamics.registry import DEVICES, NEGATIVE_LOAD
from gridfold.dynamics.typical_data import TYPICAL_DEFAULT, typical_set
from gridfold.errors import CaseError
from gridfold.grid.case import Case, DeviceRecord, UnitKey
from gridfold.grid.dynamic_records import DynamicData, DynamicRecord, SkippedRecord
from gridfold.grid.energy_source import EnergySource
from gridfold.grid.replacement import Replacement

_CLASSICAL = "gencls"
_INFINITE_BUS = "infinite_bus"
_USER_WRITTEN = "user-written models"
_ONLY_USER_WRITTEN = "no dynamic data but user-written models"
#: What a replacement names where a generator has no machine in the file.
NO_DATA = "no dynamic data"
_NEGATIVE_LOAD = "negative load"
_REPLACE = (
    '--unsupported classical (unsupported="classical") replaces machines by GENCLS and converters by '
    "negative loads, and leaves out the rest; --unsupported drop replaces both by negative loads; "
    "--devices FILE.py (devices=) gives models of your own"
)
_MEASURE = (
    "gridfold measures at the terminals of the unit alone: --unsupported classical "
    '(unsupported="classical") accepts that'
)
_ABSORB = (
    '--no-data negative-load (without_data="negative_load") makes generators without a machine '
    'negative loads; --typical (without_data="typical") gives them typical data by kind and size'
)
_ONE_EACH = {
    "machines": (Kind.MACHINE, Kind.CONVERTER),
    "exciters": (Kind.EXCITER,),
    "governors": (Kind.GOVERNOR,),
    "stabilizers": (Kind.STABILIZER,),
    "voltage compensators": (Kind.COMPENSATOR,),
}
_LEFT_OUT = {
    Kind.EXCITER: "left out, constant field voltage",
    Kind.GOVERNOR: "left out, constant mechanical power",
    Kind.COMPENSATOR: "left out, the exciter holds the terminal voltage",
    Kind.LOAD: "left out, loads are what the study makes them",
}
_TAKERS = {  # the device that a controller needs, the input there, and what is said without it
    Kind.EXCITER: (Kind.MACHINE, "field_voltage", "the machine has no field"),
    Kind.GOVERNOR: (Kind.MACHINE, "mechanical_power", "the machine has no turbine"),
    Kind.STABILIZER: (Kind.EXCITER, "stabilizer_signal", "the unit has no exciter for it"),
    Kind.COMPENSATOR: (Kind.EXCITER, "terminal_voltage", "the unit has no exciter for it"),
}
#: Exciters that add the signals of limiters to that of the stabilizer.
_ADDING = (
    *("EXAC1", "EXAC2", "EXAC4", "EXDC2", "EXPIC1", "EXST1"),
    *("IEEET1", "IEEET2", "IEEET3", "IEEEX1", "SCRX", "SEXS"),
)

_NOT_NEEDED = "nothing in its unit takes what it gives"


class Unsupported(Enum):
    """What to do with models that gridfold does not have."""

    ERROR = "error"
    CLASSICAL = "classical"
    DROP = "drop"


class WithoutData(Enum):
    """What to do with generators in service that have no machine in the dynamics data."""

    ERROR = "error"
    NEGATIVE_LOAD = "negative_load"
    TYPICAL = "typical"


@dataclass(frozen=True)
class PsseDevices:
    """Device records, what was replaced or left out, and what plays no part.

    Parameters
    ----------
    records : tuple of DeviceRecord
        For the case.
    replaced : tuple of Replacement
        What the model lacks of the file, by model.
    skipped : tuple of str
        Records without effect, such as those of units out of service, in words.
    unplaced : tuple of str
        Records that name a unit which the network does not have, in words.
    origins : mapping of str to str
        File and line of each device record, by its name.
    """

    records: tuple[DeviceRecord, ...]
    replaced: tuple[Replacement, ...] = ()
    skipped: tuple[str, ...] = ()
    unplaced: tuple[str, ...] = ()
    origins: Mapping[str, str] = field(default_factory=dict)


def device_records(
    case: Case,
    data: DynamicData,
    *,
    unsupported: Unsupported = Unsupported.ERROR,
    without_data: WithoutData = WithoutData.ERROR,
    devices: Mapping[str, Device] = DEVICES,
) -> PsseDevices:
    """Device records of the generators and loads in service.

    Parameters
    ----------
    case : Case
        The network; its own device records are not looked at.
    data : DynamicData
        Records of the file.
    unsupported : Unsupported
        What to do with models that are not among `devices`.
    without_data : WithoutData
        What to do with generators in service without a machine in the file.
    devices : mapping
        Device models by name; each answers the records that it says, of its own name if it has a
        `psse_record` and says none.

    Raises
    ------
    CaseError
        Lists every record with a wrong number of values, every unit with several devices of one
        role and, unless asked for something else, every unsupported model with its count and every
        generator without data, with the records that name no unit, which may be why.
    """
    records = _sort(case, with_user_written(data, devices), answering(devices))
    units = _Units(case, records, devices, unsupported)
    loads = load_devices(case, records.of_loads, records.supported, data.file)
    faults = [*records.role_faults(), *loads.faults]
    advice: list[str] = []
    if unsupported is Unsupported.ERROR:
        missing = list(records.unsupported_faults(case))
        faults += missing
        advice += [_REPLACE] if missing else []
    for generator in case.generators:
        if generator.in_service:
            units.convert(generator.key)
    faults += units.faults + units.elsewhere
    advice += [_MEASURE] if units.elsewhere else []
    unplaced = (*records.unplaced_texts(case), *loads.unplaced)
    if units.lacking and without_data is WithoutData.ERROR:
        extent = replacement(case, "", "", units.lacking).extent.replace("record", "generator")
        listed = ", ".join(str(unit) for unit in units.lacking)
        faults.append(f"no machine for generators in service: {extent}: {listed}")
        advice.append(_ABSORB)
        faults += unplaced
    if faults:
        raise CaseError([*faults, *records.comments()], data.file, advice)
    for unit in units.lacking:
        units.stand_in(unit, without_data)
    for record in records.apart:
        units.leave_out(record)
    notices = (*records.notices(), *units.resolved_texts(), *units.notices, *loads.notices)
    return PsseDevices(
        (*units.made, *loads.records),
        units.tally.replacements(),
        notices,
        unplaced,
        units.origins | loads.origins,
    )


@dataclass
class _Sorted:
    """Records of a file: of units in service, of none, of loads, without effect, and unplaced."""

    file: str
    supported: Mapping[str, Device]
    by_unit: dict[UnitKey, list[DynamicRecord]] = field(default_factory=lambda: defaultdict(list))
    apart: list[DynamicRecord] = field(default_factory=list)
    of_loads: list[DynamicRecord] = field(default_factory=list)
    user_written: list[SkippedRecord] = field(default_factory=list)
    ignored: list[DynamicRecord] = field(default_factory=list)
    skipped: list[SkippedRecord] = field(default_factory=list)
    unplaced: list[DynamicRecord] = field(default_factory=list)
    no_place: list[SkippedRecord] = field(default_factory=list)

    def kind(self, record: DynamicRecord) -> Kind:
        return kind_of(record.model, self.supported)

    def place(self, record: DynamicRecord) -> str:
        return f"{record} ({self.file}:{record.line})"

    def role_faults(self) -> Iterator[str]:
        for unit, records in self.by_unit.items():
            for name, kinds in _ONE_EACH.items():
                same = [record for record in records if self.kind(record) in kinds]
                if len(same) > 1:
                    listed = ", ".join(f"{record.model} (line {record.line})" for record in same)
                    yield f"unit {unit} has {len(same)} {name}: {listed}"

    def unsupported_faults(self, case: Case) -> Iterator[str]:
        missing: dict[str, list[DynamicRecord]] = defaultdict(list)
        for record in (*self.apart, *(r for records in self.by_unit.values() for r in records)):
            if record.model not in self.supported:
                missing[record.model].append(record)
        for model, records in missing.items():
            extent = replacement(case, model, "", [record.key for record in records]).extent
            kind = self.kind(records[0]).value
            yield f"{model} ({kind}) is not supported: {extent}, line {records[0].line}"
        for skipped in self.user_written:
            yield f"a user-written model is not supported: line {skipped.line}: {skipped.text}"

    def notices(self) -> Iterator[str]:
        by_model: dict[str, list[DynamicRecord]] = defaultdict(list)
        for record in self.ignored:
            by_model[record.model].append(record)
        for model, records in by_model.items():
            count = "1 record" if len(records) == 1 else f"{len(records)} records"
            yield (
                f"{self.file}: {model}: {count} of units out of service, "
                f"first {records[0].key} (line {records[0].line})"
            )
        for skipped in self.skipped:
            what = "user-written, of a unit out of service" if skipped.unit else "no device record"
            if not skipped.is_comment:
                yield f"{self.file}:{skipped.line}: {what}: {skipped.text}"
        yield from self.comments()

    def comments(self) -> Iterator[str]:
        """What reads as a record but is a comment."""
        for skipped in self.skipped:
            if skipped.is_comment:
                yield (
                    f"{self.file}:{skipped.line}: it reads as a record but stands behind a /, "
                    f"so it is a comment: {skipped.text}"
                )

    def unplaced_texts(self, case: Case) -> Iterator[str]:
        for record in self.unplaced:
            yield f"{self.place(record)}: {why_unplaced(case, record.key)}"
        for skipped in self.no_place:
            why = (
                why_unplaced(case, skipped.unit) if skipped.unit else "it begins with no bus number"
            )
            yield f"{skipped.text} ({self.file}:{skipped.line}): {why}"


def why_unplaced(case: Case, unit: UnitKey) -> str:
    """Why there is no such unit, and which one may be meant."""
    if unit.bus not in case.bus_index:
        return f"there is no bus {unit.bus}"
    there = [generator.id for generator in case.generators if generator.bus == unit.bus]
    if not there:
        return f"bus {unit.bus} has no unit"
    listed = ", ".join(repr(name) for name in there)
    return f"bus {unit.bus} has no unit {unit.id!r}, but {listed}"


def with_user_written(data: DynamicData, devices: Mapping[str, Device]) -> DynamicData:
    """The same data, with the user-written records that own `devices` answer among the others."""
    known = answering_user_written(devices)
    found = [item.user_written for item in data.skipped if item.user_written is not None]
    taken = [record for record in found if record.model in known]
    rest = (s for s in data.skipped if s.user_written is None or s.user_written not in taken)
    records = sorted((*data.records, *taken), key=lambda record: record.line)
    return replace(data, records=tuple(records), skipped=tuple(rest)) if taken else data


def _sort(case: Case, data: DynamicData, supported: Mapping[str, Device]) -> _Sorted:
    live = {g.key for g in case.generators if g.in_service}
    idle = {g.key for g in case.generators if not g.in_service} | case.left_out

    def concerned(unit: UnitKey) -> bool:
        """Whether a model of which nothing is known may belong to something in service."""
        return unit not in idle and (unit.bus == 0 or unit.bus in case.bus_index)

    found = _Sorted(data.file, supported)
    for record in data.records:
        kind = found.kind(record)
        if kind is Kind.LOAD and record.model in supported:
            found.of_loads.append(record)
        elif record.key in live and kind not in (Kind.LOAD, Kind.PROTECTION):
            found.by_unit[record.key].append(record)
        elif kind in (Kind.LOAD, Kind.PROTECTION) or (
            kind is Kind.UNKNOWN and concerned(record.key)
        ):
            found.apart.append(record)
        elif record.key in idle:
            found.ignored.append(record)
        else:
            found.unplaced.append(record)
    for skipped in data.skipped:
        if skipped.unit is None:
            meant = kind_of(skipped.model, supported) is not Kind.UNKNOWN
            (found.no_place if meant else found.skipped).append(skipped)
        elif concerned(skipped.unit):
            found.user_written.append(skipped)
        else:
            (found.skipped if skipped.unit in idle else found.no_place).append(skipped)
    return found


class _Units:
    """Makes the device records, unit by unit."""

    def __init__(
        self,
        case: Case,
        records: _Sorted,
        devices: Mapping[str, Device],
        unsupported: Unsupported,
    ):
        self.records, self.devices, self.unsupported = records, devices, unsupported
        self.generators = {generator.key: generator for generator in case.generators}
        self.user_written = {record.unit for record in records.user_written}
        self.tally = Tally(case)
        self.made: list[DeviceRecord] = []
        self.origins: dict[str, str] = {}
        self.lacking: list[UnitKey] = []
        self.faults: list[str] = []
        self.elsewhere: list[str] = []
        self.notices: list[str] = []
        self.resolved: dict[tuple[str, str], list[DynamicRecord]] = {}
        for skipped in records.user_written:
            if skipped.unit is not None:
                self.tally.add(_USER_WRITTEN, "left out", skipped.unit)

    def convert(self, unit: UnitKey) -> None:
        """Device records of one generator in service."""
        records = self.records.by_unit.get(unit, [])
        machine = self._first(records, *_ONE_EACH["machines"])
        unknown = self._first(records, Kind.UNKNOWN)
        controllers = [record for record in records if record is not machine]
        device = None
        if machine is not None:
            device = self._machine(machine)
            if device is None:
                self.make_negative_load(unit, machine.model, _NEGATIVE_LOAD)
        elif unknown is not None:
            self.make_negative_load(unit, unknown.model, _NEGATIVE_LOAD)
            controllers.remove(unknown)
        elif unit in self.user_written:
            self.make_negative_load(unit, _ONLY_USER_WRITTEN, _NEGATIVE_LOAD)
        else:
            self.lacking.append(unit)
        if device is None:
            for record in controllers:
                self.tally.add(record.model, "left out with its machine", unit)
        else:
            self._controllers(controllers, device)

    def make_negative_load(self, unit: UnitKey, model: str, outcome: str) -> None:
        """A negative load in place of a unit, on account of `model`."""
        self.made.append(DeviceRecord(NEGATIVE_LOAD, unit.bus, unit.id))
        self.tally.add(model, outcome, unit)

    def stand_in(self, unit: UnitKey, without_data: WithoutData) -> None:
        """What stands for a unit without data: typical ones if asked for, else a negative load."""
        generator = self.generators[unit]
        chosen = typical_set(generator) if without_data is WithoutData.TYPICAL else None
        if chosen is None:
            kind = "" if generator.source is EnergySource.UNKNOWN else generator.source.value
            typical = without_data is WithoutData.TYPICAL
            outcome = f"{_NEGATIVE_LOAD}, a {kind} plant" if typical else _NEGATIVE_LOAD
            self.make_negative_load(unit, NO_DATA, outcome)
            return
        records = chosen.records(generator)
        self.made += records
        models = ", ".join(record.model.upper() for record in records)
        source = generator.source
        known = f"a {source.value} unit"
        taken = f"{TYPICAL_DEFAULT.value} as nothing tells"
        why = taken if source is EnergySource.UNKNOWN else known
        self.tally.add(NO_DATA, f"typical {models} ({why})", unit)

    def leave_out(self, record: DynamicRecord) -> None:
        """Count a record of an unsupported model."""
        outcome = _LEFT_OUT.get(self.records.kind(record), "left out")
        self.tally.add(record.model, outcome, record.key)

    def _first(self, records: Iterable[DynamicRecord], *kinds: Kind) -> DynamicRecord | None:
        return next((record for record in records if self.records.kind(record) in kinds), None)

    def _machine(self, record: DynamicRecord) -> Device | None:
        """Make the machine; None if a negative load must stand in its place."""
        device = self.records.supported.get(record.model)
        place = self.records.place(record)
        if device is not None:
            given = named_parameters(record, device, place, self.faults)
        elif self.unsupported is Unsupported.CLASSICAL and record.model in CLASSICAL_COLUMNS:
            device = self.devices[_CLASSICAL]
            given = classical_parameters(record, place, self.faults)
            self.tally.add(record.model, "classical machine GENCLS", record.key)
        else:
            return None
        parameters = source_impedance(device, self.generators[record.key]) | given
        if device.model == _CLASSICAL and parameters.get("inertia") == 0:
            device = self.devices[_INFINITE_BUS]
            parameters = {name: parameters[name] for name in ("resistance", "reactance")}
            behind = f"{parameters['reactance']:g} p.u. (ZSORCE)"
            self.notices.append(f"{place} has H = 0: an infinite bus behind {behind}")
        self._make(device, record, parameters)
        return device

    def _controllers(self, records: Sequence[DynamicRecord], machine: Device) -> None:
        present = {Kind.MACHINE: machine}
        for kind, (taker, name, reason) in _TAKERS.items():
            record = self._first(records, kind)
            device = None if record is None else self.records.supported.get(record.model)
            if record is None or device is None:
                continue
            if taker in present and name in present[taker].inputs:
                present[kind] = device
                place = self.records.place(record)
                given = named_parameters(record, device, place, self.faults)
                self._make(device, record, given)
            else:
                self.tally.add(record.model, f"left out, {reason}", record.key)
        self._converter_controls(records, machine)
        self._limiters(records, present.get(Kind.EXCITER))
        for record in records:
            if record.model not in self.records.supported:
                self.leave_out(record)

    def _converter_controls(self, records: Sequence[DynamicRecord], machine: Device) -> None:
        """What controls a converter: each takes its place if another one needs what it gives."""
        needed = set(machine.inputs)
        for role in CONVERTER_ROLES:
            for record in records:
                device = self.records.supported.get(record.model)
                if device is None or device.role is not role:
                    continue
                given = {*device.states, *device.outputs}
                if not given & needed or set(device.targets) - set(device.defaults) - needed:
                    self.tally.add(record.model, f"left out, {_NOT_NEEDED}", record.key)
                    continue
                needed |= set(device.inputs)
                self._note_place_of_measuring(device, record)
                place = self.records.place(record)
                self._make(device, record, named_parameters(record, device, place, self.faults))

    def _note_place_of_measuring(self, device: Device, record: DynamicRecord) -> None:
        """A control that measures elsewhere in the network does so at its own terminals here."""
        numbers = [record.values[k] for k in device.psse_measured if k < len(record.values)]
        elsewhere = [number for number in numbers if number not in (0, record.bus)]
        if elsewhere and self.unsupported is Unsupported.ERROR:
            self.elsewhere.append(
                f"{self.records.place(record)}: it measures at bus {elsewhere[0]:g}"
            )
        elif elsewhere:
            self.tally.add(record.model, "measures at the terminals of its unit", record.key)

    def _limiters(self, records: Sequence[DynamicRecord], exciter: Device | None) -> None:
        """Limiters of excitation, where an exciter adds their signals."""
        for record in records:
            device = self.records.supported.get(record.model)
            if device is None or device.role not in LIMITERS:
                continue
            if exciter is None:
                self.tally.add(record.model, "left out, the unit has no exciter for it", record.key)
            elif exciter.model.upper() not in _ADDING:
                reason = f"left out, {exciter.model.upper()} takes it at a gate"
                self.tally.add(record.model, reason, record.key)
            else:
                place = self.records.place(record)
                self._make(device, record, named_parameters(record, device, place, self.faults))

    def _make(self, device: Device, record: DynamicRecord, parameters: Mapping[str, float]) -> None:
        made = DeviceRecord(device.model, record.bus, record.id, parameters)
        self.made.append(made)
        self.origins[str(made)] = f"{self.records.file}:{record.line}"
        acting = device.acting(parameters, self.generators[record.key].base_mva)
        for parameter in device.parameters:
            given = parameters.get(parameter.name)
            if given is not None and acting[parameter.name] != given:
                self.resolved.setdefault((record.model, parameter.symbol), []).append(record)

    def resolved_texts(self) -> Iterator[str]:
        """What a record leaves to be found from its other values."""
        for (model, symbol), records in self.resolved.items():
            count = "1 record" if len(records) == 1 else f"{len(records)} records"
            yield (
                f"{self.records.file}: {model}: {symbol} follows from other values: {count}, "
                f"first {records[0].key} (line {records[0].line})"
            )
