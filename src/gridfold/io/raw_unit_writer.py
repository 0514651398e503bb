"""Units of a case as records of a RAW file, and what they make of their buses.

A unit that holds a voltage holds the stored one of its bus when the file is read; its set point and its
limits are those of its control, where the case has one.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence

from gridfold.grid.case import Bus, Case, Control, Generator, UnitKey
from gridfold.grid.energy_source import EnergySource
from gridfold.grid.flow_controls import UnitControl
from gridfold.io.lost import Lost
from gridfold.io.raw_text import Texts, flag, real, reals

#: Difference that rounding may make, of voltages in per unit and of proportions.
_ROUNDING = 1e-9
_NO_LIMIT = 9999.0
_OWNERS = ",".join(["1,1.0", *["0,1.0"] * 3])


class Units:
    """Writes the units of a case."""

    def __init__(self, case: Case, lost: Lost):
        self.lost, self.texts = lost, Texts(lost)
        self.at_bus: dict[int, list[Generator]] = defaultdict(list)
        for unit in case.generators:
            self.at_bus[unit.bus].append(unit)
        self.controls = {
            UnitKey(item.bus, item.id): item
            for item in case.flow_controls
            if isinstance(item, UnitControl)
        }

    def voltage(self, bus: Bus) -> float:
        """Stored voltage of a bus in per unit, which its units hold."""
        held = {unit.voltage_pu for unit in self._regulating(bus.number)}
        voltage = held.pop() if held else bus.voltage_pu
        if abs(voltage - bus.voltage_pu) > _ROUNDING:
            self.lost.add("stored voltages where a unit holds another one, which is written", bus)
        return voltage

    def _regulating(self, bus: int) -> list[Generator]:
        """Units in service that hold the voltage."""
        return [u for u in self.at_bus[bus] if u.in_service and u.control is not Control.POWER]

    def bus_type(self, bus: int) -> int:
        """Type of a bus: 3 where a unit balances, 2 where there are units, else 1."""
        live = [unit for unit in self.at_bus[bus] if unit.in_service]
        if any(unit.control is Control.SLACK for unit in live):
            return 3
        held = any(unit.control is not Control.POWER for unit in self.at_bus[bus])
        return 2 if live or held else 1

    def lines(self, bus: int) -> Iterator[str]:
        """The records of the units at a bus."""
        units = self.at_bus[bus]
        live = [unit for unit in units if unit.in_service]
        reactive = self._reactive(live)
        largest = max(live, key=lambda unit: unit.base_mva, default=None)
        for unit in units:
            if unit.control is Control.SLACK and unit in live and unit is not largest:
                self.lost.add(
                    "which units balance at a slack bus, where not the largest alone", unit
                )
            if unit.source not in (EnergySource.UNKNOWN, EnergySource.WIND):
                self.lost.add("what drives a unit, other than wind", unit)
            yield self._generator(unit, reactive.get(unit.id, unit.reactive_mvar))

    def _reactive(self, live: Sequence[Generator]) -> dict[str, float]:
        """Reactive powers by id, where the stored ones do not tell the parts that units take."""
        sharing = [unit for unit in live if unit.control is not Control.POWER]
        if len(sharing) < 2:
            return {}
        given = [unit.reactive_mvar for unit in sharing]
        shares = [unit.share for unit in sharing]
        alike = all(power > 0 for power in given) or all(power < 0 for power in given)
        if _alike(map(abs, given) if alike else [unit.base_mva for unit in sharing], shares):
            return {}
        for unit in sharing:
            self.lost.add("stored reactive power of units that share a bus by other parts", unit)
        total = sum(given) or 1.0
        return {u.id: total * u.share / sum(shares) for u in sharing}

    def _generator(self, unit: Generator, reactive: float) -> str:
        holds_power = unit.in_service and unit.control is Control.POWER
        if holds_power:
            self.lost.add(
                "units that hold their reactive power: PSS/E holds it by limits, gridfold reads units "
                "that hold the stored voltage",
                unit,
            )
        control = self.controls.get(unit.key, _control(unit))
        limits = (control.reactive_max_mvar, control.reactive_min_mvar)
        powers = reals(unit.active_mw, reactive, *((reactive, reactive) if holds_power else limits))
        remote = 0 if control.regulated_bus == unit.bus else control.regulated_bus
        machine = reals(unit.base_mva, unit.source_resistance, unit.source_reactance)
        return ",".join(
            [
                f"{unit.bus},{self.texts.identifier(unit.id, unit)},{powers}",
                f"{real(control.set_point_pu)},{remote},{machine},0.0,0.0,1.0,{flag(unit)}",
                f"{real(control.part)},{reals(_NO_LIMIT, -_NO_LIMIT)},{_OWNERS}",
                f"{int(unit.source is EnergySource.WIND)},1.0",
            ]
        )


def _control(unit: Generator) -> UnitControl:
    """The control of a unit of which the case says none: its voltage, without limits."""
    return UnitControl(unit.bus, unit.id, unit.voltage_pu, unit.bus, -_NO_LIMIT, _NO_LIMIT)


def _alike(first: Iterable[float], second: Sequence[float]) -> bool:
    """Whether numbers are in the same proportions."""
    ratios = [a / b for a, b in zip(first, second, strict=True)]
    return bool(max(ratios) - min(ratios) <= _ROUNDING * max(ratios))
