"""A linear system in modal coordinates, for compiled loops."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gridfold.numerics.compiled import compile_callback
from gridfold.numerics.modal_form import ModalForm
from gridfold.numerics.rhs import RHS_SIGNATURE, CompiledRhs


@dataclass(frozen=True, eq=False)
class ModalSystem:
    """w' = blockdiag(1x1 and 2x2) w + offset.

    Parameters
    ----------
    form : ModalForm
        The modes.
    offset : ndarray, shape (n,)
        Constant part of the derivative, in modal coordinates.
    """

    form: ModalForm
    offset: NDArray[np.float64]

    @property
    def state_names(self) -> tuple[str, ...]:
        """``w:1``, ``w:2`` ..."""
        return tuple(f"w:{k + 1}" for k in range(len(self.offset)))

    @property
    def compiled(self) -> CompiledRhs:
        """The right-hand side."""
        n = len(self.offset)
        integers = np.concatenate([[n], self.form.partner]).astype(np.int64)
        reals = np.concatenate([self.form.diagonal, self.form.coupling, self.offset])
        return CompiledRhs(_compiled().address, integers, reals, 0, n)


def _modal_rhs(integers, reals, work, w, dw):
    n = integers[0]
    for i in range(n):
        dw[i] = reals[i] * w[i] + reals[n + i] * w[integers[1 + i]] + reals[2 * n + i]


@cache
def _compiled() -> Any:
    return compile_callback(_modal_rhs, RHS_SIGNATURE)
