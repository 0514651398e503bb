"""The figures an engineer asks for first."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import isnan

import numpy as np
from numpy.typing import NDArray

from gridfold.dynamics.model import DetailedModel
from gridfold.grid.case import UnitKey
from gridfold.numerics.rows import column_range, extreme_rows
from gridfold.runs.extremes import Extreme, VoltageRange
from gridfold.runs.island_figures import CutOff, FrequencyRange, cut_off, frequency_range
from gridfold.runs.parts import Part
from gridfold.runs.trajectory import Trajectory

#: Rows of the voltages of all buses that are looked at together. All rows of a large grid do not fit
#: the processor's cache.
_ROWS = 128


@dataclass(frozen=True)
class Swing:
    """Largest excursion of one machine: angle against the centre of inertia (degrees), speed (p.u.)."""

    unit: UnitKey
    largest_angle_deg: float
    at_seconds: float
    lowest_speed: float
    highest_speed: float


@dataclass(frozen=True)
class Summary:
    """What happened in a run.

    Parameters
    ----------
    swings : tuple of Swing
        Of the machines, the largest first.
    lowest_voltage, highest_voltage : Extreme or None
        Of energized buses after the last event; None where there is none.
    frequency : FrequencyRange or None
        Of all islands; None without a machine.
    cut_off : CutOff
        Islands, and what they cost.
    """

    swings: tuple[Swing, ...]
    lowest_voltage: Extreme | None
    highest_voltage: Extreme | None
    frequency: FrequencyRange | None
    cut_off: CutOff

    @property
    def dark(self) -> bool:
        """Whether nothing was energized any more at the end."""
        return self.cut_off.islands == 0


def summarize(run: Trajectory) -> Summary:
    """Summarize a run."""
    summarizer = Summarizer(run.model, run.voltage_range)
    for part in run.parts:
        summarizer.take(part)
    return summarizer.summary()


@dataclass
class Summarizer:
    """Makes the summary of a run from its parts in order of time, none of which it keeps.

    `voltages` are the extremes of the voltages where they are known already.
    """

    model: DetailedModel
    voltages: VoltageRange | None = None
    _last: DetailedModel | None = None
    _lowest: Extreme | None = None
    _highest: Extreme | None = None
    _frequency: FrequencyRange | None = None
    _start: NDArray[np.float64] = field(init=False)
    _peak: NDArray[np.float64] = field(init=False)
    _peak_at: NDArray[np.float64] = field(init=False)
    _slowest: NDArray[np.float64] = field(init=False)
    _fastest: NDArray[np.float64] = field(init=False)

    def __post_init__(self) -> None:
        count = len(self.model.machines)
        self._start, self._peak, self._peak_at = (np.zeros(count) for _ in range(3))
        self._slowest, self._fastest = np.full(count, np.nan), np.full(count, np.nan)

    def take(self, part: Part) -> None:
        """The next part of the run."""
        if not len(part):
            return
        self._take_swings(part)
        if self._last is None or part.model.state != self._last.state:
            self._lowest = self._highest = None
        self._last = part.model
        frequency = frequency_range(part)
        self._frequency = self._frequency.joined(frequency) if self._frequency else frequency
        if self.voltages is None:
            for block in part.blocks(_ROWS):
                self._take_voltages(block)

    def summary(self) -> Summary:
        """Of all parts so far."""
        swings = [
            Swing(unit, *figures)
            for unit, *figures in zip(
                self.model.machines,
                np.rad2deg(self._peak).tolist(),
                self._peak_at.tolist(),
                self._slowest.tolist(),
                self._fastest.tolist(),
                strict=True,
            )
            if not isnan(figures[2])
        ]
        swings.sort(key=lambda swing: -abs(swing.largest_angle_deg))
        gone = cut_off(self.model, self._last or self.model)
        found = self.voltages or VoltageRange(self._lowest, self._highest)
        return Summary(tuple(swings), found.lowest, found.highest, self._frequency, gone)

    def _take_swings(self, part: Part) -> None:
        machines = self.model.machines
        angles = part.relative_angles
        speed = part.signals(self.model.slots("speed", machines))
        out = [k for k, unit in enumerate(machines) if unit in part.model.state.units_out]
        if self._last is None:
            self._start = angles[0].copy()
        every = np.arange(len(machines))
        for row in extreme_rows(angles):
            largest = angles[row, every] - self._start
            further = np.abs(largest) > np.abs(self._peak)
            self._peak = np.where(further, largest, self._peak)
            self._peak_at = np.where(further, part.times[row], self._peak_at)
        slowest, fastest = column_range(speed)
        slowest[out] = fastest[out] = np.nan
        self._slowest = np.fmin(self._slowest, slowest)
        self._fastest = np.fmax(self._fastest, fastest)

    def _take_voltages(self, block: Part) -> None:
        """Lowest and highest voltage of energized buses since the network changed last."""
        on = np.flatnonzero(block.model.equations.islands.energized)
        if not len(on):
            return
        voltage = block.bus_voltages()[:, on].T
        squared = voltage.real**2 + voltage.imag**2
        found = []
        for pick in (np.argmin, np.argmax):
            row, column = np.unravel_index(pick(squared), squared.shape)
            bus = self.model.case.buses[on[row]].number
            found.append(Extreme(float(abs(voltage[row, column])), bus, float(block.times[column])))
        low, high = found
        if self._lowest is None or not self._lowest.value <= low.value:
            self._lowest = low
        if self._highest is None or not self._highest.value >= high.value:
            self._highest = high


def last_event(run: Trajectory) -> float:
    """Time in seconds from which the network stays as it is at the end; 0 if it never changes."""
    used = list(zip(run.run.pieces, run.models, strict=False))
    last = 0.0
    for piece, model in reversed(used):
        if model.state != used[-1][1].state:
            break
        last = float(piece.times[0])
    return last
