"""Whether bases serve another linearization of the area than the one that they were found for."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gridfold.dynamics.model import DetailedModel
from gridfold.equivalents.area_bases import Bases, missed
from gridfold.partition.port_area import PortArea

#: How many times as much as of their own area, or as the bound, bases may miss of another one.
MOST_MISSED = 10.0
#: By how much (1/s) a mode may grow faster on bases of another area than any did there. A projection
#: keeps what it is asked for at one rate of swings, and may be unstable all the same.
MOST_GROWTH = 0.05


class Service(NamedTuple):
    """Whether bases serve an area, and what is to be said of it."""

    enough: bool
    told: str


def service(
    bases: Bases, area: PortArea, usual: float, applied: NDArray[np.float64] | None = None
) -> Service:
    """Whether `bases` serve `area`; on their own area no mode grows by more than `usual` (1/s).

    `applied` is A T~ of `area`, if that is known.
    """
    known = area.system.apply(bases.lift) if applied is None else applied
    miss, growth = missed(bases, area, known), growth_on(bases, known)
    told = f"the bases of the intact network miss {miss:.2g} p.u. of it ({bases.miss:.2g} there)"
    if growth > max(usual, 0.0) + MOST_GROWTH:
        return Service(False, f"{told}; on them a mode grows by {growth:.2g} 1/s")
    return Service(miss <= MOST_MISSED * max(bases.miss, bases.bound or 0.0), told)


def growth_on(bases: Bases, applied: NDArray[np.float64]) -> float:
    """Largest real part of the modes of a projected area, in 1/s; `applied` is A T~."""
    return float(np.linalg.eigvals(bases.restrict @ applied).real.max(initial=-np.inf))


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
    usual = growth_on(bases, own.system.apply(bases.lift))
    return service(bases, other, usual).enough
