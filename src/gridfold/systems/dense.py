"""A linear system by its full matrix, for compiled loops, where there is no modal form."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gridfold.numerics.checked_arrays import require_shapes
from gridfold.numerics.compiled import compile_callback, matrix_view
from gridfold.numerics.rhs import RHS_SIGNATURE, CompiledRhs


@dataclass(frozen=True, eq=False)
class DenseSystem:
    """w' = A w + offset.

    Parameters
    ----------
    a : ndarray, shape (n, n)
        The matrix.
    offset : ndarray, shape (n,)
        Constant part of the derivative.
    """

    a: NDArray[np.float64]
    offset: NDArray[np.float64]

    def __post_init__(self) -> None:
        n = len(self.offset)
        require_shapes("a dense system", self, {"a": (n, n), "offset": (n,)})

    @property
    def state_names(self) -> tuple[str, ...]:
        """``w:1``, ``w:2`` ..."""
        return tuple(f"w:{k + 1}" for k in range(len(self.offset)))

    @property
    def compiled(self) -> CompiledRhs:
        """The right-hand side."""
        n = len(self.offset)
        reals = np.concatenate([self.a.ravel(), self.offset])
        return CompiledRhs(_compiled().address, np.array([n], dtype=np.int64), reals, 0, n)


def _dense_rhs(integers: Any, reals: Any, work: Any, w: Any, dw: Any) -> None:
    n = integers[0]
    a = matrix_view(reals, 0, n, n)
    for i in range(n):
        total = reals[n * n + i]
        for j in range(n):
            total += a[i, j] * w[j]
        dw[i] = total


@cache
def _compiled() -> Any:
    return compile_callback(_dense_rhs, RHS_SIGNATURE)
