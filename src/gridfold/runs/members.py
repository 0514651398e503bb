"""Disturbances that are ready to be run together, and the trajectories that come of them."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gridfold.dynamics.batch.change import NetworkChange, NetworkChanges
from gridfold.dynamics.batch.voltages import VoltageExtreme
from gridfold.dynamics.model import DetailedModel
from gridfold.errors import GridfoldError, OptionError
from gridfold.grid.change import Event
from gridfold.numerics.columns import GOES_ON, NOT_FINITE
from gridfold.numerics.steppers.base import time_grid
from gridfold.runs.extremes import Extreme, VoltageRange
from gridfold.runs.method import Choice
from gridfold.runs.notices import stage_notices
from gridfold.runs.protection import protection_among
from gridfold.runs.simulate import ModelStore, SimulationPlan, plan_simulation, simulate
from gridfold.runs.synchronism import SynchronismCriterion, share_angle_frame
from gridfold.runs.trajectory import Trajectory, UsedModel
from gridfold.simulation.run import Run
from gridfold.simulation.segment import Piece, Segment, Stop
from gridfold.systems.status import Status

#: Buses that the events of a member may touch at once; one with more runs by itself.
LARGEST_RANK = 24
#: What came of a disturbance: its run, or why there is none.
Outcome = Trajectory | GridfoldError


@dataclass(frozen=True)
class Member:
    """A disturbance that is ready: rows of its run, and the first and the last of each stage.

    `plans` made it, `basis` is the model at the equilibrium from which it starts.
    """

    number: int
    events: tuple[Event, ...]
    plans: Plans
    basis: DetailedModel
    plan: SimulationPlan
    models: tuple[DetailedModel, ...]
    changes: tuple[NetworkChange | None, ...]
    stops: tuple[tuple[Stop, ...], ...]
    times: NDArray[np.float64]
    rows: tuple[tuple[int, int], ...]
    seconds: float


@dataclass(frozen=True)
class _KeptStates:
    """Some states of the whole system, at `index` in ascending order."""

    index: NDArray[np.int64]

    def lift(self, z: NDArray[np.float64]) -> NDArray[np.float64]:
        """All states, which are there only if all are kept."""
        raise OptionError("this run kept rotor angles and speeds alone; ask for every state")

    def lift_rows(self, z: NDArray[np.float64], index: NDArray[np.int64]) -> NDArray[np.float64]:
        """Kept states at some positions."""
        first = int(np.searchsorted(self.index, index[0])) if len(index) else 0
        if np.array_equal(self.index[first : first + len(index)], index):
            return z[:, first : first + len(index)]
        at = np.minimum(np.searchsorted(self.index, index), len(self.index) - 1)
        if not np.array_equal(self.index[at], index):
            self.lift(z)
        return z[:, at]

    def restrict(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Those of a state of the whole system."""
        return x[self.index]


@dataclass
class Basis:
    """A model at an equilibrium, and what its network states change about its network."""

    model: DetailedModel
    criterion: SynchronismCriterion | None

    def __post_init__(self) -> None:
        self.changes = NetworkChanges(self.model.equations)
        self._stops = () if self.criterion is None else self.criterion.stops(self.model)
        self._labels = self.model.equations.islands.labels

    def network(
        self, system: DetailedModel, settings: bool
    ) -> tuple[NetworkChange | None, tuple[Stop, ...]] | None:
        """What a stage changes about the intact network, and what ends a run in it.

        None where it is no change of the network; `settings` may have changed parameters besides.
        """
        intact = self.model
        if system.state == intact.state:
            return None, self._stops
        as_before = system.layout is intact.layout
        if not as_before and not (settings and system.layout.has_places_of(intact.layout)):
            return None
        index, out = system.case.bus_index, system.state.units_out
        live = [index[unit.bus] for unit in system.layout.source_units if unit not in out]
        change = self.changes.change(system.equations, live)
        if change is None or len(change.buses) > LARGEST_RANK:
            return None
        same_islands = np.array_equal(system.equations.islands.labels, self._labels)
        if as_before and not out and same_islands:
            share_angle_frame(intact, system)
            return change, self._stops
        return change, () if self.criterion is None else self.criterion.stops(system)


@dataclass
class Plans:
    """Makes members of disturbances, and trajectories of what they went through.

    Parameters
    ----------
    model : DetailedModel
        The model at the operating point of the disturbances.
    t_end, method, criterion, store
        As for :func:`simulate`.
    places : DetailedModel, optional
        The model whose places all members have to have. Dispatches and parameters may then differ;
        without it members are of the operating point of `model`, with its parameters.
    """

    model: DetailedModel
    t_end: float
    method: Choice
    criterion: SynchronismCriterion | None
    store: ModelStore
    places: DetailedModel | None = None

    def __post_init__(self) -> None:
        self._bases = [Basis(self.model, self.criterion)]

    @property
    def changes(self) -> NetworkChanges:
        """Changes of the intact network of the model."""
        return self._bases[0].changes

    def ready(self, number: int, events: tuple[Event, ...]) -> Member | Outcome:
        """A disturbance as a member, or what came of it where it had to run by itself."""
        try:
            member = self.member(number, events)
            return self.alone(events) if member is None else member
        except GridfoldError as error:
            return error

    def alone(self, events: tuple[Event, ...]) -> Outcome:
        """What comes of a disturbance by itself."""
        stepper = self.method.stepper
        try:
            return simulate(self.model, events, self.t_end, stepper, self.criterion, self.store)
        except GridfoldError as error:
            return error

    def member(self, number: int, events: tuple[Event, ...]) -> Member | None:
        """A disturbance as a member; None if it has to run by itself."""
        began = time.perf_counter()
        plan = plan_simulation(self.model, events, self.t_end, self.store)
        basis = self._basis(plan.start)
        if basis is None or protection_among(events, self.model) is not None:
            return None
        models = plan.models
        found = [basis.network(system, self.places is not None) for system in models]
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
        return Member(
            number, events, self, basis.model, plan, models, changes, stops, times, rows, seconds
        )

    def _basis(self, start: DetailedModel) -> Basis | None:
        """The basis of runs from the equilibrium of `start`; None where it has other places.

        Loads that are no impedances have those of one operating point for all members.
        """
        known = next((basis for basis in self._bases if basis.model is start), None)
        if self.places is None:
            return known
        models = (start, self.places)
        loaded = any(model.injections.nonlinear is not None for model in models)
        if start is not self.places and loaded:
            return None
        if not start.has_places_of(self.places):
            return None
        if known is None:
            known = Basis(start, self.criterion)
            self._bases.append(known)
        return known

    def trajectory(
        self,
        member: Member,
        stage: int,
        end: int,
        record: NDArray[np.float64],
        kept: NDArray[np.int64],
        status: tuple[Status, int | None],
        voltages: VoltageRange | None,
        per_step: float,
    ) -> Trajectory:
        """The run of a member that is over.

        Parameters
        ----------
        stage : int
            In which it ended.
        end : int
            Rows that it has.
        record : ndarray, shape (end, len(kept))
            States at the positions `kept` along these rows.
        status : Status, and the number of the culprit or None
            How it ended, see :meth:`status`.
        per_step : float
            Seconds that the machine took for one of its steps.
        """
        plan, used = member.plan, stage + 1
        coordinates = None if len(kept) == self.model.n_states else _KeptStates(kept)
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
        return Trajectory(
            model=self.model,
            run=Run(tuple(pieces), *status),
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
            voltage_range=voltages,
        )

    def status(
        self, verdict: int, stops: tuple[Stop, ...], x: NDArray[np.float64]
    ) -> tuple[Status, int | None]:
        """How a run ended, and the number of what is to blame, from its last state `x`."""
        if verdict == GOES_ON:
            return Status.COMPLETED, None
        if verdict == NOT_FINITE:
            return Status.NOT_FINITE, int(np.flatnonzero(~np.isfinite(x))[0])
        watch, status = next((stop for stop in stops if stop.watch.holds(x)), stops[0])
        return status, int(np.argmax(watch.distances(x)))

    def voltage_range(
        self,
        member: Member,
        low: VoltageExtreme | None,
        high: VoltageExtreme | None,
    ) -> VoltageRange:
        """Extremes of voltages with numbers of buses and times."""
        buses = self.model.case.buses

        def named(found: VoltageExtreme | None) -> Extreme | None:
            if found is None:
                return None
            return Extreme(found.value, buses[found.bus].number, float(member.times[found.row]))

        return VoltageRange(named(low), named(high))

    def kept_states(self, every_state: bool) -> NDArray[np.int64]:
        """Positions of the states that are kept: all if a speed is none of them."""
        machines = self.model.machines
        slots = [self.model.slots(name, machines) for name in ("rotor_angle", "speed")]
        wanted = np.unique(np.concatenate(slots))
        if every_state or np.any(wanted >= self.model.n_states):
            return np.arange(self.model.n_states)
        return wanted
