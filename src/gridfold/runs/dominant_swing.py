"""The dominant swing of a machine after the last event."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gridfold.grid.case import UnitKey
from gridfold.numerics.ringdown import Ringdown, ringdown
from gridfold.runs.summary import last_event
from gridfold.runs.trajectory import AngleReference, Trajectory

#: Swings smaller than this (degrees) have no damping to speak of.
SMALL_SWING_DEG = 0.05


def late_swing(run: Trajectory, unit: UnitKey) -> NDArray[np.float64]:
    """Angle of `unit` in degrees against the centre of inertia, after the last event."""
    angle = run.rotor_angle_deg([unit], AngleReference.CENTRE_OF_INERTIA)[:, 0]
    return angle[run.times >= last_event(run)]


def swings(angle: NDArray[np.float64]) -> bool:
    """Whether an angle in degrees moves enough to have a damping."""
    return not (len(angle) < 2 or np.isnan(angle).any() or np.ptp(angle) < SMALL_SWING_DEG)


def dominant_swing(run: Trajectory, unit: UnitKey) -> Ringdown | None:
    """Frequency and damping of the swing of `unit` after the last event; None if nothing swings."""
    swing = late_swing(run, unit)
    return ringdown(swing, run.stepper.step) if swings(swing) else None
