"""From the name of a model and its options to what simulates it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import inf
from typing import Any

import numpy as np

from gridfold.dynamics.area_model import BoundaryCoupling
from gridfold.equivalents.area_bases import PORT_TOLERANCE
from gridfold.equivalents.families import (
    COLUMN_NORM,
    Mode,
    ReducedExternal,
    WholeSystem,
    reduce_external,
    whole_system,
)
from gridfold.equivalents.fit import Fit
from gridfold.equivalents.fitted import fit_ladder
from gridfold.equivalents.folded import FoldedArea, fold
from gridfold.equivalents.ladder import Ladder
from gridfold.equivalents.limit_scan import limited_among
from gridfold.equivalents.limit_weight import light_limits
from gridfold.equivalents.model_kind import (
    ANGLES_DEG,
    DWELL,
    LONGEST_ABOVE,
    PORTED,
    PRINTED,
    WHOLE_DEG,
    ModelKind,
    Outputs,
    ReducerKind,
    Weights,
)
from gridfold.equivalents.ranking import rank_retained
from gridfold.equivalents.saved import reducer_record
from gridfold.equivalents.swings import Swings, sample_swings
from gridfold.equivalents.switching import SwitchingRule
from gridfold.errors import OptionError
from gridfold.grid.case import UnitKey
from gridfold.grid.selection import select_machines
from gridfold.grid.selection_text import as_ranges, parse_selection
from gridfold.numerics.steppers import Stepper
from gridfold.partition import Partition, couple
from gridfold.reduction import Reducer

#: Models that have no form with states.
_PORTS_ALONE = (ModelKind.AUTO, ModelKind.RETAINED, ModelKind.ADAPTIVE, ModelKind.WHOLE)
#: What stands for the external area.
Family = Ladder | ReducedExternal | WholeSystem


@dataclass(frozen=True)
class ReductionSettings:
    """How the external area is reduced; what is None takes the default of the model."""

    reducer: ReducerKind | None = None
    tolerance: float | None = None
    order: int | None = None
    slow_modes: float | None = None
    weights: Weights | None = None

    @property
    def follows(self) -> bool:
        """Whether the order is open, so that it may follow from a tolerance of rotor angles."""
        balanced = self.reducer in (None, ReducerKind.BALANCED)
        bounds = self.tolerance is None and self.order is None
        return balanced and bounds and self.weights is not Weights.STATES

    def build(self, ported: bool) -> Reducer:
        """The reducer of a folded area, or of the paper's models."""
        kind = self.reducer or ReducerKind.BALANCED
        default = PORT_TOLERANCE if ported and self.weights is not Weights.STATES else None
        return kind.build(self.tolerance, self.order, self.slow_modes, default)


#: What messages call the machines that are retained.
_RETAINED = "external machines to be retained"


@dataclass(frozen=True)
class RetainSettings:
    """Which external machines stay nonlinear: from a column norm (p.u.), at buses, or the best few.

    If nothing is given those from 1 p.u. on do, of which there are to be no more than half.

    Machines at buses are given as a text (:mod:`gridfold.grid.selection_text`), such as ``42,50`` or
    ``area:2``; each part of it has to have one.
    """

    column_norm: float | None = None
    buses: str | None = None
    count: int | None = None

    def __post_init__(self) -> None:
        if sum(value is not None for value in (self.column_norm, self.buses, self.count)) > 1:
            raise OptionError(
                "give one of the column norm, the buses and the number of retained machines"
            )
        if self.count is not None and self.count < 0:
            raise OptionError(f"the number of retained machines must be 0 or more: {self.count}")
        if self.buses is not None:
            parse_selection(self.buses, _RETAINED)

    def choose(self, parts: Partition, swings: Swings) -> tuple[UnitKey, ...]:
        """The machines."""
        if self.buses is not None:
            among = parts.external_units
            case, inside = parts.model.case, parts.study_buses
            chosen = set(select_machines(self.buses, case, _RETAINED, inside, among))
            return tuple(unit for unit in among if unit in chosen)
        if self.count is not None:
            return rank_retained(parts, swings).first(self.count) if self.count else ()
        coupling = couple(parts)
        if self.column_norm is not None:
            return coupling.kept(self.column_norm)
        seen = coupling.norms[coupling.norms > 0]  # loads that follow the frequency have none
        return coupling.kept(max(COLUMN_NORM, float(np.median(seen)) if len(seen) else 0.0))


@dataclass(frozen=True)
class ModelSettings:
    """A model by name, with the options that are given; what is None takes the model's default."""

    kind: ModelKind
    retain: RetainSettings = RetainSettings()
    reduction: ReductionSettings = ReductionSettings()
    outputs: Outputs | None = None
    coupling: BoundaryCoupling | None = None
    angle_deg: float | None = None
    whole_deg: float | None = None
    longest_above: float | None = None
    tolerance_deg: float | None = None

    def __post_init__(self) -> None:
        self._check_tolerance()
        lagged = self.coupling is BoundaryCoupling.LAGGED
        if lagged and self.outputs is Outputs.POLAR:
            raise OptionError("the lagged coupling needs outputs 'states'")
        states = lagged or self.outputs is Outputs.STATES
        if self.kind in _PORTS_ALONE and states:
            what = "the lagged coupling" if lagged else "outputs 'states'"
            raise OptionError(f"{what} has no effect on the {self.kind.value} model")
        if self.kind in PRINTED and self.outputs is Outputs.POLAR:
            raise OptionError(
                f"the {self.kind.value} model forms states: outputs 'polar' is not its"
            )
        forms_states = self.kind in PRINTED or (self.kind in PORTED and states)
        if forms_states and self.reduction.weights is Weights.INTERFACE:
            raise OptionError(f"weights 'interface' have no effect on the {self._form}")

    def _check_tolerance(self) -> None:
        """A tolerance is the only number that says how the ladder is climbed."""
        if self.tolerance_deg is None:
            return
        if self.kind not in (ModelKind.AUTO, ModelKind.ADAPTIVE, ModelKind.DETAILED):
            raise OptionError(f"a tolerance has no effect on the {self.kind.value} model")
        for name in ("angle_deg", "whole_deg", "longest_above"):
            if getattr(self, name) is not None:
                raise OptionError(f"give the tolerance or {name}, not both")
        if not 0 <= self.tolerance_deg < inf:
            raise OptionError(f"a tolerance is 0 degrees or more, not {self.tolerance_deg!r}")

    @property
    def _form(self) -> str:
        states = " with outputs 'states'" if self.kind in PORTED else ""
        return f"{self.kind.value} model{states}"

    @property
    def ported(self) -> bool:
        """Whether linear machines act through ports."""
        states = self.outputs is Outputs.STATES or self.coupling is BoundaryCoupling.LAGGED
        return self.kind in (*PORTED, ModelKind.AUTO) and not states

    @property
    def norm(self) -> float:
        """The column norm in p.u. from which the paper's models keep machines."""
        norm = self.retain.column_norm
        return COLUMN_NORM if norm is None else norm

    @property
    def rule(self) -> SwitchingRule:
        """When which model is used."""
        if self.kind is ModelKind.LINEAR:
            if not self.ported:
                return SwitchingRule(inf)
            return SwitchingRule(self._whole_deg, inf, dwell=DWELL)
        if self.kind is ModelKind.RETAINED:
            return SwitchingRule(0.0, longest_above=inf)
        if self.kind not in ANGLES_DEG:
            return SwitchingRule(0.0)
        angle, longest = self.angle_deg, self.longest_above
        return SwitchingRule(
            ANGLES_DEG[self.kind] if angle is None else angle,
            LONGEST_ABOVE if longest is None else longest,
            whole_deg=self._whole_deg if self.kind is ModelKind.ADAPTIVE else 0.0,
            dwell=DWELL if self.ported else 0.0,
        )

    @property
    def _whole_deg(self) -> float:
        return WHOLE_DEG if self.whole_deg is None else self.whole_deg

    def build(
        self, parts: Partition, stepper: Stepper | None = None, known: Fit | None = None
    ) -> Family:
        """The models between which the rule switches, for runs with `stepper`.

        Machines whose limits act along the sample swings are retained besides. With a tolerance, what
        is not given follows from it, or from what was `known` of it before.
        """
        if not self.ported:
            return self._printed(parts)
        if self.tolerance_deg:
            return self._fitted(parts, self.tolerance_deg, stepper, known)
        reducer = self.reduction.build(ported=True)
        weights = self.reduction.weights or Weights.INTERFACE
        swings = sample_swings(parts, stepper=stepper)
        retained = () if self.kind is ModelKind.LINEAR else self.retained(parts, swings)
        ladder = self.of_areas(lambda units: fold(parts, units, reducer, weights, swings), retained)
        ladder = replace(ladder, light_limits=light_limits(ladder, swings, stepper))
        return ladder.measured(stepper) if self.kind in ANGLES_DEG else ladder

    def _fitted(
        self, parts: Partition, tolerance_deg: float, stepper: Stepper | None, known: Fit | None
    ) -> Ladder:
        """The ladder that is made for the tolerance, with the options that are given."""
        reduction, swings = self.reduction, sample_swings(parts, stepper=stepper)
        given = None if self.retain == RetainSettings() else self.retained(parts, swings)
        return fit_ladder(
            parts, tolerance_deg, stepper,
            reducer=None if reduction.follows else reduction.build(ported=True),
            retained=given,
            slow_modes=reduction.slow_modes,
            weights=reduction.weights or Weights.INTERFACE,
            swings=swings, known=known,
        )  # fmt: skip

    def retained(self, parts: Partition, swings: Swings) -> tuple[UnitKey, ...]:
        """External machines that stay exact: those chosen, and those whose limits act.

        Raises
        ------
        OptionError
            None is left to be linear.
        """
        found = limited_among(parts, swings, self.retain.choose(parts, swings))
        return tuple(unit for unit in parts.external_units if unit in found)

    def of_areas(
        self,
        folded: Callable[[tuple[UnitKey, ...]], FoldedArea],
        retained: tuple[UnitKey, ...],
    ) -> Ladder:
        """The ladder of this model from areas `folded` with the machines that are retained."""
        near = folded(retained)
        if self.kind is ModelKind.RETAINED:
            return Ladder((near,))
        if self.kind in (ModelKind.LINEAR, ModelKind.WHOLE):
            return Ladder((near,), whole=True)
        return Ladder((near, folded(()) if retained else near), whole=True)

    def adopt(self, family: Family) -> Family:
        """The same from a family that was made before, as one from a file.

        Raises
        ------
        OptionError
            It lacks an area of this model, or is of another form.
        """
        if not isinstance(family, Ladder):
            if self.ported:
                raise OptionError(f"the {self.kind.value} model needs a file with outputs 'polar'")
            return self._of_printed(family)
        if not self.ported:
            raise OptionError(f"the {self.kind.value} model needs a file with outputs 'states'")
        found = {area.retained: area for area in family.areas}
        retained = () if self.kind is ModelKind.LINEAR else family.retained
        if self.kind is ModelKind.LINEAR and () not in found:
            raise OptionError("the file has no area in which all external machines are linear")
        ladder = self.of_areas(found.__getitem__, retained)
        ladder = replace(ladder, light_limits=family.light_limits, fit=family.fit)
        rungs = {Mode.DETAILED, *ladder.rungs}
        if self.kind in ANGLES_DEG and rungs <= family.step_seconds.keys():
            known = {mode: spent for mode, spent in family.step_seconds.items() if mode in rungs}
            return replace(ladder, step_seconds=known)
        return ladder

    def _printed(self, parts: Partition) -> ReducedExternal | WholeSystem:
        if self.retain.buses is not None or self.retain.count is not None:
            raise OptionError(f"the {self.kind.value} model keeps machines by their column norm")
        if self.kind is ModelKind.PAPER_WHOLE:
            return whole_system(parts, self.norm)
        coupling = self.coupling or BoundaryCoupling.EXACT
        reducer = self.reduction.build(ported=False)
        return self._of_printed(reduce_external(parts, reducer, self.norm, coupling))

    def _of_printed(self, family: Family) -> ReducedExternal | WholeSystem:
        """With the machines kept, and the coupling, of this model."""
        if not isinstance(family, ReducedExternal):
            raise OptionError(f"the {self.kind.value} model needs a reduced external area")
        coupling = family.boundary if self.coupling is None else self.coupling
        kept = family.parts.external_units if self.kind is ModelKind.PROJECTED else family.kept
        return replace(family, boundary=coupling, kept=kept)

    def record(self, family: Family) -> dict[str, Any]:
        """What the model is about, ready for JSON."""
        rule, parts = self.rule, family.parts
        record: dict[str, Any] = {"study_buses": as_ranges(parts.study_buses)}
        if isinstance(family, Ladder):
            record |= _ladder_record(family)
        else:
            record |= {"column_norm": self.norm, "kept": [str(unit) for unit in family.kept]}
        if self.kind is ModelKind.PROJECTED or self.kind is ModelKind.LINEAR:
            record.pop("column_norm", None)
        if self.kind is ModelKind.LINEAR:
            record["kept"] = []
        if self.tolerance_deg is not None:
            return record | {"tolerance_deg": self.tolerance_deg}
        if self.kind in ANGLES_DEG:
            record |= {
                name: _finite(getattr(rule, name)) for name in ("angle_deg", "longest_above")
            }
        if self.kind is ModelKind.ADAPTIVE or (self.kind is ModelKind.LINEAR and self.ported):
            record["whole_deg"] = self._whole_deg
        if isinstance(family, ReducedExternal):
            record |= {
                "coupling": family.boundary.value,
                "outputs": Outputs.STATES.value,
                "reducer": reducer_record(family.reducer),
                "order": family.reduction.order,
                "bound": family.reduction.bound,
            }
        return record


def _ladder_record(family: Ladder) -> dict[str, Any]:
    area = family.areas[0]
    return {
        "kept": [str(unit) for unit in family.retained],
        "coupling": BoundaryCoupling.EXACT.value,
        "outputs": Outputs.POLAR.value,
        "reducer": reducer_record(area.reducer),
        "ports": list(area.ports.buses),
        "order": area.bases.order,
        "bound": area.bases.bound,
        "rungs": [
            {
                "model": rung.value,
                "step_us": None if not family.step_seconds else 1e6 * family.step_seconds[rung],
                "used": rung in family.modes,
                "limits_passed_over_deg": family.light_limits.get(rung),
            }
            for rung in dict.fromkeys(family.rungs)
        ],
        "fit": None if family.fit is None else family.fit.record(),
    }


def _finite(value: float) -> float | None:
    return None if value == inf else value
