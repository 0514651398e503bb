"""Simulate many disturbances side by side: of one model, or each at an operating point of its own."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from gridfold.dynamics.batch.change import NetworkChange
from gridfold.dynamics.batch.rhs import BatchRhs, batch_rhs
from gridfold.dynamics.batch.voltages import voltage_observer
from gridfold.dynamics.layout import Layout
from gridfold.dynamics.model import DetailedModel
from gridfold.errors import OptionError
from gridfold.grid.change import Event
from gridfold.numerics.columns import GOES_ON, NOT_FINITE, Columns, Spread
from gridfold.numerics.lanes import WIDTH
from gridfold.numerics.steppers import AdamsBashforthMoulton4, RungeKutta4, Stepper
from gridfold.numerics.watch import SpreadWatch
from gridfold.runs.members import Member, Outcome, Plans
from gridfold.runs.method import fit_stepper
from gridfold.runs.simulate import ModelStore
from gridfold.runs.size import check_states
from gridfold.runs.synchronism import (
    DEFAULT_CRITERION,
    SynchronismCriterion,
    angle_frame,
)
from gridfold.runs.trajectory import Trajectory
from gridfold.simulation.segment import Stop

#: Runs from which it pays to have them side by side: eight take the time of four.
FEWEST_TOGETHER = 4
#: What follows in a chain of runs: from its number and the last outcome to the next disturbance.
Follow = Callable[[int, Outcome], Sequence[Event] | None]


def why_single(model: DetailedModel, stepper: Stepper) -> str | None:
    """Why runs of a model do not go side by side; None if they do."""
    if not isinstance(stepper, RungeKutta4 | AdamsBashforthMoulton4):
        return f"the method {stepper.name} solves equations of its own in every step"
    return None


def simulate_batch(
    model: DetailedModel,
    disturbances: Sequence[Sequence[Event]],
    t_end: float = 16.0,
    stepper: Stepper | None = None,
    criterion: SynchronismCriterion | None = DEFAULT_CRITERION,
    store: ModelStore | None = None,
    every_state: bool = False,
    models: Sequence[DetailedModel] | None = None,
) -> Iterator[tuple[int, Outcome]]:
    """Simulate disturbances side by side, from the equilibrium at t = 0.

    Each run takes the steps that :func:`simulate` takes, and gives the same trajectory but for
    rounding. One that is over makes room for the next.

    Parameters
    ----------
    model, t_end, stepper, criterion, store
        As for :func:`simulate`.
    disturbances : sequence of sequences of events
        What happens in each run.
    every_state : bool
        Keep all states of the trajectories; else those of rotor angles and speeds, and the extremes
        of the voltages.
    models : sequence of DetailedModel, optional
        The model of each run, at an operating point and with parameters of its own
        (:meth:`gridfold.DetailedModel.at`); by default that of all is `model`. One with other devices
        or another network than `model` runs by itself. `store` has nothing of them.

    Yields
    ------
    (int, Trajectory or GridfoldError)
        Position of a disturbance, and its run or what is wrong with it, in the order in which they end.

    Raises
    ------
    OptionError
        Runs of this model, or with this stepper, do not go side by side, see :func:`why_single`;
        `models` are not as many as the disturbances.
    """
    return simulate_chains(
        model, disturbances, None, t_end, stepper, criterion, store, every_state, models=models
    )


def simulate_chains(
    model: DetailedModel,
    disturbances: Sequence[Sequence[Event]],
    follow: Follow | None,
    t_end: float = 16.0,
    stepper: Stepper | None = None,
    criterion: SynchronismCriterion | None = DEFAULT_CRITERION,
    store: ModelStore | None = None,
    every_state: bool = False,
    voltages: bool = True,
    models: Sequence[DetailedModel] | None = None,
) -> Iterator[tuple[int, Outcome]]:
    """The same where a run may be followed by another one that hangs on what came of it.

    Parameters
    ----------
    disturbances : sequence of sequences of events
        What happens in the first run of each chain.
    follow : callable, optional
        The next disturbance of a chain from its number and the last outcome; None ends it. It touches
        the same places in the network as the first one, at the same dispatch.
    voltages : bool
        Find the extremes of the voltages.
    models : sequence of DetailedModel, optional
        The model of each chain.
    """
    if models is not None and len(models) != len(disturbances):
        raise OptionError(f"{len(disturbances)} disturbances have {len(models)} models")
    method = fit_stepper(model, stepper)
    reason = why_single(model, method.stepper)
    if reason is not None:
        raise OptionError(f"runs do not go side by side: {reason}")
    if every_state:
        check_states(model, t_end, method.stepper.step)
    rest = (criterion, {model.state: model} if store is None else store, model)
    plans = Plans(model, t_end, method, *rest)
    plans_of = _PlansOfEach(plans, models)
    ready: deque[Member] = deque()

    def begin(number: int, events: Sequence[Event] | None) -> Iterator[tuple[int, Outcome]]:
        """Have a disturbance wait for a column; one that runs alone is followed at once."""
        while events is not None:
            found = plans_of[number].ready(number, tuple(events))
            if isinstance(found, Member):
                ready.append(found)
                return
            yield number, found
            events = None if follow is None else follow(number, found)

    for number, events in enumerate(disturbances):
        yield from begin(number, events)
    if not ready:
        return
    columns = _SideBySide(plans, ready, every_state, voltages)
    while (ended := columns.next()) is not None:
        yield ended
        if follow is not None:
            yield from begin(ended[0], follow(*ended))


class _PlansOfEach:
    """The plans by which each disturbance is made a member; those of one model are the same."""

    def __init__(self, plans: Plans, models: Sequence[DetailedModel] | None):
        self.shared, self.models = plans, models
        self.known = {id(plans.model): plans}

    def __getitem__(self, number: int) -> Plans:
        if self.models is None:
            return self.shared
        model = self.models[number]
        if id(model) not in self.known:
            method = fit_stepper(model, self.shared.method.stepper)
            self.known[id(model)] = replace(
                self.shared, model=model, method=method, store={model.state: model}
            )
        return self.known[id(model)]


@dataclass
class _Seat:
    """A member in its column, and the stage that it is in."""

    member: Member
    stage: int = 0


class _SideBySide:
    """Members in columns; who is done gives his column to the next."""

    def __init__(
        self,
        plans: Plans,
        ready: deque[Member],
        every_state: bool,
        voltages: bool,
    ):
        self.waiting = ready
        model = self.model = plans.model
        width = WIDTH
        self.seats: list[_Seat | None] = [None] * width
        self.ended: deque[tuple[int, Outcome]] = deque()
        self.watched: list[tuple[Stop, ...] | None] = [None] * width
        rank = max(0 if c is None else len(c.buses) for m in ready for c in m.changes)
        own = any(not _same_network(m.basis, model) for m in ready)
        self.rhs: BatchRhs = batch_rhs(model, width, rank, own)
        self.seated: list[DetailedModel] = [model] * width
        self.layouts: list[Layout] = [model.layout] * width
        self.voltages = voltage_observer(self.rhs) if voltages else None
        frame = angle_frame(model)
        self.angles = Spread.over(np.sort(frame.slots), width)
        self.speeds = Spread.over(np.sort(frame.speed_slots), width)
        self.columns = Columns(
            self.rhs.compiled,
            width,
            max(len(member.times) + 2 * len(member.rows) for member in ready),
            plans.method.stepper.step,
            isinstance(plans.method.stepper, AdamsBashforthMoulton4),
            plans.kept_states(every_state),
            (self.angles, self.speeds),
            None if self.voltages is None else self.voltages.observer,
        )
        for column in range(width):
            self._rest(column)
        self.stepping, self.steps = 0.0, 0

    def next(self) -> tuple[int, Outcome] | None:
        """The next run that ends, with the number of its disturbance; None when all have."""
        self._fill()
        while not self.ended and any(self.seats):
            before = self.columns.row.sum()
            began = time.perf_counter()
            self.columns.advance()
            self.stepping += time.perf_counter() - began
            self.steps += int(self.columns.row.sum() - before)
            self._after_steps()
            if not self.ended:
                self._fill()
        return self.ended.popleft() if self.ended else None

    def _fill(self) -> None:
        """Seat who waits."""
        for column, seat in enumerate(self.seats):
            if seat is None and self.waiting:
                self._seat_next(column)

    def _after_steps(self) -> None:
        """Who is at the end of a stage goes on to the next one, or is done."""
        columns = self.columns
        there = [
            (column, seat)
            for column, seat in enumerate(self.seats)
            if seat is not None
            and (columns.row[column] == columns.last[column] or columns.verdict[column] != GOES_ON)
        ]
        done = [
            (column, seat)
            for column, seat in there
            if columns.verdict[column] != GOES_ON or seat.stage + 1 == len(seat.member.rows)
        ]
        if done and self.voltages is not None:
            columns.look()
        for column, seat in done:
            self.ended.append((seat.member.number, self._outcome(column, seat)))
            self._rest(column)
        for column, seat in there:
            if self.seats[column] is seat:
                seat.stage += 1
                self._enter(column, seat)

    def _seat_next(self, column: int) -> None:
        """The next member takes a column."""
        seat = self.seats[column] = _Seat(self.waiting.popleft())
        basis = seat.member.basis
        if self.seated[column] is not basis:
            self.seated[column], self.layouts[column] = basis, basis.layout
            self.rhs.seat(column, basis)
            if self.voltages is not None:
                self.voltages.seat(column, basis)
        self.columns.begin(column, seat.member.times, basis.x0)
        self._enter(column, seat)

    def _rest(self, column: int) -> None:
        """A column without a member stays at the equilibrium."""
        self.seats[column] = None
        self.columns.begin(column, np.zeros(1), self.seated[column].x0)
        self._put(column, None, self.seated[column], ())

    def _enter(self, column: int, seat: _Seat) -> None:
        member, stage = seat.member, seat.stage
        models = member.models
        self.columns.enter(column, *member.rows[stage])
        if stage == 0 or models[stage].state != models[stage - 1].state:
            self._put(column, member.changes[stage], models[stage], member.stops[stage])

    def _put(
        self,
        column: int,
        change: NetworkChange | None,
        system: DetailedModel,
        stops: tuple[Stop, ...],
    ) -> None:
        """The network and the parameters of a column, and what ends its run."""
        if self.layouts[column] is not system.layout:
            self.layouts[column] = system.layout
            self.rhs.settle(column, system.layout)
        self.rhs.put(column, change, system.state.units_out, system.injections.nonlinear)
        if self.voltages is not None:
            self.voltages.put(column, change)
        watches = [stop.watch for stop in stops if isinstance(stop.watch, SpreadWatch)]
        apart, fast = watches or (None, None)
        if self.watched[column] is not stops:
            self.angles.put(column, apart)
            self.speeds.put(column, fast)
            self.watched[column] = stops

    def _outcome(self, column: int, seat: _Seat) -> Outcome:
        """What came of a member that is over.

        Loads for which no voltages were found are tried by themselves: a run alone has other factors
        for each of its networks, and says what is wrong.
        """
        lost = self.columns.verdict[column] == NOT_FINITE
        if lost and self.model.injections.nonlinear is not None:
            return seat.member.plans.alone(seat.member.events)
        return self._trajectory(column, seat)

    def _trajectory(self, column: int, seat: _Seat) -> Trajectory:
        """The run of a member that is over."""
        member, columns, verdict = seat.member, self.columns, int(self.columns.verdict[column])
        plans = member.plans
        end = int(columns.row[column]) + (1 if verdict != NOT_FINITE else 0)
        return plans.trajectory(
            member,
            seat.stage,
            end,
            columns.record[column, :end].copy(),
            columns.kept,
            plans.status(verdict, member.stops[seat.stage], columns.states[:, column].copy()),
            None
            if self.voltages is None
            else plans.voltage_range(member, *self.voltages.extremes(column)),
            self.stepping / max(self.steps, 1),
        )


def _same_network(here: DetailedModel, there: DetailedModel) -> bool:
    """Whether the admittances of two networks of one pattern are the same."""
    return here.equations is there.equations or np.array_equal(
        here.equations.matrix.data, there.equations.matrix.data
    )
