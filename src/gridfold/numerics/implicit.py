"""Compiled solvers of (I - gamma J) y = b, where J is the Jacobian of a right-hand side.

An implicit stepper asks for one with the state and gamma, and keeps it as long as its iteration
converges. A system with structure brings its own; the others are differentiated numerically.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numba import types
from numpy.typing import NDArray

from gridfold.numerics.checked_arrays import checked_state
from gridfold.numerics.compiled import FAST, compile_callback, invoke, jit, matrix_view

if TYPE_CHECKING:
    from gridfold.numerics.rhs import CompiledRhs

#: ``solve(integers, reals, b, y, scratch)``: two read-only data blocks, right-hand side, solution.
SOLVER_SIGNATURE = types.void(
    types.int64[::1],
    types.float64[::1],
    types.float64[::1],
    types.float64[::1],
    types.float64[::1],
)

#: Relative step of numerical differentiation: about the cube root of the rounding error.
_DIFFERENCE = 6e-6


@dataclass(frozen=True)
class CompiledSolver:
    """Address of a function compiled for :data:`SOLVER_SIGNATURE`, and its data."""

    address: int
    integers: NDArray[np.int64]
    reals: NDArray[np.float64]
    scratch_size: int

    def __call__(self, b: NDArray[np.float64]) -> NDArray[np.float64]:
        """The solution y for a right-hand side b, both of shape (n_states,)."""
        y = np.empty(len(b))
        call_solver(self.address, self.integers, self.reals, b, y, np.zeros(self.scratch_size))
        return y


#: Makes the solver for a state, shape (n_states,), and a gamma in seconds.
SolverFactory = Callable[[NDArray[np.float64], float], CompiledSolver]


@jit(nogil=True)
def call_solver(address, integers, reals, b, y, scratch):
    """Call the solver at `address` once."""
    invoke(address, (integers, reals, b, y, scratch))


def dense_solver(jacobian: NDArray[np.float64], gamma: float) -> CompiledSolver:
    """The solver for a full Jacobian, shape (n, n), by its inverse."""
    n = len(jacobian)
    inverse = np.asarray(np.linalg.inv(np.eye(n) - gamma * jacobian), dtype=np.float64)
    return CompiledSolver(_compiled().address, np.array([n]), inverse.reshape(-1), 0)


def numerical_jacobian(rhs: CompiledRhs, x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Jacobian of `rhs` at the state `x` by central differences, shape (n, n)."""
    state, result = checked_state(x, rhs.n_states).copy(), np.empty((len(x), len(x)))
    work = np.zeros(rhs.work_size)
    _differentiate(rhs.address, rhs.integers, rhs.reals, work, state, result)
    return result


@jit(nogil=True, error_model="numpy", fastmath=FAST)
def _differentiate(address, integers, reals, work, x, result):
    n = len(x)
    above, below = np.empty(n), np.empty(n)
    for k in range(n):
        value, h = x[k], _DIFFERENCE * max(1.0, abs(x[k]))
        x[k] = value + h
        invoke(address, (integers, reals, work, x, above))
        x[k] = value - h
        invoke(address, (integers, reals, work, x, below))
        x[k] = value
        for i in range(n):
            result[i, k] = (above[i] - below[i]) / (2 * h)


def _solve(integers, reals, b, y, scratch):
    n = integers[0]
    inverse = matrix_view(reals, 0, n, n)
    for i in range(n):
        total = 0.0
        for j in range(n):
            total += inverse[i, j] * b[j]
        y[i] = total


@cache
def _compiled() -> Any:
    return compile_callback(_solve, SOLVER_SIGNATURE)
