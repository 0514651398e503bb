"""Operating points and parameters of samples: cases on one network."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gridfold.dynamics.device import Device
from gridfold.errors import EventError, OptionError
from gridfold.grid.case import Case, Control, DeviceRecord, Generator, Load
from gridfold.grid.operating_point import at_operating_point
from gridfold.grid.selection import select_buses, select_machines
from gridfold.io.tables import suggest
from gridfold.sampling.plan import Named, ParameterSection, PowerSection, SamplePlan

#: Power in MW below zero that rounding may leave.
_ROUNDING = 1e-9
_POWERS = (
    "active_mw",
    "reactive_mvar",
    "current_active_mw",
    "current_reactive_mvar",
    "impedance_active_mw",
    "impedance_reactive_mvar",
)


@dataclass(frozen=True)
class _Powers:
    """Loads or units by position, and how a value that is drawn changes their power."""

    name: str
    at: NDArray[np.int64]
    by_factor: bool
    total_mw: float

    def factor(self, value: float) -> float:
        """What their power is multiplied by."""
        return value if self.by_factor else 1.0 + value / self.total_mw


@dataclass(frozen=True)
class _Parameters:
    """Device records by position, and what a value that is drawn does to a parameter of theirs."""

    name: str
    at: tuple[int, ...]
    parameter: str
    by_factor: bool


@dataclass(frozen=True)
class OperatingPoints:
    """What a plan draws, resolved to positions in a case.

    Parameters
    ----------
    case : Case
        The case.
    loads, units : tuple
        Loads and units whose powers are drawn.
    sharing : ndarray of int
        Positions of the units that share what these change.
    parameters : tuple
        Parameters that are drawn.
    devices : mapping
        Device models by name.
    """

    case: Case
    loads: tuple[_Powers, ...]
    units: tuple[_Powers, ...]
    sharing: NDArray[np.int64]
    parameters: tuple[_Parameters, ...]
    devices: Mapping[str, Device]

    @classmethod
    def of(cls, plan: SamplePlan, case: Case, devices: Mapping[str, Device]) -> OperatingPoints:
        """Find what a plan names.

        Raises
        ------
        OptionError
            Something is not in the case: all of it, by key.
        """
        finder = _Finder(case, devices)
        found: dict[str, list[Any]] = {"load": [], "generation": [], "parameter": []}
        faults = []
        for named in plan.named:
            try:
                found[named.table].append(finder.resolved(named))
            except OptionError as error:
                faults.append(str(error))
        sharing: list[int] = []
        try:
            sharing = finder.units("balance.units", plan.balance.units)
        except OptionError as error:
            faults.append(str(error))
        if faults:
            raise OptionError("\n".join(faults))
        drawn = {k for item in found["generation"] for k in item.at.tolist()}
        return cls(
            case,
            tuple(found["load"]),
            tuple(found["generation"]),
            np.array([k for k in sharing if k not in drawn], dtype=np.int64),
            tuple(found["parameter"]),
            devices,
        )

    def case_at(self, values: Mapping[str, float]) -> Case:
        """The case with what was drawn.

        Raises
        ------
        EventError
            A unit would have to give less than nothing.
        """
        case = self.case
        factors = np.ones(len(case.loads))
        for item in self.loads:
            factors[item.at] *= item.factor(values[item.name])
        drawn_mw = np.array([_active(case, load) for load in case.loads])
        generators = self._dispatched(values, float(((factors - 1.0) * drawn_mw).sum()))
        loads = [_scaled(load, factor) for load, factor in zip(case.loads, factors, strict=True)]
        devices = self._devices(values) if self.parameters else None
        return at_operating_point(case, loads, generators, devices)

    def _dispatched(self, values: Mapping[str, float], more_load_mw: float) -> list[Generator]:
        """The units, with what loads draw more shared out."""
        units = self.case.generators
        before = np.array([unit.active_mw for unit in units])
        power = before.copy()
        for item in self.units:
            power[item.at] *= item.factor(values[item.name])
        more = more_load_mw - float((power - before).sum())
        if len(self.sharing) and more:
            part = before[self.sharing] / before[self.sharing].sum()
            power[self.sharing] += more * part
        for unit, old, new in zip(units, before, power, strict=True):
            if new < -_ROUNDING and new < old:
                raise EventError(f"{unit} would give {new:.4g} MW, less than nothing")
        return [
            replace(unit, active_mw=float(new)) if new != old else unit
            for unit, old, new in zip(units, before, power, strict=True)
        ]

    def _devices(self, values: Mapping[str, float]) -> list[DeviceRecord]:
        records = list(self.case.devices)
        for item in self.parameters:
            value = values[item.name]
            for k in item.at:
                old = _given(self.devices[records[k].model], records[k], item.parameter)
                new = old * value if item.by_factor else value
                parameters = {**records[k].parameters, item.parameter: new}
                records[k] = replace(records[k], parameters=parameters)
        return records


@dataclass(frozen=True)
class _Finder:
    """Finds what a plan names in a case; an OptionError where that is nothing."""

    case: Case
    devices: Mapping[str, Device]

    def resolved(self, named: Named) -> _Powers | _Parameters:
        """What a table of the plan is about, by position."""
        where, item = f"{named.table} {named.number}, where", named.item
        if isinstance(item, ParameterSection):
            return self._parameters(named.name, where, item)
        find = self.loads if named.table == "load" else self.units
        return self._powers(named, where, item, find(where, item.where))

    def loads(self, where: str, text: str) -> list[int]:
        """Positions of the loads in service at the buses that a text chooses."""
        buses = set(select_buses(text, self.case, where))
        loads = enumerate(self.case.loads)
        return [k for k, load in loads if load.in_service and load.bus in buses]

    def units(self, where: str, text: str) -> list[int]:
        """Positions of units with positive power in service, those at slack buses aside."""
        units = self.case.generators
        slack = {unit.bus for unit in units if unit.control is Control.SLACK}
        chosen = set(select_machines(text, self.case, where))
        return [
            k
            for k, unit in enumerate(units)
            if unit.key in chosen
            and unit.in_service
            and unit.bus not in slack
            and unit.active_mw > 0
        ]

    def _powers(self, named: Named, where: str, item: PowerSection, at: list[int]) -> _Powers:
        if named.table == "load":
            total = sum(_active(self.case, self.case.loads[k]) for k in at)
            what = "load in service"
        else:
            total = sum(self.case.generators[k].active_mw for k in at)
            what = "unit in service with positive power, those at slack buses aside"
        if not at:
            raise OptionError(f"{where}: {item.where!r} chooses no {what}")
        if item.factor is None and not total > 0:
            raise OptionError(f"{where}: no active power in all that change_mw could be shared by")
        return _Powers(named.name, np.array(at, dtype=np.int64), item.factor is not None, total)

    def _parameters(self, name: str, where: str, item: ParameterSection) -> _Parameters:
        chosen = set(select_machines(item.where, self.case, where))
        there = [
            (k, self.devices[record.model])
            for k, record in enumerate(self.case.devices)
            if record.key in chosen
            and record.model in self.devices
            and item.model in (None, record.model)
        ]
        known = {parameter.name for _, device in there for parameter in device.parameters}
        if item.parameter not in known:
            of = f"no device {item.model}" if item.model else "no device"
            raise OptionError(
                f"{where}: {of} there has a parameter {item.parameter!r}; "
                f"{suggest(item.parameter, sorted(known))}"
            )
        at = tuple(
            k for k, device in there if item.parameter in {p.name for p in device.parameters}
        )
        return _Parameters(name, at, item.parameter, item.factor is not None)


def _active(case: Case, load: Load) -> float:
    """Active power of a load in MW at the stored voltage; 0 if it is out of service."""
    return case.stored_power(load).real if load.in_service else 0.0


def _scaled(load: Load, factor: float) -> Load:
    if factor == 1.0:
        return load
    return replace(load, **{name: getattr(load, name) * factor for name in _POWERS})


def _given(device: Device, record: DeviceRecord, name: str) -> float:
    """The value of a parameter as a file gives it, or its default."""
    default = next(p.default for p in device.parameters if p.name == name)
    value = record.parameters.get(name, default)
    assert value is not None  # of a case whose records are without faults
    return value
