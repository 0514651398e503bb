"""Whether bases serve another linearization of the area than the one that they were found for."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gridfold.dynamics.model import DetailedModel
from gridfold.equivalents.area_bases import Bases, missed
from gridfold.numerics.modal_form import modal_form
from gridfold.partition.port_area import PortArea

#: How many times as much as of their own area, or as the bound, bases may miss after a trip.
MOST_MISSED = 10.0
#: By how much (1/s) a mode may grow faster on bases of another area than any did there. A projection
#: keeps what it is asked for at one rate of swings, and may be unstable all the same.
MOST_GROWTH = 0.05


def serve(bases: Bases, miss: float, times: float = 1.0) -> bool:
    """Whether bases miss (p.u.) no more than so many times what they may miss of their own area."""
    return miss <= times * max(bases.miss, bases.bound or 0.0)


def growth_on(bases: Bases, applied: NDArray[np.float64]) -> float:
    """Largest real part of the modes of a projected area, in 1/s; `applied` is A T~."""
    return float(np.linalg.eigvals(bases.restrict @ applied).real.max(initial=-np.inf))


def grows(growth: float, usual: float) -> bool:
    """Whether a mode grows that does not on the area of the bases, where one grows by `usual` (1/s)."""
    return growth > max(usual, 0.0) + MOST_GROWTH


def without_growth(bases: Bases, applied: NDArray[np.float64], usual: float) -> Bases:
    """The bases without the modes of the projected area that grow; `applied` is A T~.

    Where the modes cannot be told apart they are all kept.
    """
    form = modal_form(bases.restrict @ applied)
    if form is None:
        return bases
    kept = np.array([not grows(rate, usual) for rate in form.diagonal], dtype=bool)
    return replace(
        bases,
        lift=bases.lift @ form.basis[:, kept],
        restrict=form.inverse[kept] @ bases.restrict,
    )


def serving(
    area: PortArea,
    candidates: Iterable[tuple[PortArea, DetailedModel]],
    find: Callable[[PortArea, DetailedModel], Sequence[Bases]],
) -> Sequence[Bases]:
    """The bases that `find` gives for the first of `candidates` on which `area` is served too.

    The last candidate is `area` itself; each comes with the model of which it is a part.
    """
    for candidate, model in candidates:
        found = find(candidate, model)
        if candidate is area or all(_serve_both(bases, candidate, area) for bases in found):
            return found
    raise ValueError("the area itself is not among the candidates")


def _serve_both(bases: Bases, own: PortArea, other: PortArea) -> bool:
    applied = other.system.apply(bases.lift)
    usual = growth_on(bases, own.system.apply(bases.lift))
    return not grows(growth_on(bases, applied), usual) and serve(
        bases, missed(bases, other, applied)
    )
