"""The study file: what is simulated, about what, and what is wanted of it.

A TOML file. Its JSON Schema is that of :class:`Study`, see :func:`json_schema`.
"""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from enum import Enum
from importlib import resources
from math import inf
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    WithJsonSchema,
    model_validator,
)

from gridfold.cards import Card
from gridfold.dynamics.area_model import BoundaryCoupling
from gridfold.dynamics.cuda.precision import Precision
from gridfold.dynamics.initialize import OnLimit
from gridfold.dynamics.psse_records import Unsupported, WithoutData
from gridfold.equivalents.choice import ModelSettings, ReductionSettings, RetainSettings
from gridfold.equivalents.model_kind import (
    PRINTED,
    ModelKind,
    Outputs,
    ReducerKind,
    Weights,
)
from gridfold.errors import OptionError
from gridfold.grid.selection_text import Word, parse_selection
from gridfold.io.criterion_records import criterion_from_record, criterion_schema
from gridfold.io.results import write_new
from gridfold.runs.loading import Solve
from gridfold.runs.method import LONGEST_STEP, SHORTEST_STEP, Method
from gridfold.runs.monitor import DEFAULT_MONITOR, parse_monitor
from gridfold.runs.synchronism import SynchronismCriterion
from gridfold.study.checked_file import checked, read_checked

Positive = Annotated[float, Field(gt=0, lt=inf)]
NotNegative = Annotated[float, Field(ge=0, lt=inf)]
Count = Annotated[int, Field(ge=0)]
#: Keys that do not change what a row says, so that a study may go on with another value.
FREE_KEYS = frozenset({"run.time_limit", "run.batch", "run.device"})


def _where(word: Word) -> AfterValidator:
    """Checks that a text chooses something of a grid; its numbers are first those of `word`."""

    def well_formed(text: str) -> str:
        try:
            parse_selection(text, "place", word)
        except OptionError as error:
            raise ValueError(str(error).removeprefix("place: ")) from None
        return text

    return AfterValidator(well_formed)


#: What is chosen of a grid: ``study area``, ``1-36,78``, ``area:2 except kv<100``, ``line:3-2`` ...
Where = Annotated[str, _where(Word.BUS)]


def _watched(text: str) -> str:
    """Checks that a text has the form of a monitor."""
    try:
        parse_monitor(text, "place")
    except OptionError as error:
        raise ValueError(str(error).removeprefix("place: ")) from None
    return text


#: What is watched of a run: ``flow 101-103, voltage area:1, every 5``.
Watched = Annotated[str, AfterValidator(_watched)]


class SideBySide(Enum):
    """Whether contingencies advance together."""

    AUTO = "auto"
    OFF = "off"


class RunsOn(Enum):
    """What contingencies run on."""

    AUTO = "auto"
    CPU = "cpu"
    CUDA = "cuda"


def _criterion(record: dict[str, Any]) -> dict[str, Any]:
    """Checks a table of a criterion."""
    try:
        criterion_from_record(record, "criterion")
    except OptionError as error:
        raise ValueError(str(error).removeprefix("criterion: ")) from None
    return record


#: A criterion: ``{ kind = "damping", percent = 3 }`` or ``{ preset = "damping at least 3 %" }``.
CriterionTable = Annotated[
    dict[str, Any], AfterValidator(_criterion), WithJsonSchema(criterion_schema())
]


class Kept(Enum):
    """Which trajectories are kept as files."""

    NONE = "none"
    UNSTABLE = "unstable"
    ALL = "all"


class Section(BaseModel):
    """A table of the file: unknown keys are refused, values are not changed."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class CaseSection(Section):
    """The grid."""

    source: str = Field(
        default="npcc", description="A built-in case, a case folder, or a .raw, .m or .mat file."
    )
    dyr: str | None = Field(default=None, description="Dynamic data of a .raw file.")
    loads: str = Field(default="z", description="Load model: z, raw, or shares P,I,Z.")
    on_limit: OnLimit = Field(
        default=OnLimit.ERROR, description="What if the start lies beyond a limit."
    )
    unsupported: Unsupported = Field(
        default=Unsupported.ERROR, description="What with dynamic models that are not implemented."
    )
    without_data: WithoutData = Field(
        default=WithoutData.ERROR, description="What with machines that have no dynamic data."
    )
    unit_sources: str | None = Field(
        default=None, description="Table of what drives the units, for typical data."
    )
    allow_unsupported_network: bool = Field(
        default=False, description="Leave out parts of the network that are not supported."
    )
    raw_revision: int | None = Field(
        default=None,
        ge=29,
        le=35,
        description="Revision of a .raw file, 29 to 35, whatever its header says.",
    )
    solve: Solve = Field(
        default=Solve.STORED,
        description="The operating point: as stored, or by set points, reactive limits and shunts.",
    )
    edits: str | None = Field(
        default=None, description="Edits of the case, a TOML file of [[edits]] tables."
    )
    strict: bool = Field(
        default=False,
        description="Unusual data, records of no unit and an unstable start are errors.",
    )
    devices: tuple[str, ...] = Field(
        default=(),
        description="Python files with device models of your own, by name or DYR record.",
    )


class StudyArea(Section):
    """The study area. Where nothing is given a built-in case has one of its own."""

    buses: Where | None = Field(default=None, description="Buses such as 1-36,78 or area:1.")
    areas: Annotated[str, _where(Word.AREA)] | None = Field(
        default=None, description="Areas such as 1,3."
    )
    zones: Annotated[str, _where(Word.ZONE)] | None = Field(
        default=None, description="Zones such as 1,3."
    )


class ContingencySection(Section):
    """A contingency with events of its own."""

    name: str = Field(min_length=1, description="Its name; every contingency has another one.")
    events: tuple[dict[str, Any], ...] = Field(
        min_length=1, description="Events as in an events file."
    )


class Contingencies(Section):
    """What happens to the grid."""

    bus_faults: Where = Field(
        default="none", description="Faults at these buses, cleared by themselves."
    )
    line_faults: Where = Field(
        default="none",
        description="Faults at both ends of every branch inside, cleared by tripping it.",
    )
    machine_trips: Where = Field(
        default="none", description="Trips of every machine at these buses."
    )
    clearing_time: Positive = Field(
        default=0.1, description="Duration of the generated faults (s)."
    )
    start: NotNegative = Field(default=0.0, description="Time of what is generated (s).")
    csv: str | None = Field(
        default=None, description="A table with columns name, kind, and fields of the events."
    )


class Model(Section):
    """The model that is simulated; what is not given is as on the command line."""

    kind: ModelKind = Field(
        default=ModelKind.AUTO, description="What stands for the external area after a fault."
    )
    column_norm: Positive | None = Field(
        default=None, description="Threshold of the column norm (p.u.)."
    )
    retain_buses: Where | None = Field(
        default=None, description="External machines that are retained, instead."
    )
    retain: Annotated[int, Field(ge=0)] | None = Field(
        default=None, description="How many external machines are retained, instead."
    )
    angle_deg: NotNegative | None = Field(
        default=None, description="Threshold of the angle deviation."
    )
    whole_deg: NotNegative | None = Field(
        default=None, description="Angle deviation up to which the adaptive model is all linear."
    )
    calibrate: bool = Field(
        default=False,
        description="Find the paper's thresholds that are not given from the faults of the study.",
    )
    largest_error_deg: Positive = Field(
        default=6.0, description="Error for which they are calibrated."
    )
    tolerance_deg: NotNegative | None = Field(
        default=None,
        description="Error that rotor angles of the study area may have, instead of thresholds.",
    )
    longest_above: Positive | None = Field(
        default=None, description="Time (s) above it until a new start."
    )
    reducer: ReducerKind = Field(
        default=ReducerKind.BALANCED, description="How the external area is reduced."
    )
    tolerance: Positive | None = Field(default=None, description="Bound of the reduction's error.")
    order: Annotated[int, Field(gt=0)] | None = Field(
        default=None,
        description="Order of the reduced area, instead of a tolerance; the modal reducer needs it.",
    )
    slow_modes: Positive | None = Field(
        default=None,
        description="Modes of the whole grid that decay more slowly (1/s) stay exact, besides.",
    )
    weights: Weights | None = Field(
        default=None, description="What is balanced: voltages at the interface, or all states."
    )
    outputs: Outputs | None = Field(
        default=None, description="Linear machines act through ports, or by their states."
    )
    coupling: BoundaryCoupling | None = Field(
        default=None,
        description="Areas are solved together, or see each other a step late as in the paper.",
    )

    def settings(self, kind: ModelKind) -> ModelSettings:
        """The model `kind` with these options."""
        return ModelSettings(
            kind,
            RetainSettings(self.column_norm, self.retain_buses, self.retain),
            ReductionSettings(
                self.reducer, self.tolerance, self.order, self.slow_modes, self.weights
            ),
            self.outputs,
            self.coupling,
            self.angle_deg,
            self.whole_deg,
            self.longest_above,
            self.tolerance_deg,
        )


class RunOptions(Section):
    """How each run is stepped, and when it ends."""

    t_end: Positive = Field(default=16.0, description="End of each run (s).")
    step: Annotated[float, Field(ge=SHORTEST_STEP, le=LONGEST_STEP)] | None = Field(
        default=None, description="Time step (s)."
    )
    method: Method = Field(default=Method.AUTO, description="Integration rule.")
    angle_limit_deg: Positive = Field(
        default=180.0, description="Angle from the centre of inertia at which synchronism is lost."
    )
    speed_limit: Positive = Field(
        default=0.12,
        description="Distance from synchronous speed at which a machine is off speed (p.u.).",
    )
    time_limit: Positive | None = Field(
        default=None,
        description="Longest time on the machine for one contingency (s); it fails beyond. It may "
        "differ where a study goes on.",
    )

    @property
    def criterion(self) -> SynchronismCriterion:
        """When a run ends as unstable."""
        return SynchronismCriterion(self.angle_limit_deg, self.speed_limit)


class Run(RunOptions):
    """How each run is stepped, and when it ends."""

    batch: SideBySide = Field(
        default=SideBySide.AUTO,
        description="Contingencies advance together where that is faster, or one by one.",
    )
    device: RunsOn = Field(
        default=RunsOn.CPU,
        description="What contingencies run on: a GPU where one is found, the CPU, or a GPU only.",
    )
    precision: Precision = Field(
        default=Precision.DOUBLE,
        description="Digits with which a GPU computes; single needs the device cuda, and its error is "
        "found and told.",
    )


class Check(Section):
    """Detailed runs beside those of a reduced model: the evidence of its accuracy."""

    sample: Count | Literal["all"] = Field(
        default=10,
        description="How many runs: unstable ones, those nearest to the limit, those with the largest "
        "estimated errors, and others by chance.",
    )


class ClearingTimes(Section):
    """Critical clearing times of faults that are alone in their contingency."""

    wanted: bool = Field(default=False, description="Find them, on the model of the study.")
    resolution: Annotated[float, Field(ge=1e-6, lt=inf)] = Field(
        default=0.01, description="Grid of clearing times (s)."
    )
    longest: Positive = Field(default=2.0, description="Longest one tried (s).")


class OutputsWanted(Section):
    """What is kept besides the summaries."""

    curves: bool = Field(
        default=True, description="Rotor angles of the study area for the report, 200 points each."
    )
    trajectories: Kept = Field(
        default=Kept.NONE, description="Whole trajectories as Parquet files."
    )
    monitor: Watched | tuple[Watched, ...] | None = Field(
        default=None,
        description="What is watched: columns of these files, and curves in the report.",
    )
    signals: tuple[str, ...] = Field(
        default=(),
        description="The older form of monitor: further columns of these files.",
        json_schema_extra={"deprecated": True},
    )

    @property
    def watched(self) -> str:
        """What is watched, as one text; that of tables where nothing is said."""
        if self.monitor is None:
            return ", ".join((DEFAULT_MONITOR, *self.signals))
        return self.monitor if isinstance(self.monitor, str) else ", ".join(self.monitor)


class Study(Card, Section):
    """A study: the whole file."""

    model_config = ConfigDict(title="gridfold study", extra="forbid", frozen=True)

    schema_version: Literal[1] = Field(
        default=1, alias="schema", description="Version of the format."
    )
    name: str = Field(default="study", min_length=1, description="Name of the study, for people.")
    case: CaseSection = CaseSection()
    study_area: StudyArea = StudyArea()
    contingencies: Contingencies = Contingencies()
    contingency: tuple[ContingencySection, ...] = ()
    edits: tuple[dict[str, Any], ...] = Field(
        default=(),
        description="Edits of the case, after those of case.edits, as in a file of edits.",
    )
    relays: tuple[dict[str, Any], ...] = Field(
        default=(), description="Relays that watch every run, as in a file of relays."
    )
    criteria: tuple[CriterionTable, ...] = Field(
        default=(), description="What a run has to fulfil, by kind or preset."
    )
    model: Model = Model()
    run: Run = Run()
    check: Check = Check()
    clearing_times: ClearingTimes = ClearingTimes()
    outputs: OutputsWanted = OutputsWanted()

    def _facts(self) -> dict[str, object]:
        return {
            "name": self.name,
            "case": self.case.source,
            "model": self.model.kind.value,
            "bus faults": self.contingencies.bus_faults,
            "line faults": self.contingencies.line_faults,
            "machine trips": self.contingencies.machine_trips,
            "listed": len(self.contingency),
            "until": f"{self.run.t_end:g} s",
        }

    @model_validator(mode="after")
    def _fits(self) -> Study:
        times = self.clearing_times
        if self.outputs.monitor is not None and self.outputs.signals:
            raise ValueError("outputs.monitor takes the place of outputs.signals: give one of them")
        if times.wanted and not times.resolution <= times.longest < self.run.t_end:
            raise ValueError(
                "clearing_times.longest must lie between clearing_times.resolution and run.t_end"
            )
        if self.contingencies.start >= self.run.t_end:
            raise ValueError("contingencies.start must lie before run.t_end")
        kind = self.model.kind
        if self.model.calibrate and kind not in (*PRINTED, ModelKind.DETAILED):
            raise ValueError(f"model.calibrate finds the paper's thresholds, not {kind.value}'s")
        try:
            settings = self.model.settings(kind)
            settings.reduction.build(settings.ported)
        except OptionError as error:
            raise ValueError(f"model: {error}") from None
        return self

    def content(self) -> dict[str, Any]:
        """Everything with defaults filled in, ready for JSON."""
        return self.model_dump(mode="json", by_alias=True)


def load_study(path: str | Path) -> Study:
    """Read and check a study file.

    Raises
    ------
    CaseFileError
        The file cannot be read, or something in it is wrong: every fault with its line.
    """
    return read_checked(Path(path), Study)


def parse_study(content: dict[str, Any]) -> Study:
    """A study from a mapping with the keys of the file.

    Raises
    ------
    CaseFileError
        Something in it is wrong: every fault.
    """
    return checked(content, Study, "study")


def with_own_devices(study: Study, files: Sequence[str | Path], folder: Path) -> Study:
    """The same study with further Python files of device models; its names start at `folder`."""
    names = [Path(os.path.relpath(file, folder)).as_posix() for file in files]
    every = tuple(dict.fromkeys((*study.case.devices, *names)))
    return study.model_copy(update={"case": study.case.model_copy(update={"devices": every})})


def json_schema() -> dict[str, Any]:
    """JSON Schema of the study file."""
    return Study.model_json_schema(by_alias=True)


def template(devices: Sequence[str] = ()) -> str:
    """A study file with a comment on every key; it names the Python files `devices`."""
    text = resources.files("gridfold.study").joinpath("study.toml").read_text("utf-8")
    if not devices:
        return text
    key, comment = '# devices = ["my_exciter.py"]', "         #"
    assert key + comment in text
    return text.replace(key + comment, f"devices = {json.dumps(list(devices))}  #")


def write_template(path: str | Path, devices: Sequence[str | Path] = ()) -> None:
    """Write :func:`template` to a new file; it names the Python files `devices`.

    Raises
    ------
    OutputError
        The file exists, or cannot be written.
    """
    path = Path(path)
    names = [Path(os.path.relpath(file, path.parent)).as_posix() for file in devices]
    write_new(path, template(names))
