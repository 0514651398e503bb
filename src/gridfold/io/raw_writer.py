"""Write the network of a case as a RAW file of PSS/E, revision 33.

Numbers are written so that they are read back as they are. A branch with a ratio, a shift, or between
two voltage levels is a transformer, in per unit of its buses (CW, CZ, CM = 1). Layouts are those of the
PSS/E Program Operation Manual, chapter on the power flow raw data file; ratings of branches and limits
of active power are no part of a case, and stand at the manual's defaults.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import fields

from gridfold.grid.case import Branch, Bus, Case, Load, Shunt
from gridfold.grid.dc_lines import ThyristorLine, TransistorLine
from gridfold.grid.flow_controls import ShuntControl, ShuntMode
from gridfold.io.lost import Lost
from gridfold.io.raw_dc_writer import thyristor_lines, transistor_lines
from gridfold.io.raw_text import Texts, flag, real, reals, title
from gridfold.io.raw_unit_writer import Units

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
#: Id of the switched shunt of a bus, as it is called when it is read.
_SWITCHED = "S1"
_SHUNT_MODES = {ShuntMode.LOCKED: 0, ShuntMode.DISCRETE: 1, ShuntMode.CONTINUOUS: 2}
#: Parts of a case that a RAW file holds, or that no result depends on.
_HELD = {
    *("name", "description", "base_mva", "frequency_hz", "area_names", "zone_names", "owner_names"),
    *("buses", "branches", "generators", "loads", "shunts", "devices", "dc_lines", "flow_controls"),
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


class _Writer:
    def __init__(self, case: Case):
        self.case, self.lost = case, Lost()
        self.texts, self.units = Texts(self.lost), Units(case, self.lost)
        controls = (item for item in case.flow_controls if isinstance(item, ShuntControl))
        self.controls = {(item.bus, item.id): item for item in controls}

    def write(self) -> tuple[str, tuple[str, ...]]:
        case, sections = self.case, self._sections()
        text = [f"0,{real(case.base_mva)},33,0,0,{real(case.frequency_hz)}"]
        text += [title(case.name), title(case.description)]
        for section, following in zip(_SECTIONS, (*_SECTIONS[1:], ""), strict=True):
            begin = f", BEGIN {following} DATA" if following else ""
            text += [*sections.get(section, ()), f"0 / END OF {section} DATA{begin}"]
        for item in fields(case):
            if item.name not in _HELD and getattr(case, item.name):
                self.lost.add(_TOLD.get(item.name, item.name.replace("_", " ")))
        return "\n".join([*text, "Q", ""]), self.lost.lines

    def _sections(self) -> Mapping[str, Iterator[str]]:
        case = self.case
        lines = [branch for branch in case.branches if not self._is_transformer(branch)]
        transformers = [branch for branch in case.branches if self._is_transformer(branch)]
        switched = [shunt for shunt in case.shunts if self._is_switched(shunt)]
        fixed = [shunt for shunt in case.shunts if shunt not in switched]
        fixed += self._charging(transformers)
        two_terminal = (line for line in case.dc_lines if isinstance(line, ThyristorLine))
        vsc = (line for line in case.dc_lines if isinstance(line, TransistorLine))
        areas = self._names(case.area_names, "area")
        return {
            "BUS": (self._bus(bus) for bus in case.buses),
            "LOAD": (self._load(load) for load in case.loads),
            "FIXED SHUNT": (self._fixed(shunt) for shunt in fixed),
            "GENERATOR": (line for bus in case.buses for line in self.units.lines(bus.number)),
            "BRANCH": (self._line(branch) for branch in lines),
            "TRANSFORMER": (line for branch in transformers for line in self._transformer(branch)),
            "AREA": (f"{number},0,0.0,10.0,{name}" for number, name in areas),
            "TWO-TERMINAL DC": (
                text for line in two_terminal for text in thyristor_lines(line, self.texts)
            ),
            "VSC DC LINE": (text for line in vsc for text in transistor_lines(line, self.texts)),
            "ZONE": (f"{number},{name}" for number, name in self._names(case.zone_names, "zone")),
            "OWNER": (
                f"{number},{name}" for number, name in self._names(case.owner_names, "owner")
            ),
            "SWITCHED SHUNT": (self._switched(shunt) for shunt in switched),
        }

    # Records.

    def _bus(self, bus: Bus) -> str:
        if bus.latitude is not None or bus.longitude is not None:
            self.lost.add("latitude and longitude", bus)
        head = f"{bus.number},{self.texts.name(bus.name, bus)},{real(bus.base_kv)}"
        head += f",{self.units.bus_type(bus.number)}"
        place = f"{bus.area},{bus.zone},{bus.owner}"
        return f"{head},{place},{reals(self.units.voltage(bus), bus.angle_deg)}"

    def _load(self, load: Load) -> str:
        powers = (
            load.active_mw,
            load.reactive_mvar,
            load.current_active_mw,
            load.current_reactive_mvar,
            load.impedance_active_mw,
            -load.impedance_reactive_mvar or 0.0,
        )
        area, zone, owner = (str(own or "") for own in (load.area, load.zone, load.owner))
        head = f"{load.bus},{self.texts.identifier(load.id, load)},{flag(load)}"
        return f"{head},{area},{zone},{reals(*powers)},{owner},1,0"

    def _fixed(self, shunt: Shunt) -> str:
        if (shunt.bus, shunt.id) in self.controls:
            self.lost.add("switched shunts that are several at a bus: fixed ones", shunt)
        values = reals(shunt.conductance_mw, shunt.susceptance_mvar)
        return f"{shunt.bus},{self.texts.identifier(shunt.id, shunt)},{flag(shunt)},{values}"

    def _is_switched(self, shunt: Shunt) -> bool:
        """Whether it is the switched shunt of its bus, as it is called when it is read."""
        control = self.controls.get((shunt.bus, shunt.id))
        return control is not None and shunt.id == _SWITCHED and not shunt.conductance_mw

    def _switched(self, shunt: Shunt) -> str:
        control = self.controls[shunt.bus, shunt.id]
        if control.mode is ShuntMode.OTHER:
            self.lost.add("what switched shunts follow, other than voltages: locked ones", shunt)
        remote = 0 if control.regulated_bus == shunt.bus else control.regulated_bus
        band = reals(control.voltage_max_pu, control.voltage_min_pu)
        blocks = [f"{steps},{real(mvar)}" for steps, mvar in control.blocks]
        head = f"{shunt.bus},{_SHUNT_MODES.get(control.mode, 0)},0,{flag(shunt)},{band},{remote}"
        return ",".join([head, f"100.0,'',{real(shunt.susceptance_mvar)}", *blocks])

    def _is_transformer(self, branch: Branch) -> bool:
        if branch.joins:
            return False
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

    def _names(self, names: Mapping[int, str], what: str) -> Iterator[tuple[int, str]]:
        return (
            (number, self.texts.name(name, f"{what} {number}")) for number, name in names.items()
        )


def _free_id(taken: Collection[str]) -> str:
    """The first of T1, T2 ... that is not taken."""
    return next(name for k in range(1, len(taken) + 2) if (name := f"T{k}") not in taken)
