"""A small case about one device, its machine behind a line at an infinite bus, and values for it."""

from __future__ import annotations

from collections.abc import Mapping

from gridfold.dynamics.device import Bound, Device, Parameter, Role, Side
from gridfold.dynamics.machines.genrou import DYR_COLUMNS as GENROU_RECORD
from gridfold.dynamics.registry import DEVICES
from gridfold.errors import OptionError
from gridfold.grid.case import Branch, Bus, Case, Control, DeviceRecord, Generator

#: Where a limit stands that is not given.
_FAR = 10.0
#: The machine of the case on 100 MVA, in the order of its record.
_GENROU = (6.5, 0.03, 0.6, 0.05, 4.0, 0.0, 1.8, 1.7, 0.3, 0.55, 0.25, 0.2, 0.05, 0.3)
_BESIDE: dict[Role, dict[str, dict[str, float]]] = {
    Role.MACHINE: {},
    Role.EXCITER: {},
    Role.GOVERNOR: {},
    Role.STABILIZER: {
        "sexs": {
            "lead_lag_ratio": 0.1,
            "lag_time": 10.0,
            "regulator_gain": 50.0,
            "exciter_time": 0.05,
            "field_voltage_minimum": -_FAR,
            "field_voltage_maximum": _FAR,
        }
    },
    Role.TURBINE: {"first_order_governor": {"droop": 0.05, "governor_time": 0.2}},
}


def trial_values(device: Device, given: Mapping[str, float]) -> dict[str, float]:
    """Parameters to try a device with: as given by name or symbol, by default, or of a usual size.

    Raises
    ------
    OptionError
        A name is none of the device's.
    """
    names = {p.symbol: p.name for p in device.parameters} | {
        p.name: p.name for p in device.parameters
    }
    strange = [name for name in given if name not in names]
    if strange:
        known = ", ".join(f"{p.name} {p.symbol}" for p in device.parameters)
        raise OptionError(f"{device.model} has no parameter {strange[0]!r}; there are {known}")
    values = {parameter.name: _usual(device, parameter) for parameter in device.parameters}
    return values | {names[name]: value for name, value in given.items()}


def _usual(device: Device, parameter: Parameter) -> float:
    if parameter.default is not None:
        return parameter.default
    sides = [limit.side for limit in device.limits if limit.parameter == parameter.name]
    if sides:
        lowest = 0.0 if parameter.bound is Bound.NOT_NEGATIVE else -_FAR
        return _FAR if sides[0] is Side.HIGHEST or parameter.bound is Bound.POSITIVE else lowest
    return 0.5 if parameter.unit == "s" else 1.0


def trial_case(device: Device, values: Mapping[str, float]) -> Case:
    """The case: the device with `values` at bus 1, with a machine and what else it needs."""
    records = [DeviceRecord(device.model, 1, "1", dict(values))]
    if device.role is not Role.MACHINE:
        machine = dict(zip(GENROU_RECORD, _GENROU, strict=True))
        records.append(DeviceRecord("genrou", 1, "1", {k: v for k, v in machine.items() if k}))
    beside = dict(_BESIDE[device.role])
    if device.role is Role.GOVERNOR and "mechanical_power" not in (
        *device.states,
        *device.signal_rows,
    ):
        turbine = DEVICES["non_reheat_turbine"]
        beside[turbine.model] = {p.name: _usual(turbine, p) for p in turbine.parameters}
    records += [DeviceRecord(model, 1, "1", parameters) for model, parameters in beside.items()]
    return Case(
        name=f"{device.model} at an infinite bus",
        buses=(Bus(1, voltage_pu=1.02), Bus(2)),
        branches=(Branch(1, 2, reactance=0.4),),
        generators=(
            Generator(1, active_mw=80.0, voltage_pu=1.02),
            Generator(2, control=Control.SLACK),
        ),
        devices=(*records, DeviceRecord("infinite_bus", 2, "1", {"reactance": 0.1})),
    )
