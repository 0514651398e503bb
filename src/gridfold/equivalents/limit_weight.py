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
from gridfold.equivalents.swing_errors import swing_error
from gridfold.equivalents.swings import Swings
from gridfold.numerics.steppers import Stepper
from gridfold.runs.method import fit_stepper

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
            below = swing_error(ladder.parts, small, swings, method)
        if below is not None and below <= LIGHT_DEG:
            found[rung] = below
    return found


def _acting(model: DetailedModel, small: SmallModel, states: NDArray[np.float64]) -> bool:
    """Whether a limit of a linear machine acts along the swing (n_times, n_states)."""
    known = limits_passed(model, model.x0[None, :], small.unlimited).keys()
    passed = limits_passed(model, states[::_EVERY], small.unlimited).keys()
    return bool(passed - known - small.followed)
