"""Which external machines to retain: those whose linearization changes most of what the area does.

Along a few swings of the detailed model, the defect of the linearization

    d = f(x) - A (x - x0)

tells for each machine how much power its rotor would be lacking if everything were linear, 2 H d of
the row of its speed. A common turn of all rotor angles changes neither f nor A (x - x0), so it is no
defect. The root mean square of that power, times the machine's column norm, is its score.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gridfold.dynamics.descriptor import grid_descriptor
from gridfold.dynamics.model import DetailedModel
from gridfold.dynamics.unit_limits import touched_held
from gridfold.equivalents.swings import Swings, sample_swings
from gridfold.errors import OptionError
from gridfold.grid.case import UnitKey
from gridfold.numerics.blas import one_blas_thread
from gridfold.partition import Partition, couple


@dataclass(frozen=True)
class Ranking:
    """External machines in the order in which to retain them.

    Parameters
    ----------
    units : tuple of UnitKey
        All external machines, the most important first.
    scores : ndarray, shape (n_external,)
        Score of each: `power_defects` times `norms`.
    power_defects : ndarray, shape (n_external,)
        Root mean square over all samples of the power that the linearization misses, in p.u. of the
        system; 0 for units without a rotor.
    norms : ndarray, shape (n_external,)
        Column norm (13) of each, in p.u.
    """

    units: tuple[UnitKey, ...]
    scores: NDArray[np.float64]
    power_defects: NDArray[np.float64]
    norms: NDArray[np.float64]

    def first(self, n: int) -> tuple[UnitKey, ...]:
        """The `n` most important machines."""
        if not 0 <= n <= len(self.units):
            raise OptionError(f"of {len(self.units)} external machines {n} cannot be taken")
        return self.units[:n]


@one_blas_thread
def rank_retained(parts: Partition, swings: Swings | None = None) -> Ranking:
    """Rank the external machines by what their linearization misses in sample swings.

    Parameters
    ----------
    parts : Partition
        Study and external area.
    swings : tuple of ndarrays, optional
        From :func:`sample_swings`, those after boundary faults by default.
    """
    samples = sample_swings(parts) if swings is None else swings
    coupling, units = couple(parts), parts.external_units
    powers = _power_defects(parts.model, samples, units)
    scores = powers * coupling.norms
    order = np.lexsort((-coupling.norms, -scores))
    ranked = tuple(units[k] for k in order)
    return Ranking(ranked, scores[order], powers[order], coupling.norms[order])


def _power_defects(
    model: DetailedModel, samples: Swings, units: Sequence[UnitKey]
) -> NDArray[np.float64]:
    """Root mean square of 2 H d of the speed of each of `units`, in p.u., shape (n_units,)."""
    rotors = tuple(unit for unit in units if unit in set(model.machines))
    rows, weight = model.slots("speed", rotors), 2 * model.inertia(rotors)
    grid = grid_descriptor(touched_held(model, model.x0, units), model.x0)
    total, count = np.zeros(len(rotors)), 0
    for states in samples:
        linear = grid.apply((states - model.x0).T)[rows].T
        exact = np.array([model.compiled(x)[rows] for x in states])
        total += ((exact - linear) ** 2).sum(axis=0)
        count += len(states)
    found = dict(zip(rotors, weight * np.sqrt(total / count), strict=True))
    return np.array([found.get(unit, 0.0) for unit in units])
