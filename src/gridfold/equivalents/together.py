"""Adaptive runs side by side: legs of one kind share columns, others go on alone.

A run asks its plan what comes next, as one that is alone does; only who integrates the leg differs.
It goes from the columns of the detailed model to those of a small one when its own fault is cleared.
"""

from __future__ import annotations

from collections.abc import Generator, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import takewhile

import numpy as np

from gridfold.dynamics.batch.change import NetworkChange
from gridfold.dynamics.batch.row_voltages import RowLift, RowVoltages
from gridfold.dynamics.batch.voltages import VoltageExtreme
from gridfold.dynamics.model import DetailedModel
from gridfold.dynamics.port_model import PortModel
from gridfold.equivalents.adaptive import AdaptiveRun, ReadyRun, ready_adaptive
from gridfold.equivalents.families import ModelFamily, affine_rows
from gridfold.equivalents.leg_columns import DetailedColumns, LegColumns, PortColumns, watches_of
from gridfold.equivalents.small_models import SmallModels
from gridfold.equivalents.switching import SwitchingRule
from gridfold.errors import GridfoldError, OptionError
from gridfold.grid.change import Event
from gridfold.grid.network_state import NetworkState
from gridfold.numerics.lanes import WIDTH
from gridfold.numerics.steppers import Stepper
from gridfold.runs.batch import FEWEST_TOGETHER, why_single
from gridfold.runs.extremes import Extreme, VoltageRange
from gridfold.runs.members import Basis
from gridfold.runs.method import fit_stepper
from gridfold.runs.simulate import ModelStore
from gridfold.runs.size import check_states
from gridfold.runs.synchronism import DEFAULT_CRITERION, SynchronismCriterion
from gridfold.runs.trajectory import Trajectory
from gridfold.simulation.run import Carried, Leg, Run, carry, run_legs
from gridfold.simulation.segment import Segment

#: What came of a disturbance: its run, or why there is none.
Outcome = AdaptiveRun | GridfoldError


def why_reduced_single(model: DetailedModel, stepper: Stepper) -> str | None:
    """Why runs on reduced models of `model` do not go side by side; None if they do."""
    if model.injections.nonlinear is not None:
        return "reduced models have loads that are no impedances"
    return why_single(model, stepper)


def simulate_adaptive_batch(
    model: DetailedModel,
    family: ModelFamily | SmallModels,
    rule: SwitchingRule,
    disturbances: Sequence[Sequence[Event]],
    t_end: float = 16.0,
    stepper: Stepper | None = None,
    criterion: SynchronismCriterion | None = DEFAULT_CRITERION,
    store: ModelStore | None = None,
) -> Iterator[tuple[int, Outcome]]:
    """Simulate disturbances with the adaptive algorithm, side by side.

    Each run is that of :func:`simulate_adaptive` but for rounding.

    Parameters
    ----------
    model, family, rule, t_end, stepper, criterion, store
        As for :func:`simulate_adaptive`.
    disturbances : sequence of sequences of events
        What happens in each run.

    Yields
    ------
    (int, AdaptiveRun or GridfoldError)
        Position of a disturbance, and its run or what is wrong with it, in the order in which they end.

    Raises
    ------
    OptionError
        Runs of this model, or with this stepper, do not go side by side, see
        :func:`why_reduced_single`.
    """
    method = fit_stepper(model, stepper)
    reason = why_reduced_single(model, method.stepper)
    if reason is not None:
        raise OptionError(f"runs do not go side by side: {reason}")
    small = family if isinstance(family, SmallModels) else SmallModels(family)
    check_states(model, t_end, method.stepper.step)
    store = {model.state: model} if store is None else store
    ready: dict[int, ReadyRun] = {}
    for number, events in enumerate(disturbances):
        try:
            ready[number] = ready_adaptive(
                model, small, rule, events, t_end, method, criterion, store
            )
        except GridfoldError as error:
            yield number, error
    if ready:
        yield from _Together(model, small, method.stepper, t_end, ready).outcomes()


@dataclass(eq=False)
class _Running:
    """A run that is under way."""

    number: int
    ready: ReadyRun
    legs: Generator[Leg, Carried, Run]
    reduction: float = 0.0
    seconds: float = 0.0


@dataclass
class _Together:
    """Runs that share columns."""

    model: DetailedModel
    small: SmallModels
    stepper: Stepper
    t_end: float
    ready: dict[int, ReadyRun]
    changes: dict[NetworkState, NetworkChange | None] = field(default_factory=dict)
    ports: dict[tuple[int, ...], PortColumns[_Running]] = field(default_factory=dict)
    lifts: dict[int | None, tuple[RowLift, Segment]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        basis = Basis(self.model, None)
        self.changes[self.model.state] = None
        lengths = [1]
        for run in self.ready.values():
            plan = run.plan.plan
            for stage, system, end in zip(plan.stages, plan.models, plan.ends, strict=True):
                if system.state not in self.changes:
                    found = basis.network(system, settings=False)
                    if found is not None:
                        self.changes[system.state] = found[0]
                if system.state.faulted:
                    lengths.append(self._rows(end - stage.start))
        self.detailed: DetailedColumns[_Running] = DetailedColumns(
            self.model, self.changes, max(lengths), self.stepper
        )
        rank = max((len(c.buses) for c in self.changes.values() if c is not None), default=0)
        self.voltages = RowVoltages(self.model, rank)

    def _rows(self, seconds: float) -> int:
        return int(np.ceil(seconds / self.stepper.step)) + 2

    def outcomes(self) -> Iterator[tuple[int, Outcome]]:
        """What comes of all runs, in the order in which they end."""
        for number, ready in self.ready.items():
            legs = run_legs(ready.plan, ready.x0, self.stepper)
            yield from self._go_on(_Running(number, ready, legs), None)
        while (columns := self._next()) is not None:
            if not columns.seated and columns.count < FEWEST_TOGETHER:
                for run, leg in list(columns.waiting):
                    columns.waiting.popleft()
                    yield from self._go_on(run, carry(leg, self.stepper))
            else:
                for run, part in columns.advance():
                    yield from self._go_on(run, part)

    def _next(self) -> LegColumns[_Running] | None:
        """Columns that are full, else those with most legs; None when all runs are over."""
        every = [self.detailed, *self.ports.values()]
        full = next((columns for columns in every if columns.count >= WIDTH), None)
        found = full or max(every, key=lambda columns: (columns.seated > 0, columns.count))
        return found if found.count else None

    def _go_on(self, run: _Running, part: Carried | None) -> Iterator[tuple[int, Outcome]]:
        """Have a run wait for columns with its next leg; integrate those that have none."""
        try:
            found = self._waits(run, part)
        except GridfoldError as error:
            yield run.number, error
        else:
            if found is not None:
                yield run.number, found

    def _waits(self, run: _Running, part: Carried | None) -> AdaptiveRun | None:
        """The run if it is over; None if its next leg waits for a column."""
        while True:
            before = self.small.seconds
            run.seconds += part.piece.seconds if part else 0.0
            try:
                leg = run.legs.send(part) if part else next(run.legs)
            except StopIteration as over:
                found = run.ready.finished(over.value, run.seconds, run.reduction)
                return replace(found, trajectory=self._with_voltages(found.trajectory))
            run.reduction += self.small.seconds - before
            columns = self._columns(run, leg)
            if columns is not None:
                columns.waiting.append((run, leg))
                return None
            part = carry(leg, self.stepper)

    def _columns(self, run: _Running, leg: Leg) -> LegColumns[_Running] | None:
        """Where a leg is stepped; None if that is done alone."""
        if run.ready.x0 is not self.model.x0:
            return None
        if self.detailed.takes(leg):
            return self.detailed
        system = leg.segment.system
        if not isinstance(system, PortModel) or leg.segment.monitor is not None:
            return None
        if system.parts.model.state != self.model.state or self.model.state.units_out:
            return None
        watches = watches_of(leg.segment)
        key = (id(system), *map(id, watches))
        if key not in self.ports:
            self.ports[key] = PortColumns(system, watches, self._rows(self.t_end), self.stepper)
        return self.ports[key] if self.ports[key].takes(leg) else None

    def _lift(self, segment: Segment) -> RowLift:
        """The way from a segment's states to those from which currents follow."""
        coordinates, index = segment.coordinates, self.voltages.index
        key = None if coordinates is None else id(segment.system)
        if key not in self.lifts:
            n = segment.system.compiled.n_states
            origin, slopes = affine_rows(coordinates, n, index)
            self.lifts[key] = RowLift.of(origin, slopes), segment
        return self.lifts[key][0]

    def _with_voltages(self, run: Trajectory) -> Trajectory:
        """The run with the extremes of its voltages after the last event."""
        state = run.parts[-1].model.state
        if state not in self.changes or run.models[0].x0 is not self.model.x0:
            return run
        back = takewhile(lambda part: part.model.state == state, reversed(run.parts))
        parts = tuple(back)[::-1]
        self.voltages.begin(self.changes[state], state.units_out)
        row = 0
        for part in parts:
            lift = self._lift(part.piece.segment)
            self.voltages.take(part.piece.states[part.rows], lift, row)
            row += len(part)
        low, high = self.voltages.extremes()
        times = np.concatenate([part.times for part in parts])
        buses = run.model.case.buses

        def named(found: VoltageExtreme | None) -> Extreme | None:
            if found is None:
                return None
            return Extreme(found.value, buses[found.bus].number, float(times[found.row]))

        return replace(run, voltage_range=VoltageRange(named(low), named(high)))
