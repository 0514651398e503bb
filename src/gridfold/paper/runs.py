"""The case studies of Osipov & Sun on a system of one's own making: models, runs and their errors.

The tables are made of these in ``tables.py``; the numbers they stand beside are in
``published.py``.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass, field, replace
from enum import Enum

import numpy as np

from gridfold.dynamics.area_model import BoundaryCoupling
from gridfold.dynamics.model import DetailedModel
from gridfold.equivalents.adaptive import AdaptiveRun, SwitchingRule, simulate_adaptive
from gridfold.equivalents.compare import Comparison, compare
from gridfold.equivalents.families import Mode, ReducedExternal, WholeSystem, reduce_external
from gridfold.equivalents.small_models import SmallModels
from gridfold.errors import OptionError
from gridfold.grid.case import UnitKey
from gridfold.grid.events import BusFault, Event
from gridfold.paper import published
from gridfold.partition import Partition, partition
from gridfold.reduction import Reducer
from gridfold.runs.clearing_time import critical_clearing_time
from gridfold.runs.simulate import ModelStore, simulate
from gridfold.runs.trajectory import Trajectory
from gridfold.systems.status import Status

#: Grid in seconds on which the margin to the true clearing time is measured.
FINE_GRID = 0.001


class SmallRun(Enum):
    """The runs with small models that the tables compare with the detailed one."""

    LINEAR = "linear"
    ADAPTIVE_PARTITIONED = "adaptive_partitioned"
    ADAPTIVE_WHOLE = "adaptive_whole"
    LINEAR_LAGGED = "linear_lagged"
    ADAPTIVE_PARTITIONED_LAGGED = "adaptive_partitioned_lagged"


#: The runs that the paper prints; it has them with the lagged coupling.
PRINTED = (SmallRun.LINEAR, SmallRun.ADAPTIVE_PARTITIONED, SmallRun.ADAPTIVE_WHOLE)


class Clearing(Enum):
    """When faults are cleared: at the critical clearing time found here, or at the paper's."""

    OWN = "own"
    PAPER = "paper"


@dataclass(frozen=True)
class Thresholds:
    """Column norm (p.u.), angle of the partitioned and of the whole version (degrees).

    An angle of None means that there is none: that version cannot be run.
    """

    column_norm: float = published.COLUMN_NORM
    partitioned_deg: float | None = published.ANGLE_PARTITIONED_DEG
    whole_deg: float | None = published.ANGLE_WHOLE_DEG


@dataclass(frozen=True)
class CaseStudy:
    """A partitioned system with its reduced models, shared by all runs.

    Build it with :func:`prepare`.

    Parameters
    ----------
    parts : Partition
        Study and external area.
    thresholds : Thresholds
        Those of the adaptive runs.
    external : ReducedExternal
        The reduced external area.
    partitioned, whole, lagged : SmallModels
        Models by network state of the two versions, and of the first with lagged coupling.
    store : mutable mapping
        Detailed models by network state.
    """

    parts: Partition
    thresholds: Thresholds
    external: ReducedExternal
    partitioned: SmallModels = field(repr=False)
    whole: SmallModels = field(repr=False)
    lagged: SmallModels = field(repr=False)
    store: ModelStore = field(repr=False)

    @property
    def model(self) -> DetailedModel:
        """The detailed model of the whole system."""
        return self.parts.model

    def detailed(self, events: Sequence[Event]) -> Trajectory:
        """The run that the others are compared with."""
        return simulate(self.model, events, published.T_END, store=self.store)

    def run(self, kind: SmallRun, events: Sequence[Event]) -> AdaptiveRun:
        """A run with small models."""
        partitioned_deg, whole_deg = self.thresholds.partitioned_deg, self.thresholds.whole_deg
        family, angle = {
            SmallRun.LINEAR: (self.partitioned, np.inf),
            SmallRun.ADAPTIVE_PARTITIONED: (self.partitioned, partitioned_deg),
            SmallRun.ADAPTIVE_WHOLE: (self.whole, whole_deg),
            SmallRun.LINEAR_LAGGED: (self.lagged, np.inf),
            SmallRun.ADAPTIVE_PARTITIONED_LAGGED: (self.lagged, partitioned_deg),
        }[kind]
        if angle is None:
            raise OptionError(f"there is no angle threshold for the run {kind.value}")
        rule = SwitchingRule(float(angle))
        return simulate_adaptive(
            self.model, family, rule, events, published.T_END, store=self.store
        )

    def with_thresholds(self, thresholds: Thresholds) -> CaseStudy:
        """The same system and reduction with other thresholds."""
        kept = self.external.coupling.kept(thresholds.column_norm)
        return _study(replace(self.external, kept=kept), thresholds, self.store)


def prepare(
    model: DetailedModel,
    thresholds: Thresholds | None = None,
    reducer: Reducer | None = None,
) -> CaseStudy:
    """Partition and reduce `model` (:func:`gridfold.build_model`) as the paper does.

    `reducer` is balanced truncation to the paper's bound by default.
    """
    chosen = Thresholds() if thresholds is None else thresholds
    parts = partition(model, published.STUDY_BUSES)
    return _study(reduce_external(parts, reducer, chosen.column_norm), chosen, {})


def _study(external: ReducedExternal, thresholds: Thresholds, store: ModelStore) -> CaseStudy:
    """All models of the intact network are built here, before threads share the stores."""
    parts, model = external.parts, external.parts.model
    whole = WholeSystem(parts, external.coupling, external.kept, external.origin)
    lagged = replace(external, boundary=BoundaryCoupling.LAGGED)
    stores = SmallModels(external), SmallModels(whole), SmallModels(lagged)
    store.setdefault(model.state, model)
    for small in stores:
        for mode in (Mode.LINEAR, Mode.HYBRID):
            small.get(model, mode)
    return CaseStudy(parts, thresholds, external, *stores, store)


@dataclass(frozen=True)
class FaultErrors:
    """Errors after one disturbance.

    Parameters
    ----------
    events : tuple of events
        The disturbance.
    clearing : float
        When the fault was cleared, in seconds.
    status : Status
        How the detailed run ended.
    comparisons : mapping
        Errors of the study area's machines by run; none at all if the detailed run lost synchronism.
    lost : tuple of SmallRun
        Runs that lost synchronism where the detailed one did not.
    largest_deviation_deg : float
        Largest angle deviation of a study-area machine in the detailed run, in degrees: the quantity
        that switching looks at.
    """

    events: tuple[Event, ...]
    clearing: float
    status: Status
    comparisons: dict[SmallRun, Comparison]
    lost: tuple[SmallRun, ...]
    largest_deviation_deg: float

    def worst_deg(self, kind: SmallRun) -> float | None:
        """Largest root mean square error of a rotor angle in degrees, None if there is none."""
        found = self.comparisons.get(kind)
        return None if found is None else found.worst.rms_deg

    def worst_unit(self, kind: SmallRun) -> UnitKey | None:
        """The machine that has it."""
        found = self.comparisons.get(kind)
        return None if found is None else found.worst.unit

    @property
    def lost_synchronism(self) -> tuple[str, ...]:
        """Names of the runs that did not reach the end."""
        if self.status is not Status.COMPLETED:
            return ("detailed",)
        return tuple(kind.value for kind in self.lost)


def fault_errors(
    study: CaseStudy,
    events: Sequence[Event],
    clearing: float,
    kinds: Sequence[SmallRun] = tuple(SmallRun),
) -> FaultErrors:
    """Run a disturbance with every model of `kinds` and compare them with the detailed run."""
    detailed = study.detailed(events)
    comparisons, lost = {}, []
    if detailed.status is Status.COMPLETED:
        for kind in kinds:
            other = study.run(kind, events).trajectory
            if other.status is Status.COMPLETED:
                comparisons[kind] = compare(detailed, other, _in_service(study, detailed))
            else:
                lost.append(kind)
    return FaultErrors(
        tuple(events),
        clearing,
        detailed.status,
        comparisons,
        tuple(lost),
        _deviation(study, detailed),
    )


def _in_service(study: CaseStudy, run: Trajectory) -> list[UnitKey]:
    """Study-area machines that are in service until the end."""
    out = run.models[-1].state.units_out
    return [unit for unit in study.parts.study_units if unit not in out]


def _deviation(study: CaseStudy, run: Trajectory) -> float:
    reference = study.external.reference_unit
    angles = run.rotor_angle_deg(_in_service(study, run), reference)
    return float(np.abs(angles - angles[0]).max())


@dataclass(frozen=True)
class BusRow:
    """A row of Table I.

    Parameters
    ----------
    bus : int
        The faulted bus.
    cct : float
        Critical clearing time in seconds, on the paper's grid of 0.01 s.
    margin_ms : float
        From the clearing time of the run to the true critical clearing time, known to 1 ms; negative
        if the fault was cleared too late.
    errors : FaultErrors
        With the thresholds of the study.
    calibrated : FaultErrors or None
        With calibrated thresholds.
    """

    bus: int
    cct: float
    margin_ms: float
    errors: FaultErrors
    calibrated: FaultErrors | None = None


def bus_row(
    study: CaseStudy,
    bus: int,
    clearing: Clearing = Clearing.OWN,
) -> BusRow:
    """Find the clearing times of a fault at `bus`, and the errors of all models at one of them."""
    if clearing is Clearing.PAPER and bus not in published.TABLE_1:
        raise OptionError(f"the paper prints no clearing time for bus {bus}")
    found = critical_clearing_time(study.model, BusFault(bus), t_end=published.T_END)
    true = critical_clearing_time(
        study.model, BusFault(bus), resolution=FINE_GRID, t_end=published.T_END
    )
    cleared = published.TABLE_1[bus].cct if clearing is Clearing.PAPER else found.seconds
    events = [BusFault(bus, duration=cleared)]
    return BusRow(
        bus,
        found.seconds,
        round(1000 * (true.seconds - cleared), 6),
        fault_errors(study, events, cleared),
    )


def bus_rows(
    study: CaseStudy,
    buses: Sequence[int],
    clearing: Clearing = Clearing.OWN,
    on_done: Callable[[BusRow], None] | None = None,
    workers: int | None = None,
) -> list[BusRow]:
    """Rows of Table I in the order of `buses`, on all cores; `on_done` is called with each."""
    with ThreadPoolExecutor(workers or os.cpu_count()) as pool:
        tasks = [pool.submit(bus_row, study, bus, clearing) for bus in buses]
        for task in as_completed(tasks):
            if on_done is not None:
                on_done(task.result())
        return [task.result() for task in tasks]
