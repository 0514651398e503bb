"""Which external machines to retain: those whose linearization changes most of what the area does.

Along a few swings of the detailed model, the defect of the linearization

    d = f(x) - A (x - x0)

tells for each machine how much power its rotor would be lacking if everything were linear, 2 H d of
the row of its speed. A common turn of all rotor angles changes neither f nor A (x - x0), so it is no
defect. The root mean square of that power, times the machine's column norm, is its score.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gridfold.dynamics.descriptor import grid_descriptor
from gridfold.dynamics.model import DetailedModel
from gridfold.dynamics.unit_limits import without_touched
from gridfold.errors import OptionError
from gridfold.grid.case import UnitKey
from gridfold.grid.events import BusFault, Event
from gridfold.numerics.blas import one_blas_thread
from gridfold.numerics.steppers import Stepper
from gridfold.partition import Partition, couple
from gridfold.runs.simulate import simulate
from gridfold.runs.trajectory import Trajectory
from gridfold.systems.status import Status

#: Sample swings follow faults of so many seconds at so many boundary buses at most.
FAULT_SECONDS, MOST_FAULTS = 0.1, 4
#: How often a fault is halved until no machine loses synchronism.
_HALVED = 4


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
def rank_retained(
    parts: Partition,
    events: Sequence[Sequence[Event]] | None = None,
    t_end: float = 3.0,
    stepper: Stepper | None = None,
) -> Ranking:
    """Rank the external machines by what their linearization misses in sample swings.

    Parameters
    ----------
    parts : Partition
        Study and external area.
    events : sequence of sequences of Event, optional
        One sequence for each sample swing. By default each is a fault of 0.1 s at one of up to four
        boundary buses of the study area, halved until no machine loses synchronism.
    t_end : float
        End of each swing in seconds.
    stepper : Stepper, optional
        As in :func:`gridfold.simulate`; every step after which the network is intact is a sample.

    Raises
    ------
    OptionError
        There is no sample: the network is intact at no time after an event.
    """
    if events is None:
        runs = [_boundary_swing(parts, bus, t_end, stepper) for bus in _spread(parts)]
    else:
        runs = [simulate(parts.model, swing, t_end, stepper) for swing in events]
    samples = [states for run in runs for states in _swinging(run)]
    if not samples:
        raise OptionError("no sample swing has a time at which the network is intact again")
    coupling, units = couple(parts), parts.external_units
    powers = _power_defects(parts.model, samples, units)
    scores = powers * coupling.norms
    order = np.lexsort((-coupling.norms, -scores))
    ranked = tuple(units[k] for k in order)
    return Ranking(ranked, scores[order], powers[order], coupling.norms[order])


def _spread(parts: Partition) -> list[int]:
    """Up to four boundary buses, spread over all of them."""
    buses = parts.boundary_buses
    chosen = np.linspace(0, len(buses) - 1, min(len(buses), MOST_FAULTS))
    return [buses[k] for k in chosen.round().astype(int)]


def _boundary_swing(
    parts: Partition, bus: int, t_end: float, stepper: Stepper | None
) -> Trajectory:
    """The swing after a fault; the last try counts even if synchronism is lost."""
    fault = BusFault(bus, duration=FAULT_SECONDS)
    run = simulate(parts.model, [fault], t_end, stepper)
    for _ in range(_HALVED):
        if run.status is not Status.LOST_SYNCHRONISM:
            break
        fault = replace(fault, duration=fault.duration / 2)
        run = simulate(parts.model, [fault], t_end, stepper)
    return run


def _swinging(run: Trajectory) -> Iterator[NDArray[np.float64]]:
    """States (n_times, n_states) of the pieces after an event in which the network is intact."""
    for piece, model in zip(run.run.pieces[1:], run.models[1:], strict=False):
        if model.state == run.model.state:
            yield piece.full_states


def _power_defects(
    model: DetailedModel, samples: Sequence[NDArray[np.float64]], units: Sequence[UnitKey]
) -> NDArray[np.float64]:
    """Root mean square of 2 H d of the speed of each of `units`, in p.u., shape (n_units,)."""
    rotors = tuple(unit for unit in units if unit in set(model.machines))
    rows, weight = model.slots("speed", rotors), 2 * model.inertia(rotors)
    grid = grid_descriptor(without_touched(model, model.x0, units), model.x0)
    total, count = np.zeros(len(rotors)), 0
    for states in samples:
        linear = grid.apply((states - model.x0).T)[rows].T
        exact = np.array([model.compiled(x)[rows] for x in states])
        total += ((exact - linear) ** 2).sum(axis=0)
        count += len(states)
    found = dict(zip(rotors, weight * np.sqrt(total / count), strict=True))
    return np.array([found.get(unit, 0.0) for unit in units])
