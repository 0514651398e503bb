"""Simulate a disturbance on the detailed model."""

from __future__ import annotations

import time
from collections.abc import MutableMapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from gridfold.dynamics.model import DetailedModel
from gridfold.errors import OptionError, StepWarning, warn_caller
from gridfold.grid.change import Change, Event
from gridfold.grid.network_state import NetworkState
from gridfold.grid.timeline import Stage, collect_changes, compose, initial_state
from gridfold.numerics.steppers import Stepper
from gridfold.runs.method import Choice, fault_doubt, fit_stepper
from gridfold.runs.notices import Notice, stage_notices
from gridfold.runs.parts import RowsOnce, Taker
from gridfold.runs.protection import Protection, protection_among
from gridfold.runs.size import check_models, check_states, check_times
from gridfold.runs.synchronism import DEFAULT_CRITERION, SynchronismCriterion
from gridfold.runs.trajectory import Trajectory
from gridfold.simulation.run import run_plan
from gridfold.simulation.segment import Segment

#: Times closer than this (s) are one instant.
INSTANT = 1e-9

ModelStore = MutableMapping[NetworkState, DetailedModel]


@dataclass(frozen=True)
class SimulationPlan:
    """A checked disturbance: changes, the stages that they lead through, and the end of the run (s).

    `store` has the models of the stages; those of stages that relays bring about are built when they
    are reached.
    """

    model: DetailedModel
    changes: tuple[Change, ...]
    stages: tuple[Stage, ...]
    t_end: float
    store: ModelStore

    @property
    def models(self) -> tuple[DetailedModel, ...]:
        """The model of each stage."""
        return tuple(self._model(stage.state) for stage in self.stages)

    @property
    def ends(self) -> tuple[float, ...]:
        """End of each stage in seconds."""
        return (*(stage.start for stage in self.stages[1:]), self.t_end)

    @property
    def start(self) -> DetailedModel:
        """The model in the state of the case, at the equilibrium of the dispatch."""
        dispatch = self.stages[0].state.dispatch
        return self._model(replace(initial_state(self.model.case), dispatch=dispatch))

    @property
    def x0(self) -> NDArray[np.float64]:
        """The state at the start: the equilibrium of the dispatch."""
        return self._model(self.stages[0].state).x0

    def at(self, time: float) -> tuple[Stage, DetailedModel, float]:
        """The stage at `time` (s), its model, and its end."""
        now = max(k for k, stage in enumerate(self.stages) if stage.start <= time + INSTANT)
        return self.stages[now], self._model(self.stages[now].state), self.ends[now]

    def reached(self, time: float) -> tuple[tuple[Stage, ...], tuple[DetailedModel, ...]]:
        """Stages up to `time` (s), and their models."""
        stages = tuple(stage for stage in self.stages if stage.start <= time + INSTANT)
        return stages, tuple(self._model(stage.state) for stage in stages)

    def with_changes(self, changes: Sequence[Change]) -> SimulationPlan:
        """The same with what relays do besides; an event that does not fit any more has no effect."""
        every = (*self.changes, *changes)
        stages = tuple(compose(self.model.case, every, unforeseen=True))
        return replace(self, changes=every, stages=stages)

    def step_notices(self, method: Choice) -> tuple[Notice, ...]:
        """What speaks against the time step, for this model and for the shortest fault; that warns."""
        faults = [
            end - stage.start
            for stage, end in zip(self.stages, self.ends, strict=True)
            if stage.state.faulted
        ]
        doubt = fault_doubt(method.stepper, min(faults)) if faults else None
        if doubt is not None:
            warn_caller(doubt, StepWarning)
        return tuple(Notice(0.0, text) for text in (*method.doubts, doubt) if text is not None)

    def _model(self, state: NetworkState) -> DetailedModel:
        if state not in self.store:
            start = replace(initial_state(self.model.case), dispatch=state.dispatch)
            if start not in self.store:
                self.store[start] = self.model.for_state(start)
            self.store[state] = self.store[start].for_state(state)
        return self.store[state]


def plan_simulation(
    model: DetailedModel,
    events: Sequence[Event],
    t_end: float,
    store: ModelStore | None = None,
) -> SimulationPlan:
    """Check all events and build the model of every network state that they lead through.

    `store` keeps models by network state; hand in the same one to share them between runs.
    Their right-hand sides are made once they are stepped.
    """
    if not (0 < t_end < float("inf")):
        raise OptionError(f"the end time must be a positive number of seconds, not {t_end!r}")
    store = {} if store is None else store
    changes = collect_changes(model.case, events, t_end)
    stages = tuple(compose(model.case, changes))
    check_models(model, len({stage.state for stage in stages} - store.keys()))
    plan = SimulationPlan(model, tuple(changes), stages, t_end, store)
    for stage in stages:
        plan.at(stage.start)
    return plan


@dataclass
class _DetailedPlan:
    """The plan of a detailed run: a segment a stage, and those that relays bring about."""

    plan: SimulationPlan
    criterion: SynchronismCriterion | None
    protection: Protection | None
    models: list[DetailedModel] = field(default_factory=list)

    def next(self, time: float, x: NDArray[np.float64]) -> Segment | None:
        """The segment from `time` and the state `x` on."""
        if time >= self.plan.t_end - INSTANT:
            return None
        stage, model, end = self.plan.at(time)
        if self.protection is not None:
            while actions := self.protection.actions(time, model, model, None, x):
                self.plan = self.plan.with_changes(actions)
                stage, model, end = self.plan.at(time)
        self.models.append(model)
        stops = () if self.criterion is None else self.criterion.stops(model)
        watch = None if self.protection is None else self.protection.monitor(model, model, None)
        return Segment(model, end, stage.label, stops, monitor=watch)


def simulate(
    model: DetailedModel,
    events: Sequence[Event] = (),
    t_end: float = 16.0,
    stepper: Stepper | None = None,
    criterion: SynchronismCriterion | None = DEFAULT_CRITERION,
    store: ModelStore | None = None,
    takers: Sequence[Taker] = (),
) -> Trajectory:
    """Simulate from the equilibrium at t = 0.

    Parameters
    ----------
    model : DetailedModel
        From :func:`gridfold.build_model`.
    events : sequence of events
        What happens, and relays that watch the run; all of them are checked before anything runs.
    t_end : float
        End of the run in seconds.
    stepper : Stepper, optional
        Integration rule and time step. By default that of :func:`gridfold.choose_stepper`: Runge-Kutta
        of order 4 with 0.01 s where that is stable, else the trapezoidal rule. One that does not suit
        the model warns (:class:`gridfold.StepWarning`), and the run has a notice of it.
    criterion : SynchronismCriterion or None
        Ends the run early once a machine has lost synchronism or its speed is out of range; None lets
        it go on.
    store : mutable mapping, optional
        Models by network state, shared between runs on the same model.
    takers : sequence of Taker
        What takes the rows while the run is stepped. With one the trajectory keeps both ends of each
        segment alone, and the memory of a run does not grow with its states.

    Returns
    -------
    Trajectory
        Times, states and outputs, and the :class:`gridfold.Status` of the run.

    Raises
    ------
    EventError
        An event is malformed or names something that is not in the case.
    OptionError
        The time step or the end of the run is out of range, or the run would take too much memory.
    NetworkError
        The network of one stage has no solution.
    """
    began = time.perf_counter()
    method = fit_stepper(model, stepper)
    if takers:
        check_times(t_end, method.stepper.step)
    else:
        check_states(model, t_end, method.stepper.step)
    plan = plan_simulation(model, events, t_end, store)
    steps = _DetailedPlan(plan, criterion, protection_among(events, model))
    for system in plan.models:
        _ = system.compiled
    ready = time.perf_counter()
    rows = RowsOnce(takers) if takers else None
    run = run_plan(steps, plan.x0, method.stepper, sink=rows)
    if rows is not None:
        rows.finish()
    done = time.perf_counter()
    return Trajectory(
        model=model,
        run=run,
        models=tuple(steps.models),
        events=tuple(events),
        notices=(
            *plan.step_notices(method),
            *stage_notices(*steps.plan.reached(float(run.pieces[-1].times[-1]))),
        ),
        stepper=method.stepper,
        criterion=criterion,
        t_end=t_end,
        setup_seconds=ready - began,
        simulation_seconds=done - ready,
        method_reason=method.reason,
    )
