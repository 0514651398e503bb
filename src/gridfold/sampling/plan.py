"""The plan of a data set: what is drawn for each sample, and what is kept of its run.

A TOML file. Its JSON Schema is that of :class:`SamplePlan`, see :func:`plan_schema`.
"""

from __future__ import annotations

from collections import Counter
from enum import Enum
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

from pydantic import ConfigDict, Field, ValidationError, model_validator

from gridfold.cards import Card, first_few
from gridfold.equivalents.model_kind import ModelKind
from gridfold.io.results import write_new
from gridfold.sampling.distribution import Amount, Distribution, value_of
from gridfold.sampling.rows import COLUMNS
from gridfold.study.checked_file import read_checked
from gridfold.study.study_file import (
    CaseSection,
    Check,
    ClearingTimes,
    Contingencies,
    ContingencySection,
    Kept,
    Model,
    NotNegative,
    OutputsWanted,
    Run,
    RunOptions,
    Section,
    Study,
    Watched,
    Where,
)

#: Keys that do not change what a row says, so that a data set may go on with another value.
FREE_KEYS = frozenset({"run.time_limit", "check.samples"})

#: Part of the clearing times that have to lie before the end of a run.
_LATEST = 1 - 1e-6

Name = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_]*$", max_length=60)]


class Filling(Enum):
    """How samples fill the space of what is drawn."""

    SOBOL = "sobol"
    LATIN_HYPERCUBE = "latin_hypercube"


class PowerSection(Section):
    """Powers that are drawn: of loads, at constant power factor, or of units, active power alone.

    Units at slack buses take no part.
    """

    name: Name | None = Field(
        default=None, description="Name of its column; by default its table and number, load_1."
    )
    where: Where = Field(default="all", description="Which: all at these buses, such as area:1.")
    factor: Amount | None = Field(default=None, description="What the power is multiplied by.")
    change_mw: Amount | None = Field(
        default=None, description="Or by how much it changes in all (MW), in proportion to power."
    )

    @model_validator(mode="after")
    def _fits(self) -> PowerSection:
        if (self.factor is None) == (self.change_mw is None):
            raise ValueError("give factor or change_mw, one of the two")
        if self.factor is not None and value_of(self.factor, 0.0) < 0:
            raise ValueError("factor must not be negative; cut a normal distribution with within")
        return self

    @property
    def amount(self) -> float | Distribution:
        """What is drawn."""
        amount = self.change_mw if self.factor is None else self.factor
        assert amount is not None
        return amount


class ParameterSection(Section):
    """Parameters of devices that are drawn, such as `inertia`, on the base that they have in files."""

    name: Name | None = Field(
        default=None,
        description="Name of its column; by default its table and number, parameter_1.",
    )
    where: Where = Field(default="all", description="Units, or all units at buses.")
    parameter: str = Field(min_length=1, description="Name as in the tables of devices.")
    model: str | None = Field(
        default=None, description="Model of the device; by default each that has the parameter."
    )
    factor: Amount | None = Field(default=None, description="What each value is multiplied by.")
    value: Amount | None = Field(default=None, description="Or the value of all.")

    @model_validator(mode="after")
    def _fits(self) -> ParameterSection:
        if (self.factor is None) == (self.value is None):
            raise ValueError("give factor or value, one of the two")
        return self

    @property
    def amount(self) -> float | Distribution:
        """What is drawn."""
        amount = self.value if self.factor is None else self.factor
        assert amount is not None
        return amount


class BalanceSection(Section):
    """Who takes up what loads and drawn units change."""

    units: Where = Field(
        default="all",
        description="Units that share it in proportion to their power, those of [[generation]] and "
        "at slack buses aside; none: the slack takes it.",
    )


class FaultSection(Section):
    """What may happen; each sample has one of all these, drawn with equal chances."""

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
    clearing_time: Amount = Field(default=0.1, description="Duration of these faults (s).")
    start: NotNegative = Field(default=0.0, description="Time at which it happens (s).")
    csv: str | None = Field(
        default=None, description="A table with columns name, kind, and fields of the events."
    )

    @model_validator(mode="after")
    def _fits(self) -> FaultSection:
        if not value_of(self.clearing_time, 0.0) > 0:
            raise ValueError(
                "clearing_time must be positive; cut a normal distribution with within"
            )
        return self


class CheckSection(Section):
    """Samples that are run anew for the data card, each model built from its case alone."""

    samples: Annotated[int, Field(ge=0, le=1000)] = Field(
        default=5, description="How many, at the time step and at half of it."
    )


class OutputSection(Section):
    """What is kept besides the labels."""

    trajectories: Kept = Field(default=Kept.NONE, description="Curves of which samples.")
    monitor: Watched | tuple[Watched, ...] = Field(
        default=("angle all", "every 5"), description="What they show, and each how many-th step."
    )


class Named(NamedTuple):
    """Something that is drawn: the name of its column, its table and number there, and what it is."""

    name: str
    table: str
    number: int
    item: PowerSection | ParameterSection


class SamplePlan(Card, Section):
    """A plan: the whole file."""

    model_config = ConfigDict(title="gridfold sample plan", extra="forbid", frozen=True)

    schema_version: Literal[1] = Field(
        default=1, alias="schema", description="Version of the format."
    )
    name: str = Field(default="samples", min_length=1, description="Name of the data, for people.")
    samples: Annotated[int, Field(ge=1, le=100_000_000)] = Field(
        description="How many samples. With sobol a data set may go on with more."
    )
    seed: Annotated[int, Field(ge=0)] = Field(description="What all that is drawn follows from.")
    filling: Filling = Field(
        default=Filling.SOBOL, description="How they fill the space of what is drawn."
    )
    chunk: Annotated[int, Field(ge=1, le=100_000)] = Field(
        default=100, description="Samples of one file; a kill loses those that are worked on."
    )
    case: CaseSection = CaseSection()
    load: tuple[PowerSection, ...] = ()
    generation: tuple[PowerSection, ...] = ()
    balance: BalanceSection = BalanceSection()
    parameter: tuple[ParameterSection, ...] = ()
    faults: FaultSection = FaultSection()
    contingency: tuple[ContingencySection, ...] = ()
    relays: tuple[dict[str, Any], ...] = Field(
        default=(), description="Relays that watch every run, as in a file of relays."
    )
    run: RunOptions = RunOptions()
    clearing_times: ClearingTimes = ClearingTimes()
    outputs: OutputSection = OutputSection()
    check: CheckSection = CheckSection()

    def _facts(self) -> dict[str, object]:
        return {
            "name": self.name,
            "case": self.case.source,
            "samples": self.samples,
            "seed": self.seed,
            "drawn": first_few(self.names),
            "bus faults": self.faults.bus_faults,
            "line faults": self.faults.line_faults,
            "machine trips": self.faults.machine_trips,
            "listed": len(self.contingency),
            "until": f"{self.run.t_end:g} s",
        }

    @model_validator(mode="after")
    def _fits(self) -> SamplePlan:
        faults = self.faults
        if faults.start + value_of(faults.clearing_time, _LATEST) >= self.run.t_end:
            raise ValueError("run.t_end must lie after the faults are cleared")
        names = self.names
        if taken := sorted(set(names) & COLUMNS.keys()):
            raise ValueError(f"columns of every data set are called {', '.join(taken)}: rename it")
        if twice := sorted(name for name, count in Counter(names).items() if count > 1):
            raise ValueError(f"several things that are drawn have one name: {', '.join(twice)}")
        try:
            self.study()
        except ValidationError as error:
            raise ValueError(error.errors()[0]["msg"].removeprefix("Value error, ")) from None
        return self

    @property
    def named(self) -> tuple[Named, ...]:
        """All powers and parameters that are drawn, in the order of the tables."""
        tables: tuple[tuple[str, tuple[PowerSection | ParameterSection, ...]], ...] = (
            ("load", self.load),
            ("generation", self.generation),
            ("parameter", self.parameter),
        )
        return tuple(
            Named(item.name or f"{table}_{number}", table, number, item)
            for table, items in tables
            for number, item in enumerate(items, start=1)
        )

    @property
    def names(self) -> tuple[str, ...]:
        """Their names, which are columns of the data."""
        return tuple(each.name for each in self.named)

    @property
    def drawn(self) -> tuple[tuple[str, float | Distribution], ...]:
        """Their names and amounts."""
        return tuple((each.name, each.item.amount) for each in self.named)

    def study(self) -> Study:
        """The study of all contingencies of the plan at the operating point of the case.

        Its faults have the shortest clearing time.
        """
        faults = self.faults
        return Study(
            name=self.name,
            case=self.case,
            contingencies=Contingencies(
                bus_faults=faults.bus_faults,
                line_faults=faults.line_faults,
                machine_trips=faults.machine_trips,
                clearing_time=value_of(faults.clearing_time, 0.0),
                start=faults.start,
                csv=faults.csv,
            ),
            contingency=self.contingency,
            relays=self.relays,
            model=Model(kind=ModelKind.DETAILED),
            run=Run(**self.run.model_dump()),
            check=Check(sample=0),
            clearing_times=self.clearing_times,
            outputs=OutputsWanted(
                curves=False,
                trajectories=self.outputs.trajectories,
                monitor=self.outputs.monitor,
            ),
        )

    def content(self) -> dict[str, Any]:
        """Everything with defaults filled in, ready for JSON."""
        return self.model_dump(mode="json", by_alias=True)


def load_plan(path: str | Path) -> SamplePlan:
    """Read and check a plan.

    Raises
    ------
    CaseFileError
        The file cannot be read, or something in it is wrong: every fault with its line.
    """
    return read_checked(Path(path), SamplePlan)


def plan_schema() -> dict[str, Any]:
    """JSON Schema of the plan."""
    return SamplePlan.model_json_schema(by_alias=True)


def write_plan(path: str | Path) -> None:
    """Write a plan with a comment on every key; an OutputError if there is such a file already."""
    text = resources.files("gridfold.sampling").joinpath("plan.toml").read_text("utf-8")
    write_new(Path(path), text)
