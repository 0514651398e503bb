"""Simulate a disturbance on the detailed model."""

from __future__ import annotations

import time
from collections.abc import MutableMapping, Sequence
from dataclasses import dataclass

from gridfold.dynamics.model import DetailedModel
from gridfold.errors import OptionError, StepWarning, warn_caller
from gridfold.grid.events import Event
from gridfold.grid.network_state import NetworkState
from gridfold.grid.timeline import Stage, build_timeline
from gridfold.numerics.steppers import Stepper
from gridfold.runs.method import Choice, fault_doubt, fit_stepper
from gridfold.runs.notices import Notice, stage_notices
from gridfold.runs.parts import RowsOnce, Taker
from gridfold.runs.size import check_models, check_states, check_times
from gridfold.runs.synchronism import DEFAULT_CRITERION, SynchronismCriterion
from gridfold.runs.trajectory import Trajectory
from gridfold.simulation.run import run_segments
from gridfold.simulation.segment import Segment

ModelStore = MutableMapping[NetworkState, DetailedModel]


@dataclass(frozen=True)
class SimulationPlan:
    """A checked disturbance: the stages, the model of each, and the end of the run in seconds."""

    stages: tuple[Stage, ...]
    models: tuple[DetailedModel, ...]
    t_end: float

    @property
    def ends(self) -> tuple[float, ...]:
        """End of each stage in seconds."""
        return (*(stage.start for stage in self.stages[1:]), self.t_end)

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
        doubts = method.doubts if doubt is None else (*method.doubts, doubt)
        return tuple(Notice(0.0, text) for text in doubts)


def plan_simulation(
    model: DetailedModel,
    events: Sequence[Event],
    t_end: float,
    store: ModelStore | None = None,
) -> SimulationPlan:
    """Check all events and build the model of every network state that they lead through.

    `store` keeps models by network state; hand in the same one to share them between runs.
    """
    if not (0 < t_end < float("inf")):
        raise OptionError(f"the end time must be a positive number of seconds, not {t_end!r}")
    store = {} if store is None else store
    stages = build_timeline(model.case, events, t_end)
    check_models(model, len({stage.state for stage in stages} - store.keys()))
    for stage in stages:
        if stage.state not in store:
            store[stage.state] = model.for_state(stage.state)
    return SimulationPlan(tuple(stages), tuple(store[stage.state] for stage in stages), t_end)


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
        What happens; all of them are checked before anything runs.
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
    segments = [
        Segment(system, end, stage.label, () if criterion is None else criterion.stops(system))
        for stage, system, end in zip(plan.stages, plan.models, plan.ends, strict=True)
    ]
    ready = time.perf_counter()
    rows = RowsOnce(takers) if takers else None
    run = run_segments(segments, model.x0, method.stepper, sink=rows)
    if rows is not None:
        rows.finish()
    done = time.perf_counter()
    return Trajectory(
        model=model,
        run=run,
        models=plan.models,
        events=tuple(events),
        notices=(
            *plan.step_notices(method),
            *stage_notices(plan.stages[: len(run.pieces)], plan.models),
        ),
        stepper=method.stepper,
        criterion=criterion,
        t_end=t_end,
        setup_seconds=ready - began,
        simulation_seconds=done - ready,
        method_reason=method.reason,
    )
