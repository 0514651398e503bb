"""Modes of a matrix that coincide in a chain, as those of two equal lags in a row.

Such a matrix has no basis of eigenvectors. So its states are taken in groups that drive each other
both ways, and each group has modes of its own. What others drive in a group is taken away mode by mode,
by a Sylvester equation. That has no solution where both modes have the same rate: there a link stays.

Source: C. A. Bavely, G. W. Stewart, "An algorithm for computing reducing subspaces by block
diagonalization", SIAM Journal on Numerical Analysis 16 (1979), with groups in place of a Schur form.
"""

from __future__ import annotations

from itertools import pairwise
from math import sqrt

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.linalg import solve_triangular
from scipy.sparse.csgraph import connected_components

from gridfold.numerics.blas import one_blas_thread
from gridfold.numerics.modal_form import ModalForm, is_exact, modal_form
from gridfold.numerics.mode_links import ModeLinks

#: Rates (1/s) are the same if they differ by less than this part of their size, or of 1/s if that is
#: larger: runs of minutes do not show it.
SAME_RATE = 1e-6
#: Links weaker than this (1/s) are rounding.
WEAKEST = 1e-11

Matrix = NDArray[np.float64]
Positions = NDArray[np.int64]


@one_blas_thread
def chained_form(a: Matrix) -> ModalForm | None:
    """The modal form of `a`, with links between modes that coincide in a chain.

    Parameters
    ----------
    a : ndarray, shape (n, n)
        In 1/s. Its zeros say which states do not drive each other.

    Returns
    -------
    ModalForm or None
        None if the modes of a group cannot be told apart, or the form is too inexact.
    """
    layers = _layers(a)
    if len(layers) <= 1:
        return modal_form(a)
    forms = [[modal_form(a[np.ix_(group, group)]) for group in layer] for layer in layers]
    alone = _side_by_side(len(a), layers, forms)
    if alone is None:
        return None
    ends = np.cumsum([sum(map(len, layer)) for layer in layers])
    drive = alone.inverse @ a @ alone.basis - alone.matrix()
    turn, links = _freed(alone, drive, ends)
    basis, inverse = alone.basis @ turn, solve_triangular(turn, alone.inverse, lower=True)
    size = np.linalg.norm(basis, axis=0)
    size = np.maximum(size, size[alone.partner])
    form = ModalForm(
        basis / size, inverse * size[:, None], alone.diagonal, alone.coupling, alone.partner,
        ModeLinks.of(links * size[:, None] / size, WEAKEST),
    )  # fmt: skip
    return form if is_exact(form, a) else None


def _layers(a: Matrix) -> list[list[Positions]]:
    """Groups of states that drive each other both ways, each driven by groups of layers before."""
    count, group_of = connected_components(a != 0, connection="strong")
    driven, driving = (group_of[index] for index in np.nonzero(a))
    layer_of, deeper = np.zeros(count, dtype=np.int64), np.zeros(count, dtype=np.int64)
    apart = driven != driving
    driven, driving = driven[apart], driving[apart]
    while True:
        np.maximum.at(deeper, driven, layer_of[driving] + 1)
        if np.array_equal(deeper, layer_of):
            break
        layer_of[:] = deeper
    order = np.argsort(group_of, kind="stable")
    groups = np.split(order, np.cumsum(np.bincount(group_of, minlength=count))[:-1])
    return [
        [groups[k] for k in np.flatnonzero(layer_of == layer)]
        for layer in range(int(layer_of.max(initial=-1)) + 1)
    ]


def _side_by_side(
    n: int, layers: list[list[Positions]], forms: list[list[ModalForm | None]]
) -> ModalForm | None:
    """The modes of all groups, layer by layer, as if none drove another."""
    basis, inverse, (diagonal, coupling) = np.zeros((n, n)), np.zeros((n, n)), np.zeros((2, n))
    partner, start = np.arange(n), 0
    for layer, found in zip(layers, forms, strict=True):
        for group, form in zip(layer, found, strict=True):
            if form is None:
                return None
            own = slice(start, start + len(group))
            basis[group, own], inverse[own, group] = form.basis, form.inverse
            diagonal[own], coupling[own] = form.diagonal, form.coupling
            partner[own] = start + form.partner
            start = own.stop
    return ModalForm(basis, inverse, diagonal, coupling, partner)


def _freed(form: ModalForm, drive: Matrix, ends: Positions) -> tuple[Matrix, Matrix]:
    """X and N with (L + drive) X = X (L + N), where N links modes of the same rate alone.

    L holds the modes of `form`. `drive` is strictly lower triangular in layers that end at `ends`; so
    is X, but for ones on its diagonal.
    """
    rates, pairs = form.eigenvalues, _pairs(form)
    back = pairs.conj().T
    between = pairs @ drive @ back
    x, links = np.eye(len(rates), dtype=np.complex128), np.zeros_like(between)
    for start, end in pairwise(ends):
        forcing = between[start:end, :start] @ x[:start, :start]
        gap = rates[start:end, None] - rates[:start]
        same = np.abs(gap) <= SAME_RATE * np.maximum(1.0, np.abs(rates[:start]))
        gap[same] = np.inf
        known = sparse.csc_array(links[:start, :start])
        for _ in ends:  # each turn follows the links by one more layer
            linked = x[start:end, :start] @ known
            x[start:end, :start] = (linked - forcing) / gap
        links[start:end, :start] = np.where(same, forcing - linked, 0.0)
    return (back @ x @ pairs).real, (back @ links @ pairs).real


def _pairs(form: ModalForm) -> sparse.csr_array:
    """The unitary way from real coordinates to those in which a pair is two complex modes."""
    first = np.flatnonzero(form.partner > np.arange(len(form.partner)))
    second = form.partner[first]
    ways = np.where(form.partner == np.arange(len(form.partner)), 1.0, sqrt(0.5)).astype(complex)
    ways[second] *= 1j
    other = np.full(len(first), sqrt(0.5), dtype=complex)
    row = np.concatenate([np.arange(len(ways)), first, second])
    column = np.concatenate([np.arange(len(ways)), second, first])
    return sparse.csr_array((np.concatenate([ways, -1j * other, other]), (row, column)))
