"""Doubts about a case: what is beyond the usual values of networks, operating points and devices.

Inertia and impedances of a machine are looked at on the rating of its unit. That is its base; in files
that have all machines on the base of the system it is not known, and taken to be one to two times the
power of a unit that gives more than this base.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager

from gridfold.dynamics.device import Device, Parameter, Role
from gridfold.dynamics.registry import DEVICES
from gridfold.dynamics.usual_values import ORDERS, RANGES, Range
from gridfold.errors import InitializationError, PowerFlowError
from gridfold.grid.case import Case, DeviceRecord, Generator
from gridfold.grid.doubts import Doubt, Usual, doubt_of, various_first
from gridfold.grid.plausible import OVERLOAD, network_doubts
from gridfold.powerflow.plausible import flow_doubts
from gridfold.powerflow.result import PowerFlowResult

#: Doubts that an error names.
_NAMED = 6


def case_doubts(case: Case, devices: Mapping[str, Device] = DEVICES) -> tuple[Doubt, ...]:
    """All doubts about a case: what its file alone shows, the network, the devices in service."""
    return various_first((*case.doubts, *network_doubts(case), *device_doubts(case, devices)))


def model_doubts(
    power_flow: PowerFlowResult, devices: Mapping[str, Device] = DEVICES
) -> tuple[Doubt, ...]:
    """The same, and those about the operating point."""
    return various_first((*case_doubts(power_flow.case, devices), *flow_doubts(power_flow)))


@contextmanager
def naming_doubts(case: Case, devices: Mapping[str, Device] = DEVICES) -> Iterator[None]:
    """Adds the first doubts about a case to the error where there is no operating point or start."""
    try:
        yield
    except (PowerFlowError, InitializationError) as error:
        lines = [f"  {doubt}" for doubt in case_doubts(case, devices)]
        if not lines:
            raise
        more = [f"  ... and {len(lines) - _NAMED} more"] if len(lines) > _NAMED else []
        text = "\n".join([error.text, "Doubtful data, which may be why:", *lines[:_NAMED], *more])
        raise type(error)(text, error.advice) from error


def device_doubts(case: Case, devices: Mapping[str, Device] = DEVICES) -> Iterator[Doubt]:
    """Doubts about the parameters of devices in service."""
    live = {unit.key: unit for unit in case.generators if unit.in_service}
    for record in case.devices:
        device = devices.get(record.model)
        if device is not None and record.key in live:
            origin = case.origins.get(str(record), "")
            yield from doubt_of(
                str(record), origin, _unusual(device, record, live[record.key], case)
            )


def _unusual(
    device: Device, record: DeviceRecord, unit: Generator, case: Case
) -> Iterator[tuple[str, str]]:
    values = device.acting(record.parameters, unit.base_mva)
    known = {parameter.name: parameter for parameter in device.parameters}
    for row in RANGES if device.states else ():  # an infinite bus has no usual values
        if row.role is device.role and row.parameter in values:
            parameter = known[row.parameter]
            text = _beyond(row, parameter, values[row.parameter], _ratings(device, unit, case))
            if text:
                yield row.name, text
    for order in ORDERS:
        if order.role is device.role and not order.holds(values):
            larger, smaller = known[order.larger], known[order.smaller]
            relation = "not more" if order.strict else "less"
            yield (
                order.name,
                f"{_named(larger)} {values[order.larger]!r} is {relation} than {_named(smaller)} "
                f"{values[order.smaller]!r}",
            )


def _beyond(
    row: Range, parameter: Parameter, value: float, ratings: tuple[float, float]
) -> str | None:
    """What is told of a value that is unusual on the lowest and on the highest of `ratings`."""
    usual = Usual(
        row.name, _named(parameter), ((row.lowest, row.highest),), parameter.unit, row.source
    )
    low, high = sorted(value / rating**parameter.scaling.value for rating in ratings)
    nearest = min(max(low, row.lowest), high)
    if usual.holds(nearest):
        return None
    on = "" if nearest == value else f"{value:g} here; on the power that the unit gives, "
    return f"{_named(parameter)} is {on}{usual.doubt(nearest).removeprefix(usual.what + ' is ')}"


def _ratings(device: Device, unit: Generator, case: Case) -> tuple[float, float]:
    """The least and the largest rating that a unit may have, in parts of its base."""
    given = abs(complex(unit.active_mw, unit.reactive_mvar)) / unit.base_mva
    known = unit.base_mva != case.base_mva or given <= OVERLOAD
    return (1.0, 1.0) if known or device.role is not Role.MACHINE else (given, 2 * given)


def _named(parameter: Parameter) -> str:
    return f"{parameter.name} ({parameter.symbol})"
