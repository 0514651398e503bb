"""The equilibrium of a network state other than the intact one.

After a loss of load or generation the machines settle at a new common speed: all rotor angles then turn
together, at a constant rate. That is an equilibrium too, in a frame that turns with them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gridfold.dynamics.model import RESIDUAL_GOOD, DetailedModel
from gridfold.errors import InitializationError
from gridfold.numerics.blas import one_blas_thread

_MAX_ITERATIONS = 30


@dataclass(frozen=True)
class Equilibrium:
    """A state at which all derivatives vanish, but for the common rate of rotor angles.

    Parameters
    ----------
    x : ndarray, shape (n_states,)
        The state.
    rate : float
        Rate at which all rotor angles turn, in rad/s.
    """

    x: NDArray[np.float64]
    rate: float


@one_blas_thread
def find_equilibrium(model: DetailedModel, guess: NDArray[np.float64]) -> Equilibrium:
    """Equilibrium of `model` in its network state, by Newton's method from `guess`.

    The inertia-weighted mean of the rotor angles stays that of the guess, and their rate is free. An
    infinite bus holds both: the rate is then zero.

    Raises
    ------
    InitializationError
        None is found: the system has none there, or falls apart into islands.
    """
    units = tuple(unit for unit in model.machines if unit not in model.state.units_out)
    angles = model.slots("rotor_angle", units)
    moving = np.zeros(model.n_states)
    moving[angles] = 1.0
    condition = np.zeros(model.n_states + 1)
    if set(model.layout.source_units) - set(model.machines) - set(model.state.units_out):
        condition[-1] = 1.0
    else:
        condition[angles] = model.inertia(units) / model.inertia(units).sum()
    x, rate = guess.copy(), 0.0
    for _ in range(_MAX_ITERATIONS):
        residual = model.compiled(x) - rate * moving
        if np.abs(residual).max() < RESIDUAL_GOOD:
            return Equilibrium(x, rate)
        excess = condition @ np.append(x - guess, rate)
        matrix = np.vstack([np.column_stack([_regular_jacobian(model, x), -moving]), condition])
        try:
            step = np.linalg.solve(matrix, np.append(residual, excess))
        except np.linalg.LinAlgError:
            break
        x, rate = x - step[:-1], float(rate - step[-1])
        if not np.isfinite(x).all():
            break
    raise InitializationError("no equilibrium was found for the network after the disturbance")


def _regular_jacobian(model: DetailedModel, x: NDArray[np.float64]) -> NDArray[np.float64]:
    """The Jacobian, with ones for the states of units that are out, whose rows are zero."""
    matrix = model.jacobian(x)
    for block in model.layout.blocks:
        for unit, column in zip(block.units, block.state_index.T, strict=True):
            if unit in model.state.units_out:
                matrix[column, column] = 1.0
    return matrix
