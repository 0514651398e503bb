"""The data of a grid: plain records, no behaviour beyond look-up.

Power is in MW and Mvar, branch data in per unit on the system base, angles in degrees: as in the
files that planners exchange. Device parameters are per unit on the generator's own base.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from enum import Enum
from functools import cached_property
from typing import NamedTuple


class UnitKey(NamedTuple):
    """A generating unit: bus number and machine id, written ``23:1``."""

    bus: int
    id: str

    def __str__(self) -> str:
        return f"{self.bus}:{self.id}"


class Control(Enum):
    """What a generator holds in the power flow."""

    SLACK = "slack"
    VOLTAGE = "voltage"
    POWER = "power"


@dataclass(frozen=True)
class Bus:
    """A bus; `voltage_pu` and `angle_deg` are the stored solution, a start for the power flow."""

    number: int
    name: str = ""
    base_kv: float = 1.0
    area: int = 1
    zone: int = 1
    voltage_pu: float = 1.0
    angle_deg: float = 0.0
    latitude: float | None = None
    longitude: float | None = None

    def __str__(self) -> str:
        return f"bus {self.number}"


@dataclass(frozen=True)
class Load:
    """A load of constant power in the power flow, constant impedance in the dynamics."""

    bus: int
    id: str = "1"
    active_mw: float = 0.0
    reactive_mvar: float = 0.0
    in_service: bool = True

    def __str__(self) -> str:
        return f"load {self.bus}:{self.id}"


@dataclass(frozen=True)
class Shunt:
    """A fixed shunt: power drawn (MW) and generated (Mvar) at 1 p.u. voltage."""

    bus: int
    id: str = "1"
    conductance_mw: float = 0.0
    susceptance_mvar: float = 0.0
    in_service: bool = True

    def __str__(self) -> str:
        return f"shunt {self.bus}:{self.id}"


@dataclass(frozen=True)
class Branch:
    """A line or transformer as a pi section behind an ideal transformer at its first bus.

    `ratio` is the off-nominal turns ratio at `from_bus`, `shift_deg` its phase shift.
    """

    from_bus: int
    to_bus: int
    circuit: str = "1"
    resistance: float = 0.0
    reactance: float = 0.0
    susceptance: float = 0.0
    ratio: float = 1.0
    shift_deg: float = 0.0
    in_service: bool = True

    def __str__(self) -> str:
        return f"branch {self.from_bus}-{self.to_bus}:{self.circuit}"


@dataclass(frozen=True)
class Generator:
    """A generating unit in the power flow.

    Where several units regulate one bus, each takes the part `share` / (sum of shares) of the
    bus's solved reactive power, and at the slack bus of its active power.
    """

    bus: int
    id: str = "1"
    active_mw: float = 0.0
    reactive_mvar: float = 0.0
    voltage_pu: float = 1.0
    base_mva: float = 100.0
    control: Control = Control.VOLTAGE
    share: float = 1.0
    in_service: bool = True

    @property
    def key(self) -> UnitKey:
        """Bus number and id."""
        return UnitKey(self.bus, self.id)

    def __str__(self) -> str:
        return f"generator {self.key}"


@dataclass(frozen=True)
class DeviceRecord:
    """One dynamic device: the name of its model, the unit it belongs to, its parameters."""

    model: str
    bus: int
    id: str
    parameters: Mapping[str, float] = field(default_factory=dict)

    @property
    def key(self) -> UnitKey:
        """Bus number and id of the unit."""
        return UnitKey(self.bus, self.id)

    def __str__(self) -> str:
        return f"{self.model} {self.key}"


Record = Bus | Load | Shunt | Branch | Generator | DeviceRecord


@dataclass(frozen=True)
class Case:
    """A grid: its network, its operating point and its dynamic devices.

    `origins` tells for a record's name (``str(record)``) the file and line it came from; it has no
    part in comparisons.
    """

    name: str
    buses: tuple[Bus, ...]
    branches: tuple[Branch, ...]
    generators: tuple[Generator, ...]
    loads: tuple[Load, ...] = ()
    shunts: tuple[Shunt, ...] = ()
    devices: tuple[DeviceRecord, ...] = ()
    base_mva: float = 100.0
    frequency_hz: float = 60.0
    description: str = ""
    area_names: Mapping[int, str] = field(default_factory=dict)
    origins: Mapping[str, str] = field(default_factory=dict, compare=False, repr=False)

    @cached_property
    def bus_index(self) -> dict[int, int]:
        """Position of each bus number in `buses`."""
        return {bus.number: position for position, bus in enumerate(self.buses)}

    @cached_property
    def branches_out(self) -> frozenset[int]:
        """Positions of the branches that are out of service."""
        return frozenset(k for k, branch in enumerate(self.branches) if not branch.in_service)

    @cached_property
    def fingerprint(self) -> str:
        """SHA-256 of all data that a simulation depends on, in hexadecimal."""
        digest = hashlib.sha256()
        for table in (self.buses, self.branches, self.generators, self.loads, self.shunts):
            for record in table:
                digest.update(repr(record).encode())
        for device in self.devices:
            parameters = sorted(device.parameters.items())
            digest.update(repr((device.model, device.key, parameters)).encode())
        digest.update(repr((self.base_mva, self.frequency_hz)).encode())
        return digest.hexdigest()

    def locate(self, record: Record) -> str:
        """Name of `record`, with the file and line it came from where that is known."""
        origin = self.origins.get(str(record))
        return f"{record} ({origin})" if origin else str(record)


def number_fields(record: Record) -> dict[str, float]:
    """The numeric fields of a record that are present, by name."""
    values = {f.name: getattr(record, f.name) for f in fields(record)}
    return {
        name: value
        for name, value in values.items()
        if isinstance(value, int | float) and not isinstance(value, bool)
    }
