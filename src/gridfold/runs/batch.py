"""Simulate many disturbances of one model side by side."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gridfold.dynamics.batch.change import NetworkChange, NetworkChanges
from gridfold.dynamics.batch.rhs import BatchRhs, batch_rhs
from gridfold.dynamics.batch.voltages import VoltageExtreme, voltage_observer
from gridfold.dynamics.model import DetailedModel
from gridfold.errors import GridfoldError, OptionError
from gridfold.grid.change import Event
from gridfold.numerics.columns import GOES_ON, NOT_FINITE, Columns, Spread
from gridfold.numerics.lanes import WIDTH
from gridfold.numerics.steppers import AdamsBashforthMoulton4, RungeKutta4, Stepper
from gridfold.numerics.steppers.base import time_grid
from gridfold.numerics.watch import SpreadWatch
from gridfold.runs.extremes import Extreme, VoltageRange
from gridfold.runs.method import Choice, fit_stepper
from gridfold.runs.notices import stage_notices
from gridfold.runs.protection import protection_among
from gridfold.runs.simulate import ModelStore, SimulationPlan, plan_simulation, simulate
from gridfold.runs.size import check_states
from gridfold.runs.synchronism import (
    DEFAULT_CRITERION,
    SynchronismCriterion,
    angle_frame,
    share_angle_frame,
)
from gridfold.runs.trajectory import Trajectory, UsedModel
from gridfold.simulation.run import Run
from gridfold.simulation.segment import Piece, Segment, Stop
from gridfold.systems.status import Status

#: Runs from which it pays to have them side by side: eight take the time of four.
FEWEST_TOGETHER = 4
#: Buses that the events of a member may touch at once; one with more runs by itself.
LARGEST_RANK = 24
#: What came of a disturbance: its run, or why there is none.
Outcome = Trajectory | GridfoldError
#: What follows in a chain of runs: from its number and the last outcome to the next disturbance.
Follow = Callable[[int, Outcome], Sequence[Event] | None]


def why_single(model: DetailedModel, stepper: Stepper) -> str | None:
    """Why runs of a model do not go side by side; None if they do."""
    if not isinstance(stepper, RungeKutta4 | AdamsBashforthMoulton4):
        return f"the method {stepper.name} solves equations of its own in every step"
    if model.injections.nonlinear is not None:
        return "loads that are no impedances need iterations of their own in every step"
    return None


def simulate_batch(
    model: DetailedModel,
    disturbances: Sequence[Sequence[Event]],
    t_end: float = 16.0,
    stepper: Stepper | None = None,
    criterion: SynchronismCriterion | None = DEFAULT_CRITERION,
    store: ModelStore | None = None,
    every_state: bool = False,
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

    Yields
    ------
    (int, Trajectory or GridfoldError)
        Position of a disturbance, and its run or what is wrong with it, in the order in which they end.

    Raises
    ------
    OptionError
        Runs of this model, or with this stepper, do not go side by side, see :func:`why_single`.
    """
    return simulate_chains(model, disturbances, None, t_end, stepper, criterion, store, every_state)


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
) -> Iterator[tuple[int, Outcome]]:
    """The same where a run may be followed by another one that hangs on what came of it.

    Parameters
    ----------
    disturbances : sequence of sequences of events
        What happens in the first run of each chain.
    follow : callable, optional
        The next disturbance of a chain from its number and the last outcome; None ends it. It touches
        the same places in the network as the first one.
    voltages : bool
        Find the extremes of the voltages.
    """
    method = fit_stepper(model, stepper)
    reason = why_single(model, method.stepper)
    if reason is not None:
        raise OptionError(f"runs do not go side by side: {reason}")
    if every_state:
        check_states(model, t_end, method.stepper.step)
    store = {model.state: model} if store is None else store
    plans = _Plans(model, t_end, method, criterion, store)
    ready: deque[_Member] = deque()

    def begin(number: int, events: Sequence[Event] | None) -> Iterator[tuple[int, Outcome]]:
        """Have a disturbance wait for a column; one that runs alone is followed at once."""
        while events is not None:
            found = plans.ready(number, tuple(events))
            if isinstance(found, _Member):
                ready.append(found)
                return
            yield number, found
            events = None if follow is None else follow(number, found)

    for number, events in enumerate(disturbances):
        yield from begin(number, events)
    if not ready:
        return
    columns = _SideBySide(model, method, criterion, ready, t_end, every_state, voltages)
    while (ended := columns.next()) is not None:
        yield ended
        if follow is not None:
            yield from begin(ended[0], follow(*ended))


@dataclass(frozen=True)
class _Member:
    """A disturbance that is ready: rows of its run, and the first and the last of each stage."""

    number: int
    events: tuple[Event, ...]
    plan: SimulationPlan
    models: tuple[DetailedModel, ...]
    changes: tuple[NetworkChange | None, ...]
    stops: tuple[tuple[Stop, ...], ...]
    times: NDArray[np.float64]
    rows: tuple[tuple[int, int], ...]
    seconds: float


@dataclass
class _Plans:
    """Makes members of disturbances."""

    model: DetailedModel
    t_end: float
    method: Choice
    criterion: SynchronismCriterion | None
    store: ModelStore

    def __post_init__(self) -> None:
        self._changes = NetworkChanges(self.model.equations)
        self._stops = () if self.criterion is None else self.criterion.stops(self.model)
        self._labels = self.model.equations.islands.labels

    def ready(self, number: int, events: tuple[Event, ...]) -> _Member | Outcome:
        """A disturbance as a member, or what came of it where it had to run by itself."""
        try:
            member = self.member(number, events)
            if member is not None:
                return member
            stepper = self.method.stepper
            return simulate(self.model, events, self.t_end, stepper, self.criterion, self.store)
        except GridfoldError as error:
            return error

    def member(self, number: int, events: tuple[Event, ...]) -> _Member | None:
        """A disturbance as a member; None if it has to run by itself."""
        began = time.perf_counter()
        plan = plan_simulation(self.model, events, self.t_end, self.store)
        if plan.x0 is not self.model.x0 or protection_among(events, self.model) is not None:
            return None
        models = plan.models
        found = [self._network(system) for system in models]
        if any(item is None for item in found):
            return None
        networks = [item for item in found if item is not None]
        starts = (stage.start for stage in plan.stages)
        grids = [
            time_grid(start, end, self.method.stepper.step)
            for start, end in zip(starts, plan.ends, strict=True)
        ]
        lasts = np.cumsum([len(grid) for grid in grids])
        rows = tuple(
            (int(last) - len(grid), int(last) - 1) for grid, last in zip(grids, lasts, strict=True)
        )
        changes, stops = zip(*networks, strict=True)
        seconds = time.perf_counter() - began
        times = np.concatenate(grids)
        return _Member(number, events, plan, models, changes, stops, times, rows, seconds)

    def _network(
        self, system: DetailedModel
    ) -> tuple[NetworkChange | None, tuple[Stop, ...]] | None:
        """What a stage changes about the intact network, and what ends a run in it."""
        intact = self.model
        if system.state == intact.state:
            return None, self._stops
        if system.layout is not intact.layout or system.injections.nonlinear is not None:
            return None
        index, out = system.case.bus_index, system.state.units_out
        live = [index[unit.bus] for unit in system.layout.source_units if unit not in out]
        change = self._changes.change(system.equations, live)
        if change is None or len(change.buses) > LARGEST_RANK:
            return None
        if not out and np.array_equal(system.equations.islands.labels, self._labels):
            share_angle_frame(intact, system)
            return change, self._stops
        return change, () if self.criterion is None else self.criterion.stops(system)


@dataclass(frozen=True)
class _Kept:
    """Some states of the whole system, at `index` in ascending order."""

    index: NDArray[np.int64]

    def lift(self, z: NDArray[np.float64]) -> NDArray[np.float64]:
        """All states, which are there only if all are kept."""
        raise OptionError("this run kept rotor angles and speeds alone; ask for every state")

    def lift_rows(self, z: NDArray[np.float64], index: NDArray[np.int64]) -> NDArray[np.float64]:
        """Kept states at some positions."""
        at = np.minimum(np.searchsorted(self.index, index), len(self.index) - 1)
        if not np.array_equal(self.index[at], index):
            self.lift(z)
        whole = len(at) > 0 and bool((np.diff(at) == 1).all())
        return z[:, at[0] : at[-1] + 1] if whole else z[:, at]

    def restrict(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Those of a state of the whole system."""
        return x[self.index]


@dataclass
class _Seat:
    """A member in its column, and the stage that it is in."""

    member: _Member
    stage: int = 0


class _SideBySide:
    """Members in columns; who is done gives his column to the next."""

    def __init__(
        self,
        model: DetailedModel,
        method: Choice,
        criterion: SynchronismCriterion | None,
        ready: deque[_Member],
        t_end: float,
        every_state: bool,
        voltages: bool,
    ):
        self.model, self.method, self.criterion, self.t_end = model, method, criterion, t_end
        self.waiting = ready
        self.every_state = every_state
        width = WIDTH
        self.seats: list[_Seat | None] = [None] * width
        self.ended: deque[tuple[int, Trajectory]] = deque()
        self.watched: list[tuple[Stop, ...] | None] = [None] * width
        rank = max(0 if c is None else len(c.buses) for m in ready for c in m.changes)
        self.rhs: BatchRhs = batch_rhs(model, width, rank)
        self.voltages = voltage_observer(self.rhs) if voltages else None
        frame = angle_frame(model)
        self.angles = Spread.over(np.sort(frame.slots), width)
        self.speeds = Spread.over(np.sort(frame.speed_slots), width)
        self.columns = Columns(
            self.rhs.compiled,
            width,
            max(len(member.times) + 2 * len(member.rows) for member in ready),
            method.stepper.step,
            isinstance(method.stepper, AdamsBashforthMoulton4),
            self._kept,
            (self.angles, self.speeds),
            None if self.voltages is None else self.voltages.observer,
        )
        for column in range(width):
            self._rest(column)
        self.stepping, self.steps = 0.0, 0

    @cached_property
    def _kept(self) -> NDArray[np.int64]:
        """Positions of the states that are kept: all if a speed is none of them."""
        machines = self.model.machines
        slots = [self.model.slots(name, machines) for name in ("rotor_angle", "speed")]
        wanted = np.unique(np.concatenate(slots))
        if self.every_state or np.any(wanted >= self.model.n_states):
            return np.arange(self.model.n_states)
        return wanted

    def next(self) -> tuple[int, Trajectory] | None:
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
            self.ended.append((seat.member.number, self._trajectory(column, seat)))
            self._rest(column)
        for column, seat in there:
            if self.seats[column] is seat:
                seat.stage += 1
                self._enter(column, seat)

    def _seat_next(self, column: int) -> None:
        """The next member takes a column."""
        seat = self.seats[column] = _Seat(self.waiting.popleft())
        self.columns.begin(column, seat.member.times, self.model.x0)
        self._enter(column, seat)

    def _rest(self, column: int) -> None:
        """A column without a member stays at the equilibrium."""
        self.seats[column] = None
        self.columns.begin(column, np.zeros(1), self.model.x0)
        self._put(column, None, self.model, ())

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
        """The network of a column, and what ends its run."""
        self.rhs.put(column, change, system.state.units_out)
        if self.voltages is not None:
            self.voltages.put(column, change)
        watches = [stop.watch for stop in stops if isinstance(stop.watch, SpreadWatch)]
        apart, fast = watches or (None, None)
        if self.watched[column] is not stops:
            self.angles.put(column, apart)
            self.speeds.put(column, fast)
            self.watched[column] = stops

    def _trajectory(self, column: int, seat: _Seat) -> Trajectory:
        """The run of a member that is over."""
        member, columns = seat.member, self.columns
        plan, used = member.plan, seat.stage + 1
        x = columns.states[:, column].copy()
        finite = columns.verdict[column] != NOT_FINITE
        end = int(columns.row[column]) + (1 if finite else 0)
        record = columns.record[column, :end].copy()
        per_step = self.stepping / max(self.steps, 1)
        coordinates = None if len(self._kept) == self.model.n_states else _Kept(self._kept)
        pieces = []
        for k in range(used):
            first, last = member.rows[k]
            rows = slice(first, min(last + 1, end))
            segment = Segment(
                member.models[k], plan.ends[k], plan.stages[k].label, member.stops[k],
                coordinates=coordinates,
            )  # fmt: skip
            seconds = per_step * (rows.stop - rows.start - 1)
            pieces.append(Piece(segment, member.times[rows], record[rows], seconds))
        status, culprit = self._status(column, member.stops[seat.stage], x)
        return Trajectory(
            model=self.model,
            run=Run(tuple(pieces), status, culprit),
            models=member.models[:used],
            events=member.events,
            notices=(
                *plan.step_notices(self.method),
                *stage_notices(*plan.reached(float(pieces[-1].times[-1]))),
            ),
            stepper=self.method.stepper,
            criterion=self.criterion,
            t_end=self.t_end,
            setup_seconds=member.seconds,
            simulation_seconds=sum(piece.seconds for piece in pieces),
            used_model=UsedModel("detailed", {}),
            method_reason=self.method.reason,
            voltage_range=self._voltages(column, member.times),
        )

    def _status(
        self, column: int, stops: tuple[Stop, ...], x: NDArray[np.float64]
    ) -> tuple[Status, int | None]:
        verdict = self.columns.verdict[column]
        if verdict == GOES_ON:
            return Status.COMPLETED, None
        if verdict == NOT_FINITE:
            return Status.NOT_FINITE, int(np.flatnonzero(~np.isfinite(x))[0])
        watch, status = next((stop for stop in stops if stop.watch.holds(x)), stops[0])
        return status, int(np.argmax(watch.distances(x)))

    def _voltages(self, column: int, times: NDArray[np.float64]) -> VoltageRange | None:
        if self.voltages is None:
            return None
        buses = self.model.case.buses

        def named(found: VoltageExtreme | None) -> Extreme | None:
            if found is None:
                return None
            return Extreme(found.value, buses[found.bus].number, float(times[found.row]))

        return VoltageRange(*map(named, self.voltages.extremes(column)))
