"""Models as chosen on the command line: which one, about which study area."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import inf, isclose
from pathlib import Path
from typing import Annotated, Any

from gridfold.cli.option_groups import given, refuse
from gridfold.cli.options import (
    AreaOptions,
    BoundaryOptions,
    NormOptions,
    ReductionOptions,
    SwitchingOptions,
    model_option,
)
from gridfold.dynamics.model import DetailedModel
from gridfold.equivalents.adaptive import AdaptiveRun, SwitchingRule, simulate_adaptive
from gridfold.equivalents.error_budget import ErrorBudget, error_budget
from gridfold.equivalents.families import (
    ReducedExternal,
    WholeSystem,
    reduce_external,
    whole_system,
)
from gridfold.equivalents.model_kind import ANGLES_DEG, LONGEST_ABOVE, ModelKind, ReducerKind
from gridfold.equivalents.saved import SavedReduction, load_reduced, reducer_record
from gridfold.equivalents.small_models import SmallModels
from gridfold.errors import OptionError
from gridfold.grid.events import Event
from gridfold.grid.number_ranges import as_ranges
from gridfold.numerics.steppers import Stepper
from gridfold.partition import Partition, couple, partition
from gridfold.reduction import BalancedTruncation, ModalTruncation
from gridfold.runs.simulate import ModelStore
from gridfold.runs.synchronism import SynchronismCriterion
from gridfold.runs.trajectory import Trajectory, UsedModel

_REDUCERS = {
    BalancedTruncation.__name__: ReducerKind.BALANCED,
    ModalTruncation.__name__: ReducerKind.MODAL,
}


@dataclass(frozen=True)
class ExternalOptions:
    """The external area: which it is, and how it is reduced."""

    area: AreaOptions
    norm: NormOptions
    reduction: ReductionOptions

    def reduce(self, model: DetailedModel, source: str) -> SavedReduction:
        """Reduce it, for `model` of the case from `source`."""
        reducer = self.reduction.build()
        parts = partition(model, self.area.find(model.case, source))
        norm = self.norm.per_unit(couple(parts))
        return SavedReduction(reduce_external(parts, reducer, norm), norm)

    def load(self, path: Path, model: DetailedModel) -> SavedReduction:
        """The file's content; what is also given on the command line has to agree with it."""
        saved = load_reduced(path, model)
        reducer = reducer_record(saved.family.reducer)
        kind = self.reduction.reducer
        buses = saved.family.parts.study_buses
        asked = self.area.find(model.case, "") if given(self.area) else buses
        norm = self.norm.given(saved.family.coupling)
        if norm is not None and isclose(norm, saved.column_norm):
            norm = saved.column_norm
        for name, wanted, there in (
            ("study buses", as_ranges(asked), as_ranges(buses)),
            ("column norm", norm, saved.column_norm),
            ("reducer", kind and kind.value, _REDUCERS[reducer["name"]].value),
            ("order", self.reduction.order, reducer.get("order")),
            ("tolerance", self.reduction.tolerance, reducer.get("tolerance")),
            ("slow modes", self.reduction.slow_modes, reducer.get("slow_modes")),
        ):
            if wanted is not None and wanted != there:
                raise OptionError(f"{path}: the file is for {name} {there}, not {wanted}")
        return saved


@dataclass(frozen=True, kw_only=True)
class ModelChoice:
    """Which model is simulated."""

    model: Annotated[
        ModelKind,
        model_option(
            help="The detailed model; the external area linear, projected (all its functions as "
            "they are), hybrid, or adaptive; whole: adaptive without partition."
        ),
    ] = ModelKind.DETAILED
    reduced: Annotated[
        Path | None, model_option(help="Reduced external area from gridfold reduce.")
    ] = None
    boundary: BoundaryOptions
    external: ExternalOptions
    switching: SwitchingOptions

    def __post_init__(self) -> None:
        refuse(self._unused(), f"the {self.model.value} model")

    def _unused(self) -> list[str]:
        """Options that are given and have no effect on the model."""
        if self.partitioned:
            names = [] if self.model is ModelKind.ADAPTIVE else given(self.switching)
            # The projected model has no linear machines that could act by polar outputs.
            projected = self.model is ModelKind.PROJECTED and self.boundary.outputs is not None
            return [*names, "--outputs"] if projected else names
        names = given(self.boundary) + ([] if self.reduced is None else ["--reduced"])
        if self.model is ModelKind.WHOLE:
            return names + given(self.external.reduction)
        return names + given(self.external) + given(self.switching)

    @property
    def partitioned(self) -> bool:
        """Whether its external area is reduced."""
        return self.model not in (ModelKind.DETAILED, ModelKind.WHOLE)

    def build(self, model: DetailedModel, source: str) -> ReducedSimulator | None:
        """What simulates it, for `model` of the case from `source`; None for the detailed model."""
        if self.model is ModelKind.DETAILED:
            return None
        began = time.perf_counter()
        rule = self._rule()
        family: ReducedExternal | WholeSystem
        if self.model is ModelKind.WHOLE:
            parts = partition(model, self.external.area.find(model.case, source))
            norm = self.external.norm.per_unit(couple(parts))
            family = whole_system(parts, norm)
            settings = model_settings(parts, norm, family.kept) | _rule_record(rule)
        else:
            family, norm = self._reduce(model, source)
            settings = self._settings(family, norm, rule)
        used = UsedModel(self.model.value, settings)
        seconds = time.perf_counter() - began
        return ReducedSimulator(family, SmallModels(family), rule, used, seconds)

    def _reduce(self, model: DetailedModel, source: str) -> SavedReduction:
        """The reduced external area, from the file if one is given."""
        if self.reduced is None:
            family, norm = self.external.reduce(model, source)
        else:
            family, norm = self.external.load(self.reduced, model)
        if self.model is ModelKind.PROJECTED:
            family = replace(family, kept=family.parts.external_units)
        return SavedReduction(self.boundary.applied(family), norm)

    def _rule(self) -> SwitchingRule:
        if self.model is ModelKind.LINEAR:
            return SwitchingRule(inf)
        if self.model not in ANGLES_DEG:
            return SwitchingRule(0.0)
        angle, longest = self.switching.angle_deg, self.switching.longest_above
        return SwitchingRule(
            ANGLES_DEG[self.model] if angle is None else angle,
            LONGEST_ABOVE if longest is None else longest,
        )

    def _settings(
        self, family: ReducedExternal, norm: float, rule: SwitchingRule
    ) -> dict[str, Any]:
        settings = model_settings(family.parts, norm, family.kept)
        if self.model is not ModelKind.HYBRID and self.model is not ModelKind.ADAPTIVE:
            del settings["column_norm"]
        if self.model is ModelKind.LINEAR:
            settings["kept"] = []
        if self.model is ModelKind.ADAPTIVE:
            settings |= _rule_record(rule)
        return settings | {
            "coupling": family.boundary.value,
            "outputs": family.outputs.value,
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

    family: ReducedExternal | WholeSystem
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

    def budget(self, events: Sequence[Event], t_end: float, stepper: Stepper) -> ErrorBudget:
        """The error by its causes."""
        if isinstance(self.family, WholeSystem):
            raise OptionError("an error budget needs a reduced external area")
        return error_budget(self.family, self.rule, events, t_end, stepper)

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
