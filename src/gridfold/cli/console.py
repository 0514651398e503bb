"""What all commands share: terminals, exit codes, options as text."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Iterable, Mapping
from enum import Enum, IntEnum
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

from gridfold.errors import OptionError
from gridfold.io.results import write_json
from gridfold.numerics.steppers import AdamsBashforthMoulton4, RungeKutta4, Stepper
from gridfold.systems.status import Status

out = Console()
err = Console(stderr=True)

EXIT_CODES = (
    "Exit codes: 0 completed; 2 bad input or options; 3 a machine lost synchronism; "
    "1 anything else, such as non-finite states."
)


class ExitCode(IntEnum):
    """Exit codes of the command."""

    COMPLETED = 0
    FAILED = 1
    BAD_INPUT = 2
    LOST_SYNCHRONISM = 3


class Method(Enum):
    """Integration rules by name."""

    RK4 = "rk4"
    ABM4 = "abm4"


CaseArgument = Annotated[
    str, typer.Argument(help="A built-in case (npcc, npcc-pst) or a case folder.")
]
EndOption = Annotated[float, typer.Option(help="End of each run (s).")]
StepOption = Annotated[
    float | None, typer.Option(help="Time step (s).", show_default="0.01; abm4 0.02")
]
MethodOption = Annotated[Method, typer.Option(help="Integration rule.")]
AngleLimitOption = Annotated[
    float, typer.Option(help="Angle from the centre of inertia at which synchronism is lost (deg).")
]
JsonOption = Annotated[str | None, typer.Option(help="Write facts as JSON; - for the terminal.")]


class ModelKind(Enum):
    """Which model is simulated."""

    DETAILED = "detailed"
    LINEAR = "linear"
    PROJECTED = "projected"
    HYBRID = "hybrid"
    ADAPTIVE = "adaptive"
    WHOLE = "whole"


ModelOption = Annotated[
    ModelKind,
    typer.Option(
        help="The detailed model; the external area linear, projected (all its functions as they "
        "are), hybrid, or adaptive; whole: adaptive without partition."
    ),
]
StudyBusesOption = Annotated[
    str | None,
    typer.Option(help="Buses of the study area, such as 1-36.", show_default="npcc: area 1"),
]
StudyAreasOption = Annotated[str | None, typer.Option(help="Areas in the study area.")]
StudyZonesOption = Annotated[str | None, typer.Option(help="Zones in the study area.")]
ColumnNormOption = Annotated[
    float | None,
    typer.Option(
        help="Column norm (p.u.) from which functions stay nonlinear.", show_default="1.0"
    ),
]
ToleranceOption = Annotated[
    float | None,
    typer.Option(help="Bound of the balanced truncation's error.", show_default="1e-5"),
]
OrderOption = Annotated[
    int | None, typer.Option(help="States of the reduced external area, instead of a tolerance.")
]
AngleDegOption = Annotated[
    float | None,
    typer.Option(
        help="Angle deviation (deg) above which the hybrid model is used.",
        show_default="67; whole 6",
    ),
]
LongestAboveOption = Annotated[
    float | None,
    typer.Option(
        help="Time (s) above it after which the operating point is looked for anew.",
        show_default="5",
    ),
]
ReducedFileOption = Annotated[
    Path | None, typer.Option("--reduced", help="Reduced external area from gridfold reduce.")
]


def exit_code(status: Status) -> ExitCode:
    """Exit code that tells how a run ended."""
    return {
        Status.COMPLETED: ExitCode.COMPLETED,
        Status.LOST_SYNCHRONISM: ExitCode.LOST_SYNCHRONISM,
    }.get(status, ExitCode.FAILED)


def make_stepper(method: Method, step: float | None) -> Stepper:
    """The stepper of a name; its own default step if `step` is None."""
    if method is Method.ABM4:
        return AdamsBashforthMoulton4() if step is None else AdamsBashforthMoulton4(step)
    return RungeKutta4() if step is None else RungeKutta4(step)


def parse_buses(text: str, what: str = "buses") -> list[int]:
    """Numbers of buses, or of `what`, from text such as ``1-36,78``."""
    numbers: list[int] = []
    for part in text.split(","):
        match = re.fullmatch(r"\s*(\d+)\s*(?:-\s*(\d+)\s*)?", part)
        if match is None:
            raise OptionError(f"{what} are given as 3,7 or 1-36, not {part.strip()!r} in {text!r}")
        first, last = int(match[1]), int(match[2] or match[1])
        if last < first:
            raise OptionError(f"the range {part.strip()!r} ends before it starts")
        numbers += range(first, last + 1)
    return list(dict.fromkeys(numbers))


def as_ranges(numbers: Iterable[int]) -> str:
    """Numbers as text such as ``1-36,78``, in ascending order."""
    ranges: list[list[int]] = []
    for number in sorted(numbers):
        if ranges and number == ranges[-1][1] + 1:
            ranges[-1][1] = number
        else:
            ranges.append([number, number])
    return ",".join(str(a) if a == b else f"{a}-{b}" for a, b in ranges)


def write_json_option(path: str | None, data: Mapping[str, Any] | list[Any]) -> None:
    """Write JSON to a file, or to standard output for ``-``."""
    if path == "-":
        sys.stdout.write(json.dumps(data, indent=2, allow_nan=False) + "\n")
    elif path is not None:
        write_json(Path(path), data)


def speaks_to_people(json_path: str | None) -> bool:
    """Whether tables go to standard output: not if JSON goes there."""
    return json_path != "-"
