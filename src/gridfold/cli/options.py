"""Options that several commands share, in groups."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from functools import cached_property, partial
from pathlib import Path
from typing import Annotated

import typer

from gridfold.cli.completion import case_sources
from gridfold.cli.console import err
from gridfold.cli.option_groups import given
from gridfold.dynamics.area_model import BoundaryCoupling
from gridfold.dynamics.device import Device
from gridfold.dynamics.initialize import OnLimit
from gridfold.dynamics.model import DetailedModel, build_model
from gridfold.dynamics.network import LoadModel, NetworkBackend
from gridfold.dynamics.own_models import is_own
from gridfold.dynamics.psse_records import Unsupported, WithoutData
from gridfold.editing import Edit, Set
from gridfold.editing.edit_files import load_edits
from gridfold.equivalents.choice import ReductionSettings, RetainSettings
from gridfold.equivalents.families import COLUMN_NORM
from gridfold.equivalents.model_kind import (
    STUDY_AREAS,
    ModelKind,
    Outputs,
    ReducerKind,
    Weights,
)
from gridfold.errors import OptionError
from gridfold.grid.case import Case
from gridfold.grid.events import Event
from gridfold.partition import Coupling, Partition, chosen_study_buses, couple, study_buses
from gridfold.runs.basis import basis_of
from gridfold.runs.case_info import CaseInfo, examine_case, examine_files
from gridfold.runs.loading import Solve, faults_later, is_network_file, load_case
from gridfold.runs.method import Choice, Method, choose_stepper
from gridfold.runs.own_devices import load_devices
from gridfold.runs.size import check_times
from gridfold.runs.step_error import choose_step
from gridfold.runs.strict import refuse_doubtful_start
from gridfold.runs.synchronism import SynchronismCriterion
from gridfold.runs.unstable_start import with_start_checked

_case_option = partial(typer.Option, rich_help_panel="Case")
run_option = partial(typer.Option, rich_help_panel="Runs")
model_option = partial(typer.Option, rich_help_panel="Model")
_area_option = partial(typer.Option, rich_help_panel="Study area")
_reduction_option = partial(typer.Option, rich_help_panel="Reduction")
_switching_option = partial(typer.Option, rich_help_panel="Switching")

JsonOption = Annotated[str | None, typer.Option(help="Write facts as JSON; - for the terminal.")]
DevicesOption = Annotated[
    list[Path] | None,
    _case_option(
        metavar="FILE.py",
        help="Python file with device models of your own, for records of their names too; it is run. "
        "May be repeated.",
    ),
]
JobsOption = Annotated[
    int | None, run_option("--jobs", "-j", min=1, help="How many threads.", show_default="cores")
]


class NoData(Enum):
    """What becomes of generators without dynamic data."""

    ERROR = "error"
    NEGATIVE_LOAD = "negative-load"


@dataclass(frozen=True)
class CaseOptions:
    """The case, and what is made of what gridfold has no model for."""

    case: Annotated[
        str,
        typer.Argument(
            help="A built-in case (npcc, npcc-pst), a case folder, or a file: .raw (PSS/E), .m "
            "(MATPOWER), .mat (RAPID).",
            autocompletion=case_sources,
        ),
    ]
    dyr: Annotated[
        Path | None, typer.Argument(help="Dynamic data of PSS/E (.dyr) for that file.")
    ] = None
    loads: Annotated[
        str,
        _case_option(
            metavar="z|raw|P,I,Z",
            help="Loads: constant impedances, as in the case, or shares of constant power, current "
            "and impedance.",
        ),
    ] = "z"
    on_limit: Annotated[
        OnLimit,
        _case_option(help="Where the start is beyond a device's limit: refuse, or move the limit."),
    ] = OnLimit.ERROR
    unsupported: Annotated[
        Unsupported,
        _case_option(
            help="Dynamic models that gridfold does not have: refuse; replace machines by GENCLS, "
            "converters by negative loads; or replace both by negative loads. The rest is left out."
        ),
    ] = Unsupported.ERROR
    no_data: Annotated[
        NoData, _case_option(help="Generators without dynamic data: refuse, or negative loads.")
    ] = NoData.ERROR
    typical: Annotated[
        bool,
        _case_option(
            "--typical", help="Generators without dynamic data: typical data by kind and size."
        ),
    ] = False
    unit_sources: Annotated[
        Path | None,
        _case_option(help="Table of what drives the units (bus, id, source), for typical data."),
    ] = None
    allow_unsupported_network: Annotated[
        bool,
        _case_option(
            "--allow-unsupported-network", help="Leave out what the network has no model for."
        ),
    ] = False
    raw_revision: Annotated[
        int | None,
        _case_option(
            help="Revision of a .raw file, 29 to 35, whatever its header says.",
            show_default="that of the header",
        ),
    ] = None
    solve: Annotated[
        Solve,
        _case_option(
            help="The operating point: as stored, or by the set points, reactive limits and switched "
            "shunts of the file."
        ),
    ] = Solve.STORED
    devices: DevicesOption = None
    edits: Annotated[
        Path | None, _case_option(help="Edits of the case, a TOML file of [[edits]] tables.")
    ] = None
    settings: Annotated[
        list[str] | None,
        _case_option(
            "--set",
            metavar="RECORD NAME=VALUE",
            help="Values of one record, such as 'GENROU 101:1 H=4' or 'load 7 PL=90'. Repeatable.",
        ),
    ] = None
    strict: Annotated[
        bool,
        _case_option(
            "--strict", help="Unusual data, records of no unit and an unstable start are errors."
        ),
    ] = False

    def __post_init__(self) -> None:
        LoadModel.parse(self.loads)
        if self.typical and self.no_data is not NoData.ERROR:
            raise OptionError("give --typical or --no-data, not both")
        if self.unit_sources is not None and not self.typical:
            raise OptionError("--unit-sources has no effect without --typical")

    @property
    def without_data(self) -> WithoutData:
        """What becomes of generators without dynamic data."""
        return WithoutData.TYPICAL if self.typical else WithoutData[self.no_data.name]

    @property
    def load_model(self) -> LoadModel:
        """How loads depend on voltage."""
        return LoadModel.parse(self.loads)

    @cached_property
    def device_models(self) -> Mapping[str, Device]:
        """All device models; files of one's own are run."""
        return load_devices(*(self.devices or ()))

    @cached_property
    def all_edits(self) -> tuple[Edit, ...]:
        """Edits of the case: those of the file first."""
        of_file = () if self.edits is None else load_edits(self.edits)
        return (*of_file, *map(Set, self.settings or ()))

    def load(self) -> Case:
        """The case, with its edits."""
        return self._load(self.device_models)

    def _load(self, devices: Mapping[str, Device]) -> Case:
        return load_case(
            self.case,
            self.dyr,
            unsupported=self.unsupported,
            without_data=self.without_data,
            unit_sources=self.unit_sources,
            allow_unsupported_network=self.allow_unsupported_network,
            raw_revision=self.raw_revision,
            solve=self.solve,
            edits=self.all_edits,
            strict=self.strict,
            devices=devices,
        )

    def build(self, backend: NetworkBackend = NetworkBackend.AUTO) -> DetailedModel:
        """The detailed model of the case."""
        if self.dyr is None and is_network_file(self.case):
            raise OptionError(
                f"{self.case} holds the network alone; the file with its dynamic data (.dyr) comes "
                "after it"
            )
        with faults_later(lambda: self._start(self._answered._load(self.device_models), backend)):
            case = self.load()
        model = self._start(case, backend)
        self._tell_unused(model)
        if self.strict:
            refuse_doubtful_start(model.case, basis_of(model))
        return model

    @property
    def _answered(self) -> CaseOptions:
        """The same with all options by which a file with faults may be loaded."""
        refusing = self.unsupported is Unsupported.ERROR
        return replace(
            self,
            unsupported=Unsupported.CLASSICAL if refusing else self.unsupported,
            no_data=NoData.ERROR if self.typical else NoData.NEGATIVE_LOAD,
            allow_unsupported_network=True,
            strict=False,
        )

    def _start(self, case: Case, backend: NetworkBackend) -> DetailedModel:
        return with_start_checked(
            build_model(
                case,
                backend=backend,
                devices=self.device_models,
                on_limit=self.on_limit,
                loads=self.load_model,
            )
        )

    def _tell_unused(self, model: DetailedModel) -> None:
        """Say so where no unit has a model of the files given."""
        used = {block.device.model for block in model.layout.blocks}
        own = [device for device in self.device_models.values() if is_own(device)]
        if own and not any(device.model in used for device in own):
            names = ", ".join(device.model for device in own)
            err.print(f"note: no unit of the case has {names} (--devices)", style="yellow")

    def examine(self) -> CaseInfo:
        """The case as far as it goes."""
        found = self._examined()
        if found.model is not None:
            self._tell_unused(found.model)
        if self.strict:
            refuse_doubtful_start(found.case, found.basis)
        return found

    def _examined(self) -> CaseInfo:
        if not is_network_file(self.case, self.dyr):
            return examine_case(self.load(), self.load_model, self.on_limit, self.device_models)
        return examine_files(
            self.case,
            self.dyr,
            self.load_model,
            self.on_limit,
            self.unsupported,
            self.without_data,
            self.raw_revision,
            self.unit_sources,
            self.solve,
            self.device_models,
            self.all_edits,
        )


@dataclass(frozen=True)
class RunOptions:
    """How runs are stepped, and when they end."""

    t_end: Annotated[float, run_option(help="End of each run (s).")] = 16.0
    step: Annotated[
        str | None,
        run_option(
            help="Time step (s); auto (simulate): the longest that is right within 0.05 degrees.",
            show_default="0.01; abm4 0.02",
        ),
    ] = None
    method: Annotated[
        Method,
        run_option(
            help="Integration rule; auto: rk4, trapezoidal where that is unstable, abm4 for many "
            "runs where a trial shows that it is exact enough."
        ),
    ] = Method.AUTO
    angle_limit: Annotated[
        float,
        run_option(help="Angle from the centre of inertia at which synchronism is lost (deg)."),
    ] = 180.0

    speed_limit: Annotated[
        float,
        run_option(help="Distance from synchronous speed at which a machine is off speed (p.u.)."),
    ] = 0.12

    @property
    def seconds(self) -> float | None:
        """The time step that was given.

        Raises
        ------
        OptionError
            It is no number.
        """
        try:
            return None if self.step is None else float(self.step)
        except ValueError:
            known = "a number of seconds, or auto for one run of simulate"
            raise OptionError(f"--step must be {known}, not {self.step!r}") from None

    def choose(self, model: DetailedModel, events: Sequence[Event] | None = None) -> Choice:
        """The stepper for `model`, with its own default step if none is given, and why.

        For one run with `events` the step may follow from its error.
        """
        if self.step == "auto" and events is not None:
            return choose_step(
                model, events, self.method, t_end=self.t_end, criterion=self.criterion
            )
        chosen = choose_stepper(model, self.method, self.seconds)
        check_times(self.t_end, chosen.stepper.step)
        return chosen

    @property
    def criterion(self) -> SynchronismCriterion:
        """When a run ends as unstable."""
        return SynchronismCriterion(self.angle_limit, self.speed_limit)


@dataclass(frozen=True)
class AreaOptions:
    """The study area."""

    study_buses: Annotated[
        str | None,
        _area_option(
            help="Buses of the study area, such as 1-36, area:1 or 'area:2 except kv<100'.",
            show_default="npcc: area 1",
        ),
    ] = None
    study_areas: Annotated[str | None, _area_option(help="Areas in the study area.")] = None
    study_zones: Annotated[str | None, _area_option(help="Zones in the study area.")] = None

    def find(self, case: Case, source: str) -> frozenset[int]:
        """Its bus numbers in `case`, which was loaded from `source`."""
        found = self.known(case, source)
        if found is None:
            raise OptionError(
                f"case {case.name} has no study area of its own; give it with --study-buses, "
                "--study-areas or --study-zones"
            )
        return found

    def known(self, case: Case, source: str) -> frozenset[int] | None:
        """The same; None where it is not given and the case has none of its own."""
        texts = (self.study_buses, self.study_areas, self.study_zones)
        found = chosen_study_buses(case, "--study-", *texts)
        if found is None and source in STUDY_AREAS:
            return study_buses(case, areas=STUDY_AREAS[source])
        return found


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
class RetainOptions:
    """Which external machines stay nonlinear."""

    norms: NormOptions
    retain_buses: Annotated[
        str | None,
        _reduction_option(
            help="External machines that stay exact, such as 42,50 or area:2, instead of a norm."
        ),
    ] = None
    retain: Annotated[
        int | None,
        _reduction_option(
            min=0,
            help="How many external machines are retained: those whose linearization matters most.",
        ),
    ] = None

    def norm(self, parts: Partition) -> float | None:
        """The column norm in per unit; None if there is none."""
        return self.norms.given(couple(parts))

    def settings(self, parts: Partition) -> RetainSettings:
        """The same for the machines of `parts`."""
        return RetainSettings(self.norm(parts), self.retain_buses, self.retain)


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
        _reduction_option(
            help="Bound of the balanced truncation's error.", show_default="1e-3; paper 1e-5"
        ),
    ] = None
    order: Annotated[
        int | None,
        _reduction_option(help="States of the reduced external area, instead of a tolerance."),
    ] = None
    slow_modes: Annotated[
        float | None,
        _reduction_option(
            help="Modes of the whole grid that decay more slowly (1/s) stay exact, besides.",
            show_default="none",
        ),
    ] = None

    weights: Annotated[
        Weights | None,
        _reduction_option(
            help="What is balanced: voltages caused at the interface, or all states alike.",
            show_default="interface; paper states",
        ),
    ] = None

    @property
    def settings(self) -> ReductionSettings:
        """The same, apart from the command line."""
        return ReductionSettings(
            self.reducer, self.tolerance, self.order, self.slow_modes, self.weights
        )


@dataclass(frozen=True)
class CouplingOptions:
    """How the areas know each other's boundary voltages."""

    coupling: Annotated[
        BoundaryCoupling | None,
        model_option(
            help="Boundary voltages solved for together, or of the previous step.",
            show_default="exact",
        ),
    ] = None


@dataclass(frozen=True)
class BoundaryOptions(CouplingOptions):
    """How the areas act on each other."""

    outputs: Annotated[
        Outputs | None,
        model_option(
            help="External machines act through ports, whose currents are linear in logarithm and "
            "angle, or by their states as in the paper.",
            show_default="polar; paper states",
        ),
    ] = None


@dataclass(frozen=True)
class SwitchingOptions:
    """When the adaptive algorithm switches."""

    angle_deg: Annotated[
        float | None,
        _switching_option(
            help="Angle deviation (deg) above which the most exact reduced model is used.",
            show_default="67; whole 6",
        ),
    ] = None
    whole_deg: Annotated[
        float | None,
        _switching_option(
            help="Angle deviation (deg) up to which adaptive and linear models are linear throughout.",
            show_default="15",
        ),
    ] = None
    tolerance_deg: Annotated[
        float | None,
        _switching_option(
            help="Error (deg, root mean square against the centre of inertia) that rotor angles of the "
            "study area may have, instead of thresholds: each run climbs the ladder until it holds."
        ),
    ] = None
    longest_above: Annotated[
        float | None,
        _switching_option(
            help="Time (s) above it after which the operating point is looked for anew.",
            show_default="5",
        ),
    ] = None

    def unused(self, kind: ModelKind) -> list[str]:
        """Those that are given and have no effect on a model."""
        if kind in (ModelKind.ADAPTIVE, ModelKind.AUTO):
            return []
        names = given(self)
        if kind is ModelKind.LINEAR:
            return [name for name in names if name != "--whole-deg"]
        switches = (ModelKind.WHOLE, ModelKind.PAPER, ModelKind.PAPER_WHOLE)
        ladder_alone = ("--whole-deg", "--tolerance-deg")
        return [name for name in names if name in ladder_alone or kind not in switches]
