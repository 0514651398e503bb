"""Write the network of a case as a RAW file of PSS/E, revision 33.

Numbers are written so that they are read back as they are. A branch with a ratio, a shift, or between
two voltage levels is a transformer, in per unit of its buses (CW, CZ, CM = 1). A unit that holds a
voltage holds the stored one of its bus. Layouts are those of the PSS/E Program Operation Manual, chapter
on the power flow raw data file; ratings of branches, limits of units and remote control are no part of
a case, and stand at the manual's defaults.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any

from gridfold.grid.case import Branch, Bus, Case, Control, Generator, Load, Shunt
from gridfold.grid.energy_source import EnergySource
from gridfold.io.lost import Lost
from gridfold.io.raw_text import Texts, flag, real, reals, title

_SECTIONS = (
    "BUS",
    "LOAD",
    "FIXED SHUNT",
    "GENERATOR",
    "BRANCH",
    "TRANSFORMER",
    "AREA",
    "TWO-TERMINAL DC",
    "VSC DC LINE",
    "IMPEDANCE CORRECTION",
    "MULTI-TERMINAL DC",
    "MULTI-SECTION LINE",
    "ZONE",
    "INTER-AREA TRANSFER",
    "OWNER",
    "FACTS DEVICE",
    "SWITCHED SHUNT",
    "GNE",
)
#: Difference that rounding may make, of voltages in per unit and of proportions.
_ROUNDING = 1e-9
_NO_LIMIT = "9999.0,-9999.0"
_OWNERS = ",".join(["1,1.0", *["0,1.0"] * 3])
#: Parts of a case that a RAW file holds, or that no result depends on.
_HELD = {
    *("name", "description", "base_mva", "frequency_hz", "area_names", "zone_names", "owner_names"),
    *("buses", "branches", "generators", "loads", "shunts", "devices"),
    *("origins", "notices", "doubts", "file_counts", "left_out"),
}
_TOLD = {
    "unsupported": "what the file of the case had and gridfold has no model for",
    "replacements": "dynamic data that were replaced: the file holds what stands for them",
    "unplaced": "dynamic data of units that are not there",
}


def raw_text(case: Case) -> tuple[str, tuple[str, ...]]:
    """The text of a RAW file, and what it cannot hold of the case, in words."""
    return _Writer(case).write()


@dataclass
class _Writer:
    case: Case
    lost: Lost = field(default_factory=Lost)
    texts: Texts = field(init=False)
    units: dict[int, list[Generator]] = field(default_factory=lambda: defaultdict(list))

    def __post_init__(self) -> None:
        self.texts = Texts(self.lost)

    def write(self) -> tuple[str, tuple[str, ...]]:
        for unit in self.case.generators:
            self.units[unit.bus].append(unit)
        lines = [branch for branch in self.case.branches if not self._is_transformer(branch)]
        transformers = [branch for branch in self.case.branches if self._is_transformer(branch)]
        charging = list(self._charging(transformers))
        records: Mapping[str, Iterator[str]] = {
            "BUS": (self._bus(bus) for bus in self.case.buses),
            "LOAD": (self._load(load) for load in self.case.loads),
            "FIXED SHUNT": (self._shunt(shunt) for shunt in (*self.case.shunts, *charging)),
            "GENERATOR": (line for bus in self.case.buses for line in self._generators(bus.number)),
            "BRANCH": (self._line(branch) for branch in lines),
            "TRANSFORMER": (line for branch in transformers for line in self._transformer(branch)),
            "AREA": (
                f"{number},0,0.0,10.0,{self.texts.name(name, f'area {number}')}"
                for number, name in self.case.area_names.items()
            ),
            "ZONE": self._names(self.case.zone_names, "zone"),
            "OWNER": self._names(self.case.owner_names, "owner"),
        }
        text = [f"0,{real(self.case.base_mva)},33,0,0,{real(self.case.frequency_hz)}"]
        text += [title(self.case.name), title(self.case.description)]
        for section, following in zip(_SECTIONS, (*_SECTIONS[1:], ""), strict=True):
            begin = f", BEGIN {following} DATA" if following else ""
            text += [*records.get(section, ()), f"0 / END OF {section} DATA{begin}"]
        self._other_parts()
        return "\n".join([*text, "Q", ""]), self.lost.lines

    # Records.

    def _bus(self, bus: Bus) -> str:
        if bus.latitude is not None or bus.longitude is not None:
            self.lost.add("latitude and longitude", bus)
        held = {unit.voltage_pu for unit in self._regulating(bus.number)}
        voltage = held.pop() if held else bus.voltage_pu
        if abs(voltage - bus.voltage_pu) > _ROUNDING:
            self.lost.add("stored voltages where a unit holds another one, which is written", bus)
        name = self.texts.name(bus.name, bus)
        head = f"{bus.number},{name},{real(bus.base_kv)},{self._bus_type(bus.number)}"
        place = f"{bus.area},{bus.zone},{bus.owner}"
        return f"{head},{place},{real(voltage)},{real(bus.angle_deg)}"

    def _regulating(self, bus: int) -> list[Generator]:
        """Units in service that hold the voltage."""
        return [u for u in self.units[bus] if u.in_service and u.control is not Control.POWER]

    def _bus_type(self, bus: int) -> int:
        live = [unit for unit in self.units[bus] if unit.in_service]
        if any(unit.control is Control.SLACK for unit in live):
            return 3
        held = any(unit.control is not Control.POWER for unit in self.units[bus])
        return 2 if live or held else 1

    def _load(self, load: Load) -> str:
        bus = self.case.buses[self.case.bus_index[load.bus]]
        powers = (
            load.active_mw,
            load.reactive_mvar,
            load.current_active_mw,
            load.current_reactive_mvar,
            load.impedance_active_mw,
            -load.impedance_reactive_mvar,
        )
        head = (
            f"{load.bus},{self.texts.identifier(load.id, load)},{flag(load)},{bus.area},{bus.zone}"
        )
        return f"{head},{reals(*powers)},1,1,0"

    def _shunt(self, shunt: Shunt) -> str:
        values = reals(shunt.conductance_mw, shunt.susceptance_mvar)
        return f"{shunt.bus},{self.texts.identifier(shunt.id, shunt)},{flag(shunt)},{values}"

    def _generators(self, bus: int) -> Iterator[str]:
        units = self.units[bus]
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
        holds_power = unit.control is Control.POWER
        if holds_power and unit.in_service:
            self.lost.add(
                "units that hold their reactive power: PSS/E holds it by limits, gridfold reads units "
                "that hold the stored voltage",
                unit,
            )
        limits = reals(reactive, reactive) if holds_power else _NO_LIMIT
        powers = reals(unit.active_mw, reactive)
        head = f"{unit.bus},{self.texts.identifier(unit.id, unit)},{powers},{limits}"
        source = reals(unit.source_resistance, unit.source_reactance)
        machine = f"{real(unit.voltage_pu)},0,{real(unit.base_mva)},{source},0.0,0.0,1.0"
        wind = int(unit.source is EnergySource.WIND)
        return f"{head},{machine},{flag(unit)},100.0,{_NO_LIMIT},{_OWNERS},{wind},1.0"

    def _is_transformer(self, branch: Branch) -> bool:
        if branch.ratio != 1 or branch.shift_deg != 0:
            return True
        plain = not (branch.susceptance or branch.to_conductance or branch.to_susceptance)
        first, second = (
            self.case.buses[self.case.bus_index[bus]] for bus in (branch.from_bus, branch.to_bus)
        )
        return plain and first.base_kv != second.base_kv

    def _line(self, branch: Branch) -> str:
        head = f"{branch.from_bus},{branch.to_bus},{self.texts.identifier(branch.circuit, branch)}"
        series = reals(branch.resistance, branch.reactance, branch.susceptance)
        ends = reals(
            branch.from_conductance,
            branch.from_susceptance,
            branch.to_conductance,
            branch.to_susceptance,
        )
        return f"{head},{series},0.0,0.0,0.0,{ends},{flag(branch)},1,0.0,1,1.0"

    def _transformer(self, branch: Branch) -> Iterator[str]:
        at_from = complex(branch.from_conductance, branch.from_susceptance)
        at_from += 0.5j * branch.susceptance / branch.ratio**2
        head = (
            f"{branch.from_bus},{branch.to_bus},0,{self.texts.identifier(branch.circuit, branch)}"
        )
        yield f"{head},1,1,1,{reals(at_from.real, at_from.imag)},2,'',{flag(branch)},1,1.0"
        yield f"{reals(branch.resistance, branch.reactance)},{real(self.case.base_mva)}"
        yield f"{real(branch.ratio)},0.0,{real(branch.shift_deg)},0.0,0.0,0.0,0,0"
        yield "1.0,0.0"

    def _charging(self, transformers: Sequence[Branch]) -> Iterator[Shunt]:
        """What stands at the second bus of a transformer, as fixed shunts."""
        taken = defaultdict(set, {s.bus: {s.id} for s in self.case.shunts})
        for shunt in self.case.shunts:
            taken[shunt.bus].add(shunt.id)
        for branch in transformers:
            susceptance = branch.to_susceptance + branch.susceptance / 2
            if not (susceptance or branch.to_conductance):
                continue
            self.lost.add(
                "charging at the second bus of transformers: a fixed shunt that stays when they trip",
                branch,
            )
            identifier = _free_id(taken[branch.to_bus])
            taken[branch.to_bus].add(identifier)
            powers = (branch.to_conductance, susceptance)
            active, reactive = (power * self.case.base_mva for power in powers)
            yield Shunt(branch.to_bus, identifier, active, reactive, branch.in_service)

    def _names(self, names: Mapping[int, str], what: str) -> Iterator[str]:
        for number, name in names.items():
            yield f"{number},{self.texts.name(name, f'{what} {number}')}"

    def _other_parts(self) -> None:
        """What the case has besides: a part that this writer does not know is told by its name."""
        for item in fields(self.case):
            if item.name not in _HELD and getattr(self.case, item.name):
                self.lost.add(_TOLD.get(item.name, item.name.replace("_", " ")))


def _alike(first: Any, second: Sequence[float]) -> bool:
    """Whether numbers are in the same proportions."""
    ratios = [a / b for a, b in zip(first, second, strict=True)]
    return bool(max(ratios) - min(ratios) <= _ROUNDING * max(ratios))


def _free_id(taken: Collection[str]) -> str:
    """The first of T1, T2 ... that is not taken."""
    return next(name for k in range(1, len(taken) + 2) if (name := f"T{k}") not in taken)
