"""Where everything stands: device blocks, the state vector and the signal vector.

The signal vector holds all that devices exchange: the states, constants for inputs that no device
provides, the algebraic outputs of each block, and the terminal voltages (real parts, then imaginary).
All names are resolved to positions here, none while stepping.
"""

from __future__ import annotations

from collections.abc import Collection, Container, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gridfold.dynamics.device import Device, taken
from gridfold.errors import CaseError
from gridfold.grid.case import UnitKey

_VOLTAGE_INPUTS = ("voltage_real", "voltage_imag")
#: Ends the name of a signal that a device of the unit takes and gives on.
BEFORE = "_before"
#: States that turn as the whole system does: of a rotor, and of the voltage that a converter follows.
ROTOR_ANGLE, VOLTAGE_ANGLE = "rotor_angle", "voltage_angle"


@dataclass(frozen=True)
class Block:
    """All units of one device model.

    Parameters
    ----------
    device : Device
        The model.
    units : tuple of UnitKey
        Units, in the order of the columns of all its matrices.
    parameters : ndarray, shape (n_parameter_rows, n_units)
        Parameters on the system base, then set points (NaN until the start), then base speed.
    state_start, signal_start : int
        Position of its states in the state vector, of its outputs in the signal vector.
    inputs : ndarray of int, shape (n_inputs, n_units)
        Position in the signal vector of each input.
    """

    device: Device
    units: tuple[UnitKey, ...]
    parameters: NDArray[np.float64]
    state_start: int
    signal_start: int
    inputs: NDArray[np.int64]

    @property
    def state_index(self) -> NDArray[np.int64]:
        """Positions of its states, shape (n_states, n_units)."""
        return self._index(self.state_start, len(self.device.states))

    @property
    def signal_index(self) -> NDArray[np.int64]:
        """Positions of its outputs, shape (n_outputs, n_units)."""
        return self._index(self.signal_start, len(self.device.signal_rows))

    def _index(self, start: int, rows: int) -> NDArray[np.int64]:
        return start + np.arange(rows * len(self.units)).reshape(rows, len(self.units))


@dataclass(frozen=True)
class Layout:
    """Blocks in order of evaluation and the positions of all signals.

    `constant_names` are the units and inputs that no device provides; `terminals` are the bus numbers
    at which machines and devices of loads stand; `sources` are for each of these `source_units`:
    position of the real and the imaginary part of its Norton current, and its terminal; `relayed` are
    signals of units that a device of the unit takes and gives on.
    """

    blocks: tuple[Block, ...]
    n_states: int
    n_signals: int
    constant_names: tuple[tuple[UnitKey, str], ...]
    terminals: tuple[int, ...]
    sources: NDArray[np.int64]
    source_units: tuple[UnitKey, ...]
    signal_slots: Mapping[tuple[UnitKey, str], int] = field(repr=False)
    state_names: tuple[str, ...] = field(repr=False)
    relayed: frozenset[tuple[UnitKey, str]] = frozenset()

    def holds(self, groups: Sequence[Group]) -> bool:
        """Whether these are the units that it has."""
        units = {device.model: tuple(units) for device, units, _ in groups}
        return units == {block.device.model: block.units for block in self.blocks}

    def has_places_of(self, other: Layout) -> bool:
        """Whether all stands where it stands in the other one, whatever the parameters are."""
        if self is other:
            return True
        if self.signal_slots is not other.signal_slots and (
            self.signal_slots != other.signal_slots
            or self.constant_names != other.constant_names
            or self.terminals != other.terminals
            or self.source_units != other.source_units
        ):
            return False
        pairs = zip(self.blocks, other.blocks, strict=False)
        return len(self.blocks) == len(other.blocks) and all(
            here.device is there.device
            and (here.inputs is there.inputs or np.array_equal(here.inputs, there.inputs))
            for here, there in pairs
        )

    def with_parameters(self, groups: Sequence[Group]) -> Layout:
        """The same places of the same units with the parameters of `groups`, which are in any order."""
        rows = {device.model: parameters for device, _, parameters in groups}
        blocks = (replace(block, parameters=rows[block.device.model]) for block in self.blocks)
        return replace(self, blocks=tuple(blocks))

    @cached_property
    def speed_states(self) -> dict[UnitKey, int]:
        """Position of the speed of each unit whose speed is a state."""
        return {
            unit: slot
            for (unit, name), slot in self.signal_slots.items()
            if name == "speed" and slot < self.n_states
        }

    def angle_states(self, units_out: Collection[UnitKey] = ()) -> NDArray[np.int64]:
        """Positions of the states that turn as the whole system does, of all units in service."""
        return turning_states(self.state_names, (ROTOR_ANGLE, VOLTAGE_ANGLE), units_out)

    @property
    def constant_start(self) -> int:
        """Position of the constants in the signal vector."""
        return self.n_states

    @property
    def voltage_start(self) -> int:
        """Position of the terminal voltages in the signal vector."""
        return self.n_signals - 2 * len(self.terminals)

    @property
    def voltage_slots(self) -> NDArray[np.int64]:
        """Positions of the terminal voltages in the signal vector, real parts first."""
        return np.arange(self.voltage_start, self.n_signals)


def turning_states(
    state_names: Sequence[str], kinds: Sequence[str], units_out: Collection[UnitKey] = ()
) -> NDArray[np.int64]:
    """Positions of the states of some `kinds` of angle among `state_names`, of units in service."""
    out = {str(unit) for unit in units_out}
    parted = (name.partition(":") for name in state_names)
    found = [k for k, (name, _, unit) in enumerate(parted) if name in kinds and unit not in out]
    return np.array(found, dtype=np.int64)


def infinite_buses(layout: Layout) -> dict[UnitKey, float]:
    """Angle in rad of each source without states."""
    angles: dict[UnitKey, float] = {}
    for block in layout.blocks:
        if block.device.sources and not block.device.states:
            rows = dict(zip(block.device.parameter_rows, block.parameters, strict=True))
            angle = np.arctan2(rows["internal_imag"], rows["internal_real"])
            angles |= dict(zip(block.units, angle.tolist(), strict=True))
    return angles


def frame_states(
    state_names: Sequence[str], units_out: Collection[UnitKey] = ()
) -> NDArray[np.int64]:
    """Positions of the angles that tell how far all have turned: of rotors, else of converters."""
    rotors = turning_states(state_names, (ROTOR_ANGLE,), units_out)
    return rotors if len(rotors) else turning_states(state_names, (VOLTAGE_ANGLE,), units_out)


Group = tuple[Device, Sequence[UnitKey], NDArray[np.float64]]


def build_layout(
    groups: Sequence[Group],
    ports: Sequence[int] = (),
    given: Collection[tuple[UnitKey, str]] = (),
) -> Layout:
    """Lay out groups of (device, units, parameter rows); roles are put into order of evaluation.

    `ports` are buses whose voltages are wanted beside those of the machines' terminals; `given` are
    inputs that come from elsewhere and have the place of a constant.
    """
    ordered = sorted(groups, key=lambda group: group[0].role)
    slots: dict[tuple[UnitKey, str], int] = {}
    providers: dict[tuple[UnitKey, str], str] = {}
    faults: list[str] = []
    relayed = _relayed(ordered)

    def place(device: Device, units: Sequence[UnitKey], rows: Sequence[str], start: int) -> int:
        for row, name in enumerate(rows):
            for column, unit in enumerate(units):
                key = given_as(device, unit, name, relayed)
                other = providers.setdefault(key, device.model)
                if other != device.model:
                    faults.append(f"unit {unit}: both {other} and {device.model} give {name}")
                slots[key] = start + row * len(units) + column
        return start + len(rows) * len(units)

    state_starts, signal_starts = [], []
    position = 0
    for device, units, _ in ordered:
        state_starts.append(position)
        position = place(device, units, device.states, position)
    n_states = position
    constants = _open_inputs(ordered, slots, faults, given, relayed)
    for name in constants:
        slots[name] = position
        position += 1
    for device, units, _ in ordered:
        signal_starts.append(position)
        position = place(device, units, device.signal_rows, position)
    terminals, terminal_of = _terminals(ordered, ports)
    for unit, terminal in terminal_of.items():
        slots[unit, "voltage_real"] = position + terminal
        slots[unit, "voltage_imag"] = position + len(terminals) + terminal
    if faults:
        raise CaseError(faults, "dynamic devices")
    blocks = tuple(
        Block(device, tuple(units), parameters, states, signals, _inputs(device, units, slots))
        for (device, units, parameters), states, signals in zip(
            ordered, state_starts, signal_starts, strict=True
        )
    )
    sources = [
        (slots[unit, device.sources[0]], slots[unit, device.sources[1]], terminal_of[unit])
        for device, units, _ in ordered
        if device.injects
        for unit in units
    ]
    return Layout(
        blocks=blocks,
        n_states=n_states,
        n_signals=position + 2 * len(terminals),
        constant_names=tuple(constants),
        terminals=terminals,
        sources=np.array(sources, dtype=np.int64).reshape(-1, 3),
        source_units=tuple(terminal_of),
        signal_slots=slots,
        state_names=tuple(_state_names(blocks)),
        relayed=relayed,
    )


def _relayed(groups: Sequence[Group]) -> frozenset[tuple[UnitKey, str]]:
    """Signals of units that a device of the unit takes and gives on."""
    return frozenset(
        (unit, name)
        for device, units, _ in groups
        for name in device.signal_rows
        if name + BEFORE in device.inputs
        for unit in units
    )


def given_as(
    device: Device, unit: UnitKey, name: str, relayed: Collection[tuple[UnitKey, str]]
) -> tuple[UnitKey, str]:
    """What a signal that `device` gives is called in its unit."""
    before = (unit, name) in relayed and name + BEFORE not in device.inputs
    return unit, name + BEFORE if before else name


def _open_inputs(
    groups: Sequence[Group],
    slots: Mapping[tuple[UnitKey, str], int],
    faults: list[str],
    given: Collection[tuple[UnitKey, str]],
    relayed: Collection[tuple[UnitKey, str]],
) -> list[tuple[UnitKey, str]]:
    """Inputs that no device of the unit provides; those that nothing can stand for are faults."""
    provided = set(slots)
    for device, units, _ in groups:
        provided |= {
            given_as(device, unit, name, relayed) for unit in units for name in device.signal_rows
        }
    open_inputs: dict[tuple[UnitKey, str], None] = {}
    for device, units, _ in groups:
        for unit in units:
            for name in device.inputs:
                is_voltage = device.injects and name in _VOLTAGE_INPUTS
                signal = _taken(device, unit, name, provided)
                if is_voltage or (unit, signal) in provided:
                    continue
                known = (unit, name) in given or name in device.solved_inputs
                if not known and name not in device.defaults:
                    faults.append(f"{device.model} {unit}: no device of the unit gives its {name}")
                open_inputs[unit, signal] = None
    return list(open_inputs)


def _terminals(
    groups: Sequence[Group], ports: Sequence[int]
) -> tuple[tuple[int, ...], dict[UnitKey, int]]:
    """Bus numbers with sources, then ports, and the position of each source's bus among them."""
    units = [u for device, us, _ in groups if device.injects for u in us]
    terminals = tuple(dict.fromkeys([*(unit.bus for unit in units), *ports]))
    place = {bus: position for position, bus in enumerate(terminals)}
    return terminals, {unit: place[unit.bus] for unit in units}


def _inputs(
    device: Device, units: Sequence[UnitKey], slots: Mapping[tuple[UnitKey, str], int]
) -> NDArray[np.int64]:
    index = [
        [slots.get((unit, _taken(device, unit, name, slots)), -1) for unit in units]
        for name in device.inputs
    ]
    return np.array(index, dtype=np.int64).reshape(len(device.inputs), len(units))


def _taken(device: Device, unit: UnitKey, name: str, given: Container[tuple[UnitKey, str]]) -> str:
    return taken(device, name, lambda signal: (unit, signal) in given)


def _state_names(blocks: Sequence[Block]) -> Iterator[str]:
    for block in blocks:
        for name in block.device.states:
            for unit in block.units:
                yield f"{name}:{unit}"
