"""The adaptive switching algorithm: section II.C and Fig. 2 of Osipov & Sun.

Detailed while a fault is on; after that the most exact model of the family as long as the angle
deviation of any study-area machine exceeds the threshold, and cheaper ones below it. When the topology
has changed, or the threshold has been exceeded for too long, the models move to the new operating
point.

Where a parameter of a linear unit is set, the detailed model stays in use from then on: the area behind
ports is reduced for what comes through them.

Linear units know no limits. Where one of theirs is reached the detailed model takes over, or a rung of
the ladder that is not at a limit.
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gridfold.cards import Card, first_few
from gridfold.dynamics.model import DetailedModel
from gridfold.equivalents.error_causes import ErrorCauses
from gridfold.equivalents.families import Mode, ModelFamily, SmallModel
from gridfold.equivalents.limit_watches import (
    LinearLimits,
    let_go_notices,
    light_notices,
    listed,
    origin_notice,
    passed_notices,
)
from gridfold.equivalents.relay_places import blind_spots
from gridfold.equivalents.small_models import SmallModels
from gridfold.equivalents.switching import Band, SwitchingRule
from gridfold.grid.events import Event
from gridfold.grid.timeline import Stage
from gridfold.numerics.blas import one_blas_thread
from gridfold.numerics.steppers import Stepper
from gridfold.numerics.watch import Watch
from gridfold.runs.method import Choice as MethodChoice
from gridfold.runs.method import fit_stepper
from gridfold.runs.notices import Notice, in_order, stage_notices
from gridfold.runs.protection import Protection, protection_among
from gridfold.runs.simulate import INSTANT, ModelStore, SimulationPlan, plan_simulation
from gridfold.runs.size import check_states
from gridfold.runs.synchronism import DEFAULT_CRITERION, SynchronismCriterion
from gridfold.runs.trajectory import Trajectory
from gridfold.simulation.run import Run, run_plan
from gridfold.simulation.segment import Piece, Segment
from gridfold.systems.status import Status

#: Time (s) for which the detailed model stays in use once a limit was reached; each time that it is
#: still reached, twice as long.
LIMIT_DWELL = 0.1
#: Time (s) after which limits that are held at the operating point are looked at again: whether the
#: swing would let them go.
HELD_DWELL = 1.0
#: Models that may take over from one below them where a limit is reached.
_FOLLOWING = (Mode.RETAINED, Mode.LINEAR)
#: Why there is no small model at all in a network state.
_NO_EQUILIBRIUM = "there is no equilibrium to linearize about"
_NO_JOINT = "the linear area cannot be joined to the rest here"


class Switch(NamedTuple):
    """A change of model: when (s), from what to what, why, and the largest jump of a rotor angle."""

    time: float
    before: Mode | None
    after: Mode
    reason: str
    jump_deg: float


@dataclass(frozen=True)
class Attempt:
    """A run that was tried for a tolerance: its most exact model, and why it was not taken.

    `estimate_deg` is its estimated error, at least, where it was given up early; None where it lost
    synchronism or none could be made. `within_error`: it was not taken because its outcome may be
    another one within its error.
    """

    mode: Mode
    estimate_deg: float | None
    refused: str | None = None
    within_error: bool = False

    def record(self) -> dict[str, object]:
        """The same, ready for JSON."""
        return {
            "model": self.mode.value,
            "estimate_deg": self.estimate_deg,
            "refused": self.refused,
        }


@dataclass(frozen=True, repr=False)
class AdaptiveRun(Card):
    """A run with reduced models.

    Parameters
    ----------
    trajectory : Trajectory
        The run; its states are those of the whole system, lifted where a reduced model was in use.
    switches : tuple of Switch
        The log of switches.
    reduction_seconds : float
        Time spent on building reduced models during the run.
    modes : tuple of Mode
        Which model was in use in each piece of the run.
    error_estimate_deg : float or None
        Estimated root mean square error of the worst rotor angle of the study area against the centre
        of inertia, in degrees; None where it was not asked for.
    attempts : tuple of Attempt
        With a tolerance all runs that were tried, the one that was taken last.
    find_causes : callable, optional
        What finds `error_causes`.
    """

    trajectory: Trajectory
    switches: tuple[Switch, ...]
    reduction_seconds: float
    modes: tuple[Mode, ...] = ()
    error_estimate_deg: float | None = None
    attempts: tuple[Attempt, ...] = ()
    find_causes: Callable[[], ErrorCauses] | None = field(default=None, repr=False, compare=False)

    @cached_property
    def error_causes(self) -> ErrorCauses | None:
        """Where the estimated error came from; None where it was not asked for. Found on demand."""
        return None if self.find_causes is None else self.find_causes()

    @property
    def pieces(self) -> Iterator[tuple[Piece, Mode, DetailedModel]]:
        """Pieces, which model was in use in each, and that of the whole network."""
        run = self.trajectory
        return zip(run.run.pieces, self.modes, run.models, strict=False)

    def _facts(self) -> dict[str, object]:
        used = dict.fromkeys(mode.value for mode in self.modes)
        facts = {
            **self.trajectory._facts(),
            "models": first_few(used),
            "switches": len(self.switches),
        }
        if self.error_estimate_deg is not None:
            facts["estimated error"] = f"{self.error_estimate_deg:.2g} degrees"
        return facts


class Choice(NamedTuple):
    """What comes next: the model, why, and what ends it.

    A deviation above `outside`, or all of them below `inside` (degrees), or the time `until` (s).
    """

    mode: Mode
    reason: str
    outside: float = np.inf
    inside: float = 0.0
    until: float = np.inf


def _in_band(band: Band, worst: float) -> Choice:
    if band.lowest == 0:
        reason = f"largest angle deviation {worst:.1f} degrees is within the threshold"
    else:
        reason = f"largest angle deviation {worst:.1f} degrees exceeds the threshold"
    return Choice(band.mode, reason, band.highest, band.lowest)


@dataclass
class AdaptivePlan:
    """Says which model comes next, and keeps the log."""

    plan: SimulationPlan
    small: SmallModels
    rule: SwitchingRule
    criterion: SynchronismCriterion | None
    step: float
    protection: Protection | None = None
    blind: str = ""
    switches: list[Switch] = field(default_factory=list)
    models: list[DetailedModel] = field(default_factory=list)
    modes: list[Mode] = field(default_factory=list)
    above_since: float | None = None
    looked: bool = False
    at_limit: bool = False
    patience: float = LIMIT_DWELL
    limits: list[LinearLimits | None] = field(default_factory=list)
    told: dict[tuple[str, ...], float] = field(default_factory=dict)
    moved: dict[str, float] = field(default_factory=dict)
    light: dict[Mode, float] = field(default_factory=dict)
    pause: float = np.inf
    paused: tuple[float, Segment] | None = None

    def next(self, time: float, x: NDArray[np.float64]) -> Segment | None:
        """The segment from `time` and the state `x` on; None at a pause, too."""
        if time >= min(self.pause, self.plan.t_end) - INSTANT:
            return None
        if self.paused is not None and abs(time - self.paused[0]) < INSTANT:
            segment = self.paused[1]
            self.models.append(self.models[-1])
            self.modes.append(self.modes[-1])
            self.limits.append(self.limits[-1])
        else:
            segment = self._chosen(time, x)
        self.paused = None
        if segment.until > self.pause + INSTANT:
            self.paused = self.pause, segment
            return replace(segment, until=self.pause)
        return segment

    def _chosen(self, time: float, x: NDArray[np.float64]) -> Segment:
        """The segment of the model that is chosen at `time` in the state `x`."""
        stage, model, end = self._stage(time, x)
        choice = self._choose(time, model, x)
        mode, reason = choice.mode, choice.reason
        small = None if mode is Mode.DETAILED else self.small.get(model, mode)
        if small is None and mode is not Mode.DETAILED:
            mode, reason = Mode.DETAILED, _NO_JOINT
            choice = Choice(mode, reason)
        self._tell(time, model, mode)
        limits = None if small is None else self.small.limits(model, mode)
        reached = self._reached(limits, x)
        if reached:
            mode, reason = self._above(mode, model, x), f"{listed(reached)} reached"
            small = None if mode is Mode.DETAILED else self.small.get(model, mode)
            limits = None if small is None else self.small.limits(model, mode)
            choice = Choice(mode, reason)
            self.patience = 2 * self.patience if self.at_limit else LIMIT_DWELL
            end = min(end, round(time + self.patience, 9))
        if limits is not None and limits.held.names and self.rule.limits:
            end = min(end, round(time + HELD_DWELL, 9))
        end = min(end, max(choice.until, time + INSTANT))
        self._log(time, mode, reason, x, model, bool(reached) is not self.at_limit)
        self.at_limit = bool(reached)
        self.models.append(model)
        self.modes.append(mode)
        self.limits.append(limits)
        return self._segment(model, small, mode, end, stage, choice, limits)

    def _segment(
        self,
        model: DetailedModel,
        small: SmallModel | None,
        mode: Mode,
        end: float,
        stage: Stage,
        choice: Choice,
        limits: LinearLimits | None,
    ) -> Segment:
        """A segment with its watches, in the coordinates of its system."""
        watches = self.small.watches(model, mode)
        stops = () if self.criterion is None else watches.stops(self.criterion)
        switches = [
            watches.deviation(limit, inside, steps)
            for limit, inside, steps in (
                (choice.outside, False, 1),
                (choice.inside, True, 1 + round(self.rule.dwell / self.step)),
            )
            if 0 < limit < np.inf
        ]
        system = model if small is None else small.system
        coordinates = None if small is None else small.coordinates
        monitor = None
        if self.protection is not None:
            monitor = self.protection.monitor(model, system, coordinates)
        return Segment(
            system,
            end,
            f"{stage.label} ({mode.value})",
            stops,
            (*switches, *self._limit_watch(limits)),
            coordinates,
            monitor,
        )

    def notices(self, pieces: Sequence[Piece]) -> list[Notice]:
        """New operating points, limits that act at them, and those that small models passed."""
        every = not self.rule.limits
        phases = [
            limits.passed(piece, every)
            for piece, limits in zip(pieces, self.limits, strict=False)
            if limits is not None
        ]
        gone = [
            limits.let_go(piece)
            for piece, limits in zip(pieces, self.limits, strict=False)
            if limits is not None
        ]
        at_origin = [origin_notice(time, names) for names, time in self.told.items() if names]
        moved = [
            Notice(time, f"models about the new operating point: {how}")
            for how, time in self.moved.items()
        ]
        light = light_notices(self.light, self.small.family.light_limits)
        return [*moved, *light, *at_origin, *passed_notices(phases), *let_go_notices(gone)]

    def _reached(self, limits: LinearLimits | None, x: NDArray[np.float64]) -> tuple[str, ...]:
        """Limits for which the detailed model has to take over, or stay."""
        if limits is None or not self.rule.limits:
            return ()
        was_detailed = not self.switches or self.switches[-1].after is Mode.DETAILED
        return limits.reached(x, inside=was_detailed or self.at_limit)

    def _above(self, mode: Mode, model: DetailedModel, x: NDArray[np.float64]) -> Mode:
        """The next rung of a ladder that no limit is in the way of; else the detailed model."""
        family = self.small.family_for(model)
        rungs = () if family is None else family.modes
        higher = rungs[: rungs.index(mode)] if mode in rungs else ()
        for rung in reversed(higher):
            if rung in _FOLLOWING and not self._reached(self.small.limits(model, rung), x):
                return rung
        return Mode.DETAILED

    def _limit_watch(self, limits: LinearLimits | None) -> tuple[Watch, ...]:
        if limits is None or limits.watch is None or not self.rule.limits:
            return ()
        return (limits.watch,)

    def _stage(self, time: float, x: NDArray[np.float64]) -> tuple[Stage, DetailedModel, float]:
        """The stage at `time` and the state `x`, after what relays do there."""
        stage, model, end = self.plan.at(time)
        if self.protection is not None:
            while actions := self.protection.actions(time, model, model, None, x):
                self.plan = self.plan.with_changes(actions)
                stage, model, end = self.plan.at(time)
        return stage, model, end

    def _choose(self, time: float, model: DetailedModel, x: NDArray[np.float64]) -> Choice:
        if model.state.faulted:
            self.above_since = None
            return Choice(Mode.DETAILED, "fault on")
        if self.blind:
            return Choice(Mode.DETAILED, self.blind)
        if model.state.settings:
            near = set(self.small.family.study_units)
            far = [item for item in model.state.settings if item.unit not in near]
            if far:
                where = f"{far[0].name} of unit {far[0].unit} is set"
                return Choice(Mode.DETAILED, f"{where}, and small models have the unit linear")
        family = self.small.family_for(model)
        if family is None:
            return Choice(Mode.DETAILED, _NO_EQUILIBRIUM)
        worst = self.small.watches(model, Mode.DETAILED).largest_deviation(x)
        bands = self.rule.bands(self._allowed(family.modes))
        level = next(k for k, band in enumerate(bands) if worst > band.lowest or band.lowest == 0)
        choice = _in_band(bands[level], worst)
        return self._looking(
            time, choice, (level == 0 and len(bands) > 1) or self._first_only(bands)
        )

    def _allowed(self, modes: Sequence[Mode]) -> tuple[Mode, ...]:
        """The modes with the rung above in the place of one that has the study area linear.

        That is all of them where no relays watch.
        """
        allowed: list[Mode] = []
        for mode in modes:
            exact = self.protection is None or mode is not Mode.WHOLE
            allowed.append(mode if exact else (allowed or [Mode.DETAILED])[-1])
        return tuple(allowed)

    def _tell(self, time: float, model: DetailedModel, mode: Mode) -> None:
        """Note how the model came about that is in use from now on, and what is at limits there."""
        family = self.small.family_for(model)
        if family is not None and mode is not Mode.DETAILED:
            if mode in family.light_limits:
                self.light.setdefault(mode, time)
            else:
                self.told.setdefault(family.held_at_limits(mode), time)
            if family is not self.small.family:
                self.moved.setdefault(family.how(mode), time)

    def _first_only(self, bands: Sequence[Band]) -> bool:
        """Whether the most exact model is in use all the time because the threshold is zero."""
        return len(bands) == 1 and self.rule.angle_deg == 0

    def _looking(self, time: float, choice: Choice, above: bool) -> Choice:
        """Look for the operating point once the threshold has been exceeded for too long."""
        if not above:
            self.above_since, self.looked = None, False
            return choice
        if self.above_since is None:
            self.above_since = time
        look_at = self.above_since + self.rule.longest_above
        if self.looked:
            return choice
        if time < look_at - INSTANT:
            return choice._replace(until=min(choice.until, look_at))
        self.looked = True
        return choice._replace(
            reason=f"above the threshold for {self.rule.longest_above:g} s; the topology is that of "
            "the operating point, nothing is rebuilt"
        )

    def _log(
        self,
        time: float,
        mode: Mode,
        reason: str,
        x: NDArray[np.float64],
        model: DetailedModel,
        other_cause: bool,
    ) -> None:
        before = self.switches[-1].after if self.switches else None
        if reason in (_NO_EQUILIBRIUM, _NO_JOINT):
            other_cause |= bool(self.switches) and self.switches[-1].reason != reason
        if before is mode and not other_cause and "nothing is rebuilt" not in reason:
            return
        jump = self.small.watches(model, mode).jump(x)
        self.switches.append(Switch(time, before, mode, reason, jump))


class AdaptiveSimulation:
    """A run with the adaptive algorithm that may pause.

    Parameters
    ----------
    model, family, rule, events, t_end, stepper, criterion, store
        As in :func:`simulate_adaptive`.
    """

    def __init__(
        self,
        model: DetailedModel,
        family: ModelFamily | SmallModels,
        rule: SwitchingRule,
        events: Sequence[Event] = (),
        t_end: float = 16.0,
        stepper: Stepper | None = None,
        criterion: SynchronismCriterion | None = DEFAULT_CRITERION,
        store: ModelStore | None = None,
    ) -> None:
        method = fit_stepper(model, stepper)
        self.t_end, self.criterion, self._stepper = t_end, criterion, method.stepper
        self._small = family if isinstance(family, SmallModels) else SmallModels(family)
        check_states(model, t_end, self._stepper.step)
        self._ready = ready_adaptive(
            model, self._small, rule, events, t_end, method, criterion, store
        )
        self._run, self._time, self._x = Run((), Status.COMPLETED), 0.0, self._ready.x0
        self._seconds = self._reduction_seconds = 0.0

    @property
    def status(self) -> Status:
        """How the run has gone so far."""
        return self._run.status

    @property
    def pieces(self) -> Iterator[tuple[Piece, Mode, DetailedModel]]:
        """The run so far: pieces, which model was in use, and that of the whole network."""
        plan = self._ready.plan
        return zip(self._run.pieces, plan.modes, plan.models, strict=False)

    def after_events(self, part: float) -> float:
        """When a part of the time from the last event to the end has gone by, in s."""
        last, step = self._ready.plan.plan.stages[-1].start, self._stepper.step
        return last + step * max(1, round(part * (self.t_end - last) / step))

    @one_blas_thread
    def advance(self, until: float = np.inf) -> Status:
        """Go on to the time `until` (s), or to the end; nothing follows a run that ended early."""
        if self.status is not Status.COMPLETED:
            return self.status
        spent, began = self._small.seconds, clock.perf_counter()
        self._ready.plan.pause = until
        more = run_plan(self._ready.plan, self._x, self._stepper, self._time)
        self._run = replace(more, pieces=(*self._run.pieces, *more.pieces))
        if more.pieces:
            last = more.pieces[-1]
            self._time, self._x = float(last.times[-1]), last.segment.lift(last.states[-1])
        reduction = self._small.seconds - spent
        self._reduction_seconds += reduction
        self._seconds += clock.perf_counter() - began - reduction
        return self.status

    def result(self) -> AdaptiveRun:
        """The run, once it has come to its end."""
        return self._ready.finished(self._run, self._seconds, self._reduction_seconds)


@one_blas_thread
def simulate_adaptive(
    model: DetailedModel,
    family: ModelFamily | SmallModels,
    rule: SwitchingRule,
    events: Sequence[Event] = (),
    t_end: float = 16.0,
    stepper: Stepper | None = None,
    criterion: SynchronismCriterion | None = DEFAULT_CRITERION,
    store: ModelStore | None = None,
) -> AdaptiveRun:
    """Simulate with the adaptive algorithm.

    Parameters
    ----------
    model : DetailedModel
        The whole system.
    family : ModelFamily or SmallModels
        From :func:`gridfold.fold`, a :class:`gridfold.Ladder`, or the paper's from
        :func:`gridfold.reduce` or :func:`gridfold.whole_system`; a :class:`SmallModels` keeps what it
        builds for further runs.
    rule : SwitchingRule
        Thresholds; 0 degrees gives the most exact small model and infinity the next one all the
        time.
    events, t_end, stepper, criterion, store
        As in :func:`gridfold.simulate`. With relays among the events nothing in the study area is
        linear; where one of them watches something outside of it, the run is detailed and says so.
    """
    method = fit_stepper(model, stepper)
    small = family if isinstance(family, SmallModels) else SmallModels(family)
    check_states(model, t_end, method.stepper.step)
    spent = small.seconds
    ready = ready_adaptive(model, small, rule, events, t_end, method, criterion, store)
    began = clock.perf_counter()
    run = run_plan(ready.plan, ready.x0, method.stepper)
    reduction = small.seconds - spent
    return ready.finished(run, clock.perf_counter() - began - reduction, reduction)


def ready_adaptive(
    model: DetailedModel,
    small: SmallModels,
    rule: SwitchingRule,
    events: Sequence[Event],
    t_end: float,
    method: MethodChoice,
    criterion: SynchronismCriterion | None,
    store: ModelStore | None,
) -> ReadyRun:
    """A checked disturbance with its plan, for someone else to integrate."""
    began = clock.perf_counter()
    stages = plan_simulation(model, events, t_end, store)
    protection = protection_among(events, model)
    blind = ""
    if protection is not None:
        blind = blind_spots(protection.elements, small.family, model.case)
    plan = AdaptivePlan(stages, small, rule, criterion, method.stepper.step, protection, blind)
    return ReadyRun(model, plan, tuple(events), t_end, method, clock.perf_counter() - began)


@dataclass(frozen=True)
class ReadyRun:
    """A disturbance that waits to be integrated, and what it took to get there (s)."""

    model: DetailedModel
    plan: AdaptivePlan
    events: tuple[Event, ...]
    t_end: float
    method: MethodChoice
    seconds: float

    @property
    def x0(self) -> NDArray[np.float64]:
        """The state at the start."""
        return self.plan.plan.x0

    def finished(self, run: Run, seconds: float, reduction: float) -> AdaptiveRun:
        """What came of it in so many seconds of integration, and of building reduced models."""
        plan, method = self.plan, self.method
        notices = plan.notices(run.pieces)
        notices += [Notice(0.0, f"the detailed model throughout: {plan.blind}")] * bool(plan.blind)
        reached = plan.plan.reached(float(run.pieces[-1].times[-1]))
        steps = plan.plan.step_notices(method)
        trajectory = Trajectory(
            model=self.model,
            run=run,
            models=tuple(plan.models),
            events=self.events,
            notices=in_order(*steps, *stage_notices(*reached), *notices),
            stepper=method.stepper,
            criterion=plan.criterion,
            t_end=self.t_end,
            setup_seconds=self.seconds,
            simulation_seconds=seconds,
            method_reason=method.reason,
            study_buses=plan.small.family.parts.study_buses,
        )
        return AdaptiveRun(trajectory, tuple(plan.switches), reduction, tuple(plan.modes))
