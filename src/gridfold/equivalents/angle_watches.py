"""Angle deviations and loss of synchronism, watched in the coordinates of a small model."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gridfold.dynamics.model import DetailedModel
from gridfold.equivalents.families import ModelFamily, SmallModel
from gridfold.numerics.watch import BandWatch, Watch
from gridfold.runs.synchronism import SynchronismCriterion, angle_frame
from gridfold.simulation.segment import Segment


def deviation_rows(model: DetailedModel, family: ModelFamily) -> NDArray[np.float64]:
    """Rows that give each study machine's rotor angle against the reference machine."""
    units = [unit for unit in family.study_units if unit in model.machines]
    units = [unit for unit in units if unit not in model.state.units_out]
    rows = np.zeros((len(units), model.n_states))
    rows[np.arange(len(units)), model.slots("rotor_angle", tuple(units))] = 1.0
    rows[:, model.slots("rotor_angle", (family.reference_unit,))] -= 1.0
    return rows


class Deviation(NamedTuple):
    """A condition on the deviations rows @ x + offset (rad): one beyond the limit, or all inside."""

    rows: NDArray[np.float64]
    offset: NDArray[np.float64]
    limit: float
    inside: bool


def watched_segment(
    model: DetailedModel,
    small: SmallModel | None,
    end: float,
    label: str,
    deviations: Sequence[Deviation],
    criterion: SynchronismCriterion | None,
    further: Sequence[Watch] = (),
) -> Segment:
    """A segment with its watches, in the coordinates of its system; `further` ones switch, too."""
    if small is None:
        stops = () if criterion is None else (criterion.watch(model),)
        return Segment(model, end, label, stops, tuple(BandWatch(*each) for each in deviations))
    stop_watches: tuple[BandWatch, ...] = ()
    if criterion is not None:
        rows, offset = _spread_rows(model)
        limit = float(np.deg2rad(criterion.limit_deg))
        stop_watches = (_band(small, rows, offset, limit, inside=False),)
    switches = tuple(_band(small, *each) for each in deviations)
    every = (*switches, *further)
    return Segment(small.system, end, label, stop_watches, every, small.coordinates)


def _spread_rows(model: DetailedModel) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Distances from the island's reference as rows and offsets over the whole system's states."""
    frame = angle_frame(model)
    rows = np.zeros((len(frame.units), model.n_states))
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


def _band(
    small: SmallModel,
    rows: NDArray[np.float64],
    offset: NDArray[np.float64],
    limit: float,
    inside: bool,
) -> BandWatch:
    """A band over the whole system's states as one over the small system's."""
    origin, slopes = small.affine
    used = np.flatnonzero(rows.any(axis=0))
    matrix = rows[:, used] @ slopes[:, used].T
    return BandWatch(matrix, rows @ origin + offset, limit, inside)
