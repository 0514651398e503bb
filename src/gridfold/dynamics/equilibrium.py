"""The equilibrium of a network state other than the intact one.

After a loss of load or generation the machines settle at a new common speed: all rotor angles then turn
together, at a constant rate. That is an equilibrium too, in a frame that turns with them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import block_array, csc_array, diags_array
from scipy.sparse.linalg import splu

from gridfold.dynamics.descriptor import grid_descriptor
from gridfold.dynamics.layout import ROTOR_ANGLE, infinite_buses
from gridfold.dynamics.model import DetailedModel, good_residual
from gridfold.dynamics.unit_limits import StateLimits, state_limits
from gridfold.errors import InitializationError

#: Steps of Newton's method, and of the implicit Euler rule where that leads nowhere.
_NEWTON_STEPS, _EULER_STEPS = 15, 40
#: Length of the first of the latter in s; each next one is twice as long.
_SHORT = 0.02
#: The Jacobian is taken anew where a step leaves more than this part of the residual.
_SLOW = 0.3
#: Not where no more than so many times the residual that is good is left: the next step ends there.
_NEARLY = 10.0
#: A step of Newton's method is that of the implicit Euler rule over so many seconds: what nothing
#: holds, such as an integrator whose output is cut off, drifts to its limit instead of making the
#: Jacobian singular.
_LONG = 1e4
#: A step of Newton's method below this part of each state (of 1, for states below 1) ends the search:
#: in a state with a large gain rounding keeps the derivative above the tolerance.
_STILL = 1e-9
#: A state in p.u. beyond this belongs to no equilibrium; devices may divide by zero there. A rotor
#: angle that has moved by more (rad) drifts away with an island of its own.
_LOST, _ADRIFT = 1e8, 1e3
_NONE = "no equilibrium was found for the network after the disturbance"


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


def find_equilibrium(model: DetailedModel, guess: NDArray[np.float64]) -> Equilibrium:
    """Equilibrium of `model` in its network state, by Newton's method from `guess`.

    The Jacobian of one step serves the next ones as long as they converge quickly.

    A step that leads beyond a limit of a state ends at it, for beyond it a state may be anywhere. None
    moves a state, but for rotor angles, by more than 1 p.u. and its own size. Where that leads
    nowhere, the way is that of the implicit Euler rule with steps that grow: first fast states, such
    as those of exciters with a large gain, then slow ones come to rest.

    The inertia-weighted mean of the rotor angles stays that of the guess, and their rate is free. An
    infinite bus holds both: the rate is then zero.

    Raises
    ------
    InitializationError
        None is found: the system has none there, or falls apart into islands.
    """
    out = model.state.units_out
    units = tuple(unit for unit in model.machines if unit not in out)
    angles = model.slots(ROTOR_ANGLE, units)
    moving = np.zeros(model.n_states)
    moving[model.layout.angle_states(out)] = 1.0
    condition = np.zeros(model.n_states + 1)
    if set(infinite_buses(model.layout)) - set(out):
        condition[-1] = 1.0
    else:
        condition[angles] = model.inertia(units) / model.inertia(units).sum()
    limits = state_limits(model, guess, model.layout.source_units)
    search = _Search(_Bordered(model, moving, condition), guess, angles, limits)
    growing = [min(_SHORT * 2.0**k, _LONG) for k in range(_EULER_STEPS)]
    for lengths in ([_LONG] * _NEWTON_STEPS, growing):
        found = search.along(lengths)
        if found is not None:
            return found
    raise InitializationError(_NONE)


@dataclass(frozen=True)
class _Search:
    """Steps from `guess` to an equilibrium."""

    jacobian: _Bordered
    guess: NDArray[np.float64]
    angles: NDArray[np.int64]
    limits: StateLimits

    def along(self, lengths: Iterable[float]) -> Equilibrium | None:
        """The equilibrium to which steps of these lengths (s) lead, if they get there.

        Raises
        ------
        InitializationError
            They lead off: no more of them would help.
        """
        border, guess = self.jacobian, self.guess
        model, moving, condition = border.model, border.moving, border.condition
        x, rate = guess.copy(), 0.0
        before, solve, good = np.inf, None, good_residual(model.power_flow)
        for length in lengths:
            residual = model.compiled(x) - rate * moving
            size = np.abs(residual).max(initial=0.0)
            if size < good:
                return Equilibrium(x, rate)
            try:
                quick = size <= max(_SLOW * before, _NEARLY * good)
                if solve is None or length < _LONG or not quick:
                    solve = border.at(x, length)
                step = solve(np.append(residual, condition @ np.append(x - guess, rate)))
            except RuntimeError as error:
                raise InitializationError(_NONE) from error
            scale = np.maximum(np.abs(x), 1.0)
            still = length == _LONG and (np.abs(step[:-1]) < _STILL * scale).all()
            room = np.where(moving > 0, np.inf, scale)
            x, rate, before = (
                self.limits.held(x - np.clip(step[:-1], -room, room)),
                float(rate - step[-1]),
                size,
            )
            if still:
                return Equilibrium(x, rate)
            turned = np.abs(x - guess)[self.angles].max(initial=0.0)
            if not (np.abs(x).max(initial=0.0) < _LOST and turned < _ADRIFT):
                raise InitializationError(_NONE)
        return None


@dataclass(frozen=True)
class _Bordered:
    """The Jacobian with the rate's column and the condition's row, (n_states + 1,) each.

    The node voltages are unknowns too, so that all is sparse. States that nothing moves stay: those of
    units that are out, and what a limit holds. What moves at a rate that a limit holds moves for 1 s.
    """

    model: DetailedModel
    moving: NDArray[np.float64]
    condition: NDArray[np.float64]

    def at(
        self, x: NDArray[np.float64], length: float
    ) -> Callable[[NDArray[np.float64]], NDArray[np.float64]]:
        """What solves with it at the state `x`, for right-hand sides of shape (n_states + 1,).

        The step is one of the implicit Euler rule over `length` (s).
        """
        grid, n = grid_descriptor(self.model, x), self.model.n_states
        idle = abs(grid.a11).sum(axis=1) + abs(grid.a12).sum(axis=1) == 0
        shift = np.where(idle, -1.0, -1.0 / length)
        row, corner = self.condition[None, :n], self.condition[n:, None]
        matrix = block_array(
            [
                [grid.a11 + diags_array(shift), grid.a12, -self.moving[:, None]],
                [grid.a21, grid.a22, None],
                [csc_array(row), None, csc_array(corner)],
            ],
            format="csc",
        )
        factors = splu(matrix)

        def solve(rhs: NDArray[np.float64]) -> NDArray[np.float64]:
            full = np.zeros(matrix.shape[0])
            full[:n], full[-1] = rhs[:n], rhs[n]
            solution = factors.solve(full)
            return np.asarray(np.append(solution[:n], solution[-1]))

        return solve
