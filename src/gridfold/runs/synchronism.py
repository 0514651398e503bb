"""When a machine counts as having lost synchronism, or as being off speed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gridfold.dynamics.layout import ROTOR_ANGLE, infinite_buses
from gridfold.dynamics.model import DetailedModel
from gridfold.errors import OptionError
from gridfold.grid.case import UnitKey
from gridfold.numerics.rows import less_reference
from gridfold.numerics.watch import SpreadWatch
from gridfold.simulation.segment import Stop
from gridfold.systems.status import Status


@dataclass(frozen=True)
class SynchronismCriterion:
    """When a run ends as unstable; the limits are checked at every time step.

    A machine has lost synchronism once its rotor is `limit_deg` away from its island's reference: the
    centre of inertia of the island's machines, or the infinite bus of the island if it has one. It is
    off speed once its speed is `speed_limit` away from synchronous speed. Machines of an island can be
    that and yet in step with each other.

    Parameters
    ----------
    limit_deg : float
        In degrees.
    speed_limit : float
        In per unit of synchronous speed; overspeed protection trips turbines at 1.1 to 1.12. Infinity
        lets machines run at any speed.
    """

    limit_deg: float = 180.0
    speed_limit: float = 0.12

    def __post_init__(self) -> None:
        if not self.speed_limit > 0:
            raise OptionError(
                f"the speed limit must be a positive number in p.u., not {self.speed_limit!r}"
            )
        if not (np.isfinite(self.limit_deg) and self.limit_deg > 0):
            raise OptionError(
                f"the angle limit must be a positive number of degrees, not {self.limit_deg!r}"
            )

    def __str__(self) -> str:
        return (
            f"a rotor more than {self.limit_deg:g} degrees from the centre of inertia of its island "
            "(from the infinite bus, if there is one)"
        ) + (
            f", or a speed more than {self.speed_limit:g} p.u. from synchronous speed"
            if np.isfinite(self.speed_limit)
            else ""
        )

    def stops(self, model: DetailedModel) -> tuple[Stop, ...]:
        """What ends a run, for the network state of `model`."""
        return self.stops_of(angle_frame(model))

    def stops_of(self, frame: AngleFrame) -> tuple[Stop, ...]:
        """The same where machines and their references are known."""
        apart = SpreadWatch(
            frame.slots, frame.island, frame.inertia, frame.fixed, np.deg2rad(self.limit_deg)
        )
        speeds = frame.speed_slots
        fast = SpreadWatch(
            speeds, np.zeros_like(speeds), np.ones(len(speeds)), np.ones(1), self.speed_limit
        )
        return Stop(apart, Status.LOST_SYNCHRONISM), Stop(fast, Status.OFF_SPEED)


DEFAULT_CRITERION = SynchronismCriterion()
#: Where a model keeps its frame, which is looked at many times.
_FRAME = "angle_frame"


@dataclass(frozen=True)
class AngleFrame:
    """Machines in service and the angle references of their islands.

    Parameters
    ----------
    units : tuple of UnitKey
        Machines with a rotor that are in service.
    slots : ndarray of int, shape (n_units,)
        Positions of their rotor angles in the state vector.
    island : ndarray of int, shape (n_units,)
        Island of each, counted from 0.
    inertia : ndarray, shape (n_units,)
        Weight of each in its island's centre of inertia.
    fixed : ndarray, shape (n_islands,)
        Angle in rad of an infinite bus in the island; NaN where there is none.
    speed_units : tuple of UnitKey
        Those of the machines whose speed is a state.
    speed_slots : ndarray of int
        Positions of these speeds in the state vector.
    """

    units: tuple[UnitKey, ...]
    slots: NDArray[np.int64]
    island: NDArray[np.int64]
    inertia: NDArray[np.float64]
    fixed: NDArray[np.float64]
    speed_units: tuple[UnitKey, ...]
    speed_slots: NDArray[np.int64]

    def references(self, states: NDArray[np.float64]) -> NDArray[np.float64]:
        """Reference angle in rad for each unit along `states`, shape (n_times, n_units)."""
        return self.references_of(states[:, self.slots])

    def references_of(self, angles: NDArray[np.float64]) -> NDArray[np.float64]:
        """The same from the units' rotor angles, (n_times, n_units); read only."""
        means = self._means(angles)
        if len(self.fixed) == 1:
            return np.broadcast_to(means, angles.shape)
        return np.asarray(means[:, self.island])

    def relative(self, angles: NDArray[np.float64]) -> NDArray[np.float64]:
        """Rotor angles less these references, in rad, shape (n_times, n_units)."""
        means = self._means(angles)
        if len(self.fixed) == 1:
            return less_reference(angles, means[:, 0])
        return np.asarray(angles - means[:, self.island])

    def _means(self, angles: NDArray[np.float64]) -> NDArray[np.float64]:
        """Reference angle of each island, shape (n_times, n_islands)."""
        shares = np.zeros((len(self.units), len(self.fixed)))
        shares[np.arange(len(self.units)), self.island] = self.inertia
        total = shares.sum(axis=0)
        means = angles @ (shares / np.where(total, total, 1.0))
        known = ~np.isnan(self.fixed)
        means[:, known] = self.fixed[known]
        return np.asarray(means)


def angle_frame(model: DetailedModel) -> AngleFrame:
    """Machines in service and the references of their islands, in the network state of `model`."""
    known: AngleFrame | None = vars(model).get(_FRAME)
    if known is None:
        known = vars(model)[_FRAME] = _angle_frame(model)
    return known


def share_angle_frame(known: DetailedModel, other: DetailedModel) -> None:
    """Have `other`, with the same machines in service and the same islands, take a known frame."""
    vars(other)[_FRAME] = angle_frame(known)


def _angle_frame(model: DetailedModel) -> AngleFrame:
    out = model.state.units_out
    units = tuple(unit for unit in model.machines if unit not in out)
    labels = model.equations.islands.labels
    index = model.case.bus_index
    raw = np.array([labels[index[unit.bus]] for unit in units], dtype=np.int64)
    present, island = np.unique(raw, return_inverse=True)
    fixed = np.full(len(present), np.nan)
    for unit, angle in infinite_buses(model.layout).items():
        here = np.flatnonzero(present == labels[index[unit.bus]])
        if unit not in out:
            fixed[here] = angle
    speeds = model.layout.speed_states
    turning = tuple(unit for unit in units if unit in speeds)
    return AngleFrame(
        units,
        model.slots(ROTOR_ANGLE, units),
        island.astype(np.int64),
        model.inertia(units),
        fixed,
        turning,
        np.array([speeds[unit] for unit in turning], dtype=np.int64),
    )
