"""What the data of a network usually are: a table of ranges, and the doubts about a case.

The ranges are wide enough for grids of all voltages from the public cases, and narrow enough for slips
of a factor of ten or of a sign in what matters most. A value outside of them may be right.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from math import inf
from typing import Any

from gridfold.grid.case import Branch, Bus, Case, Control, Generator, Load, Shunt
from gridfold.grid.doubts import Doubt, Usual, doubt_of

#: Active power of a unit up to which its base may be its rating, in parts of the base.
OVERLOAD = 1.25
#: Base voltage (kV) from which series impedances are looked at: in per unit those of low voltage are
#: large. Where no base voltage is given they are looked at too.
_TRANSMISSION_KV = 60.0
#: Reactance (p.u.) from which resistance and reactance are compared: short links are of any kind.
_SHORT = 1e-3


@dataclass(frozen=True)
class NetworkRow:
    """A row of the table: `value` gives what is looked at in a record of a case, None for nothing."""

    usual: Usual
    record: type
    value: Callable[[Any, Case], float | None]


def network_doubts(case: Case) -> Iterator[Doubt]:
    """Doubts about the network of a case: buses, branches, and what is in service at the buses."""
    yield from _doubts(case, case, "the case", "")
    for table in (case.buses, case.branches, case.generators, case.loads, case.shunts):
        for record in table:
            if isinstance(record, Bus | Branch) or record.in_service:
                yield from _doubts(record, case, str(record), case.origins.get(str(record), ""))


def _doubts(record: Any, case: Case, name: str, origin: str) -> Iterator[Doubt]:
    return doubt_of(name, origin, _unusual(record, case))


def _unusual(record: Any, case: Case) -> Iterator[tuple[str, str]]:
    for row in NETWORK_ROWS:
        if isinstance(record, row.record):
            value = row.value(record, case)
            if value is not None and not row.usual.holds(value):
                yield row.usual.name, row.usual.doubt(value)


def _set_point(unit: Generator, case: Case) -> float | None:
    """Voltage set point where it is not the stored voltage of the bus, which is looked at itself."""
    stored = case.buses[case.bus_index[unit.bus]].voltage_pu
    return None if unit.control is Control.POWER or unit.voltage_pu == stored else unit.voltage_pu


def _loading(unit: Generator, case: Case) -> float | None:
    """Power in parts of the unit's base; None where that is the base of the system, so no rating.

    What slack units give is not stored, but solved.
    """
    if unit.base_mva == case.base_mva or unit.control is Control.SLACK:
        return None
    return abs(unit.active_mw) / unit.base_mva


def _is_transmission(branch: Branch, case: Case) -> bool:
    ends = (case.buses[case.bus_index[number]] for number in (branch.from_bus, branch.to_bus))
    return all(bus.base_kv >= _TRANSMISSION_KV or bus.base_kv == Bus.base_kv for bus in ends)


def _impedance(branch: Branch, case: Case) -> float | None:
    """Impedance on 100 MVA of what is no line at a known voltage."""
    if _ohms(branch, case) is not None or not _is_transmission(branch, case):
        return None
    return abs(complex(branch.resistance, branch.reactance)) * 100 / case.base_mva


def _ohms(branch: Branch, case: Case) -> float | None:
    """Impedance in ohms between two buses of one base voltage that is given."""
    kv, other = (case.buses[case.bus_index[n]].base_kv for n in (branch.from_bus, branch.to_bus))
    if kv != other or kv == Bus.base_kv:
        return None
    return abs(complex(branch.resistance, branch.reactance)) * kv**2 / case.base_mva


def _resistance_ratio(branch: Branch, case: Case) -> float | None:
    if abs(branch.resistance) < _SHORT or not _is_transmission(branch, case):
        return None
    return branch.resistance / abs(branch.reactance) if branch.reactance else inf


def _negative_reactance(branch: Branch, case: Case) -> float | None:
    """Reactance of a branch with losses: series capacitors and legs of stars have next to none."""
    return branch.reactance if branch.resistance > abs(branch.reactance) / 100 else None


NETWORK_ROWS = (
    NetworkRow(
        Usual("case.frequency", "base frequency", ((50, 50), (60, 60)), "Hz", "public grids"),
        Case,
        lambda case, _: case.frequency_hz,
    ),
    NetworkRow(
        Usual("case.base", "base power", ((1, 10_000),), "MVA", "100 MVA is the custom"),
        Case,
        lambda case, _: case.base_mva,
    ),
    NetworkRow(
        Usual("bus.base_kv", "base voltage", ((0.1, 1200),), "kV", "the highest in use is 1150 kV"),
        Bus,
        lambda bus, _: bus.base_kv,
    ),
    NetworkRow(
        Usual(
            "bus.voltage", "stored voltage", ((0.8, 1.2),), "p.u.", "limits of operation, widened"
        ),
        Bus,
        lambda bus, _: bus.voltage_pu,
    ),
    NetworkRow(
        Usual(
            "branch.impedance",
            "impedance",
            ((0, 3),),
            "p.u. on 100 MVA",
            "a transformer of 5 MVA",
        ),
        Branch,
        _impedance,
    ),
    NetworkRow(
        Usual("branch.ohms", "impedance", ((0, 500),), "ohm", "a line of 1500 km"),
        Branch,
        _ohms,
    ),
    NetworkRow(
        Usual("branch.r_over_x", "R/X", ((0, 3),), "", "Kundur 1994, table 6.1: below 0.3"),
        Branch,
        _resistance_ratio,
    ),
    NetworkRow(
        Usual(
            "branch.reactance",
            "reactance beside a resistance",
            ((0, inf),),
            "p.u.",
            "lines are inductive; series capacitors have no resistance",
        ),
        Branch,
        _negative_reactance,
    ),
    NetworkRow(
        Usual(
            "branch.charging",
            "charging susceptance",
            ((-0.05, inf),),
            "p.u.",
            "it is positive, but for reactors lumped into a line",
        ),
        Branch,
        lambda branch, _: branch.susceptance,
    ),
    NetworkRow(
        Usual(
            "branch.length",
            "X B, the square of the electrical length,",
            ((-inf, 1),),
            "",
            "1 rad is 800 km at 60 Hz, too long for a pi section; Kundur 1994, section 6.1",
        ),
        Branch,
        lambda branch, _: branch.reactance * branch.susceptance,
    ),
    NetworkRow(
        Usual("branch.ratio", "turns ratio", ((0.8, 1.25),), "", "taps reach 0.85 to 1.15"),
        Branch,
        lambda branch, _: branch.ratio,
    ),
    NetworkRow(
        Usual("branch.shift", "phase shift", ((-180, 180),), "deg", "a vector group, or a shifter"),
        Branch,
        lambda branch, _: branch.shift_deg,
    ),
    NetworkRow(
        Usual("generator.base", "base power", ((0.05, 20_000),), "MVA", "one unit, or a region"),
        Generator,
        lambda unit, _: unit.base_mva,
    ),
    NetworkRow(
        Usual(
            "generator.loading",
            "active power / base",
            ((0, OVERLOAD),),
            "",
            "the base is the rating; not looked at where it is the base of the system",
        ),
        Generator,
        _loading,
    ),
    NetworkRow(
        Usual("generator.voltage", "voltage set point", ((0.8, 1.2),), "p.u.", "as for buses"),
        Generator,
        _set_point,
    ),
    NetworkRow(
        Usual("load.power", "power at 1 p.u.", ((0, 10_000),), "MVA", "one load, or a region"),
        Load,
        lambda load, _: abs(load.power(1.0)),
    ),
    NetworkRow(
        Usual("shunt.power", "power at 1 p.u.", ((0, 3000),), "MVA", "a station at 765 kV"),
        Shunt,
        lambda shunt, _: abs(complex(shunt.conductance_mw, shunt.susceptance_mvar)),
    ),
)
