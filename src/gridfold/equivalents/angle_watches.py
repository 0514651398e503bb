"""Angle deviations, loss of synchronism and speeds, watched in the coordinates of a small model."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gridfold.dynamics.model import DetailedModel
from gridfold.equivalents.families import ModelFamily, SmallModel
from gridfold.grid.case import UnitKey
from gridfold.numerics.band_watch import BandWatch
from gridfold.numerics.watch import Watch
from gridfold.runs.synchronism import AngleFrame, SynchronismCriterion, angle_frame
from gridfold.simulation.segment import Stop
from gridfold.systems.status import Status


class AngleWatches:
    """Watches on the rotor angles in one model of a family, in one network state; each is made once.

    Parameters
    ----------
    model : DetailedModel
        The whole system in the network state.
    family : ModelFamily or None
        The family about its operating point; None where there is none.
    small : SmallModel or None
        The small model; None for the detailed one.
    """

    def __init__(
        self, model: DetailedModel, family: ModelFamily | None, small: SmallModel | None
    ) -> None:
        units = () if family is None else _study_machines(model, family)
        self._n_states, self._small = model.n_states, small
        self._angles = model.slots("rotor_angle", units)
        self._every = model.slots("rotor_angle", model.machines)
        reference = None if family is None else family.reference_unit
        self._reference = model.slots("rotor_angle", () if reference is None else (reference,))
        self._start = np.zeros(len(units))
        if family is not None:
            self._start = self._apart(family.origin)
        self._model = model
        self._stops: dict[SynchronismCriterion, tuple[Stop, ...]] = {}
        self._bands: dict[tuple[float, bool, int], Watch] = {}

    @cached_property
    def _frame(self) -> AngleFrame:
        return angle_frame(self._model)

    def largest_deviation(self, x: NDArray[np.float64]) -> float:
        """Largest angle deviation of a study machine at the state `x` (n_states,), in degrees."""
        apart = self._apart(x) - self._start
        return float(np.rad2deg(np.abs(apart).max(initial=0.0)))

    def _apart(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Angles from the reference, which stays at 0 where there is none, in rad."""
        return np.asarray(x[self._angles] - x[self._reference].sum())

    def jump(self, x: NDArray[np.float64]) -> float:
        """Largest change of a rotor angle in degrees when the small model takes over at `x`."""
        if self._small is None:
            return 0.0
        coordinates = self._small.coordinates
        again = coordinates.lift(coordinates.restrict(x))
        return float(np.rad2deg(np.abs((again - x)[self._every]).max(initial=0.0)))

    def stops(self, criterion: SynchronismCriterion) -> tuple[Stop, ...]:
        """What ends a run."""
        if criterion not in self._stops:
            if self._small is None:
                self._stops[criterion] = criterion.stops_of(self._frame)
            else:
                limit = float(np.deg2rad(criterion.limit_deg))
                apart = self._band(*self._distances(), limit, inside=False)
                fast = self._band(*self._speeds(), criterion.speed_limit, inside=False)
                self._stops[criterion] = (
                    Stop(apart, Status.LOST_SYNCHRONISM),
                    Stop(fast, Status.OFF_SPEED),
                )
        return self._stops[criterion]

    def deviation(self, limit_deg: float, inside: bool, steps: int = 1) -> Watch:
        """Holds when a deviation is beyond the limit, or with `inside` when all are within it.

        That has to be so for as many `steps` in a row.
        """
        key = limit_deg, inside, steps
        if key not in self._bands:
            rows = np.zeros((len(self._angles), self._n_states))
            rows[np.arange(len(rows)), self._angles] = 1.0
            rows[:, self._reference] -= 1.0
            limit = float(np.deg2rad(limit_deg))
            self._bands[key] = self._band(rows, -self._start, limit, inside, steps)
        return self._bands[key]

    def _distances(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Distances from the island's reference as rows and offsets over the whole's states."""
        frame = self._frame
        rows = np.zeros((len(frame.units), self._n_states))
        offset = np.zeros(len(frame.units))
        rows[np.arange(len(frame.units)), frame.slots] = 1.0
        for island, fixed in enumerate(frame.fixed):
            members = np.flatnonzero(frame.island == island)
            if np.isnan(fixed):
                weights = frame.inertia[members] / frame.inertia[members].sum()
                rows[np.ix_(members, frame.slots[members])] -= weights
            else:
                offset[members] -= fixed
        return rows, offset

    def _speeds(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Speeds less synchronous speed, as rows and offsets over the whole's states."""
        slots = self._frame.speed_slots
        rows = np.zeros((len(slots), self._n_states))
        rows[np.arange(len(slots)), slots] = 1.0
        return rows, -np.ones(len(slots))

    def _band(
        self,
        rows: NDArray[np.float64],
        offset: NDArray[np.float64],
        limit: float,
        inside: bool,
        steps: int = 1,
    ) -> BandWatch:
        """A band over the whole's states, in the coordinates of the small model."""
        if self._small is None:
            return BandWatch(rows, offset, limit, inside, steps)
        used = np.flatnonzero(rows.any(axis=0))
        origin, slopes = self._small.rows(used)
        matrix = np.ascontiguousarray(rows[:, used] @ slopes)
        return BandWatch(matrix, rows[:, used] @ origin + offset, limit, inside, steps)


def _study_machines(model: DetailedModel, family: ModelFamily) -> tuple[UnitKey, ...]:
    """Machines of the study area that are in service."""
    machines = set(model.machines) - model.state.units_out
    return tuple(unit for unit in family.study_units if unit in machines)
