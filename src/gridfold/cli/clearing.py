"""The command that finds critical clearing times: cct."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from gridfold.cli.brake import brake_on_signals
from gridfold.cli.choice import ModelChoice, Simulator
from gridfold.cli.console import (
    err,
    out,
    say_basis,
    say_doubts,
    say_method,
    say_model,
    speaks_to_people,
    stage_bars,
    write_json_option,
)
from gridfold.cli.exit_codes import ExitCode
from gridfold.cli.options import CaseOptions, JobsOption, JsonOption, RunOptions, run_option
from gridfold.cli.study import ResumeOption, output_option
from gridfold.cli.table_options import TableOptions
from gridfold.dynamics.model import DetailedModel
from gridfold.equivalents.auto import Work
from gridfold.equivalents.model_kind import ModelKind
from gridfold.errors import OptionError
from gridfold.grid.events import BranchFault, BusFault
from gridfold.grid.selection import select_buses, select_lines
from gridfold.io.results import check_target
from gridfold.report.clearing_plot import plot_clearing_times
from gridfold.report.style import check_format
from gridfold.report.tables import clearing_table
from gridfold.runs.basis import basis_of
from gridfold.runs.clearing import ClearingTimes, Fault, critical_clearing_times
from gridfold.runs.longer_step import choose_for_many
from gridfold.runs.simulate import simulate

#: Runs that a critical clearing time takes, roughly.
_RUNS_PER_FAULT = 8
#: What the record of a reduced model has of clocks and rounding, which differ from run to run.
_MEASURED = ("rungs", "bound")
#: Places that are shown at the end.
_SHOWN = 40

_HELP = """Critical clearing times of three-phase faults, of a few places or of the whole grid.

The longest clearing time on a grid of times for which no machine loses synchronism until the run ends.
Without --buses and --lines all buses are faulted. With --out each time is written as it is found;
Ctrl-C ends the work, and --resume goes on, after a kill too.

Examples: gridfold cct npcc --report map.html

          gridfold cct npcc --buses area:1 --lines "area:1 to area:2" --plot map.png

          gridfold cct grid.raw grid.dyr --buses "kv>=220" --out grid.cct --resume

Exit codes: 0 every place has a time; 2 bad input; 4 some places failed; 130 interrupted.
"""


@dataclass(frozen=True)
class PlaceOptions:
    """Where the faults are."""

    buses: Annotated[
        str | None,
        typer.Option(
            help="Faulted buses, such as 1-36, area:1, zone:2 or 'kv>=345'.",
            show_default="all, unless --lines",
        ),
    ] = None
    lines: Annotated[
        str | None,
        typer.Option(
            help="Lines, such as 3-2 or area:1, with a fault at either end that trips them."
        ),
    ] = None

    def faults(self, model: DetailedModel, study: frozenset[int] | None) -> list[Fault]:
        """Faults at buses that have a voltage, then at both ends of lines in service."""
        case, on = model.case, model.equations.islands.energized
        live = {bus.number for bus, alive in zip(case.buses, on, strict=True) if alive}
        faults: list[Fault] = []
        if self.buses is not None or self.lines is None:
            chosen = select_buses(self.buses or "all", case, "--buses", study)
            faults += [BusFault(bus) for bus in chosen if bus in live]
        if self.lines is not None:
            found = select_lines(self.lines, case, "--lines", study)
            faults += [
                BranchFault(case.branch_names[position], fraction=end)
                for position in sorted({line.position for line in found})
                if case.branches[position].in_service and case.branches[position].from_bus in live
                for end in (0.0, 1.0)
            ]
        if not faults:
            raise OptionError("no bus with a voltage and no line in service is chosen")
        return faults


@dataclass(frozen=True)
class MapOptions:
    """Where the clearing times are kept and drawn."""

    folder: Annotated[
        Path | None,
        output_option("--out", help="Folder in which each time is kept as it is found."),
    ] = None
    resume: ResumeOption = False
    report: Annotated[
        Path | None, output_option(help="Write the report: map, bars, table (.html).")
    ] = None
    plot: Annotated[
        Path | None, output_option(help="Draw the map and the shortest times (.png or .svg).")
    ] = None

    def __post_init__(self) -> None:
        if self.resume and self.folder is None:
            raise OptionError("--resume needs --out, the folder with the clearing times")
        if self.plot is not None:
            check_format(self.plot)
        for path in (self.report, self.plot):
            if path is not None:
                check_target(path)

    def write(self, times: ClearingTimes) -> None:
        """Write what was asked for."""
        if self.report is not None:
            times.report(self.report)
        if self.plot is not None:
            plot_clearing_times(times, self.plot)


def cct(
    source: CaseOptions,
    runs: RunOptions,
    choice: ModelChoice,
    places: PlaceOptions,
    resolution: Annotated[float, run_option(help="Grid of clearing times (s).")] = 0.01,
    longest: Annotated[float, run_option(help="Longest clearing time tried (s).")] = 2.0,
    jobs: JobsOption = None,
    *,
    kept: MapOptions,
    tables: TableOptions,
    json: JsonOption = None,
) -> None:
    """Critical clearing times of three-phase faults, of a few places or of the whole grid."""
    grid = source.build()
    faults = places.faults(grid, choice.external.area.known(grid.case, source.case))
    count = _RUNS_PER_FAULT * len(faults)
    method = choose_for_many(
        grid,
        [(fault,) for fault in faults],
        runs.method,
        runs.seconds,
        runs=count,
        t_end=runs.t_end,
        criterion=runs.criterion,
    )
    work = Work(count, round(runs.t_end / method.stepper.step))
    simulator = choice.build(grid, source.case, work, method.stepper)
    basis = basis_of(grid)
    with ExitStack() as stack:
        brake = stack.enter_context(brake_on_signals())
        bars = stack.enter_context(stage_bars())
        brake.working = True
        times = critical_clearing_times(
            grid,
            faults,
            jobs,
            bars.counter("clearing times", len(faults)),
            resolution=resolution,
            longest=longest,
            t_end=runs.t_end,
            stepper=method.stepper,
            criterion=runs.criterion,
            simulator=simulate if simulator.kind is ModelKind.DETAILED else simulator,
            out=kept.folder,
            resume=kept.resume,
            settings=_settings(simulator) | {"load_model": basis.loads.text},
            stop=brake.stop,
        )
    name = simulator.kind.value
    told = {"model": name, "model_reason": simulator.reason} | method.record() | basis.record()
    about = {"case": grid.case.name, "fingerprint": grid.case.fingerprint, **told}
    about["together"] = times.together
    tables.write(times.frame(), about)
    kept.write(times)
    write_json_option(json, about | {"clearing_times": times.rows})
    if speaks_to_people(json):
        out.print(clearing_table(times, _SHOWN))
        out.print(
            f"Synchronism is lost at {runs.criterion}; runs of {runs.t_end:g} s on the {name} model, "
            f"{times.together}."
        )
        say_basis(basis)
        say_method(method.reason)
        say_doubts(method.doubts)
        say_model(name, simulator.reason)
    raise typer.Exit(_ended(times, kept))


cct.__doc__ = _HELP


def _settings(simulator: Simulator) -> dict[str, Any]:
    """What of a model clearing times hang on, ready for JSON."""
    told: dict[str, Any] = {"model": simulator.kind.value}
    if simulator.used is not None:
        record = simulator.used.settings
        told["options"] = {key: record[key] for key in record if key not in _MEASURED}
    return told


def _ended(times: ClearingTimes, kept: MapOptions) -> ExitCode:
    """How the work ended; what is missing is told."""
    if times.waiting:
        total = len(times) + len(times.waiting)
        further = "; go on with --resume" if kept.folder is not None else "; --out would keep them"
        err.print(f"interrupted: {len(times)} of {total} are found{further}", style="yellow")
        return ExitCode.INTERRUPTED
    for item in times.failed[:6]:
        err.print(f"failed: {item.fault}: {item.reason}", style="yellow")
    return ExitCode.ROWS_FAILED if times.failed else ExitCode.COMPLETED
