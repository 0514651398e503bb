"""The one compiled form of a right-hand side: x' = f(x)."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numba import types
from numpy.typing import NDArray

from gridfold.numerics.checked_arrays import checked_state, require_positions
from gridfold.numerics.compiled import FAST, invoke, jit
from gridfold.numerics.implicit import SolverFactory

#: ``f(integers, reals, work, x, dx)``: two read-only blocks of data, scratch space, state, result.
RHS_SIGNATURE = types.void(
    types.int64[::1],
    types.float64[::1],
    types.float64[::1],
    types.float64[::1],
    types.float64[::1],
)


@dataclass(frozen=True)
class CompiledRhs:
    """A right-hand side that compiled loops can call.

    Parameters
    ----------
    address : int
        Address of a function compiled for :data:`RHS_SIGNATURE`.
    integers, reals : ndarray
        Its data. What they mean is the function's own business.
    work_size : int
        Length of the scratch space that one caller at a time needs.
    n_states : int
        Length of the state vector.
    after_step : int
        Address of a function of the same signature that may change the state after each step, for
        values that are held during a step; 0 if there is none.
    solver : callable, optional
        Makes the solver of implicit steppers; without it the Jacobian is found numerically.
    """

    address: int
    integers: NDArray[np.int64]
    reals: NDArray[np.float64]
    work_size: int
    n_states: int
    after_step: int = 0
    solver: SolverFactory | None = field(default=None, repr=False, compare=False)

    def __call__(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Derivative at the state `x`, shape (n_states,)."""
        state = checked_state(x, self.n_states).reshape(self.n_states)
        dx = np.empty(self.n_states)
        call_rhs(self.address, self.integers, self.reals, np.zeros(self.work_size), state, dx)
        return dx

    def along(self, states: NDArray[np.float64]) -> NDArray[np.float64]:
        """Derivatives at each of `states`, shape (n, n_states)."""
        rows = checked_state(states, self.n_states).reshape(len(states), self.n_states)
        rates, work = np.empty_like(rows), np.zeros(self.work_size)
        _call_along(self.address, self.integers, self.reals, work, rows, rates)
        return rates

    def held_after_step(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """The state after a step that ended in `x`: the same, but for values held during steps."""
        state = checked_state(x, self.n_states).reshape(self.n_states).copy()
        if self.after_step:
            work, dx = np.zeros(self.work_size), np.empty(self.n_states)
            call_rhs(self.after_step, self.integers, self.reals, work, state, dx)
        return state

    def work_along(
        self, states: NDArray[np.float64], places: NDArray[np.int64]
    ) -> NDArray[np.float64]:
        """Entries `places` (m,) of the scratch space after a call at each of `states`: (n, m)."""
        rows = checked_state(states, self.n_states).reshape(len(states), self.n_states)
        require_positions("places in the scratch space", places, self.work_size)
        result = np.empty((len(rows), len(places)))
        _collect_work(
            self.address, self.integers, self.reals, np.zeros(self.work_size), rows, places, result
        )
        return result


@jit(nogil=True)
def call_rhs(address, integers, reals, work, x, dx):
    """Call the right-hand side at `address` once."""
    invoke(address, (integers, reals, work, x, dx))


@jit(nogil=True)
def _call_along(address, integers, reals, work, states, rates):
    for row in range(states.shape[0]):
        invoke(address, (integers, reals, work, states[row], rates[row]))


@jit(nogil=True, error_model="numpy", fastmath=FAST)
def _collect_work(address, integers, reals, work, states, places, result):
    dx = np.empty(states.shape[1])
    for row in range(states.shape[0]):
        invoke(address, (integers, reals, work, states[row], dx))
        for k in range(result.shape[1]):
            result[row, k] = work[places[k]]
