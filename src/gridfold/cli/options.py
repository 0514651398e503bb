"""Options that several commands share, in groups."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum
from functools import partial
from typing import Annotated

import typer

from gridfold.cli.console import parse_buses
from gridfold.dynamics.area_model import BoundaryCoupling, Outputs
from gridfold.dynamics.model import DetailedModel
from gridfold.errors import OptionError
from gridfold.grid.case import Case
from gridfold.partition import Coupling, study_buses
from gridfold.reduction import BalancedTruncation, ModalTruncation, Reducer
from gridfold.studies.method import Choice, Method, choose_stepper
from gridfold.studies.reduced import COLUMN_NORM, ReducedExternal
from gridfold.studies.synchronism import SynchronismCriterion

#: Areas that are the study area of a built-in case if nothing else is asked for.
_STUDY_AREAS = {"npcc": (1,), "npcc-pst": (1,)}
_TOLERANCE = 1e-5

run_option = partial(typer.Option, rich_help_panel="Runs")
model_option = partial(typer.Option, rich_help_panel="Model")
_area_option = partial(typer.Option, rich_help_panel="Study area")
_reduction_option = partial(typer.Option, rich_help_panel="Reduction")
_switching_option = partial(typer.Option, rich_help_panel="Switching")

CaseArgument = Annotated[
    str, typer.Argument(help="A built-in case (npcc, npcc-pst) or a case folder.")
]
JsonOption = Annotated[str | None, typer.Option(help="Write facts as JSON; - for the terminal.")]
WorkersOption = Annotated[int | None, run_option(min=1, help="Threads.", show_default="one a core")]


class ReducerKind(Enum):
    """Reducers by name."""

    BALANCED = "balanced"
    MODAL = "modal"


@dataclass(frozen=True)
class RunOptions:
    """How runs are stepped, and when they end."""

    t_end: Annotated[float, run_option(help="End of each run (s).")] = 16.0
    step: Annotated[
        float | None, run_option(help="Time step (s).", show_default="0.01; abm4 0.02")
    ] = None
    method: Annotated[
        Method,
        run_option(help="Integration rule; auto: rk4, or trapezoidal where that is unstable."),
    ] = Method.AUTO
    angle_limit: Annotated[
        float,
        run_option(help="Angle from the centre of inertia at which synchronism is lost (deg)."),
    ] = 180.0

    def choose(self, model: DetailedModel) -> Choice:
        """The stepper for `model`, with its own default step if none is given, and why."""
        return choose_stepper(model, self.method, self.step)

    @property
    def criterion(self) -> SynchronismCriterion:
        """When synchronism is lost."""
        return SynchronismCriterion(self.angle_limit)


@dataclass(frozen=True)
class AreaOptions:
    """The study area."""

    study_buses: Annotated[
        str | None,
        _area_option(help="Buses of the study area, such as 1-36.", show_default="npcc: area 1"),
    ] = None
    study_areas: Annotated[str | None, _area_option(help="Areas in the study area.")] = None
    study_zones: Annotated[str | None, _area_option(help="Zones in the study area.")] = None

    def find(self, case: Case, source: str) -> frozenset[int]:
        """Its bus numbers in `case`, which was loaded from `source`."""
        texts = {"buses": self.study_buses, "areas": self.study_areas, "zones": self.study_zones}
        asked = {kind: parse_buses(t, kind) for kind, t in texts.items() if t is not None}
        if asked:
            return study_buses(case, **asked)
        if source in _STUDY_AREAS:
            return study_buses(case, areas=_STUDY_AREAS[source])
        raise OptionError(
            f"case {case.name} has no study area of its own; give it with --study-buses, "
            "--study-areas or --study-zones"
        )


@dataclass(frozen=True)
class NormOptions:
    """The threshold of the column norm."""

    column_norm: Annotated[
        float | None,
        _reduction_option(
            help="Column norm (p.u.) from which functions stay nonlinear.", show_default="1.0"
        ),
    ] = None
    column_norm_siemens: Annotated[
        float | None, _reduction_option(help="The same in siemens at 20 kV, instead.")
    ] = None

    def __post_init__(self) -> None:
        if self.column_norm is not None and self.column_norm_siemens is not None:
            raise OptionError("give --column-norm or --column-norm-siemens, not both")

    def given(self, coupling: Coupling) -> float | None:
        """The threshold in per unit; None if there is none."""
        if self.column_norm_siemens is None:
            return self.column_norm
        return coupling.per_unit(self.column_norm_siemens)

    def per_unit(self, coupling: Coupling) -> float:
        """The threshold in per unit, as in the paper if none is given."""
        norm = self.given(coupling)
        return COLUMN_NORM if norm is None else norm


@dataclass(frozen=True)
class AngleNormOptions(NormOptions):
    """The threshold of the column norm with which angles are calibrated."""

    column_norm: Annotated[
        float | None,
        _reduction_option(
            help="Column norm (p.u.) for the angles.", show_default="the calibrated one"
        ),
    ] = None


@dataclass(frozen=True)
class ReductionOptions:
    """How the external area is reduced."""

    reducer: Annotated[
        ReducerKind | None,
        _reduction_option(
            help="Balanced truncation, or modal truncation to an --order.", show_default="balanced"
        ),
    ] = None
    tolerance: Annotated[
        float | None,
        _reduction_option(help="Bound of the balanced truncation's error.", show_default="1e-5"),
    ] = None
    order: Annotated[
        int | None,
        _reduction_option(help="States of the reduced external area, instead of a tolerance."),
    ] = None

    def __post_init__(self) -> None:
        if self.reducer is ReducerKind.MODAL and self.tolerance is not None:
            raise OptionError("--tolerance has no effect on the modal reducer; give an --order")

    def build(self) -> Reducer:
        """The reducer."""
        if self.reducer is ReducerKind.MODAL:
            if self.order is None:
                raise OptionError("the modal reducer needs an --order")
            return ModalTruncation(self.order)
        tolerance = _TOLERANCE if self.order is None and self.tolerance is None else self.tolerance
        return BalancedTruncation(tolerance=tolerance, order=self.order)


@dataclass(frozen=True)
class BoundaryOptions:
    """How the areas act on each other: choices of the run, whatever the reduction."""

    coupling: Annotated[
        BoundaryCoupling | None,
        model_option(
            help="Boundary voltages solved for together, or of the previous step.",
            show_default="exact",
        ),
    ] = None
    outputs: Annotated[
        Outputs | None,
        model_option(
            help="External machines act by their states, or by voltages linear in logarithm and "
            "angle: faster.",
            show_default="states",
        ),
    ] = None

    def __post_init__(self) -> None:
        if (self.coupling, self.outputs) == (BoundaryCoupling.LAGGED, Outputs.POLAR):
            raise OptionError("--coupling lagged needs --outputs states")

    def applied(self, family: ReducedExternal) -> ReducedExternal:
        """The same external area with what is given here."""
        return replace(
            family,
            boundary=self.coupling or family.boundary,
            outputs=self.outputs or family.outputs,
        )


@dataclass(frozen=True)
class SwitchingOptions:
    """When the adaptive algorithm switches."""

    angle_deg: Annotated[
        float | None,
        _switching_option(
            help="Angle deviation (deg) above which the hybrid model is used.",
            show_default="67; whole 6",
        ),
    ] = None
    longest_above: Annotated[
        float | None,
        _switching_option(
            help="Time (s) above it after which the operating point is looked for anew.",
            show_default="5",
        ),
    ] = None
