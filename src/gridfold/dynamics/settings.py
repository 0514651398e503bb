"""Parameters and references of devices that events set.

Values are on the base that they have in files. The reference of a governor's speed is no row of its
parameters: it moves the power reference by as much as holds the power of the start at the other speed,
found by the same equations as the start.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gridfold.dynamics.device import Bound, Device, Role
from gridfold.dynamics.initialize import reference_at_speed
from gridfold.dynamics.layout import Block, Layout
from gridfold.errors import EventError, InitializationError
from gridfold.grid.case import UnitKey
from gridfold.grid.network_state import Setting
from gridfold.powerflow.result import PowerFlowResult

#: Name of the reference of a governor's speed, and of the reference that it moves.
SPEED_REFERENCE, POWER_REFERENCE = "speed_reference", "power_reference"
#: What PSS/E calls references.
_REFERENCES = (
    ("VREF", "voltage_reference"),
    ("GREF", POWER_REFERENCE),
    ("PREF", POWER_REFERENCE),
    ("WREF", SPEED_REFERENCE),
)
#: Part of a difference between two starts that rounding may make.
_SAME = 1e-12


def settled(layout: Layout, settings: Sequence[Setting], flow: PowerFlowResult) -> Layout:
    """The layout with parameters as the settings say.

    Raises
    ------
    EventError
        A unit has no such parameter, or several devices with it; a value is out of range, or does not
        go with the others of its device.
    """
    blocks = list(layout.blocks)
    for setting in settings:
        at, column = _find(layout, setting)
        row, value = _row_and_value(layout, at, column, setting, flow)
        parameters = blocks[at].parameters.copy()
        parameters[row, column] = value
        blocks[at] = replace(blocks[at], parameters=parameters)
    for setting in settings:
        at, column = _find(layout, setting)
        _check(setting, _Unit(layout.blocks[at], column, flow), _Unit(blocks[at], column, flow))
    return replace(layout, blocks=tuple(blocks))


@dataclass(frozen=True)
class _Unit:
    """One column of a block."""

    block: Block
    column: int
    flow: PowerFlowResult

    @property
    def key(self) -> UnitKey:
        return self.block.units[self.column]

    @property
    def base_mva(self) -> float:
        return next(g.base_mva for g in self.flow.case.generators if g.key == self.key)

    def factor(self, name: str) -> float:
        """What a value of a file is multiplied by."""
        known = {parameter.name: parameter.scaling for parameter in self.block.device.parameters}
        ratio = self.base_mva / self.flow.case.base_mva
        return float(ratio ** known[name].value) if name in known else 1.0

    def value(self, name: str) -> float:
        """The value of a row, as a file would give it."""
        row = self.block.device.parameter_rows.index(name)
        return float(self.block.parameters[row, self.column]) / self.factor(name)

    @property
    def faults(self) -> list[str]:
        """What its device finds wrong with its parameters."""
        device = self.block.device
        return list(device.check({p.name: self.value(p.name) for p in device.parameters}))


def _names(device: Device) -> list[str]:
    """What can be set of a device."""
    names = [*(parameter.name for parameter in device.parameters), *device.set_points]
    governs = device.role is Role.GOVERNOR and "speed" in device.inputs
    return [*names, SPEED_REFERENCE] if governs and POWER_REFERENCE in device.set_points else names


def _find(layout: Layout, setting: Setting) -> tuple[int, int]:
    """Block and column that a setting is meant for."""
    where = f"{setting.name} of unit {setting.unit}"
    own = [(k, b) for k, b in enumerate(layout.blocks) if setting.unit in b.units]
    if setting.model:
        own = [(k, b) for k, b in own if b.device.model == setting.model]
    found = [(k, b) for k, b in own if setting.name in _names(b.device)]
    if len(found) == 1:
        return found[0][0], found[0][1].units.index(setting.unit)
    if found:
        models = " and ".join(b.device.model for _, b in found)
        raise EventError(f"{where}: {models} have it; say which by model")
    meant = [name for _, b in own for name in _by_symbol(b.device, setting.name)]
    if meant:
        raise EventError(f"{where}: it is called {' or '.join(dict.fromkeys(meant))} here")
    known = "; ".join(f"{b.device.model}: {', '.join(_names(b.device))}" for _, b in own)
    raise EventError(f"{where}: no device of the unit has it; known: {known or 'nothing'}")


def _by_symbol(device: Device, symbol: str) -> list[str]:
    """Names of what a device's page, or PSS/E, has under a symbol."""
    symbols = [
        *_REFERENCES,
        *((parameter.symbol, parameter.name) for parameter in device.parameters),
    ]
    wanted, settable = symbol.casefold(), _names(device)
    return [name for known, name in symbols if known.casefold() == wanted and name in settable]


def _row_and_value(
    layout: Layout, at: int, column: int, setting: Setting, flow: PowerFlowResult
) -> tuple[int, float]:
    """Row of the parameters, and its new value on the system base."""
    unit = _Unit(layout.blocks[at], column, flow)
    device = unit.block.device
    if setting.name == SPEED_REFERENCE:
        speed = (1.0 if setting.value is None else setting.value) + setting.change
        row = device.parameter_rows.index(POWER_REFERENCE)
        return row, float(unit.block.parameters[row, column]) + _moved(
            layout, at, unit, speed, flow
        )
    start = unit.value(setting.name) if setting.value is None else setting.value
    value = start + setting.change
    bounds = {parameter.name: parameter.bound for parameter in device.parameters}
    bound = bounds.get(setting.name, Bound.ANY)
    if not bound.holds(value):
        raise EventError(
            f"{setting.name} of unit {setting.unit}: it must be {bound.value}, not {value:g}"
        )
    return device.parameter_rows.index(setting.name), value * unit.factor(setting.name)


def _moved(layout: Layout, at: int, unit: _Unit, speed: float, flow: PowerFlowResult) -> float:
    """By how much a governor's power reference moves with the reference of its speed."""
    where = f"{SPEED_REFERENCE} of unit {unit.key}"
    try:
        before, after = (
            reference_at_speed(layout, flow, at, unit.key, POWER_REFERENCE, at_speed)
            for at_speed in (1.0, speed)
        )
    except (InitializationError, np.linalg.LinAlgError):
        before, after = 0.0, np.nan
    if not np.isfinite(after) or (abs(after - before) <= _SAME and abs(speed - 1) > _SAME):
        raise EventError(
            f"{where}: {unit.block.device.model} has no droop by which a power would hold another speed"
        )
    return after - before


def _check(setting: Setting, before: _Unit, after: _Unit) -> None:
    """Raise where a device finds a fault that it did not have."""
    new = [fault for fault in after.faults if fault not in before.faults]
    if new:
        raise EventError(f"{setting.name} of unit {setting.unit}: {'; '.join(new)}")
