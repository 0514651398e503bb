"""The data of a grid: plain records, no behaviour beyond look-up.

Power is in MW and Mvar, branch data in per unit on the system base, angles in degrees: as in the
files that planners exchange. Device parameters are per unit on the generator's own base.
"""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from enum import Enum
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gridfold.cards import Card
from gridfold.grid.dc_lines import DcLine
from gridfold.grid.doubts import Doubt
from gridfold.grid.energy_source import EnergySource
from gridfold.grid.flow_controls import FlowControl
from gridfold.grid.replacement import Replacement

if TYPE_CHECKING:
    import pandas as pd

    from gridfold.editing import CaseEditor

#: How the unit of a load's devices begins, before the id of the load.
LOAD_PREFIX = "load-"
_LATER = {"later": True}  # fields added since: part of the fingerprint only where not the default
_LABEL = {"label": True}  # fields that no simulation depends on: no part of the fingerprint


class UnitKey(NamedTuple):
    """A generating unit: bus number and machine id, written ``23:1``.

    A load with devices of its own is a unit too, ``23:load-1``.
    """

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
    owner: int = field(default=1, metadata=_LABEL)

    def __str__(self) -> str:
        return f"bus {self.number}"


@dataclass(frozen=True)
class Load:
    """A load: constant power, current and impedance in the power flow.

    The power drawn at voltage V (p.u.) is ``active_mw + current_active_mw V + impedance_active_mw
    V^2``, reactive power likewise. What it is in the dynamics is said when the model is built, or by
    device records whose id is ``load-`` and that of the load. `area`, `zone` and `owner` are its own;
    0 where nothing is said: they are then those of its bus.
    """

    bus: int
    id: str = "1"
    active_mw: float = 0.0
    reactive_mvar: float = 0.0
    in_service: bool = True
    current_active_mw: float = field(default=0.0, metadata=_LATER)
    current_reactive_mvar: float = field(default=0.0, metadata=_LATER)
    impedance_active_mw: float = field(default=0.0, metadata=_LATER)
    impedance_reactive_mvar: float = field(default=0.0, metadata=_LATER)
    area: int = field(default=0, metadata=_LATER)
    zone: int = field(default=0, metadata=_LATER)
    owner: int = field(default=0, metadata=_LATER)

    @property
    def key(self) -> UnitKey:
        """The unit that its devices belong to."""
        return UnitKey(self.bus, f"{LOAD_PREFIX}{self.id}")

    def power(self, voltage_pu: float) -> complex:
        """Active and reactive power drawn at a voltage, in MVA."""
        steady = complex(self.active_mw, self.reactive_mvar)
        current = complex(self.current_active_mw, self.current_reactive_mvar)
        impedance = complex(self.impedance_active_mw, self.impedance_reactive_mvar)
        return steady + current * voltage_pu + impedance * voltage_pu**2

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

    Reactors at the ends of a line and the magnetizing branch of a transformer are admittances to
    ground, in per unit on the system base, that stand at the buses and go out with the branch:
    ``from_conductance + j from_susceptance`` at `from_bus`, outside of the ideal transformer, and
    likewise at `to_bus`.

    Resistance and reactance 0 without ratio and shift: its two buses are one node while it is in
    service, as with a closed bus coupler (:mod:`gridfold.grid.nodes`).
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
    from_conductance: float = field(default=0.0, metadata=_LATER)
    from_susceptance: float = field(default=0.0, metadata=_LATER)
    to_conductance: float = field(default=0.0, metadata=_LATER)
    to_susceptance: float = field(default=0.0, metadata=_LATER)

    @property
    def joins(self) -> bool:
        """Whether it has no impedance: in service it makes one node of its two buses."""
        is_plain = self.ratio == 1 and self.shift_deg == 0
        return is_plain and self.resistance == 0 and self.reactance == 0

    def __str__(self) -> str:
        return f"branch {self.from_bus}-{self.to_bus}:{self.circuit}"


@dataclass(frozen=True)
class Generator:
    """A generating unit in the power flow.

    Where several units regulate one bus, each takes the part `share` / (sum of shares) of the
    bus's solved reactive power, and at the slack bus of its active power.

    `source_resistance` and `source_reactance` (PSS/E: ZSORCE, per unit on `base_mva`) are the
    impedance behind which planners' files put the machine; models that bring their own ignore it.
    `source` tells what drives the unit, where that is known; it plays a part where typical data stand
    for missing ones.
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
    source_resistance: float = field(default=0.0, metadata=_LATER)
    source_reactance: float = field(default=1.0, metadata=_LATER)
    source: EnergySource = field(default=EnergySource.UNKNOWN, metadata=_LATER)

    @property
    def key(self) -> UnitKey:
        """Bus number and id."""
        return UnitKey(self.bus, self.id)

    def __str__(self) -> str:
        return f"generator {self.key}"


@dataclass(frozen=True)
class DeviceRecord:
    """One dynamic device: the name of its model, the unit it belongs to, its parameters.

    The unit is a generator, or a load (:attr:`Load.key`).
    """

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


@dataclass(frozen=True, repr=False)
class Case(Card):
    """A grid: its network, its operating point and its dynamic devices.

    `origins` tells for a record's name (``str(record)``) the file and line it came from.
    `unsupported` has a line for every record of the network that could not be taken over, `notices`
    one for what was left out or changed without loss. `replacements` tells what became of dynamic data
    that are not there as in the file, `unplaced` which of them name a unit that the network does not
    have. `doubts` are about values that the file alone shows, `file_counts` tells how many records of
    each kind the file of the network holds, `left_out` which of its units are not in the case, such as
    those at isolated buses. `flow_controls` say how the operating point would move, which is stored.
    None of these has a part in comparisons.
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
    dc_lines: tuple[DcLine, ...] = ()
    flow_controls: tuple[FlowControl, ...] = field(default=(), compare=False, repr=False)
    zone_names: Mapping[int, str] = field(default_factory=dict)
    owner_names: Mapping[int, str] = field(default_factory=dict)
    origins: Mapping[str, str] = field(default_factory=dict, compare=False, repr=False)
    unsupported: tuple[str, ...] = field(default=(), compare=False)
    notices: tuple[str, ...] = field(default=(), compare=False)
    replacements: tuple[Replacement, ...] = field(default=(), compare=False)
    unplaced: tuple[str, ...] = field(default=(), compare=False)
    doubts: tuple[Doubt, ...] = field(default=(), compare=False)
    file_counts: Mapping[str, int] = field(default_factory=dict, compare=False, repr=False)
    left_out: frozenset[UnitKey] = field(default=frozenset(), compare=False, repr=False)

    def _facts(self) -> dict[str, object]:
        return {
            "case": self.name,
            "buses": len(self.buses),
            "branches": len(self.branches),
            "generators": len(self.generators),
            "loads": len(self.loads),
            "devices": len(self.devices),
            "base": f"{self.base_mva:g} MVA",
        }

    @cached_property
    def bus_index(self) -> dict[int, int]:
        """Position of each bus number in `buses`."""
        return {bus.number: position for position, bus in enumerate(self.buses)}

    @cached_property
    def unit_keys(self) -> tuple[UnitKey, ...]:
        """The unit of each generator."""
        return tuple(unit.key for unit in self.generators)

    @cached_property
    def load_keys(self) -> tuple[UnitKey, ...]:
        """The unit of each load."""
        return tuple(load.key for load in self.loads)

    @cached_property
    def device_keys(self) -> tuple[UnitKey, ...]:
        """The unit of each device record."""
        return tuple(record.key for record in self.devices)

    @cached_property
    def branch_names(self) -> tuple[str, ...]:
        """``FROM-TO`` of each branch, ``FROM-TO:CIRCUIT`` where several join the same buses."""
        parallel = Counter(frozenset((item.from_bus, item.to_bus)) for item in self.branches)
        return tuple(
            f"{item.from_bus}-{item.to_bus}"
            + (f":{item.circuit}" if parallel[frozenset((item.from_bus, item.to_bus))] > 1 else "")
            for item in self.branches
        )

    @cached_property
    def branch_ends(self) -> NDArray[np.int64]:
        """Positions of the buses at both ends of each branch, shape (n_branches, 2)."""
        index = self.bus_index
        ends = [(index[branch.from_bus], index[branch.to_bus]) for branch in self.branches]
        return np.array(ends, dtype=np.int64).reshape(-1, 2)

    @cached_property
    def motors_with_trips(self) -> tuple[DeviceRecord, ...]:
        """Records of motors in service that ask for a trip where the voltage stays low."""
        asking = [
            record
            for record in self.devices
            if record.parameters.get("trip_voltage", 0.0) > 0
            and record.parameters.get("trip_cycles", 0.0) > 0
        ]
        live = {load.key for load in self.loads if load.in_service} if asking else set()
        return tuple(record for record in asking if record.key in live)

    @cached_property
    def branches_out(self) -> frozenset[int]:
        """Positions of the branches that are out of service."""
        return frozenset(k for k, branch in enumerate(self.branches) if not branch.in_service)

    @cached_property
    def fingerprint(self) -> str:
        """SHA-256 of all data that a simulation depends on, in hexadecimal.

        Whether devices are listed by unit or by model makes no difference.
        """
        digest = hashlib.sha256()
        for table in (self.buses, self.branches, self.generators, self.loads, self.shunts):
            for record in table:
                digest.update(_print(record).encode())
        for device in sorted(self.devices, key=lambda device: device.model):
            parameters = sorted(device.parameters.items())
            digest.update(repr((device.model, device.key, parameters)).encode())
        digest.update(repr((self.base_mva, self.frequency_hz)).encode())
        for line in self.dc_lines:
            digest.update(repr(line).encode())
        return digest.hexdigest()

    def stored_power(self, load: Load) -> complex:
        """What a load draws at the stored voltage of its bus, in MVA."""
        return load.power(self.buses[self.bus_index[load.bus]].voltage_pu)

    def frame(self, table: str) -> pd.DataFrame:
        """A table of the case to look at.

        Parameters
        ----------
        table : str
            ``"buses"``, ``"branches"``, ``"generators"``, ``"loads"`` or ``"shunts"``; ``"devices"``, a
            row for each parameter; or a device model such as ``"GENROU"``, a row for each unit.

        Returns
        -------
        pandas.DataFrame
            Its columns are named as in :meth:`edit`; ``attrs["units"]`` holds their units.

        Raises
        ------
        OptionError
            There is no such table.
        """
        from gridfold.editing import case_frame

        return case_frame(self, table)

    def edit(self, devices: Any = None) -> CaseEditor:
        """Begin to edit: ``case.edit().scale_load(1.1, areas=1).set("GENROU 101:1 H=4").case()``.

        Parameters
        ----------
        devices : Device, iterable of Device, or mapping, optional
            Device models of your own that edits name, as for :func:`gridfold.load_case`.

        Returns
        -------
        CaseEditor
            Its :meth:`~gridfold.CaseEditor.case` gives the changed case.
        """
        from gridfold.editing import edit_case

        return edit_case(self, () if devices is None else devices)

    def save(self, path: str | Path, *, overwrite: bool = False) -> None:
        """Write the case: a folder of tables, or files of PSS/E.

        Parameters
        ----------
        path : str or Path
            ``NAME.raw`` is written as RAW of revision 33, with the dynamic data beside it in
            ``NAME.dyr``; ``NAME.dyr`` as these alone; any other name as a folder of tables.
        overwrite : bool
            Replace what is there.

        Raises
        ------
        OutputError
            It is there already, or cannot be written.

        Warns
        -----
        SaveWarning
            The files cannot hold all of the case; the text lists what.
        """
        from gridfold.editing import save_case

        save_case(self, path, overwrite=overwrite)

    def locate(self, record: Record | DcLine) -> str:
        """Name of `record`, with the file and line it came from where that is known."""
        origin = self.origins.get(str(record))
        return f"{record} ({origin})" if origin else str(record)


def _print(record: Record) -> str:
    """``repr(record)`` without labels and without later fields at their default.

    Old fingerprints stay valid.
    """
    values = ((item, getattr(record, item.name)) for item in fields(record))
    kept = ((f, v) for f, v in values if "label" not in f.metadata)
    shown = (f"{f.name}={v!r}" for f, v in kept if not (f.metadata and v == f.default))
    return f"{type(record).__name__}({', '.join(shown)})"


def number_fields(record: Record) -> dict[str, float]:
    """The numeric fields of a record that are present, by name."""
    values = {f.name: getattr(record, f.name) for f in fields(record)}
    return {
        name: value
        for name, value in values.items()
        if isinstance(value, int | float) and not isinstance(value, bool)
    }
