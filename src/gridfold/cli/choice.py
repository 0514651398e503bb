"""Models as chosen on the command line: which one, about which study area."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import inf
from pathlib import Path
from typing import Any

from gridfold.cli.console import ModelKind, as_ranges, parse_buses
from gridfold.dynamics.model import DetailedModel
from gridfold.errors import OptionError
from gridfold.grid.case import Case
from gridfold.grid.events import Event
from gridfold.numerics.steppers import Stepper
from gridfold.partition import Partition, partition, study_buses
from gridfold.reduction import BalancedTruncation
from gridfold.studies.adaptive import AdaptiveRun, SwitchingRule, simulate_adaptive
from gridfold.studies.reduced import COLUMN_NORM, ReducedExternal, reduce_external, whole_system
from gridfold.studies.saved import SavedReduction, load_reduced, reducer_record
from gridfold.studies.simulate import ModelStore
from gridfold.studies.small_models import SmallModels
from gridfold.studies.synchronism import SynchronismCriterion
from gridfold.studies.trajectory import Trajectory, UsedModel

#: Areas that are the study area of a built-in case if nothing else is asked for.
_STUDY_AREAS = {"npcc": (1,), "npcc-pst": (1,)}
#: Thresholds of the angle deviation in degrees by which the paper switches.
_ANGLES = {ModelKind.ADAPTIVE: 67.0, ModelKind.WHOLE: 6.0}
_TOLERANCE = 1e-5
_LONGEST_ABOVE = 5.0


@dataclass(frozen=True)
class StudyArea:
    """A study area as given on the command line; None where nothing is given."""

    buses: str | None = None
    areas: str | None = None
    zones: str | None = None

    @property
    def given(self) -> bool:
        """Whether it is given at all."""
        return (self.buses, self.areas, self.zones) != (None, None, None)

    def find(self, case: Case, source: str) -> frozenset[int]:
        """Its bus numbers in `case`, which was loaded from `source`."""
        if self.given:
            texts = {"buses": self.buses, "areas": self.areas, "zones": self.zones}
            given = {kind: parse_buses(t, kind) for kind, t in texts.items() if t is not None}
            return study_buses(case, **given)
        if source in _STUDY_AREAS:
            return study_buses(case, areas=_STUDY_AREAS[source])
        raise OptionError(
            f"case {case.name} has no study area of its own; give it with --study-buses, "
            "--study-areas or --study-zones"
        )


@dataclass(frozen=True)
class ModelChoice:
    """A model as chosen on the command line; None where nothing is given."""

    kind: ModelKind
    area: StudyArea
    column_norm: float | None = None
    order: int | None = None
    tolerance: float | None = None
    angle_deg: float | None = None
    longest_above: float | None = None
    file: Path | None = None

    def __post_init__(self) -> None:
        given = {
            "--study-buses, --study-areas and --study-zones": self.area.given or None,
            "--column-norm": self.column_norm,
            "--order": self.order,
            "--tolerance": self.tolerance,
            "--reduced": self.file,
            "--angle-deg": self.angle_deg,
            "--longest-above": self.longest_above,
        }
        unused = list(given)
        if self.kind is ModelKind.WHOLE:
            unused = ["--order", "--tolerance", "--reduced"]
        elif self.kind is not ModelKind.DETAILED:
            unused = [] if self.kind in _ANGLES else ["--angle-deg", "--longest-above"]
        for name in unused:
            if given[name] is not None:
                raise OptionError(f"{name} has no effect on the {self.kind.value} model")

    def build(self, model: DetailedModel, source: str) -> ReducedSimulator | None:
        """What simulates it, for `model` of the case from `source`; None for the detailed model."""
        if self.kind is ModelKind.DETAILED:
            return None
        began = time.perf_counter()
        rule = self._rule()
        if self.kind is ModelKind.WHOLE:
            norm = COLUMN_NORM if self.column_norm is None else self.column_norm
            whole = whole_system(partition(model, self.area.find(model.case, source)), norm)
            settings = model_settings(whole.parts, norm, whole.kept) | _rule_record(rule)
            small = SmallModels(whole)
            parts = whole.parts
        else:
            family, norm = self.reduce(model, source)
            if self.kind is ModelKind.PROJECTED:
                family = replace(family, kept=family.parts.external_units)
            settings = self._settings(family, norm, rule)
            small, parts = SmallModels(family), family.parts
        used = UsedModel(self.kind.value, settings)
        return ReducedSimulator(parts, small, rule, used, time.perf_counter() - began)

    def reduce(self, model: DetailedModel, source: str) -> SavedReduction:
        """The reduced external area, from the file if one is given."""
        if self.file is not None:
            return self._load(self.file, model)
        norm = COLUMN_NORM if self.column_norm is None else self.column_norm
        tolerance = _TOLERANCE if self.order is None and self.tolerance is None else self.tolerance
        reducer = BalancedTruncation(tolerance=tolerance, order=self.order)
        parts = partition(model, self.area.find(model.case, source))
        return SavedReduction(reduce_external(parts, reducer, norm), norm)

    def _load(self, path: Path, model: DetailedModel) -> SavedReduction:
        """The file's content; what is also given on the command line has to agree with it."""
        saved = load_reduced(path, model)
        reducer = reducer_record(saved.family.reducer)
        buses = saved.family.parts.study_buses
        asked = self.area.find(model.case, "") if self.area.given else buses
        for name, wanted, there in (
            ("study buses", as_ranges(asked), as_ranges(buses)),
            ("column norm", self.column_norm, saved.column_norm),
            ("order", self.order, reducer.get("order")),
            ("tolerance", self.tolerance, reducer.get("tolerance")),
        ):
            if wanted is not None and wanted != there:
                raise OptionError(f"{path}: the file is for {name} {there}, not {wanted}")
        return saved

    def _rule(self) -> SwitchingRule:
        if self.kind is ModelKind.LINEAR:
            return SwitchingRule(inf)
        if self.kind not in _ANGLES:
            return SwitchingRule(0.0)
        angle = _ANGLES[self.kind] if self.angle_deg is None else self.angle_deg
        longest = _LONGEST_ABOVE if self.longest_above is None else self.longest_above
        return SwitchingRule(angle, longest)

    def _settings(
        self, family: ReducedExternal, norm: float, rule: SwitchingRule
    ) -> dict[str, Any]:
        settings = model_settings(family.parts, norm, family.kept)
        if self.kind is not ModelKind.HYBRID and self.kind is not ModelKind.ADAPTIVE:
            del settings["column_norm"]
        if self.kind is ModelKind.LINEAR:
            settings["kept"] = []
        if self.kind is ModelKind.ADAPTIVE:
            settings |= _rule_record(rule)
        return settings | {
            "reducer": reducer_record(family.reducer),
            "order": family.reduction.order,
            "bound": family.reduction.bound,
        }


def model_settings(parts: Partition, norm: float, kept: Sequence[object]) -> dict[str, Any]:
    """What a model is about, ready for JSON."""
    return {
        "study_buses": as_ranges(parts.study_buses),
        "column_norm": norm,
        "kept": [str(unit) for unit in kept],
    }


def _rule_record(rule: SwitchingRule) -> dict[str, Any]:
    angle = None if rule.angle_deg == inf else rule.angle_deg
    longest = None if rule.longest_above == inf else rule.longest_above
    return {"angle_deg": angle, "longest_above": longest}


@dataclass(frozen=True)
class ReducedSimulator:
    """Simulates disturbances on one reduced model.

    `seconds` were spent on building it, `used` is what the results say about it.
    """

    parts: Partition
    small: SmallModels
    rule: SwitchingRule
    used: UsedModel
    seconds: float

    def run(
        self,
        model: DetailedModel,
        events: Sequence[Event],
        t_end: float,
        stepper: Stepper | None,
        criterion: SynchronismCriterion | None,
        store: ModelStore | None = None,
    ) -> AdaptiveRun:
        """Simulate; arguments as in :func:`gridfold.simulate`."""
        run = simulate_adaptive(
            model, self.small, self.rule, events, t_end, stepper, criterion, store
        )
        return replace(run, trajectory=replace(run.trajectory, used_model=self.used))

    def __call__(
        self,
        model: DetailedModel,
        events: Sequence[Event],
        t_end: float,
        stepper: Stepper | None,
        criterion: SynchronismCriterion | None,
        store: ModelStore | None,
        /,
    ) -> Trajectory:
        """The trajectory alone."""
        return self.run(model, events, t_end, stepper, criterion, store).trajectory
