"""What is looked at of an error: rotor angles against centres of inertia, and speeds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gridfold.grid.case import UnitKey
from gridfold.numerics.error_modes import Modes
from gridfold.runs.synchronism import AngleFrame
from gridfold.simulation.segment import Segment


@dataclass(frozen=True, eq=False)
class ErrorFrame:
    """Rows by which modes of an error move angles and speeds.

    Parameters
    ----------
    frame : AngleFrame
        The machines in service.
    angles : ndarray, shape (n_study, n_modes)
        Rotor angles of the study area's machines against their islands' references; NaN for one that
        is out.
    every_angle, every_speed : ndarray
        The same of all machines in service, and their speeds.
    """

    frame: AngleFrame
    angles: NDArray[np.float64]
    every_angle: NDArray[np.float64]
    every_speed: NDArray[np.float64]

    def reach(
        self, segment: Segment, states: NDArray[np.float64], errors: NDArray[np.float64]
    ) -> tuple[float, float]:
        """Largest angle (rad) and distance from synchronous speed (p.u.) that a machine may come to.

        For each machine that is its largest along the `states` of the segment, (n_times, n), and its
        largest error along `errors`, (n_times, n_modes), at the same instants.
        """
        frame = self.frame
        angles = segment.lift_rows(states, frame.slots)
        apart = np.abs(angles - frame.references_of(angles)).max(axis=0)
        apart += np.abs(errors @ self.every_angle.T).max(axis=0)
        fast = np.abs(segment.lift_rows(states, frame.speed_slots) - 1).max(axis=0)
        fast += np.abs(errors @ self.every_speed.T).max(axis=0)
        return float(apart.max(initial=0.0)), float(fast.max(initial=0.0))


def error_frame(frame: AngleFrame, modes: Modes, study: Sequence[UnitKey]) -> ErrorFrame:
    """The rows in the network of `frame`."""
    every = modes.rows(frame.slots)
    for island, fixed in enumerate(frame.fixed):
        members = frame.island == island
        if np.isnan(fixed):
            weights = frame.inertia[members] / frame.inertia[members].sum()
            every[members] -= weights @ every[members]
    place = {unit: k for k, unit in enumerate(frame.units)}
    missing = np.full(every.shape[1], np.nan)
    angles = np.array([every[place[unit]] if unit in place else missing for unit in study])
    return ErrorFrame(frame, angles, every, modes.rows(frame.speed_slots))
