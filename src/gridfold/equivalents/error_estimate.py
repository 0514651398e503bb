"""How wrong a run with small models is, estimated from the run itself.

The run, lifted to the whole system, misses the detailed equations by a defect. That drives the error
(:mod:`gridfold.numerics.defect`), which also has the jumps where models take over from each
other. The error travels in the modes of an area that is reduced more finely than the run's own, with
everything linear.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from gridfold.cards import Card
from gridfold.dynamics.model import DetailedModel
from gridfold.equivalents.adaptive import AdaptiveRun
from gridfold.equivalents.families import Mode, SmallModel
from gridfold.equivalents.folded import FoldedArea, fold
from gridfold.equivalents.small_models import INTACT, SmallModels, topology
from gridfold.equivalents.swings import Swings
from gridfold.grid.case import UnitKey
from gridfold.numerics.blas import one_blas_thread
from gridfold.numerics.defect import carry_error
from gridfold.numerics.modal_form import ModalForm
from gridfold.partition import Partition
from gridfold.reduction import BalancedTruncation
from gridfold.runs.synchronism import AngleFrame, angle_frame
from gridfold.simulation.segment import Piece
from gridfold.systems.modal import ModalSystem
from gridfold.systems.status import Status

#: Bound of the area in which errors travel, in p.u. of port voltage.
FINE_TOLERANCE = 1e-5
#: Time between the instants at which the detailed equations are looked at, in s; twice as long where
#: everything is linear, since swings are small there.
EVERY = 0.05
#: Part of the mode that moves an angle most from which on a mode counts.
CARRYING = 0.01


@dataclass(frozen=True, repr=False)
class ErrorEstimate(Card):
    """Estimated errors of rotor angles against the centre of inertia of their island.

    Parameters
    ----------
    units : tuple of UnitKey
        Machines of the study area.
    times : ndarray, shape (n_times,)
        In seconds.
    angles_deg : ndarray, shape (n_times, n_units)
        The detailed run less the run, in degrees; NaN where a machine is out.
    largest_deg : float
        Largest angle of a machine against the centre in the run itself, in degrees.
    parts : tuple of ErrorPart
        The errors in each piece of the run, as they travel.
    """

    units: tuple[UnitKey, ...]
    times: NDArray[np.float64] = field(repr=False)
    angles_deg: NDArray[np.float64] = field(repr=False)
    largest_deg: float
    parts: tuple[ErrorPart, ...] = field(default=(), repr=False)

    def _facts(self) -> dict[str, object]:
        return {
            "machines": f"of {len(self.units)} machines",
            "worst": f"{self.worst_deg:.2g} degrees RMS against the centre of inertia",
        }

    @property
    def rms_deg(self) -> NDArray[np.float64]:
        """Root mean square over the run of each machine, shape (n_units,); 0 for one always out."""
        squares = np.nan_to_num(self.angles_deg) ** 2
        span = self.times[-1] - self.times[0]
        return np.asarray(np.sqrt(np.trapezoid(squares, self.times, axis=0) / span))

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
    most : int, optional
        Other topologies of which the modes are kept, the last used; all of them by default.
    area : FoldedArea, optional
        The area in which errors travel, if it is there.
    """

    def __init__(
        self,
        parts: Partition,
        swings: Swings | None = None,
        most: int | None = None,
        area: FoldedArea | None = None,
    ) -> None:
        self.units = parts.study_units
        self._study = frozenset(self.units)
        self._model = parts.model
        if area is None:
            area = fold(parts, reducer=BalancedTruncation(FINE_TOLERANCE), swings=swings)
        self._modes = SmallModels(area, most)
        self._intact = _modes_of(self._modes.get(parts.model, Mode.WHOLE))
        self._focused = self._intact

    @one_blas_thread
    def focus(self, runs: Iterable[AdaptiveRun]) -> None:
        """Of the intact network keep the modes that carry the errors of these runs alone.

        Runs that did not reach their end are left out.
        """
        if self._intact is None:
            return
        self._focused, weights = self._intact, np.zeros(len(self._intact.slopes))
        for run in runs:
            if run.trajectory.status is not Status.COMPLETED:
                continue
            for part in self._along(run):
                if part.modes is self._intact:
                    moved = np.abs(part.carried).max(axis=0) * np.abs(part.rows).max(axis=0)
                    weights = np.fmax(weights, np.fmax(moved, moved[self._intact.form.partner]))
        if weights.any():
            self._focused = self._intact.only(weights >= CARRYING * weights.max())

    @one_blas_thread
    def estimate(self, run: AdaptiveRun) -> ErrorEstimate | None:
        """Errors along a run that reached its end.

        None where the network has no modes in which errors could travel.
        """
        if self._intact is None:
            return None
        parts = list(self._along(run))
        return ErrorEstimate(
            self.units,
            np.concatenate([part.times for part in parts]),
            np.concatenate([np.rad2deg(part.carried @ part.rows.T) for part in parts]),
            max(part.largest_deg for part in parts),
            tuple(parts),
        )

    def _along(self, run: AdaptiveRun) -> Iterator[ErrorPart]:
        """The error in each piece of a run, carried from one to the next."""
        pieces, models = run.trajectory.run.pieces, run.trajectory.models
        modes, error, last = self._focused, np.zeros(self._model.n_states), None
        for piece, mode, model in zip(pieces, run.modes, models, strict=False):
            if not model.state.faulted:
                modes = self._modes_for(model) or modes
            assert modes is not None
            index, frame = _samples(piece, mode), angle_frame(model)
            if mode is Mode.DETAILED and not error.any():
                index = index[[0, -1]]
            states = piece.segment.lift(piece.states[index])
            if last is not None:
                error = error + last - states[0]
            carried = _carried(piece, mode, model, modes, index, states, modes.restrict @ error)
            error, last = carried[-1] @ modes.slopes, states[-1]
            apart = np.abs(states[:, frame.slots] - frame.references(states))
            inside = [unit in self._study for unit in frame.units]
            largest = float(np.rad2deg(apart[:, inside].max(initial=0.0)))
            yield ErrorPart(modes, piece.times[index], carried, self._rows(frame, modes), largest)

    def _modes_for(self, model: DetailedModel) -> ErrorModes | None:
        if topology(model.state, model.case) == INTACT:
            return self._focused
        return _modes_of(self._modes.get(model, Mode.WHOLE))

    def _rows(self, frame: AngleFrame, modes: ErrorModes) -> NDArray[np.float64]:
        """Angles of the study machines against their islands' centres in the modes, (n_units, r)."""
        turned = modes.slopes[:, frame.slots].T
        for island, fixed in enumerate(frame.fixed):
            members = frame.island == island
            if np.isnan(fixed):
                weights = frame.inertia[members] / frame.inertia[members].sum()
                turned[members] -= weights @ turned[members]
        place = {unit: k for k, unit in enumerate(frame.units)}
        missing = np.full(turned.shape[1], np.nan)
        return np.array([turned[place[u]] if u in place else missing for u in self.units])


@dataclass(frozen=True)
class ErrorModes:
    """Modes of a whole system that is linear, and the way from and to its states."""

    form: ModalForm
    slopes: NDArray[np.float64]
    restrict: NDArray[np.float64]

    @property
    def n(self) -> int:
        """Number of modes."""
        return len(self.slopes)

    def restricted(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Modes (..., n) of deviations of all states, (..., n_states)."""
        return np.asarray(x @ self.restrict.T)

    def lifted(self, w: NDArray[np.float64]) -> NDArray[np.float64]:
        """Deviations of all states (..., n_states) from modes, (..., n)."""
        return np.asarray(w @ self.slopes)

    def only(self, kept: NDArray[np.bool_]) -> ErrorModes:
        """Some of the modes (n_modes,), pairs as a whole."""
        form, place, same = self.form, np.cumsum(kept) - 1, np.eye(int(kept.sum()))
        partner = place[form.partner[kept]]
        part = ModalForm(same, same, form.diagonal[kept], form.coupling[kept], partner)
        return ErrorModes(part, self.slopes[kept], self.restrict[kept])


@dataclass(frozen=True)
class ErrorPart:
    """The error in one piece of a run.

    `carried` (n_times, n_modes) are its modes at `times`, `rows` (n_units, n_modes) the angles of the
    study machines in them; `largest_deg` is the largest angle of these in the run itself.
    """

    modes: ErrorModes
    times: NDArray[np.float64]
    carried: NDArray[np.float64]
    rows: NDArray[np.float64]
    largest_deg: float


def _modes_of(small: SmallModel | None) -> ErrorModes | None:
    if small is None or not isinstance(small.system, ModalSystem):
        return None
    return ErrorModes(small.system.form, small.affine[1], small.restriction)


def _samples(piece: Piece, mode: Mode) -> NDArray[np.int64]:
    """Rows of a piece, about EVERY apart, both ends included."""
    last = len(piece.times) - 1
    spacing = (piece.times[-1] - piece.times[0]) / last
    every = 2 * EVERY if mode is Mode.WHOLE else EVERY
    return np.append(np.arange(0, last, max(1, round(every / spacing))), last)


def _carried(
    piece: Piece,
    mode: Mode,
    model: DetailedModel,
    modes: ErrorModes,
    index: NDArray[np.int64],
    states: NDArray[np.float64],
    start: NDArray[np.float64],
) -> NDArray[np.float64]:
    """The error in modal coordinates at the rows `index` of a piece, whose lifted states are given."""
    if not start.any() and mode is Mode.DETAILED:
        return np.zeros((len(index), len(start)))
    if mode is Mode.DETAILED:
        rates = model.compiled.along(states)
    else:
        segment = piece.segment
        own = segment.system.compiled.along(piece.states[index])
        rates = segment.lift(own) - segment.lift(np.zeros(own.shape[1]))
    return carry_error(
        model.compiled, modes.form, modes.slopes, modes.restrict, piece.times[index], states,
        rates, start,
    )  # fmt: skip
