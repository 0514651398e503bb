"""Whether the limits of linear machines matter for the study area: asked of sample swings.

A grid of hundreds of machines has thousands of limits, and after every fault some of them act: a
stabilizer far away is at the end of its range for a moment. If each of these sent a run to the detailed
model, no run would ever leave it. So each rung runs the sample swings as if there were no limits. Where
that moves no rotor angle of the study area by much, the limits of the rung's linear machines are passed
over.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from gridfold.dynamics.model import DetailedModel
from gridfold.dynamics.unit_limits import limits_passed
from gridfold.equivalents.families import Mode, SmallModel
from gridfold.equivalents.ladder import Ladder
from gridfold.equivalents.swings import Swings
from gridfold.numerics.steppers import Stepper
from gridfold.runs.method import fit_stepper
from gridfold.simulation.run import run_segments
from gridfold.simulation.segment import Segment

#: Limits are passed over where no rotor angle of the study area errs by more against the centre of
#: inertia (degrees, root mean square over each sample swing).
LIGHT_DEG = 0.5
#: Samples at which limits are looked at: every one of so many.
_EVERY = 5


def light_limits(
    ladder: Ladder, swings: Swings, stepper: Stepper | None = None
) -> Mapping[Mode, float]:
    """Rungs whose limits hardly matter, with the error in degrees that shows it.

    Where no limit acts in a sample, nothing shows what limits do: such a rung is as that below it,
    which is linear in more machines. Where everything is linear limits always count.

    Parameters
    ----------
    ladder : Ladder
        About the operating point of the intact network.
    swings : tuple of ndarrays
        From :func:`sample_swings`, with the steps of `stepper`.
    stepper : Stepper, optional
        As in :func:`gridfold.simulate`.
    """
    model = ladder.parts.model
    method = fit_stepper(model, stepper).stepper
    found: dict[Mode, float] = {}
    below: float | None = None
    for rung in reversed([rung for rung in ladder.rungs if rung is not Mode.WHOLE]):
        small = ladder.build(rung, model)
        if any(_acting(model, small, states) for states in swings):
            below = max(_error(ladder, small, states, method) for states in swings)
        if below is not None and below <= LIGHT_DEG:
            found[rung] = below
    return found


def _acting(model: DetailedModel, small: SmallModel, states: NDArray[np.float64]) -> bool:
    """Whether a limit of a linear machine acts along the swing (n_times, n_states)."""
    known = limits_passed(model, model.x0[None, :], small.unlimited).keys()
    passed = limits_passed(model, states[::_EVERY], small.unlimited).keys()
    return bool(passed - known - small.followed)


def _error(
    ladder: Ladder, small: SmallModel, states: NDArray[np.float64], stepper: Stepper
) -> float:
    """Root mean square error of the worst rotor angle of the study area, in degrees.

    Infinite where the run does not end.
    """
    rows = len(states) - 1  # the last step of a swing may be a shorter one
    segment = Segment(small.system, (rows - 1) * stepper.step, coordinates=small.coordinates)
    run = run_segments([segment], states[0], stepper)
    other = np.concatenate([piece.full_states for piece in run.pieces])
    if len(other) < rows:
        return np.inf
    error = _relative(ladder, other[:rows]) - _relative(ladder, states[:rows])
    return float(np.degrees(np.sqrt((error**2).mean(axis=0)).max()))


def _relative(ladder: Ladder, states: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rotor angles (n_times, n_study_units) against the centre of inertia, in rad."""
    model = ladder.parts.model
    inertia = model.inertia(model.machines)
    centre = states[:, model.slots("rotor_angle", model.machines)] @ (inertia / inertia.sum())
    units = tuple(unit for unit in ladder.study_units if unit in model.machines)
    return np.asarray(states[:, model.slots("rotor_angle", units)] - centre[:, None])
