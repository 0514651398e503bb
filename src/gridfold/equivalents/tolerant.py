"""Runs whose rotor angles are right within a tolerance, by the cheapest model that is good enough.

A run begins on the lowest rung of a ladder. Its error is estimated; where that is too large the next
rung repeats it. It is looked at a first time soon after the last event: the squared error only grows,
so that a rung that has used up the tolerance there is left at once. The detailed model ends the climb.
It repeats every run whose outcome lies within its error, and takes those that lead to another topology:
to make models for that costs more than the run. So it does where relays watch, which may lead there.
"""

from __future__ import annotations

import time as clock
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import inf

from gridfold.cards import Card
from gridfold.dynamics.model import DetailedModel
from gridfold.equivalents.adaptive import (
    AdaptiveRun,
    AdaptiveSimulation,
    Attempt,
    simulate_adaptive,
)
from gridfold.equivalents.error_causes import NO_CAUSES
from gridfold.equivalents.error_estimate import ErrorEstimate, ErrorEstimator, ErrorTrail
from gridfold.equivalents.families import Mode
from gridfold.equivalents.ladder import Ladder
from gridfold.equivalents.model_kind import DWELL, WHOLE_DEG
from gridfold.equivalents.small_models import INTACT, SmallModels, topology
from gridfold.equivalents.split_error import ErrorSplitter
from gridfold.equivalents.swings import sample_faults
from gridfold.equivalents.switching import SwitchingRule
from gridfold.errors import OptionError
from gridfold.grid.criteria import Criterion
from gridfold.grid.events import Event
from gridfold.grid.relays import relays_of_run
from gridfold.numerics.steppers import Stepper
from gridfold.runs.criteria import doubt_of
from gridfold.runs.notices import Notice, in_order
from gridfold.runs.simulate import ModelStore, plan_simulation, simulate
from gridfold.runs.synchronism import DEFAULT_CRITERION, SynchronismCriterion
from gridfold.systems.status import Status

#: Part of the tolerance that an estimate may reach.
TRUSTED = 0.9
#: Part of the time from the last event to the end after which a run is looked at first.
PROBE = 1 / 8


class TolerantModel(Card):
    """A ladder whose runs keep a tolerance.

    Parameters
    ----------
    ladder : Ladder
        The models; without a rung that is cheaper than the detailed one all runs are detailed.
    tolerance_deg : float
        Root mean square error of the worst rotor angle of the study area against the centre of
        inertia, in degrees; 0 makes all runs detailed, and so does a grid on which errors cannot be
        estimated. Rungs that miss it in all runs after faults at a few boundary buses are not tried.
    most : int, optional
        Other topologies of which models are kept, the last used; all of them by default.

    Raises
    ------
    OptionError
        The tolerance is negative or not a number.

    Attributes
    ----------
    share : float
        What runs after the sample faults took, with all attempts and estimates, in parts of detailed
        runs; 1 where all runs are detailed, infinite for a ladder whose steps were not measured.
    """

    def _facts(self) -> dict[str, object]:
        return {
            "tolerance": f"within {self.tolerance_deg:g} degrees",
            "family": repr(self.small.family),
            "rules": len(self.rules),
        }

    def __init__(self, ladder: Ladder, tolerance_deg: float, most: int | None = None) -> None:
        if not 0 <= tolerance_deg < inf:
            raise OptionError(f"a tolerance is 0 degrees or more, not {tolerance_deg!r}")
        self.tolerance_deg = tolerance_deg
        self.ladder = ladder
        self.small = SmallModels(ladder, most)
        self._splitter = ErrorSplitter(self.small)
        self.rules = tuple(_rules(ladder, tolerance_deg)) if tolerance_deg > 0 else ()
        self.estimator = None
        if self.rules:
            self.estimator = ErrorEstimator(ladder.parts, most=most, area=ladder.fine)
        self.cheap, self._lost = bool(self.rules), False
        self.share = 1.0
        if self.estimator is not None and not self.estimator.possible:
            self.rules = ()
        if self.rules:
            self._keep_what_fits(ladder)

    @property
    def told(self) -> str | None:
        """How the ladder was made for the tolerance, or why all runs are detailed."""
        if self.tolerance_deg == 0:
            return "with a tolerance of 0 degrees all runs are detailed"
        if not self.cheap:
            return "no reduced model is cheaper than the detailed one: all runs are detailed"
        if self.estimator is not None and not self.estimator.possible:
            return (
                "errors of reduced models cannot be estimated, since modes of the linear system "
                "coincide: all runs are detailed"
            )
        if self._lost:
            return (
                "estimated errors of reduced models grow without bound after the sample faults: all "
                "runs are detailed"
            )
        if not self.rules:
            return (
                f"no reduced model keeps a tolerance of {self.tolerance_deg:g} degrees after the "
                "sample faults: all runs are detailed"
            )
        fit = self.ladder.fit
        return None if fit is None else f"for {fit.tolerance_deg:g} degrees: {fit.text}"

    def run(
        self,
        model: DetailedModel,
        events: Sequence[Event] = (),
        t_end: float = 16.0,
        stepper: Stepper | None = None,
        criterion: SynchronismCriterion | None = DEFAULT_CRITERION,
        store: ModelStore | None = None,
        criteria: Sequence[Criterion] = (),
    ) -> AdaptiveRun:
        """Simulate within the tolerance; arguments as in :func:`gridfold.simulate`.

        Where its error could turn the verdict of one of the `criteria`, a run is repeated as well.
        """
        known = {} if store is None else store
        rest = (events, t_end, stepper, criterion, known)
        last = plan_simulation(model, events, t_end, known).models[-1]
        attempts: list[Attempt] = []
        stays = topology(last.state, last.case) == INTACT and not relays_of_run(events, last.case)
        for rule in self.rules if stays else ():
            tried = self._try(AdaptiveSimulation(model, self.small, rule, *rest), criteria)
            attempts.append(tried.attempt)
            if tried.run is not None and tried.estimate is not None:
                return replace(
                    tried.run,
                    error_estimate_deg=tried.attempt.estimate_deg,
                    attempts=tuple(attempts),
                    find_causes=partial(self._splitter.split, tried.estimate),
                )
            if tried.attempt.within_error:
                break
        detailed = simulate(model, *rest)
        within = [item for item in attempts if item.within_error]
        if within:
            text = (
                f"repeated in detail: with the {within[-1].mode.value} model {within[-1].refused}"
            )
            notices = in_order(*detailed.notices, Notice(0.0, text))
            detailed = replace(detailed, notices=notices)
        modes = (Mode.DETAILED,) * len(detailed.run.pieces)
        attempts.append(Attempt(Mode.DETAILED, 0.0))
        return AdaptiveRun(detailed, (), 0.0, modes, 0.0, tuple(attempts), lambda: NO_CAUSES)

    def _keep_what_fits(self, ladder: Ladder) -> None:
        """Of the rungs those that keep the tolerance after one of the sample faults.

        The errors of these runs tell which modes an estimate needs, their time what a climb takes.
        """
        assert self.estimator is not None
        model, faults = ladder.parts.model, sample_faults(ladder.parts)
        whole = [
            simulate_adaptive(model, self.small, rule, [fault])
            for rule in self.rules
            for fault in faults
        ]
        self._lost = self.estimator.focus(whole) == len(whole)
        if self._lost:
            self.rules = ()
            return
        climbs: list[list[tuple[float, bool]]] = [[] for _ in faults]
        kept = []
        for rule in self.rules:
            tried = []
            for fault in faults:
                began = clock.thread_time()
                run = self._try(AdaptiveSimulation(model, self.small, rule, [fault])).run
                tried.append((clock.thread_time() - began, run is not None))
            if any(fits for _, fits in tried):
                kept.append(rule)
                for climb, attempt in zip(climbs, tried, strict=True):
                    climb.append(attempt)
        self.rules = tuple(kept)
        if kept:
            step = ladder.step_seconds.get(Mode.DETAILED, 0.0)
            detailed = step * max(run.trajectory.run.step_count for run in whole)
            spent = sum(_climbed(climb, detailed) for climb in climbs) / len(climbs)
            self.share = spent / detailed if detailed else inf

    def _try(self, simulation: AdaptiveSimulation, criteria: Sequence[Criterion] = ()) -> _Tried:
        """Take a run to its end, or as far as it may still be within the tolerance."""
        assert self.estimator is not None
        trail = ErrorTrail(self.estimator)
        for until in (simulation.after_events(PROBE), inf):
            status = simulation.advance(until)
            if status is not Status.COMPLETED:
                refused = f"its outcome is {status.value}"
                return _Tried(Attempt(_highest(simulation), None, refused))
            trail.follow(simulation)
            estimate = trail.estimate()
            if estimate is None:
                refused = "the estimate of its error grows without bound"
                return _Tried(Attempt(_highest(simulation), None, refused))
            worst = estimate.worst_over(simulation.t_end)
            if not worst <= TRUSTED * self.tolerance_deg:
                refused = "its error is above the tolerance"
                return _Tried(Attempt(_highest(simulation), worst, refused))
            why = _near_the_limit(estimate, simulation.criterion)
            if why is not None:
                return _Tried(Attempt(_highest(simulation), worst, why, within_error=True))
        run = simulation.result()
        if criteria:
            why = doubt_of(run.trajectory, trail.corrected(run.trajectory), criteria)
        attempt = Attempt(_highest(simulation), worst, why, within_error=why is not None)
        return _Tried(attempt, *((run, estimate) if why is None else ()))


@dataclass(frozen=True)
class _Tried:
    """An attempt, and the run and its error if it is taken."""

    attempt: Attempt
    run: AdaptiveRun | None = None
    estimate: ErrorEstimate | None = None


def _climbed(climb: Sequence[tuple[float, bool]], detailed: float) -> float:
    """Seconds of attempts up to the first that fits, or with the detailed run after all of them."""
    spent = 0.0
    for seconds, fits in climb:
        spent += seconds
        if fits:
            return spent
    return spent + detailed


def _rules(ladder: Ladder, tolerance_deg: float) -> Iterator[SwitchingRule]:
    """Rules from the cheapest to the most exact, for rungs that are cheaper than the detailed model."""
    modes, fit = ladder.modes, ladder.fit
    made_for_it = fit is not None and fit.tolerance_deg == tolerance_deg
    at_most = fit.whole_deg if fit is not None and made_for_it else WHOLE_DEG
    whole = at_most if Mode.WHOLE in modes else 0.0
    if modes[-1] is not Mode.DETAILED:
        yield SwitchingRule(inf if len(modes) > 2 else whole, inf, whole_deg=whole, dwell=DWELL)
    if len(modes) > 1 and modes[0] not in (Mode.DETAILED, modes[-1]):
        retained = len(modes) > 2 and modes[0] is not modes[1]
        near = whole if retained and made_for_it else 0.0
        yield SwitchingRule(near, inf, whole_deg=near, dwell=DWELL)


def _near_the_limit(estimate: ErrorEstimate, criterion: SynchronismCriterion | None) -> str | None:
    """Why a machine may have passed a limit of the criterion within the error."""
    if criterion is not None and estimate.largest_deg >= criterion.limit_deg:
        return "synchronism is lost within its error"
    if criterion is not None and estimate.fastest_pu >= criterion.speed_limit:
        return "a machine is off speed within its error"
    return None


def _highest(simulation: AdaptiveSimulation) -> Mode:
    """The most exact model that was in use without a fault."""
    used = [mode for _, mode, model in simulation.pieces if not model.state.faulted]
    return min(used or [Mode.DETAILED], key=list(Mode).index)
