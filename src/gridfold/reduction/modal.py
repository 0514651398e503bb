"""Modal truncation: keep the modes that matter most."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gridfold.errors import OptionError
from gridfold.numerics.modal_form import ModalForm, modal_form
from gridfold.reduction.base import Parts, Reduction, check_order
from gridfold.systems.linear import LinearSystem

Matrix = NDArray[np.float64]


@dataclass(frozen=True)
class ModalTruncation:
    """Keep the modes with the largest contributions ``|C v_i| |w_i B| / |Re lambda_i|``.

    v_i and w_i are right and left eigenvectors with w_i v_i = 1. The contribution is the largest
    modulus, over all frequencies, of the mode's own term of the transfer matrix, C v_i w_i B /
    (s - lambda_i), taken for each eigenvalue of a pair separately. There is no a-priori bound:
    terms of modes can cancel each other.
    The poles kept are poles of the full system.

    Source: A. C. Antoulas, "Approximation of Large-Scale Dynamical Systems", SIAM, 2005, section
    9.2; the ranking is the usual dominance measure, e.g. J. Rommes, N. Martins, IEEE Transactions
    on Power Systems 21 (2006), pp. 1471-1483.

    Parameters
    ----------
    order : int
        Number of states, with unstable and marginal modes. A complex pair is never split: where
        it would be, the reduced system has one state more.

    Raises
    ------
    OptionError
        If the order is below 1; in :meth:`reduce`, if it exceeds the number of states, is below
        that of unstable modes, or the stable part has no well-conditioned modal form.
    """

    order: int

    def __post_init__(self) -> None:
        if self.order < 1:
            raise OptionError(f"the order of a reduction must be at least 1: {self.order}")

    def reduce(self, system: LinearSystem, reference: Matrix) -> Reduction:
        """Reduce `system`, whose states are deviations from `reference`, shape (n,)."""
        parts = Parts.of(system)
        check_order(self.order, system, parts.kept)
        stable = parts.stable_system
        form = modal_form(stable.a)
        if form is None:
            raise OptionError(
                "modal truncation: the eigenvectors are too close to dependent; "
                "use a balanced method"
            )
        chosen = _dominant(form, contributions(form, stable), self.order - parts.kept)
        lift, restrict = form.basis[:, chosen], form.inverse[chosen]
        block = form.matrix()[np.ix_(chosen, chosen)]
        reduced = LinearSystem(block, restrict @ stable.b, stable.c @ lift)
        joined = parts.join(reduced, lift, restrict)
        return Reduction(joined.system, joined.map_from(reference), None, None, parts.kept)


def contributions(form: ModalForm, system: LinearSystem) -> Matrix:
    """Contribution of each modal coordinate, shape (n,); both of a pair have the same.

    Parameters
    ----------
    form : ModalForm
        Modal form of the A of `system`, which is stable.
    system : LinearSystem
    """
    seen, driven = system.c @ form.basis, form.inverse @ system.b
    columns = (seen**2).sum(axis=0)
    rows = (driven**2).sum(axis=1)
    paired = form.partner != np.arange(len(form.partner))
    # The eigenvectors of a pair are v = p +- jq and w = (f -+ jg) / 2 in the real basis (p, q) with
    # inverse (f, g), so that the squared norms add up, those of w with a factor 1/4.
    columns = np.where(paired, columns + columns[form.partner], columns)
    rows = np.where(paired, (rows + rows[form.partner]) / 4, rows)
    weights: Matrix = np.sqrt(columns * rows) / np.abs(form.diagonal)
    return weights


def _dominant(form: ModalForm, weights: Matrix, count: int) -> NDArray[np.int64]:
    """Coordinates of the largest modes, at least `count`, in the order of the modal form."""
    chosen = np.zeros(len(weights), dtype=bool)
    for i in np.argsort(-weights, kind="stable"):
        if np.count_nonzero(chosen) >= count:
            break
        chosen[[i, form.partner[i]]] = True
    return np.flatnonzero(chosen)
