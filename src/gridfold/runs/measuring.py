"""What relays measure along the states of a run.

The frequency of a bus is that of its voltage phasor V, which turns in the synchronous frame:

    f = f0 (1 + Im(V* dV/dt) / |V|^2 / w0),

with dV/dt in the direction of dx/dt = f(x), by a central difference. It has no filter and no window.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from gridfold.dynamics.model import DetailedModel
from gridfold.grid.branch_port import state_port
from gridfold.grid.event_checks import branches_at
from gridfold.grid.measurements import Blinders, Frequency, Level, Measurement, Mho
from gridfold.simulation.segment import Coordinates
from gridfold.systems.protocol import System

#: Voltage in p.u. below which a bus has no frequency, as of relays that block there.
NO_FREQUENCY = 0.5
#: Voltage in p.u. below which a mho relay goes by the voltage that it remembers.
MEMORY = 0.05
#: Margin of what is not measured: a dead bus, an open branch.
BLOCKED = -1e9
#: Part of a second by which states are moved to differentiate voltages.
_MOVE = 1e-5


@dataclass
class Meter:
    """Margins of measurements, positive where they are picked up; it remembers voltages for mho relays.

    Parameters
    ----------
    model : DetailedModel
        The intact model, whose voltages are remembered at the start.
    measurements : sequence of Measurement
        What is measured.
    """

    model: DetailedModel
    measurements: Sequence[Measurement]
    remembered: dict[int, complex] = field(default_factory=dict)

    def __post_init__(self) -> None:
        index, voltage = self.model.case.bus_index, self.model.power_flow.voltage
        watched: set[int] = set()
        for measured in self.measurements:
            if isinstance(measured, Level):
                watched.add(measured.bus)
            else:
                branch = self.model.case.branches[measured.branch]
                watched |= {branch.from_bus, branch.to_bus}
        self.remembered |= {bus: complex(voltage[index[bus]]) for bus in watched}
        self._watched = np.array(sorted(index[bus] for bus in watched), dtype=np.int64)

    def margins(
        self,
        model: DetailedModel,
        system: System,
        coordinates: Coordinates | None,
        states: NDArray[np.float64],
    ) -> NDArray[np.float64]:
        """Margins along states (n, r) of `system` on the network of `model`.

        Returns
        -------
        ndarray, shape (n, n_measurements, 2)
            Of blinders those of the outer and the inner ones, of all others the same twice.
        """
        seen = _Seen(model, system, coordinates, states, self._watched)
        result = np.empty((len(states), len(self.measurements), 2))
        for k, measured in enumerate(self.measurements):
            if isinstance(measured, Level):
                result[:, k] = seen.level(measured)[:, None]
            elif isinstance(measured, Mho):
                result[:, k] = self._mho(seen, measured)[:, None]
            else:
                result[:, k] = seen.blinders(measured)
        return result

    def _mho(self, seen: _Seen, measured: Mho) -> NDArray[np.float64]:
        """Re((Zr I - V) V*) / |Zr I|^2: V remembered where there is hardly any."""
        found = seen.at_end(measured.branch, measured.end)
        if found is None:
            return np.full(len(seen.voltages), BLOCKED)
        voltage, current, impedance, bus = found
        if bus not in seen.polarizing:
            seen.polarizing[bus] = self._polarizing(bus, voltage)
        polarizing = seen.polarizing[bus]
        drop = measured.reach * impedance * current
        size = np.abs(drop)
        with np.errstate(divide="ignore", invalid="ignore"):
            margin = ((drop - voltage) * np.conj(polarizing)).real / size**2
        seen_at_all = np.where(size > 1e-9, np.nan_to_num(margin, nan=BLOCKED), BLOCKED)
        return np.asarray(seen_at_all, dtype=np.float64)

    def _polarizing(self, bus: int, voltage: NDArray[np.complex128]) -> NDArray[np.complex128]:
        """The voltages (n,) of a bus, and the last one that was one where there is hardly any."""
        result = np.empty_like(voltage)
        for row, value in enumerate(voltage):
            if abs(value) >= MEMORY:
                self.remembered[bus] = complex(value)
            result[row] = self.remembered[bus]
        return result


class _Seen:
    """Voltages and what follows from them along some states."""

    def __init__(
        self,
        model: DetailedModel,
        system: System,
        coordinates: Coordinates | None,
        states: NDArray[np.float64],
        watched: NDArray[np.int64],
    ):
        self.model, self.system, self.coordinates, self.states = model, system, coordinates, states
        self.watched = watched
        self.place = {int(position): k for k, position in enumerate(watched)}
        self.voltages = model.bus_voltages(self._lifted(states), watched)
        self.polarizing: dict[int, NDArray[np.complex128]] = {}
        self._rates: NDArray[np.complex128] | None = None

    def level(self, measured: Level) -> NDArray[np.float64]:
        """Margin of a level."""
        at = self.model.case.bus_index[measured.bus]
        out = measured.unit is not None and measured.unit in self.model.state.units_out
        if out or not self.model.equations.islands.energized[at]:
            return np.full(len(self.states), BLOCKED)
        value = np.abs(self.voltages[:, self.place[at]])
        measurable = np.ones(len(value), dtype=bool)
        if isinstance(measured, Frequency):
            measurable = value >= NO_FREQUENCY
            value = self._frequency(at)
        if measured.below is not None:
            margin = measured.below - value
        else:
            margin = value - (np.inf if measured.above is None else measured.above)
        return np.asarray(np.where(measurable, margin, BLOCKED), dtype=np.float64)

    def blinders(self, measured: Blinders) -> NDArray[np.float64]:
        """Margins of the outer and the inner blinders, (n, 2)."""
        found = self.at_end(measured.branch, measured.end)
        if found is None:
            return np.full((len(self.states), 2), BLOCKED)
        voltage, current, impedance, _ = found
        with np.errstate(divide="ignore", invalid="ignore"):
            part = voltage / current / impedance
        along = 0.5 + measured.reach - np.abs(part.real - 0.5)
        across = np.abs(part.imag)
        margins = [np.minimum(size - across, along) for size in (measured.outer, measured.inner)]
        both = np.stack(margins, axis=1)
        return np.asarray(np.nan_to_num(both, nan=BLOCKED, neginf=BLOCKED), dtype=np.float64)

    def at_end(
        self, position: int, end: int
    ) -> tuple[NDArray[np.complex128], NDArray[np.complex128], complex, int] | None:
        """Voltage, current into a branch, its series impedance and the bus at an end; None if open.

        Impedances are as seen from that end, so behind the ratio of a transformer.
        """
        state, case = self.model.state, self.model.case
        if position in state.branches_out or (position, end) in state.open_ends:
            return None
        branch = case.branches[position]
        buses = branch.from_bus, branch.to_bus
        both = self.voltages[:, [self.place[case.bus_index[bus]] for bus in buses]]
        current = both @ state_port(case, state, position)[end]
        current = current + self._own_fault(position, end)
        size = branch.ratio**2 if end == 0 else 1.0
        return (
            both[:, end],
            current,
            size * complex(branch.resistance, branch.reactance),
            buses[end],
        )

    def _own_fault(self, position: int, end: int) -> NDArray[np.complex128]:
        """Current into a fault of the branch at this end, which is behind the relay, (n,).

        At a bolted fault no voltage drives the shunts of the bus: what machines feed and branches
        bring there is all that there is.
        """
        state, case = self.model.state, self.model.case
        none = np.zeros(len(self.states), dtype=np.complex128)
        fault = next((p for p in state.branch_faults if p.branch == position), None)
        if fault is None or fault.at_end != end:
            return none
        branch = case.branches[position]
        bus = branch.to_bus if end else branch.from_bus
        if fault.impedance:
            here = self.voltages[:, self.place[case.bus_index[bus]]]
            return np.asarray(here / fault.impedance)
        every = self.model.bus_voltages(self._lifted(self.states))
        total = none - sum((self._into(k, bus, every) for k in branches_at(case, bus)), none)
        return np.asarray(total + self._fed(bus))

    def _into(
        self, position: int, bus: int, voltages: NDArray[np.complex128]
    ) -> NDArray[np.complex128]:
        """Current from a bus into a branch, (n,), at the voltages of all buses."""
        case = self.model.case
        branch = case.branches[position]
        ends = [case.bus_index[branch.from_bus], case.bus_index[branch.to_bus]]
        port = state_port(case, self.model.state, position)
        return np.asarray(voltages[:, ends] @ port[0 if branch.from_bus == bus else 1])

    def _fed(self, bus: int) -> NDArray[np.complex128]:
        """Norton current of the machines at a bus, (n,)."""
        layout, out = self.model.layout, self.model.state.units_out
        here = [
            row[:2]
            for unit, row in zip(layout.source_units, layout.sources, strict=True)
            if unit.bus == bus and unit not in out
        ]
        slots = np.array(here, dtype=np.int64).reshape(-1, 2)
        parts = self.model.signals(self._lifted(self.states), slots.T.ravel())
        real, imag = np.split(parts, 2, axis=1)
        return np.asarray((real + 1j * imag).sum(axis=1))

    def _frequency(self, at: int) -> NDArray[np.float64]:
        if self._rates is None:
            moves = _MOVE * self.system.compiled.along(self.states)
            ahead, behind = (
                self.model.bus_voltages(self._lifted(self.states + side * moves), self.watched)
                for side in (1, -1)
            )
            self._rates = (ahead - behind) / (2 * _MOVE)
        voltage, rate = (rows[:, self.place[at]] for rows in (self.voltages, self._rates))
        with np.errstate(divide="ignore", invalid="ignore"):
            turning = (np.conj(voltage) * rate).imag / np.abs(voltage) ** 2
        return np.asarray(self.model.case.frequency_hz + turning / (2 * np.pi))

    def _lifted(self, states: NDArray[np.float64]) -> NDArray[np.float64]:
        return states if self.coordinates is None else self.coordinates.lift(states)
