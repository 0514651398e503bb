"""Frequencies of the islands of a run, and what was cut off by its end."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gridfold.dynamics.model import DetailedModel
from gridfold.runs.parts import Part
from gridfold.runs.synchronism import angle_frame


@dataclass(frozen=True)
class FrequencyRange:
    """Lowest and highest frequency in Hz of the centre of inertia of any island, and when (s)."""

    lowest_hz: float
    lowest_at: float
    highest_hz: float
    highest_at: float

    def joined(self, later: FrequencyRange | None) -> FrequencyRange:
        """Of this part of a run and a later one."""
        if later is None:
            return self
        low = self if self.lowest_hz <= later.lowest_hz else later
        high = self if self.highest_hz >= later.highest_hz else later
        return FrequencyRange(low.lowest_hz, low.lowest_at, high.highest_hz, high.highest_at)


@dataclass(frozen=True)
class CutOff:
    """The parts of the network at the end of a run.

    Parameters
    ----------
    islands : int
        Parts that have a machine.
    islanded_mw : float
        Generation before the disturbance of the units outside the island with the most buses, MW.
    lost_load_mw : float
        Load before the disturbance at the buses that were energized then and are no longer, MW.
    """

    islands: int
    islanded_mw: float
    lost_load_mw: float


def island_frequencies(part: Part) -> NDArray[np.float64]:
    """Frequency in Hz of the centre of inertia of each island that has a machine, (n, n_islands)."""
    frame = angle_frame(part.model)
    if not frame.units:
        return np.zeros((len(part), 0))
    speed = part.signals(part.model.slots("speed", frame.units))
    return part.model.case.frequency_hz * (speed @ _shares(frame.inertia, frame.island))


def frequency_range(part: Part) -> FrequencyRange | None:
    """Extremes over all islands and times of a part of a run; None without a machine in service."""
    here = island_frequencies(part)
    return range_of(part.times, here) if here.size else None


def range_of(times: NDArray[np.float64], frequencies: NDArray[np.float64]) -> FrequencyRange:
    """Extremes of frequencies (n, n_islands) in Hz, at least one island, at `times` (n,) in s."""
    low, high = frequencies.min(axis=1), frequencies.max(axis=1)
    first, last = int(low.argmin()), int(high.argmax())
    return FrequencyRange(
        float(low[first]), float(times[first]), float(high[last]), float(times[last])
    )


def cut_off(start: DetailedModel, final: DetailedModel) -> CutOff:
    """What is cut off in the network of `final`, and was not in that of `start`."""
    islands, flow = final.equations.islands, final.power_flow
    lost = start.equations.islands.energized & ~islands.energized
    base = final.case.base_mva
    return CutOff(
        islands.count,
        base * _generation(final, islands.energized & (islands.labels != islands.main)),
        base * float(flow.load_power.real[lost].sum()),
    )


def _generation(model: DetailedModel, buses: NDArray[np.bool_]) -> float:
    """Generation in p.u. at the operating point of the units in service at some buses."""
    index, out = model.case.bus_index, model.state.units_out
    return sum(
        float(power.real)
        for unit, power in zip(model.case.generators, model.power_flow.unit_power, strict=True)
        if unit.in_service and unit.key not in out and buses[index[unit.bus]]
    )


def _shares(inertia: NDArray[np.float64], island: NDArray[np.int64]) -> NDArray[np.float64]:
    """Part of each machine in the centre of inertia of its island, (n_units, n_islands)."""
    shares = np.zeros((len(island), island.max() + 1))
    shares[np.arange(len(island)), island] = inertia
    return np.asarray(shares / shares.sum(axis=0))
