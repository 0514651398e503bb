"""What units and switched shunts hold in the power flow, and within which limits.

A case keeps the stored operating point; these records say how it would move
(:func:`gridfold.powerflow.limits.with_limits`). They have no part in comparisons or fingerprints.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple


class UnitControl(NamedTuple):
    """Set point and limits of a generator.

    Parameters
    ----------
    bus : int
        Its bus number.
    id : str
        Its id.
    set_point_pu : float
        Voltage that it holds at `regulated_bus`.
    regulated_bus : int
        Bus number; its own or a remote one.
    reactive_min_mvar, reactive_max_mvar : float
        Limits of its reactive power.
    part : float
        Its part of the reactive power where plants at several buses hold the voltage of one.
    """

    bus: int
    id: str
    set_point_pu: float
    regulated_bus: int
    reactive_min_mvar: float
    reactive_max_mvar: float
    part: float = 100.0


class ShuntMode(Enum):
    """How a switched shunt follows the voltage."""

    LOCKED = "locked"
    DISCRETE = "discrete"
    CONTINUOUS = "continuous"
    OTHER = "other"


@dataclass(frozen=True)
class ShuntControl:
    """Control of a switched shunt.

    Parameters
    ----------
    bus : int
        Its bus number.
    id : str
        Id of the :class:`~gridfold.grid.case.Shunt` that it is.
    mode : ShuntMode
        How it follows the voltage; OTHER is what follows something else, and stays as stored.
    voltage_min_pu, voltage_max_pu : float
        Band in which it stays as it is.
    regulated_bus : int
        Bus number; its own or a remote one.
    blocks : tuple of (int, float)
        Steps and Mvar of each at 1 p.u., in the order in which they are switched.
    """

    bus: int
    id: str
    mode: ShuntMode
    voltage_min_pu: float
    voltage_max_pu: float
    regulated_bus: int
    blocks: tuple[tuple[int, float], ...] = ()

    @property
    def levels(self) -> tuple[float, ...]:
        """Mvar that can be switched on, ascending: reactors in their order, none, capacitors."""
        below, above = [0.0], [0.0]
        for steps, mvar in self.blocks:
            side = above if mvar > 0 else below
            for _ in range(steps):
                side.append(side[-1] + mvar)
        return tuple(sorted({*below, *above}))

    def __str__(self) -> str:
        return f"switched shunt {self.bus}:{self.id}"


FlowControl = UnitControl | ShuntControl
