"""External machines whose limits a run would reach: found beforehand, so that they can be retained."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from gridfold.dynamics.prime_movers import limited_by_any_swing, mover_limits
from gridfold.dynamics.unit_limits import limits_along, limits_touched
from gridfold.grid.case import UnitKey
from gridfold.grid.events import BusFault, Event
from gridfold.numerics.steppers import Stepper
from gridfold.partition import Partition
from gridfold.runs.simulate import simulate
from gridfold.runs.trajectory import Trajectory

#: Duration of the sample faults and length of the sample runs, both in seconds.
SAMPLE_FAULT, SAMPLE_END = 0.1, 5.0
#: Samples at which limits are looked at: every one of so many.
_EVERY = 5


class LimitedUnit(NamedTuple):
    """A machine, and its limits that acted: name, and the earliest time (s) in a sample run."""

    unit: UnitKey
    reasons: tuple[tuple[str, float], ...]


def limited_units(
    parts: Partition,
    samples: Sequence[Sequence[Event]] | None = None,
    t_end: float = SAMPLE_END,
    stepper: Stepper | None = None,
) -> tuple[LimitedUnit, ...]:
    """External machines whose limits act after sample disturbances in the detailed model.

    Neither limits that are held at the start count, nor those of prime movers that stay exact in a
    folded area, nor what acts only while a fault is on, when the detailed model is in use.

    Parameters
    ----------
    parts : Partition
        Study and external area.
    samples : sequence of sequences of events, optional
        One detailed run each; a fault of 0.1 s at each boundary bus of the study area by default.
    t_end : float
        End of each run in seconds.
    stepper : Stepper, optional
        As in :func:`gridfold.simulate`.

    Returns
    -------
    tuple of LimitedUnit
        In order of the external machines.
    """
    model, units = parts.model, parts.external_units
    if samples is None:
        samples = [[BusFault(bus, duration=SAMPLE_FAULT)] for bus in parts.boundary_buses]
    known = {*limits_touched(model, model.x0, units)}
    known |= mover_limits(model, limited_by_any_swing(model, model.x0, units))
    first: dict[str, float] = {}
    for events in samples:
        run = simulate(model, events, t_end, stepper)
        for name, time in _acted(run, units).items():
            first[name] = min(time, first.get(name, time))
    found = sorted((item for item in first.items() if item[0] not in known), key=lambda i: i[1])
    reasons = {
        unit: tuple((name, time) for name, time in found if name.endswith(f" {unit}"))
        for unit in units
    }
    return tuple(LimitedUnit(unit, why) for unit, why in reasons.items() if why)


def _acted(run: Trajectory, units: Sequence[UnitKey]) -> dict[str, float]:
    """Limits that acted while no fault was on, and when (s) that was first seen."""
    first: dict[str, float] = {}
    for piece, model in zip(run.run.pieces, run.models, strict=False):
        if model.state.faulted:
            continue
        times = piece.times[::_EVERY]
        for name, acts in limits_along(model, piece.full_states[::_EVERY], units).items():
            if acts.any():
                first.setdefault(name, float(times[int(acts.argmax())]))
    return first
