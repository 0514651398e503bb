"""The estimated error of a run by its causes: truncation, linearization, jumps.

The error of a run obeys e' = A e + d to first order, so what drives it may be taken one after another.
At the lifted state the untruncated linear area would have other derivatives than the area in use: that
defect is truncation. States that a model cannot take up when it takes over are jumps. What these two do
not explain of the estimate is linearization. No evaluation of the detailed equations is needed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gridfold.dynamics.descriptor import grid_descriptor
from gridfold.dynamics.model import DetailedModel
from gridfold.dynamics.port_model import PortModel
from gridfold.dynamics.port_rhs import inputs_along
from gridfold.dynamics.unit_limits import touched_held
from gridfold.equivalents.error_causes import NO_CAUSES, ErrorCauses
from gridfold.equivalents.error_estimate import STEPS, ErrorEstimate, ErrorPart
from gridfold.equivalents.families import Mode, SmallModel
from gridfold.equivalents.folded import FoldedArea
from gridfold.equivalents.ladder import Ladder
from gridfold.equivalents.small_models import SmallModels
from gridfold.numerics.blas import one_blas_thread
from gridfold.numerics.driven_modes import drive_modes
from gridfold.numerics.error_modes import Modes
from gridfold.simulation.segment import Piece


class ErrorSplitter:
    """Splits estimated errors of runs with one ladder.

    Parameters
    ----------
    small : SmallModels
        The small models of the runs, a ladder's.
    """

    def __init__(self, small: SmallModels) -> None:
        self._small = small
        self._known: dict[tuple[object, ...], tuple[Modes, _Lost | None]] = {}

    def split(self, estimate: ErrorEstimate) -> ErrorCauses:
        """What each cause contributes to the angle of the machine with the largest estimated error."""
        if not estimate.units:
            return NO_CAUSES
        squares = np.nan_to_num(self.curves(estimate)) ** 2
        span = estimate.times[-1] - estimate.times[0]
        return ErrorCauses(*np.sqrt(np.trapezoid(squares, estimate.times, axis=1) / span).tolist())

    @one_blas_thread
    def curves(self, estimate: ErrorEstimate) -> NDArray[np.float64]:
        """The contributions of truncation, linearization and jumps in degrees, (3, n_times).

        Their sum is the estimated error of that machine.
        """
        worst = estimate.units.index(estimate.worst_unit)
        found: list[NDArray[np.float64]] = []
        modes = estimate.parts[0].modes
        w = np.zeros((2, len(modes.form.partner)))
        last: NDArray[np.float64] | None = None
        for part in estimate.parts:
            piece = part.piece
            first, end = piece.segment.lift(piece.states[[0, -1]])
            if part.modes is not modes:
                w, modes = part.modes.project(modes.lift(w).T).T, part.modes
            if last is not None:
                w[1] += modes.project(last - first)
            rows, index = _rows(piece, part.carried.rows)
            load = self._load(part, rows)
            times = piece.times[rows]
            lost = drive_modes(modes.form, times, w[0], load)
            jumped = drive_modes(modes.form, times, w[1], np.zeros_like(load))
            rest = part.carried.errors - lost[index] - jumped[index]
            sight = part.frame.angles[worst]
            angles = [curve @ sight for curve in (lost[index], rest, jumped[index])]
            found.append(np.rad2deg(np.array(angles)))
            w, last = np.array([lost[-1], jumped[-1]]), end
        return np.hstack(found)

    def _load(self, part: ErrorPart, rows: NDArray[np.int64]) -> NDArray[np.float64]:
        """The defect of the truncation in modal coordinates, (n_rows, n_modes)."""
        if part.mode is not Mode.DETAILED:
            key = part.mode, part.model.state, id(part.modes)
            if key not in self._known:
                self._known[key] = part.modes, self._lost(part)
            lost = self._known[key][1]
            if lost is not None:
                return lost.along(part.piece.states[rows])
        return np.zeros((len(rows), len(part.modes.form.partner)))

    def _lost(self, part: ErrorPart) -> _Lost | None:
        model, mode = part.model, part.mode
        family, small = self._small.family_for(model), self._small.get(model, mode)
        if not isinstance(family, Ladder | FoldedArea) or small is None:
            return None
        area = family.area_of(mode)
        within = np.zeros((len(area.area.state_index), model.n_states))
        within[np.arange(len(within)), area.area.state_index] = 1.0
        inside = part.modes.project(within.T)
        left = inside - (inside @ area.states.lift_matrix) @ area.states.restrict_matrix
        if isinstance(small.coordinates, PortModel):
            return _lost_behind_ports(area, small.coordinates, left)
        return _lost_throughout(area, small, model, left)


@dataclass(frozen=True)
class _Lost:
    """What truncation loses in modal coordinates: constant + gain @ (states, inputs).

    `ports` is the model behind whose ports the area is, with the order of the area; None where the
    states say everything.
    """

    gain: NDArray[np.float64]
    constant: NDArray[np.float64]
    area: FoldedArea | None = None
    ports: PortModel | None = None

    def along(self, states: NDArray[np.float64]) -> NDArray[np.float64]:
        """At states of the segment, (n_times, n_modes)."""
        known = states
        if self.area is not None and self.ports is not None:
            driven = inputs_along(self.area.linear_ports, self.ports.compiled, states)
            known = np.hstack([states[:, len(self.ports.exact_index) :], driven])
        return np.asarray(self.constant + known @ self.gain.T)


def _lost_behind_ports(area: FoldedArea, ports: PortModel, left: NDArray[np.float64]) -> _Lost:
    """Of z' = T (A T~ z + B u + powers P + drift), with `left` the modes of 1 - T~ T."""
    whole = area.area
    moved = whole.system.apply(area.states.lift_matrix)
    gain = left @ np.hstack([moved, whole.system.b, whole.powers])
    return _Lost(gain, left @ whole.drift, area, ports)


def _lost_throughout(
    area: FoldedArea, small: SmallModel, model: DetailedModel, left: NDArray[np.float64]
) -> _Lost:
    """The same where all else is linear, too."""
    origin, slopes = small.affine
    smooth = touched_held(model, area.origin, model.layout.source_units)
    grid, inside = grid_descriptor(smooth, area.origin), area.area.state_index
    at = (
        grid.apply((origin - area.origin)[:, None])[inside, 0] + model.compiled(area.origin)[inside]
    )
    return _Lost(left @ grid.apply(slopes.T)[inside], left @ at)


def _rows(piece: Piece, known: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Rows of a piece, `known` ones and every so often between, and where the known ones are."""
    spacing = (piece.times[-1] - piece.times[0]) / (len(piece.times) - 1)
    rows = np.union1d(known, np.arange(0, len(piece.times), max(1, round(STEPS[0] / spacing))))
    return rows, np.searchsorted(rows, known)
