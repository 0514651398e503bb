"""Frequencies of the islands of a run, and what was cut off by its end."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gridfold.dynamics.model import DetailedModel
from gridfold.runs.synchronism import angle_frame
from gridfold.runs.trajectory import Trajectory


@dataclass(frozen=True)
class FrequencyRange:
    """Lowest and highest frequency in Hz of the centre of inertia of any island, and when (s)."""

    lowest_hz: float
    lowest_at: float
    highest_hz: float
    highest_at: float


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


def frequency_range(run: Trajectory) -> FrequencyRange | None:
    """Extremes over all islands and times; None where no machine with a rotor is in service."""
    machines = run.model.machines
    column = {unit: k for k, unit in enumerate(machines)}
    speed = run.signal("speed", machines)
    lowest, highest = (np.inf, 0.0), (-np.inf, 0.0)
    for rows, model in run.stages:
        frame = angle_frame(model)
        if not frame.units:
            continue
        here = speed[rows][:, [column[unit] for unit in frame.units]] @ _shares(
            frame.inertia, frame.island
        )
        low, high = here.min(axis=1), here.max(axis=1)
        times = run.times[rows]
        lowest = min(lowest, (float(low.min()), float(times[low.argmin()])))
        highest = max(highest, (float(high.max()), float(times[high.argmax()])))
    if not np.isfinite(lowest[0]):
        return None
    hertz = run.model.case.frequency_hz
    return FrequencyRange(hertz * lowest[0], lowest[1], hertz * highest[0], highest[1])


def cut_off(run: Trajectory) -> CutOff:
    """What has been cut off at the end of a run."""
    start, final = run.model, run.models[len(run.run.pieces) - 1]
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
