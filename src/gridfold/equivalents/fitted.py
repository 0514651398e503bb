"""One number in, everything else follows: a ladder that is made for a tolerance.

Sample swings of the detailed model are there already, so the true error of a candidate along them costs
a run of the candidate alone. By these errors are chosen: the bound of the reduction and with it the
order; how many machines are retained; and up to which angle everything may be linear. What is given
instead stays as it is.

An area that is finer than all candidates is reduced first. The candidates for the bound are truncations
of its bases. Errors travel in it, too (:mod:`gridfold.equivalents.error_estimate`): if they cannot,
nothing else is made.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from functools import cached_property
from math import inf, sqrt

import numpy as np
from numpy.typing import NDArray

from gridfold.equivalents.error_estimate import FINE_TOLERANCE, errors_travel_in
from gridfold.equivalents.families import Mode
from gridfold.equivalents.fit import Fit, TriedCount
from gridfold.equivalents.folded import FoldedArea, fold
from gridfold.equivalents.ladder import Ladder
from gridfold.equivalents.limit_scan import limited_among
from gridfold.equivalents.limit_weight import light_limits
from gridfold.equivalents.model_kind import WHOLE_DEG, Weights
from gridfold.equivalents.ranking import Ranking, rank_retained
from gridfold.equivalents.retained_count import best_count, try_counts
from gridfold.equivalents.swing_errors import (
    Angles,
    angles_along,
    apart_deg,
    detailed_angles,
    swing_error,
)
from gridfold.equivalents.swings import Swings, sample_swings
from gridfold.errors import OptionError
from gridfold.grid.case import UnitKey
from gridfold.numerics.blas import one_blas_thread
from gridfold.numerics.steppers import Stepper
from gridfold.partition import Partition
from gridfold.reduction import BalancedTruncation, Reducer
from gridfold.runs.method import fit_stepper

#: Bounds of the reduction that are tried, in p.u. of port voltage. The finest is ten times that of the
#: area in which errors travel, so that an estimate sees what is left out.
BOUNDS = (1e-1, 3e-2, 1e-2, 3e-3, 1e-3, 3e-4, 1e-4)
#: Bound of the finest area where the bound of the reduction is chosen.
FINEST = 1e-5
#: Part of the tolerance by which a truncation may move angles in sample swings.
TRUNCATION_SHARE = 0.05
#: Part of the tolerance that retained machines leave as error in sample swings: the rung is for swings
#: that are larger than these, and the error grows with the square.
RETAINED_SHARE = 0.1


@one_blas_thread
def fit_ladder(
    parts: Partition,
    tolerance_deg: float,
    stepper: Stepper | None = None,
    *,
    reducer: Reducer | None = None,
    retained: Collection[UnitKey] | None = None,
    slow_modes: float | None = None,
    weights: Weights = Weights.INTERFACE,
    swings: Swings | None = None,
    known: Fit | None = None,
) -> Ladder:
    """The ladder for runs whose rotor angles are to be right within a tolerance.

    Parameters
    ----------
    parts : Partition
        Study and external area.
    tolerance_deg : float
        Error that rotor angles of the study area may have, as in :class:`gridfold.TolerantModel`;
        positive.
    stepper : Stepper, optional
        As in :func:`gridfold.simulate`.
    reducer : Reducer, optional
        How areas are reduced; by default to the coarsest bound that the tolerance allows.
    retained : collection of UnitKey, optional
        External machines that stay exact; by default as many as the tolerance asks for, and those whose
        limits act in sample swings.
    slow_modes : float, optional
        As in :class:`gridfold.BalancedTruncation`; without a `reducer`.
    weights : Weights
        As in :func:`gridfold.fold`.
    swings : tuple of ndarrays, optional
        From :func:`gridfold.sample_swings` with the steps of `stepper`.
    known : Fit, optional
        What was chosen before, to be made again.

    Returns
    -------
    Ladder
        With what decided in its `fit`. Where errors of runs cannot be estimated no run can keep a
        tolerance: then it has the finest area alone, and nothing is chosen.

    Raises
    ------
    OptionError
        The tolerance is not a positive number, or no machine is left to be linear.
    """
    if not 0 < tolerance_deg < inf:
        raise OptionError(
            f"a tolerance that a ladder is made for is positive, not {tolerance_deg!r}"
        )
    method = fit_stepper(parts.model, stepper).stepper
    samples = sample_swings(parts, stepper=stepper) if swings is None else swings
    fitting = _Fitting(parts, tolerance_deg, method, samples, reducer, slow_modes, weights, known)
    fine = fitting.finest()
    if not errors_travel_in(fine):
        return Ladder((fine,), fine=fine)
    linear, fit = fitting.linear_area(fine)
    if retained is None:
        near, fit = fitting.near_area(fit, linear)
    else:
        near = fitting.with_retained(linear, retained) if retained else None
    ladder = Ladder((near or linear, linear), whole=True, fit=fit, fine=fine)
    return replace(ladder, light_limits=light_limits(ladder, samples, stepper)).measured(stepper)


@dataclass(frozen=True)
class _Fitting:
    """What a ladder is made from; see :func:`fit_ladder`."""

    parts: Partition
    tolerance_deg: float
    stepper: Stepper
    swings: Swings
    reducer: Reducer | None
    slow_modes: float | None
    weights: Weights
    known: Fit | None

    def finest(self) -> FoldedArea:
        """The area in which errors travel."""
        bound = FINEST if self.reducer is None else FINE_TOLERANCE
        finest = BalancedTruncation(bound, slow_modes=self.slow_modes)
        return fold(self.parts, (), finest, self.weights, self.swings)

    def linear_area(self, fine: FoldedArea) -> tuple[FoldedArea, Fit]:
        """The area with all machines linear, and what decided it."""
        bound = truncation = None
        if self.reducer is not None:
            area = fold(self.parts, (), self.reducer, self.weights, self.swings)
        else:
            area, bound, truncation = self._truncated(fine)
        if self.known is not None:
            return area, self.known
        whole = self._whole_deg(area)
        return area, Fit(self.tolerance_deg, self._error(area), whole, bound, truncation)

    def near_area(self, fit: Fit, linear: FoldedArea) -> tuple[FoldedArea | None, Fit]:
        """The area with as many machines retained as the tolerance asks for, and what decided it."""
        wanted, areas = RETAINED_SHARE * self.tolerance_deg, dict[int, FoldedArea | None]()

        def attempt(count: int) -> TriedCount:
            areas[count] = area = self._with_count(linear, count)
            if area is None:
                return TriedCount(count, inf, inf)
            spent = Ladder((area, linear), whole=True).measured(self.stepper).step_seconds
            cost = spent[Mode.RETAINED] / spent[Mode.DETAILED]
            return TriedCount(count, self._error(area), cost)

        if self.known is None:
            most = len(self.parts.external_units) - 1
            tried = try_counts(fit.linear_deg, wanted, most, attempt)
            chosen = best_count(tried, fit.linear_deg, wanted, self.tolerance_deg)
            fit = replace(fit, count=chosen, tried=tried)
        count = fit.count or 0
        return areas[count] if count in areas else self._with_count(linear, count), fit

    def _with_count(self, linear: FoldedArea, count: int) -> FoldedArea | None:
        chosen = self._limited | set(self._ranking.first(count) if count else ())
        if not chosen or len(chosen) == len(self.parts.external_units):
            return None
        return self.with_retained(linear, chosen)

    def with_retained(self, linear: FoldedArea, retained: Collection[UnitKey]) -> FoldedArea:
        """The area with these machines retained, reduced as the linear one."""
        return fold(self.parts, retained, linear.reducer, self.weights, self.swings)

    def _truncated(self, fine: FoldedArea) -> tuple[FoldedArea, float, float]:
        """The coarsest truncation that is good enough, or the finest; its bound, what it moves."""
        if self.known is not None and self.known.bound is not None:
            area = next(fine.truncated([self.known.bound]))
            return area, self.known.bound, self.known.truncation_deg or 0.0
        exact = self._angles(fine)
        allowed = TRUNCATION_SHARE * self.tolerance_deg
        for bound, area in zip(BOUNDS, fine.truncated(BOUNDS), strict=True):
            found = area, bound, apart_deg(self._angles(area), exact)
            if found[-1] <= allowed:
                break
        return found

    def _whole_deg(self, linear: FoldedArea) -> float:
        """Angle deviation up to which everything may be linear.

        The error of a linearization grows with the square of the swing, so a swing that is smaller
        than a sample by the root of tolerance and error meets the tolerance.
        """
        small, most = linear.build(Mode.WHOLE, self.parts.model), inf
        for states in self.swings:
            error = swing_error(self.parts, small, (states,), self.stepper)
            if error > 0:
                most = min(most, self._deviation(linear, states) * sqrt(self.tolerance_deg / error))
        return WHOLE_DEG if most == inf else most

    def _deviation(self, area: FoldedArea, states: NDArray[np.float64]) -> float:
        """Largest deviation of a study machine's angle from the reference machine's, in degrees."""
        model, reference = self.parts.model, area.reference_unit
        units = tuple(unit for unit in self.parts.study_units if unit in set(model.machines))
        moved = np.asarray(states - model.x0)
        apart = moved[:, model.slots("rotor_angle", units)]
        if reference is not None:
            apart = apart - moved[:, model.slots("rotor_angle", (reference,))]
        return float(np.degrees(np.abs(apart).max(initial=0.0)))

    def _angles(self, area: FoldedArea) -> Angles:
        small = area.build(area.mode, self.parts.model)
        return angles_along(self.parts, small, self.swings, self.stepper)

    def _error(self, area: FoldedArea) -> float:
        return apart_deg(self._angles(area), detailed_angles(self.parts, self.swings))

    @cached_property
    def _ranking(self) -> Ranking:
        return rank_retained(self.parts, self.swings)

    @cached_property
    def _limited(self) -> set[UnitKey]:
        """Machines whose limits act in the sample swings; they are retained in any case."""
        return limited_among(self.parts, self.swings)
