"""The figures an engineer asks for first."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gridfold.grid.case import UnitKey
from gridfold.runs.island_figures import CutOff, FrequencyRange, cut_off, frequency_range
from gridfold.runs.trajectory import AngleReference, Trajectory


@dataclass(frozen=True)
class Swing:
    """Largest excursion of one machine: angle against the centre of inertia (degrees), speed (p.u.)."""

    unit: UnitKey
    largest_angle_deg: float
    at_seconds: float
    lowest_speed: float
    highest_speed: float


@dataclass(frozen=True)
class Extreme:
    """An extreme value, where (bus number) and when (s)."""

    value: float
    bus: int
    at_seconds: float


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
    angles = run.rotor_angle_deg(reference=AngleReference.CENTRE_OF_INERTIA)
    deviation = np.nan_to_num(angles - angles[0])
    speed = run.signal("speed")
    peaks = np.argmax(np.abs(deviation), axis=0)
    lowest, highest = np.fmin.reduce(speed, axis=0), np.fmax.reduce(speed, axis=0)
    swings = [
        Swing(
            unit,
            float(deviation[peaks[k], k]),
            float(run.times[peaks[k]]),
            float(lowest[k]),
            float(highest[k]),
        )
        for k, unit in enumerate(run.model.machines)
        if not np.isnan(lowest[k])
    ]
    swings.sort(key=lambda swing: -abs(swing.largest_angle_deg))
    return Summary(tuple(swings), *_voltage_extremes(run), frequency_range(run), cut_off(run))


def last_event(run: Trajectory) -> float:
    """Time in seconds from which the network stays as it is at the end; 0 if it never changes."""
    used = list(zip(run.run.pieces, run.models, strict=False))
    last = 0.0
    for piece, model in reversed(used):
        if model.state != used[-1][1].state:
            break
        last = float(piece.times[0])
    return last


def _voltage_extremes(run: Trajectory) -> tuple[Extreme | None, Extreme | None]:
    """Lowest and highest voltage of energized buses from the last event on."""
    final = run.models[len(run.run.pieces) - 1]
    on = np.flatnonzero(final.equations.islands.energized)
    if not len(on):
        return None, None
    lowest = highest = Extreme(np.nan, 0, 0.0)
    for times, voltages in run.voltage_blocks(last_event(run)):
        voltage = voltages[:, on].T
        squared = voltage.real**2 + voltage.imag**2
        found = []
        for pick in (np.argmin, np.argmax):
            row, column = np.unravel_index(pick(squared), squared.shape)
            bus = run.model.case.buses[on[row]].number
            found.append(Extreme(float(abs(voltage[row, column])), bus, float(times[column])))
        lowest = lowest if found[0].value >= lowest.value else found[0]
        highest = highest if found[1].value <= highest.value else found[1]
    return lowest, highest
