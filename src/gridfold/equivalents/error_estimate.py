"""How wrong a run with small models is, estimated from the run itself.

The run, lifted to the whole system, misses the detailed equations by a defect. That drives the error
(:mod:`gridfold.numerics.defect`), which also has the jumps where models take over from each
other. The error travels in the modes of an area that is reduced more finely than the run's own, with
everything linear.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from gridfold.dynamics.model import DetailedModel
from gridfold.equivalents.adaptive import AdaptiveRun
from gridfold.equivalents.families import Mode, SmallModel
from gridfold.equivalents.folded import fold
from gridfold.equivalents.small_models import SmallModels
from gridfold.equivalents.swings import Swings
from gridfold.grid.case import UnitKey
from gridfold.numerics.blas import one_blas_thread
from gridfold.numerics.defect import carry_error
from gridfold.partition import Partition
from gridfold.reduction import BalancedTruncation
from gridfold.runs.synchronism import angle_frame
from gridfold.simulation.segment import Piece
from gridfold.systems.modal import ModalSystem

#: Bound of the area in which errors travel, in p.u. of port voltage.
FINE_TOLERANCE = 1e-5
#: Time between the instants at which the detailed equations are looked at, in s.
EVERY = 0.05


@dataclass(frozen=True)
class ErrorEstimate:
    """Estimated errors of rotor angles against the centre of inertia of their island.

    Parameters
    ----------
    units : tuple of UnitKey
        Machines of the study area.
    times : ndarray, shape (n_times,)
        In seconds.
    angles_deg : ndarray, shape (n_times, n_units)
        The detailed run less the run, in degrees; NaN where a machine is out.
    """

    units: tuple[UnitKey, ...]
    times: NDArray[np.float64] = field(repr=False)
    angles_deg: NDArray[np.float64] = field(repr=False)

    @property
    def rms_deg(self) -> NDArray[np.float64]:
        """Root mean square over the run of each machine, shape (n_units,); 0 for one always out."""
        squares = np.nan_to_num(self.angles_deg) ** 2
        span = self.times[-1] - self.times[0]
        return np.sqrt(np.trapezoid(squares, self.times, axis=0) / span)

    @property
    def worst_deg(self) -> float:
        """That of the machine with the largest, as ``relative_rms_deg`` of a comparison measures it."""
        return float(self.rms_deg.max(initial=0.0))

    @property
    def worst_unit(self) -> UnitKey:
        """The machine with the largest."""
        return self.units[int(self.rms_deg.argmax())]


class ErrorEstimator:
    """Estimates errors of runs about one operating point and the topologies that follow from it.

    Parameters
    ----------
    parts : Partition
        Study and external area.
    swings : tuple of ndarrays, optional
        From :func:`gridfold.sample_swings`, those after boundary faults by default.
    """

    def __init__(self, parts: Partition, swings: Swings | None = None) -> None:
        self.units = parts.study_units
        self._model = parts.model
        area = fold(parts, reducer=BalancedTruncation(FINE_TOLERANCE), swings=swings)
        self._modes = SmallModels(area)
        self._intact = _modes_of(self._modes.get(parts.model, Mode.WHOLE))

    @one_blas_thread
    def estimate(self, run: AdaptiveRun) -> ErrorEstimate | None:
        """Errors along a run; None where the network has no modes in which errors could travel."""
        pieces, models = run.trajectory.run.pieces, run.trajectory.models
        modes, error = self._intact, None
        times, angles = [], []
        for k, (piece, mode, model) in enumerate(zip(pieces, run.modes, models, strict=False)):
            if not model.state.faulted:
                modes = _modes_of(self._modes.get(model, Mode.WHOLE)) or modes
            if modes is None:
                return None
            if k:
                jump = pieces[k - 1].full_states[-1] - piece.full_states[0]
                error = jump if error is None else error + jump
            if mode is Mode.DETAILED and (error is None or not error.any()):
                times.append(piece.times[[0, -1]])
                angles.append(np.zeros((2, len(self.units))))
                continue
            index = _samples(piece)
            start = np.zeros(len(modes.slopes)) if error is None else modes.restrict @ error
            carried = _carried(piece, mode, model, modes, index, start)
            error = carried[-1] @ modes.slopes
            times.append(piece.times[index])
            angles.append(np.rad2deg(carried @ self._rows(model, modes).T))
        return ErrorEstimate(self.units, np.concatenate(times), np.concatenate(angles))

    def _rows(self, model: DetailedModel, modes: _Modes) -> NDArray[np.float64]:
        """Angles of the study machines against their islands' centres in the modes, (n_units, r)."""
        frame, turned = angle_frame(model), modes.slopes[:, angle_frame(model).slots].T
        rows = np.full((len(self.units), turned.shape[1]), np.nan)
        place = {unit: k for k, unit in enumerate(frame.units)}
        for island, fixed in enumerate(frame.fixed):
            members = frame.island == island
            if np.isnan(fixed):
                turned[members] -= np.average(
                    turned[members], axis=0, weights=frame.inertia[members]
                )
        for row, unit in enumerate(self.units):
            if unit in place:
                rows[row] = turned[place[unit]]
        return rows


@dataclass(frozen=True)
class _Modes:
    """Modes of a whole system that is linear: the system, and the way from and to its states."""

    system: ModalSystem
    slopes: NDArray[np.float64]
    restrict: NDArray[np.float64]


def _modes_of(small: SmallModel | None) -> _Modes | None:
    if small is None or not isinstance(small.system, ModalSystem):
        return None
    return _Modes(small.system, small.affine[1], small.restriction)


def _samples(piece: Piece) -> NDArray[np.int64]:
    """Rows of a piece, about EVERY apart, both ends included."""
    last = len(piece.times) - 1
    spacing = (piece.times[-1] - piece.times[0]) / max(last, 1)
    count = max(1, int(EVERY / spacing + 1e-9)) if spacing > 0 else 1
    return np.append(np.arange(0, last, count), last)


def _carried(
    piece: Piece,
    mode: Mode,
    model: DetailedModel,
    modes: _Modes,
    index: NDArray[np.int64],
    start: NDArray[np.float64],
) -> NDArray[np.float64]:
    """The error in modal coordinates at the rows `index` of a piece."""
    states = piece.segment.lift(piece.states[index])
    if mode is Mode.DETAILED:
        rates = model.compiled.along(states)
    else:
        small = piece.segment
        own = small.system.compiled.along(piece.states[index])
        rates = small.lift(own) - small.lift(np.zeros(own.shape[1]))
    times, form = piece.times[index], modes.system.form
    return carry_error(
        model.compiled, form, modes.slopes, modes.restrict, times, states, rates, start
    )
