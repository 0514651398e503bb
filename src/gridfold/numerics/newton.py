"""Newton's method for many small independent systems at once, with complex-step Jacobians."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

#: Length of a complex step: so small that the derivative is exact to rounding
#: (Squire & Trapp, SIAM Review 40 (1998), pp. 110-112).
COMPLEX_STEP = 1e-200
#: Residual below which Newton's method ends where no correction makes any better: rounding.
_ROUNDING = 1e-10

Batch = NDArray[np.float64]
ComplexBatch = NDArray[np.complex128]


def complex_step_jacobian(function: Callable[[ComplexBatch], ComplexBatch], z: Batch) -> Batch:
    """Jacobians of `function`, which maps (n, batch) to (m, batch): shape (m, n, batch)."""
    columns = []
    for k in range(len(z)):
        stepped = z.astype(np.complex128)
        stepped[k] += 1j * COMPLEX_STEP
        columns.append(np.asarray(function(stepped)).imag / COMPLEX_STEP)
    return np.stack(columns, axis=1) if columns else np.zeros((0, 0, z.shape[1]))


def newton_batch(
    function: Callable[[ComplexBatch], ComplexBatch],
    start: Batch,
    tolerance: float = 1e-13,
    max_iterations: int = 30,
    jacobian: Callable[[Batch], Batch] | None = None,
) -> Batch:
    """Solve function(z) = 0 for each column of `start`, shape (n, batch).

    Each column is iterated until its residual does not exceed `tolerance` or no correction improves it,
    whatever the others do; the caller judges the residual that is left. `jacobian` gives the Jacobians
    as :func:`complex_step_jacobian` does, which stands for it by default.
    """
    slopes = jacobian or partial(complex_step_jacobian, function)
    z = start.copy()
    best, best_error = z, np.full(z.shape[1], np.inf)
    left = np.ones(z.shape[1], dtype=bool)
    for _ in range(max_iterations):
        residual = function(z.astype(np.complex128)).real
        error = np.abs(residual).max(axis=0, initial=0.0)
        better = left & (error < best_error)
        best = np.where(better, z, best)
        best_error = np.where(better, error, best_error)
        left &= (best_error > tolerance) & (better | (best_error > _ROUNDING))
        if not left.any():
            break
        try:
            correction = np.linalg.solve(slopes(z).transpose(2, 0, 1), residual.T[:, :, None])
        except np.linalg.LinAlgError:
            break
        z = z - correction[:, :, 0].T
        lost = ~np.isfinite(z).all(axis=0)
        if lost.any():
            left &= ~lost
            z = np.where(lost, best, z)
    return best
