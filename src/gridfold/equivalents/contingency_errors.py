"""Errors of many contingencies with small models, on all cores."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gridfold.dynamics.model import DetailedModel
from gridfold.equivalents.adaptive import simulate_adaptive
from gridfold.equivalents.families import Mode
from gridfold.equivalents.small_models import SmallModels
from gridfold.equivalents.switching import SwitchingRule
from gridfold.errors import OptionError
from gridfold.grid.case import UnitKey
from gridfold.grid.events import Event
from gridfold.numerics.steppers import Stepper
from gridfold.partition import Partition
from gridfold.runs.simulate import ModelStore, plan_simulation, simulate
from gridfold.runs.synchronism import SynchronismCriterion
from gridfold.runs.trajectory import Trajectory
from gridfold.systems.status import Status

Contingency = tuple[Event, ...]


class AngleError(NamedTuple):
    """RMS error (19) in degrees of the worst study-area machine; infinite if the run ended early."""

    contingency: Contingency
    unit: UnitKey
    rms_deg: float
    status: Status


class LeftOut(NamedTuple):
    """A contingency of which the detailed run is not stable, and how that ended."""

    contingency: Contingency
    status: Status


class Progress(NamedTuple):
    """How far the calibration is: what it is at, how many steps are done, and of how many at most."""

    stage: str
    done: int
    total: int


class Reference(NamedTuple):
    """Rotor angles (n_times, n_units) in degrees of a detailed run, and its unfaulted networks."""

    contingency: Contingency
    angles: NDArray[np.float64]
    models: tuple[DetailedModel, ...]


class Trial(NamedTuple):
    """A value of a threshold, and what is run with it; where it is more than one, all count."""

    value: float
    families: tuple[SmallModels, ...]
    angle_deg: float


@dataclass(frozen=True)
class ContingencyRunner:
    """Simulates contingencies in threads; everything that is shared is built before they start."""

    parts: Partition
    t_end: float
    stepper: Stepper
    criterion: SynchronismCriterion
    pool: Executor
    threads: int
    on_progress: Callable[[Progress], None] | None
    store: ModelStore = field(default_factory=dict)

    def report(self, stage: str, done: int, total: int) -> None:
        """Tell the caller how far it is."""
        if self.on_progress is not None:
            self.on_progress(Progress(stage, done, total))

    def detailed(
        self, contingencies: Sequence[Contingency]
    ) -> tuple[list[Reference], list[LeftOut]]:
        """Detailed runs of all contingencies: the stable ones, and the others."""
        model, stage, total = self.parts.model, "detailed runs", len(contingencies)
        plans = [plan_simulation(model, item, self.t_end, self.store) for item in contingencies]
        self.report(stage, 0, total)
        references, left_out = [], []
        outcomes = self.pool.map(self._angles, contingencies)
        for done, (item, plan, outcome) in enumerate(
            zip(contingencies, plans, outcomes, strict=True), start=1
        ):
            self.report(stage, done, total)
            status, angles = outcome
            if status is not Status.COMPLETED:
                left_out.append(LeftOut(item, status))
                continue
            healthy = {m.state: m for m in plan.models if not m.state.faulted}
            references.append(Reference(item, angles, tuple(healthy.values())))
        if not references:
            raise OptionError(f"none of the {total} contingencies is stable on the detailed model")
        return references, left_out

    def errors(self, jobs: Sequence[tuple[Trial, Reference]]) -> list[AngleError]:
        """Errors of each contingency with each trial."""
        for trial, reference in jobs:
            for model, mode in product(reference.models, (Mode.HYBRID, Mode.LINEAR)):
                for family in trial.families:
                    family.get(model, mode)
        return list(self.pool.map(lambda job: self._error(*job), jobs))

    def _angles(self, contingency: Contingency) -> tuple[Status, NDArray[np.float64]]:
        options = self.t_end, self.stepper, self.criterion, self.store
        run = simulate(self.parts.model, contingency, *options)
        return run.status, _study_angles(self.parts, run)

    def _error(self, trial: Trial, reference: Reference) -> AngleError:
        found = [self._family_error(family, trial, reference) for family in trial.families]
        return max(found, key=lambda error: error.rms_deg)

    def _family_error(self, family: SmallModels, trial: Trial, reference: Reference) -> AngleError:
        # To look for a new operating point changes nothing in a run, and would add a sample.
        rule = SwitchingRule(trial.angle_deg, longest_above=math.inf)
        options = self.t_end, self.stepper, self.criterion, self.store
        events = reference.contingency
        run = simulate_adaptive(self.parts.model, family, rule, events, *options).trajectory
        angles = _study_angles(self.parts, run)
        error = np.ma.masked_invalid(angles - reference.angles[: len(angles)])
        rms = np.sqrt((error**2).mean(axis=0)).filled(0.0)
        worst = int(np.argmax(rms))
        size = float(rms[worst]) if run.status is Status.COMPLETED else math.inf
        return AngleError(events, _study_machines(self.parts)[worst], size, run.status)


def _study_machines(parts: Partition) -> list[UnitKey]:
    return [unit for unit in parts.study_units if unit in parts.model.machines]


def _study_angles(parts: Partition, run: Trajectory) -> NDArray[np.float64]:
    return run.rotor_angle_deg(_study_machines(parts))
