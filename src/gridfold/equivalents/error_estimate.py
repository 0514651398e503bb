"""How wrong a run with small models is, estimated from the run itself.

The run, lifted to the whole system, misses the detailed equations by a defect. That drives the error
(:mod:`gridfold.numerics.defect`), which also has the jumps where models take over from each
other. The error travels in the modes of an area that is reduced more finely than the run's own, with
everything linear.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from gridfold.cards import Card
from gridfold.dynamics.model import DetailedModel
from gridfold.equivalents.adaptive import AdaptiveRun, AdaptiveSimulation
from gridfold.equivalents.error_frames import ErrorFrame, error_frame
from gridfold.equivalents.families import Mode, SmallModel
from gridfold.equivalents.folded import FoldedArea, WholeCoordinates, fold
from gridfold.equivalents.small_models import INTACT, SmallModels, topology
from gridfold.equivalents.swings import Swings
from gridfold.grid.case import UnitKey
from gridfold.numerics.blas import one_blas_thread
from gridfold.numerics.defect import Carried, carry_error
from gridfold.numerics.error_modes import Modes, Way
from gridfold.partition import Partition
from gridfold.reduction import BalancedTruncation
from gridfold.runs.synchronism import AngleFrame, angle_frame
from gridfold.runs.trajectory import Trajectory
from gridfold.simulation.run import Run
from gridfold.simulation.segment import Piece, Segment
from gridfold.systems.modal import ModalSystem
from gridfold.systems.status import Status

#: Bound of the area in which errors travel, in p.u. of port voltage.
FINE_TOLERANCE = 1e-4
#: Time between the first instants at which the detailed equations are looked at, and the longest, in s.
STEPS = (0.05, 0.4)
#: Errors of angles, in rad, that need not be exact.
LEAST = np.deg2rad(0.01)
#: Errors of angles, in rad, beyond which they are not followed: a full turn.
MOST = 2 * np.pi
#: Part of the mode that moves an angle most from which on a mode counts.
CARRYING = 0.001
#: Small models and networks of which what errors need is kept.
_KEPT = 16


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
        Angle against the centre that a machine of the whole grid may have come to: its largest one in
        the run and its largest error, in degrees.
    fastest_pu : float
        The same of its distance from synchronous speed, in p.u.
    parts : tuple of ErrorPart
        The errors in each piece of the run, as they travel.
    """

    units: tuple[UnitKey, ...]
    times: NDArray[np.float64] = field(repr=False)
    angles_deg: NDArray[np.float64] = field(repr=False)
    largest_deg: float
    fastest_pu: float
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

    def worst_over(self, span: float) -> float:
        """The same over a longer span, in s, should there be no error in the rest of it."""
        return self.worst_deg * float(np.sqrt((self.times[-1] - self.times[0]) / span))

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
        if area is None:
            area = fold(parts, reducer=BalancedTruncation(FINE_TOLERANCE), swings=swings)
        self._modes = SmallModels(area, most)
        self._intact = _modes_of(self._modes.get(parts.model, Mode.WHOLE))
        self._focused = self._intact
        self._ways: dict[tuple[int, int], tuple[Segment, Modes, Way]] = {}
        self._frames: dict[tuple[int, int], tuple[AngleFrame, Modes, ErrorFrame]] = {}

    @one_blas_thread
    def focus(self, runs: Iterable[AdaptiveRun]) -> int:
        """Of the intact network keep the modes that carry the errors of these runs alone.

        Runs that did not reach their end, or whose error is lost, are left out. Of the latter the
        number is returned.
        """
        lost = 0
        if self._intact is None:
            return lost
        self._focused, weights = self._intact, np.zeros(len(self._intact.form.partner))
        for run in runs:
            if run.trajectory.status is not Status.COMPLETED:
                continue
            trail = self.trail(run)
            lost += trail.lost
            for part in () if trail.lost else trail.parts:
                if part.modes is self._intact:
                    moved = np.abs(part.carried.errors).max(axis=0)
                    moved *= np.abs(np.nan_to_num(part.frame.angles)).max(axis=0)
                    weights = np.fmax(weights, np.fmax(moved, moved[self._intact.form.partner]))
        if weights.any():
            self._focused = self._intact.only(weights >= CARRYING * weights.max())
        return lost

    def estimate(self, run: AdaptiveRun) -> ErrorEstimate | None:
        """Errors along a run that reached its end.

        None where the network has no modes in which errors could travel, or the error is lost.
        """
        return None if self._intact is None else self.trail(run).estimate()

    def trail(self, run: AdaptiveRun | AdaptiveSimulation) -> ErrorTrail:
        """The error along a run, or along what there is of it."""
        trail = ErrorTrail(self)
        trail.follow(run)
        return trail

    @property
    def possible(self) -> bool:
        """Whether the network has modes in which errors could travel."""
        return self._intact is not None

    def modes_for(self, model: DetailedModel) -> Modes | None:
        """Modes of the errors in the network of a model without a fault."""
        if topology(model.state, model.case) == INTACT:
            return self._focused
        return _modes_of(self._modes.get(model, Mode.WHOLE))

    @property
    def first_modes(self) -> Modes:
        """Those of the intact network."""
        assert self._focused is not None
        return self._focused

    def frame(self, model: DetailedModel, modes: Modes) -> ErrorFrame:
        """What is looked at of the errors in a network; known for those last used."""
        frame = angle_frame(model)
        key = id(frame), id(modes)
        if key not in self._frames:
            if len(self._frames) >= _KEPT:
                self._frames.clear()
            self._frames[key] = frame, modes, error_frame(frame, modes, self.units)
        return self._frames[key][-1]

    def way(self, segment: Segment, modes: Modes) -> Way:
        """How the states of a segment meet the modes; known for those last used."""
        key = id(segment.coordinates), id(modes)
        if segment.coordinates is None:
            return Way.itself(modes)
        if key not in self._ways:
            if len(self._ways) >= _KEPT:
                self._ways.clear()
            size = segment.system.compiled.n_states
            origin = segment.lift(np.zeros(size))
            way = Way.between(modes, origin, segment.lift(np.eye(size)) - origin)
            self._ways[key] = segment, modes, way
        return self._ways[key][-1]


@dataclass(frozen=True)
class ErrorPart:
    """The error in one piece of a run: modes, what is looked at, the error at some rows.

    `largest` and `fastest` are the angle (rad) and the speed (p.u.) that a machine may have come to.
    """

    piece: Piece
    mode: Mode
    model: DetailedModel
    modes: Modes
    frame: ErrorFrame
    carried: Carried
    largest: float
    fastest: float


class ErrorTrail:
    """The error along a run, carried from piece to piece as the run goes on.

    Attributes
    ----------
    lost : bool
        Whether it came to more than a full turn of an angle, and is not followed from there. Where
        limits of many linear machines act the equation of the error may be unstable.
    """

    def __init__(self, estimator: ErrorEstimator) -> None:
        self._estimator = estimator
        self._modes, self._last = estimator.first_modes, np.zeros(0)
        self._error = np.zeros(self._modes.slopes.shape[1])
        self.parts: list[ErrorPart] = []
        self.lost = False

    @one_blas_thread
    def follow(self, run: AdaptiveRun | AdaptiveSimulation) -> None:
        """Take up the pieces of the run that have come since."""
        for piece, mode, model in list(run.pieces)[len(self.parts) :]:
            if self.lost:
                return
            self.parts.append(self._part(piece, mode, model))

    def estimate(self) -> ErrorEstimate | None:
        """What they come to; None if the error is lost."""
        if self.lost:
            return None
        parts = self.parts
        return ErrorEstimate(
            self._estimator.units,
            np.concatenate([part.piece.times[part.carried.rows] for part in parts]),
            np.concatenate(
                [np.rad2deg(part.carried.errors @ part.frame.angles.T) for part in parts]
            ),
            float(np.rad2deg(max(part.largest for part in parts))),
            max(part.fastest for part in parts),
            tuple(parts),
        )

    @one_blas_thread
    def corrected(self, run: Trajectory) -> Trajectory:
        """The run that was followed plus its error: an estimate of the detailed run."""
        pieces = []
        for part in self.parts:
            piece, carried = part.piece, part.carried
            states = piece.full_states
            if carried.errors.any():
                errors = carried.between(part.modes.form, piece.times)
                states = states + part.modes.lift(errors)
            segment = Segment(part.model, piece.segment.until, piece.segment.label)
            pieces.append(Piece(segment, piece.times, states, piece.seconds))
        return replace(run, run=Run(tuple(pieces), run.run.status, run.run.culprit))

    def _part(self, piece: Piece, mode: Mode, model: DetailedModel) -> ErrorPart:
        if not model.state.faulted:
            self._modes = self._estimator.modes_for(model) or self._modes
        modes, segment = self._modes, piece.segment
        frame, ends = self._estimator.frame(model, modes), segment.lift(piece.states[[0, -1]])
        if self.parts:
            self._error = self._error + self._last - ends[0]
        carried = self._carried(piece, mode, model, frame)
        self.lost = bool(carried.rows[-1] < len(piece.times) - 1)
        self._error, self._last = modes.lift(carried.errors[-1]), ends[-1]
        reach = frame.reach(segment, piece.states[carried.rows], carried.errors)
        return ErrorPart(piece, mode, model, modes, frame, carried, *reach)

    def _carried(
        self, piece: Piece, mode: Mode, model: DetailedModel, frame: ErrorFrame
    ) -> Carried:
        modes, start = self._modes, self._modes.project(self._error)
        if mode is Mode.DETAILED and not start.any():
            nothing = np.zeros((2, len(start)))
            return Carried(np.array([0, len(piece.times) - 1]), nothing, nothing)
        segment = piece.segment
        return carry_error(
            model.compiled, modes, np.nan_to_num(frame.angles), self._estimator.way(segment, modes),
            segment.system.compiled, piece.times, piece.states, start, STEPS, LEAST, MOST,
        )  # fmt: skip


def errors_travel_in(area: FoldedArea) -> bool:
    """Whether errors of runs on the intact network could be estimated with modes of this area."""
    return isinstance(area.whole(area.parts.model).system, ModalSystem)


def _modes_of(small: SmallModel | None) -> Modes | None:
    if small is None or not isinstance(small.system, ModalSystem):
        return None
    assert isinstance(small.coordinates, WholeCoordinates)
    places, states = small.coordinates.places, small.coordinates.states
    area, n = places.states, len(places.exact_index) + len(places.area_index)
    slopes, restrict = np.zeros((2, area.order, n))
    slopes[:, places.area_index] = area.lift_matrix.T
    restrict[:, places.area_index] = area.restrict_matrix
    return Modes(
        small.system.form, states.lift_matrix, states.restrict_matrix, places.exact_index, slopes,
        restrict,
    )  # fmt: skip
