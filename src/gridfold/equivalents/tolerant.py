"""Runs whose rotor angles are right within a tolerance, by the cheapest model that is good enough.

A run begins on the lowest rung of a ladder. Its error is estimated; where that is too large, or where
the run's outcome lies within its error, the next rung repeats it. The detailed model ends the climb. It
also takes every run that leads to another topology: to make models for that costs more than the run.
So it does where relays watch, which may lead there.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from math import inf

import numpy as np

from gridfold.cards import Card
from gridfold.dynamics.model import DetailedModel
from gridfold.equivalents.adaptive import AdaptiveRun, Attempt, simulate_adaptive
from gridfold.equivalents.error_causes import NO_CAUSES
from gridfold.equivalents.error_estimate import ErrorEstimate, ErrorEstimator
from gridfold.equivalents.families import Mode
from gridfold.equivalents.ladder import Ladder
from gridfold.equivalents.model_kind import DWELL, WHOLE_DEG
from gridfold.equivalents.small_models import INTACT, SmallModels, topology
from gridfold.equivalents.split_error import ErrorSplitter
from gridfold.equivalents.swings import sample_faults
from gridfold.equivalents.switching import SwitchingRule
from gridfold.errors import OptionError
from gridfold.grid.events import Event
from gridfold.grid.relays import relays_of_run
from gridfold.numerics.steppers import Stepper
from gridfold.partition import Partition
from gridfold.runs.simulate import ModelStore, plan_simulation, simulate
from gridfold.runs.synchronism import DEFAULT_CRITERION, SynchronismCriterion
from gridfold.runs.trajectory import Trajectory
from gridfold.systems.status import Status

#: Part of the tolerance that an estimate may reach.
TRUSTED = 0.9


class TolerantModel(Card):
    """A ladder whose runs keep a tolerance.

    Parameters
    ----------
    ladder : Ladder
        The models; without a rung that is cheaper than the detailed one all runs are detailed.
    tolerance_deg : float
        Root mean square error of the worst rotor angle of the study area against the centre of
        inertia, in degrees; 0 makes all runs detailed. Rungs that miss it in all runs after faults at
        a few boundary buses are not tried.
    most : int, optional
        Other topologies of which models are kept, the last used; all of them by default.

    Raises
    ------
    OptionError
        The tolerance is negative or not a number.
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
        self.estimator = (
            ErrorEstimator(ladder.parts, most=most, area=ladder.fine) if self.rules else None
        )
        self.cheap = bool(self.rules)
        self.rules = tuple(self._that_fit(ladder.parts))

    @property
    def told(self) -> str | None:
        """How the ladder was made for the tolerance, or why all runs are detailed."""
        if self.tolerance_deg == 0:
            return "with a tolerance of 0 degrees all runs are detailed"
        if not self.cheap:
            return "no reduced model is cheaper than the detailed one: all runs are detailed"
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
    ) -> AdaptiveRun:
        """Simulate within the tolerance; arguments as in :func:`gridfold.simulate`."""
        known = {} if store is None else store
        rest = (events, t_end, stepper, criterion, known)
        last = plan_simulation(model, events, t_end, known).models[-1]
        attempts: list[Attempt] = []
        stays = topology(last.state, last.case) == INTACT and not relays_of_run(events, last.case)
        for rule in self.rules if stays else ():
            run = simulate_adaptive(model, self.small, rule, *rest)
            attempt, estimate = self._judge(run)
            attempts.append(attempt)
            if attempt.refused is None and estimate is not None:
                return replace(
                    run, error_estimate_deg=estimate.worst_deg, attempts=tuple(attempts),
                    find_causes=partial(self._splitter.split, estimate, run),
                )  # fmt: skip
        detailed = simulate(model, *rest)
        modes = (Mode.DETAILED,) * len(detailed.run.pieces)
        attempts.append(Attempt(Mode.DETAILED, 0.0))
        return AdaptiveRun(detailed, (), 0.0, modes, 0.0, tuple(attempts), lambda: NO_CAUSES)

    def _that_fit(self, parts: Partition) -> Iterator[SwitchingRule]:
        """Rungs that keep the tolerance after one of the sample faults; the others are not tried.

        The errors of these runs tell which modes an estimate needs.
        """
        if self.estimator is None:
            return
        faults = sample_faults(parts)
        runs = {
            rule: [simulate_adaptive(parts.model, self.small, rule, [f]) for f in faults]
            for rule in self.rules
        }
        self.estimator.focus(run for tried in runs.values() for run in tried)
        for rule, tried in runs.items():
            if any(self._judge(run)[0].refused is None for run in tried):
                yield rule

    def _judge(self, run: AdaptiveRun) -> tuple[Attempt, ErrorEstimate | None]:
        order = list(Mode)
        used = [mode for mode, stage in zip(run.modes, run.trajectory.models, strict=False)
                if not stage.state.faulted]  # fmt: skip
        mode = min(used or [Mode.DETAILED], key=order.index)
        if run.trajectory.status is not Status.COMPLETED:
            return Attempt(mode, None, f"its outcome is {run.trajectory.status.value}"), None
        assert self.estimator is not None
        estimate = self.estimator.estimate(run)
        if estimate is None:
            return Attempt(mode, None, "its error cannot be estimated"), None
        worst = estimate.worst_deg
        if not worst <= TRUSTED * self.tolerance_deg:
            return Attempt(mode, worst, "its error is above the tolerance"), estimate
        if _near_the_limit(run.trajectory, estimate):
            return Attempt(mode, worst, "synchronism is lost within its error"), estimate
        return Attempt(mode, worst), estimate


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


def _near_the_limit(run: Trajectory, estimate: ErrorEstimate) -> bool:
    """Whether a machine may have passed the limit of synchronism within the largest estimated error."""
    if run.criterion is None:
        return False
    error = float(np.nanmax(np.abs(estimate.angles_deg), initial=0.0))
    return estimate.largest_deg + error >= run.criterion.limit_deg
