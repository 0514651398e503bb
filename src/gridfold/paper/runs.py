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
from gridfold.equivalents.adaptive import AdaptiveRun, simulate_adaptive
from gridfold.equivalents.compare import Comparison, compare
from gridfold.equivalents.families import (
    ModelFamily,
    ReducedExternal,
    WholeSystem,
    reduce_external,
)
from gridfold.equivalents.folded import fold
from gridfold.equivalents.ladder import Ladder
from gridfold.equivalents.model_kind import DWELL, WHOLE_DEG
from gridfold.equivalents.small_models import SmallModels
from gridfold.equivalents.switching import SwitchingRule
from gridfold.errors import OptionError
from gridfold.grid.case import UnitKey
from gridfold.grid.events import BusFault, Event
from gridfold.paper import published
from gridfold.partition import Partition, partition
from gridfold.reduction import Reducer
from gridfold.runs.clearing import critical_clearing_time
from gridfold.runs.simulate import ModelStore, simulate
from gridfold.runs.trajectory import Trajectory
from gridfold.systems.status import Status

#: Grid in seconds on which the margin to the true clearing time is measured.
FINE_GRID = 0.001


class SmallRun(Enum):
    """The runs with small models that the tables compare with the detailed one.

    The first three are those of the paper's tables in our form: machines near the boundary retained,
    the rest linear behind ports. RETAINED switches to no cheaper model. Then the paper's form as it is
    printed, with exact and with lagged coupling.
    """

    LINEAR = "linear"
    ADAPTIVE_PARTITIONED = "adaptive_partitioned"
    ADAPTIVE_WHOLE = "adaptive_whole"
    RETAINED = "retained"
    LINEAR_PRINTED = "linear_printed"
    ADAPTIVE_PARTITIONED_PRINTED = "adaptive_partitioned_printed"
    ADAPTIVE_WHOLE_PRINTED = "adaptive_whole_printed"
    LINEAR_LAGGED = "linear_lagged"
    ADAPTIVE_PARTITIONED_LAGGED = "adaptive_partitioned_lagged"

    @property
    def column(self) -> str:
        """The column of the paper's tables that it belongs beside."""
        return self.value.removesuffix("_printed").removesuffix("_lagged")


#: The columns of the paper's tables in our form, and as printed.
OURS = (SmallRun.LINEAR, SmallRun.ADAPTIVE_PARTITIONED, SmallRun.ADAPTIVE_WHOLE)
PRINTED = (
    SmallRun.LINEAR_PRINTED,
    SmallRun.ADAPTIVE_PARTITIONED_PRINTED,
    SmallRun.ADAPTIVE_WHOLE_PRINTED,
)


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
        The external area reduced as the paper does.
    ladder, ladder_whole : SmallModels
        Models by network state in our form: with and without the linear external area.
    partitioned, whole, lagged : SmallModels
        Models of the two versions of the paper, and of the first with lagged coupling.
    store : mutable mapping
        Detailed models by network state.
    """

    parts: Partition
    thresholds: Thresholds
    external: ReducedExternal
    ladder: SmallModels = field(repr=False)
    ladder_whole: SmallModels = field(repr=False)
    partitioned: SmallModels = field(repr=False)
    whole: SmallModels = field(repr=False)
    lagged: SmallModels = field(repr=False)
    store: ModelStore = field(repr=False)

    @property
    def model(self) -> DetailedModel:
        """The detailed model of the whole system."""
        return self.parts.model

    @property
    def reference_unit(self) -> UnitKey:
        """The machine against which angle deviations are measured."""
        unit = self.external.reference_unit
        if unit is None:
            raise OptionError("the external area has no machine with a rotor")
        return unit

    def detailed(self, events: Sequence[Event]) -> Trajectory:
        """The run that the others are compared with."""
        return simulate(self.model, events, published.T_END, store=self.store)

    def run(self, kind: SmallRun, events: Sequence[Event]) -> AdaptiveRun:
        """A run with small models."""
        family, angle = self._models(kind)
        if angle is None:
            raise OptionError(f"there is no angle threshold for the run {kind.value}")
        ladders = (SmallRun.LINEAR, SmallRun.ADAPTIVE_PARTITIONED)
        linear_to = WHOLE_DEG if kind in ladders else 0.0
        ours = kind in (*OURS, SmallRun.RETAINED)
        dwell = DWELL if ours else 0.0
        rule = SwitchingRule(float(angle), whole_deg=linear_to, dwell=dwell)
        return simulate_adaptive(
            self.model, family, rule, events, published.T_END, store=self.store
        )

    def _models(self, kind: SmallRun) -> tuple[SmallModels, float | None]:
        """The models of a run, and the angle deviation in degrees above which the first is used."""
        partitioned, whole = self.thresholds.partitioned_deg, self.thresholds.whole_deg
        return {
            SmallRun.LINEAR: (self.ladder, np.inf),
            SmallRun.ADAPTIVE_PARTITIONED: (self.ladder, partitioned),
            SmallRun.ADAPTIVE_WHOLE: (self.ladder_whole, whole),
            SmallRun.RETAINED: (self.ladder, 0.0),
            SmallRun.LINEAR_PRINTED: (self.partitioned, np.inf),
            SmallRun.ADAPTIVE_PARTITIONED_PRINTED: (self.partitioned, partitioned),
            SmallRun.ADAPTIVE_WHOLE_PRINTED: (self.whole, whole),
            SmallRun.LINEAR_LAGGED: (self.lagged, np.inf),
            SmallRun.ADAPTIVE_PARTITIONED_LAGGED: (self.lagged, partitioned),
        }[kind]

    def with_thresholds(self, thresholds: Thresholds) -> CaseStudy:
        """The same system and reductions with other thresholds; our form keeps its machines."""
        kept = self.external.coupling.kept(thresholds.column_norm)
        external = replace(self.external, kept=kept)
        ladder = self.ladder.family
        assert isinstance(ladder, Ladder)
        return _study(external, ladder, thresholds, self.store)


def prepare(
    model: DetailedModel,
    thresholds: Thresholds | None = None,
    reducer: Reducer | None = None,
) -> CaseStudy:
    """Partition and reduce `model` (:func:`gridfold.build_model`) as the paper does.

    `reducer`, that of the paper's form, is balanced truncation to the paper's bound by default.
    """
    chosen = Thresholds() if thresholds is None else thresholds
    parts = partition(model, published.STUDY_BUSES)
    external = reduce_external(parts, reducer, chosen.column_norm)
    ladder = Ladder((fold(parts, external.kept), fold(parts)), whole=True)
    return _study(external, ladder, chosen, {})


def _study(
    external: ReducedExternal, ladder: Ladder, thresholds: Thresholds, store: ModelStore
) -> CaseStudy:
    """All models of the intact network are built here, before threads share the stores."""
    parts, model = external.parts, external.parts.model
    whole = WholeSystem(parts, external.coupling, external.kept, external.origin)
    lagged = replace(external, boundary=BoundaryCoupling.LAGGED)
    without_linear = Ladder(ladder.areas[:1], whole=True)

    def models(family: ModelFamily) -> SmallModels:
        small = SmallModels(family)
        for mode in family.modes:
            small.get(model, mode)
        return small

    store.setdefault(model.state, model)
    return CaseStudy(
        parts,
        thresholds,
        external,
        ladder=models(ladder),
        ladder_whole=models(without_linear),
        partitioned=models(external),
        whole=models(whole),
        lagged=models(lagged),
        store=store,
    )


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
    reference = study.reference_unit
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
