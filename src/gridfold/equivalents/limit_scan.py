"""External machines whose limits a run would reach: found beforehand, so that they can be retained."""

from __future__ import annotations

from collections.abc import Collection
from typing import NamedTuple

from gridfold.dynamics.prime_movers import limited_by_any_swing, mover_limits
from gridfold.dynamics.unit_limits import limits_passed, limits_touched
from gridfold.equivalents.swings import Swings
from gridfold.errors import OptionError
from gridfold.grid.case import UnitKey
from gridfold.partition import Partition

#: Samples at which limits are looked at: every one of so many.
_EVERY = 5


class LimitedUnit(NamedTuple):
    """A machine, and the names of its limits that acted."""

    unit: UnitKey
    limits: tuple[str, ...]


def limited_units(parts: Partition, swings: Swings) -> tuple[LimitedUnit, ...]:
    """External machines whose limits act along sample swings of the detailed model.

    Neither limits that are held at the start count, nor those of prime movers that stay exact in a
    folded area.

    Parameters
    ----------
    parts : Partition
        Study and external area.
    swings : tuple of ndarrays
        From :func:`sample_swings`.

    Returns
    -------
    tuple of LimitedUnit
        In order of the external machines.
    """
    model, units = parts.model, parts.external_units
    known = {*limits_touched(model, model.x0, units)}
    known |= mover_limits(model, limited_by_any_swing(model, model.x0, units))
    found: set[str] = set()
    for states in swings:
        found |= limits_passed(model, states[::_EVERY], units).keys()
    names = sorted(found - known)
    limits = {unit: tuple(n for n in names if n.endswith(f" {unit}")) for unit in units}
    return tuple(LimitedUnit(unit, own) for unit, own in limits.items() if own)


def limited_among(
    parts: Partition, swings: Swings, chosen: Collection[UnitKey] = ()
) -> set[UnitKey]:
    """Machines to retain: `chosen` external ones, and those whose limits act along the swings.

    Raises
    ------
    OptionError
        None is left to be linear, because limits act.
    """
    limited = {item.unit for item in limited_units(parts, swings)}
    found = limited | set(chosen)
    if limited and len(found) == len(parts.external_units):
        raise OptionError(
            f"all external machines are retained, {len(limited)} of them because their limits act "
            "in sample swings: none is left to be linear"
        )
    return found
