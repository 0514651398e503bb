"""Models as chosen on the command line: which one, about which study area."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import isclose
from pathlib import Path
from typing import Annotated

from gridfold.cli.option_groups import given, refuse
from gridfold.cli.options import (
    AreaOptions,
    BoundaryOptions,
    ReductionOptions,
    RetainOptions,
    SwitchingOptions,
    model_option,
)
from gridfold.dynamics.model import DetailedModel
from gridfold.equivalents.adaptive import AdaptiveRun, simulate_adaptive
from gridfold.equivalents.auto import Work, choose_model
from gridfold.equivalents.choice import Family, ModelSettings
from gridfold.equivalents.error_budget import ErrorBudget, error_budget
from gridfold.equivalents.families import ReducedExternal
from gridfold.equivalents.ladder import Ladder
from gridfold.equivalents.model_kind import STUDY_AREAS, ModelKind, ReducerKind
from gridfold.equivalents.saved import SavedReduction, load_reduced, reducer_record
from gridfold.equivalents.small_models import SmallModels
from gridfold.equivalents.tolerant import TolerantModel
from gridfold.errors import OptionError
from gridfold.grid.case import UnitKey
from gridfold.grid.criteria import Criterion
from gridfold.grid.events import Event
from gridfold.grid.selection_text import as_ranges
from gridfold.numerics.steppers import Stepper
from gridfold.partition import Partition, partition
from gridfold.reduction import BalancedTruncation, ModalTruncation
from gridfold.runs.simulate import ModelStore, simulate
from gridfold.runs.synchronism import SynchronismCriterion
from gridfold.runs.trajectory import Trajectory, UsedModel

_REDUCERS = {
    BalancedTruncation.__name__: ReducerKind.BALANCED,
    ModalTruncation.__name__: ReducerKind.MODAL,
}


@dataclass(frozen=True)
class ExternalOptions:
    """The external area: which it is, what of it stays nonlinear, and how it is reduced."""

    area: AreaOptions
    retain: RetainOptions
    reduction: ReductionOptions

    def settings(self, kind: ModelKind, parts: Partition) -> ModelSettings:
        """A model of `kind` with these options."""
        return ModelSettings(kind, self.retain.settings(parts), self.reduction.settings)

    def divide(self, model: DetailedModel, source: str) -> Partition:
        """Study and external area of `model` of the case from `source`."""
        return partition(model, self.area.find(model.case, source))

    def check(self, saved: SavedReduction, path: Path) -> None:
        """What is given on the command line has to agree with the file."""
        family, parts = saved.family, saved.family.parts
        reducer = family.areas[0].reducer if isinstance(family, Ladder) else family.reducer
        record = reducer_record(reducer)
        asked = self.area.find(parts.model.case, "") if given(self.area) else parts.study_buses
        norm = self.retain.norm(parts)
        if norm is not None and saved.column_norm is not None and isclose(norm, saved.column_norm):
            norm = saved.column_norm
        kind = self.reduction.reducer
        for name, wanted, there in (
            ("study buses", as_ranges(asked), as_ranges(parts.study_buses)),
            ("column norm", norm, saved.column_norm),
            ("reducer", kind and kind.value, _REDUCERS[record["name"]].value),
            ("order", self.reduction.order, record.get("order")),
            ("tolerance", self.reduction.tolerance, record.get("tolerance")),
            ("slow modes", self.reduction.slow_modes, record.get("slow_modes")),
        ):
            if wanted is not None and wanted != there:
                raise OptionError(f"{path}: the file is for {name} {there}, not {wanted}")


@dataclass(frozen=True, kw_only=True)
class ModelChoice:
    """Which model is simulated."""

    model: Annotated[
        ModelKind,
        model_option(
            help="The detailed model; the external area linear; near machines retained; adaptive: "
            "these by the size of the swing; whole: adaptive without the linear area; auto: adaptive "
            "where that is cheaper, else detailed. As in the paper: hybrid, projected, paper, "
            "paper-whole."
        ),
    ] = ModelKind.AUTO
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
        if self.model is ModelKind.AUTO:
            return given(self.boundary) + ([] if self.reduced is None else ["--reduced"])
        if self.model is ModelKind.DETAILED:
            names = given(self.boundary) + ([] if self.reduced is None else ["--reduced"])
            external = given(self.external.retain) + given(self.external.reduction)
            return names + external + given(self.switching)
        unused = self.switching.unused(self.model)
        if self.model is ModelKind.PAPER_WHOLE:
            unused += given(self.boundary) + ([] if self.reduced is None else ["--reduced"])
            unused += given(self.external.reduction)
        if self.model is ModelKind.LINEAR:
            unused += given(self.external.retain)
            settings = ModelSettings(self.model, **vars(self.boundary))
            if self.switching.whole_deg is not None and not settings.ported:
                unused.append("--whole-deg")
        if self.reduced is not None:
            chosen = ("--retain-buses", "--retain", "--weights")
            both = given(self.external.retain) + given(self.external.reduction)
            unused += [f"with --reduced {name}" for name in both if name in chosen]
        return unused

    def build(self, model: DetailedModel, source: str, work: Work, stepper: Stepper) -> Simulator:
        """What simulates `work` with `stepper`, for `model` of the case from `source`."""
        if self.model is ModelKind.AUTO:
            return self._automatic(model, source, work, stepper)
        if self.model is ModelKind.DETAILED:
            unused = given(self.external.area)
            why = f"{unused[0]} has no effect on the detailed model" if unused else None
            return Simulator(ModelKind.DETAILED, reason=why)
        began = time.perf_counter()
        if self.reduced is not None:
            saved = load_reduced(self.reduced, model)
            self.external.check(saved, self.reduced)
            settings = self._settings(saved.family.parts, saved.column_norm)
            family = settings.adopt(saved.family)
        else:
            parts = self.external.divide(model, source)
            settings = self._settings(parts)
            family = settings.build(parts, stepper)
        return Simulator.of(settings, family, time.perf_counter() - began)

    def _automatic(
        self, model: DetailedModel, source: str, work: Work, stepper: Stepper
    ) -> Simulator:
        began = time.perf_counter()
        known = given(self.external.area) or source in STUDY_AREAS
        parts = self.external.divide(model, source) if known else None
        settings = ModelSettings(ModelKind.ADAPTIVE)
        if parts is not None:
            settings = replace(self._settings(parts), kind=ModelKind.ADAPTIVE)
        chosen = choose_model(settings, model, parts, work, stepper)
        if chosen.family is None:
            asked = self.switching.tolerance_deg
            return Simulator(ModelKind.DETAILED, reason=chosen.reason, tolerance_deg=asked)
        spent = time.perf_counter() - began
        simulator = Simulator.of(settings, chosen.family, spent, chosen.tolerant)
        told = [chosen.reason, *([] if simulator.reason is None else [simulator.reason])]
        return replace(simulator, reason="; ".join(told))

    def _settings(self, parts: Partition, norm: float | None = None) -> ModelSettings:
        settings = self.external.settings(self.model, parts)
        if norm is not None:
            settings = replace(settings, retain=replace(settings.retain, column_norm=norm))
        return replace(
            settings,
            outputs=self.boundary.outputs,
            coupling=self.boundary.coupling,
            angle_deg=self.switching.angle_deg,
            whole_deg=self.switching.whole_deg,
            longest_above=self.switching.longest_above,
            tolerance_deg=self.switching.tolerance_deg,
        )


@dataclass(frozen=True)
class Simulator:
    """Simulates disturbances on one model.

    Parameters
    ----------
    kind : ModelKind
        Which it is.
    settings : ModelSettings, optional
        Its options, unless it is the detailed one.
    small : SmallModels, optional
        Its small models.
    used : UsedModel, optional
        What the results say about it.
    seconds : float
        Time spent on building it.
    reason : str, optional
        Why it was chosen.
    tolerance_deg : float, optional
        Error in degrees that rotor angles may have.
    tolerant : TolerantModel, optional
        What keeps it on a ladder.
    """

    kind: ModelKind
    settings: ModelSettings | None = None
    small: SmallModels | None = None
    used: UsedModel | None = None
    seconds: float = 0.0
    reason: str | None = None
    tolerance_deg: float | None = None
    tolerant: TolerantModel | None = None

    @classmethod
    def of(
        cls,
        settings: ModelSettings,
        family: Family,
        seconds: float,
        tolerant: TolerantModel | None = None,
    ) -> Simulator:
        """The reduced model with `settings`, and what keeps its tolerance if that is known."""
        used = UsedModel(settings.kind.value, settings.record(family))
        if settings.tolerance_deg is None or not isinstance(family, Ladder):
            return cls(settings.kind, settings, SmallModels(family), used, seconds)
        if tolerant is None:
            began = time.perf_counter()
            tolerant = TolerantModel(family, settings.tolerance_deg)
            seconds += time.perf_counter() - began
        return cls(
            settings.kind, settings, tolerant.small, used, seconds,
            reason=tolerant.told, tolerance_deg=settings.tolerance_deg, tolerant=tolerant,
        )  # fmt: skip

    @property
    def study_units(self) -> Sequence[UnitKey]:
        """Machines of the study area; none are known of the detailed model."""
        return () if self.small is None else self.small.family.study_units

    def run(
        self,
        model: DetailedModel,
        events: Sequence[Event],
        t_end: float,
        stepper: Stepper | None,
        criterion: SynchronismCriterion | None,
        store: ModelStore | None = None,
        criteria: Sequence[Criterion] = (),
    ) -> AdaptiveRun:
        """Simulate; arguments as in :func:`gridfold.simulate`.

        With a tolerance no error turns the verdict of one of the `criteria`.
        """
        if self.small is None or self.settings is None:
            return AdaptiveRun(simulate(model, events, t_end, stepper, criterion, store), (), 0.0)
        rest = (events, t_end, stepper, criterion, store)
        if self.tolerant is not None:
            run = self.tolerant.run(model, *rest, criteria)
        else:
            run = simulate_adaptive(model, self.small, self.settings.rule, *rest)
        return replace(run, trajectory=replace(run.trajectory, used_model=self.used))

    def budget(self, events: Sequence[Event], t_end: float, stepper: Stepper) -> ErrorBudget:
        """The error by its causes."""
        family = None if self.small is None else self.small.family
        if self.settings is None or not isinstance(family, Ladder | ReducedExternal):
            raise OptionError("an error budget needs a reduced external area")
        return error_budget(family, self.settings.rule, events, t_end, stepper)

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
