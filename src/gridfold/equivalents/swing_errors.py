"""True errors of small models along sample swings of the detailed model, as if there were no limits.

The swings are there already, so an error costs a run of the small model alone.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gridfold.equivalents.families import SmallModel
from gridfold.equivalents.swings import Swings
from gridfold.numerics.steppers import Stepper
from gridfold.partition import Partition
from gridfold.simulation.run import run_segments
from gridfold.simulation.segment import Segment

#: Rotor angles (n_times, n_study_units) against the centre of inertia along each swing, in rad.
Angles = tuple[NDArray[np.float64], ...]


def swing_error(parts: Partition, small: SmallModel, swings: Swings, stepper: Stepper) -> float:
    """Error of the worst rotor angle of the study area against the centre of inertia, in degrees.

    Root mean square over a swing; of several swings the largest, infinite where a run does not end.

    Parameters
    ----------
    parts : Partition
        Study and external area.
    small : SmallModel
        Of the intact network.
    swings : tuple of ndarrays
        From :func:`gridfold.sample_swings`, with the steps of `stepper`.
    stepper : Stepper
        Integration rule.
    """
    return apart_deg(angles_along(parts, small, swings, stepper), detailed_angles(parts, swings))


def angles_along(parts: Partition, small: SmallModel, swings: Swings, stepper: Stepper) -> Angles:
    """Angles of the small model from the start of each swing; shorter where the run does not end."""
    return tuple(_relative(parts, _run(small, states, stepper)) for states in swings)


def detailed_angles(parts: Partition, swings: Swings) -> Angles:
    """Angles of the swings themselves, without the last step, which may be a shorter one."""
    return tuple(_relative(parts, states[:-1]) for states in swings)


def apart_deg(these: Angles, those: Angles) -> float:
    """Root mean square difference of the worst angle in degrees; infinite where lengths differ."""
    worst = 0.0
    for one, other in zip(these, those, strict=True):
        if len(one) != len(other):
            return float("inf")
        squares = ((one - other) ** 2).mean(axis=0)
        worst = max(worst, float(np.degrees(np.sqrt(squares.max(initial=0.0)))))
    return worst


def _run(small: SmallModel, states: NDArray[np.float64], stepper: Stepper) -> NDArray[np.float64]:
    """States of the whole system (n_times, n_states) that the model makes of a swing."""
    rows = len(states) - 1
    segment = Segment(small.system, (rows - 1) * stepper.step, coordinates=small.coordinates)
    run = run_segments([segment], states[0], stepper)
    return np.concatenate([piece.full_states for piece in run.pieces])[:rows]


def _relative(parts: Partition, states: NDArray[np.float64]) -> NDArray[np.float64]:
    model = parts.model
    inertia = model.inertia(model.machines)
    centre = states[:, model.slots("rotor_angle", model.machines)] @ (inertia / inertia.sum())
    units = tuple(unit for unit in parts.study_units if unit in model.machines)
    return np.asarray(states[:, model.slots("rotor_angle", units)] - centre[:, None])
