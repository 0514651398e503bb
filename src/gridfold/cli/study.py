"""Commands about studies: init, run, show, report."""

from __future__ import annotations

import json
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from threading import Event
from typing import Annotated, Any, TextIO

import typer
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    SpinnerColumn,
    TextColumn,
    TimeRemainingColumn,
)
from rich.progress import Progress as Bars

from gridfold.cli.console import ExitCode, err, out, write_json_option
from gridfold.cli.options import JsonOption
from gridfold.cli.trusted import trusted_devices
from gridfold.errors import OptionError, OutputError
from gridfold.io.results import write_csv, write_parquet
from gridfold.io.study_store import StudyStore
from gridfold.report.study_report import write_report
from gridfold.report.study_tables import result_table, study_facts
from gridfold.report.tables import facts_table, shortened
from gridfold.study import Progress, Stage, Workers, run_study
from gridfold.study.study_file import json_schema, write_template

#: Exit code of a study that was interrupted and can be resumed, as of a shell after Ctrl-C.
_INTERRUPTED = 130

_worker_option = partial(typer.Option, rich_help_panel="Workers")
_output_option = partial(typer.Option, rich_help_panel="Output")

_RUN_HELP = """Run a study: every contingency, on all cores or a cluster.

Ctrl-C ends it with what was in flight written; --resume goes on, after a kill too.

Python files that a study names as devices run only with --trust-devices, or if the same files were
trusted before.

Examples:

  gridfold init && gridfold run study.toml && gridfold report study.results

  gridfold run study.toml --resume --workers processes --jobs 8

Exit codes: 0 every contingency has a result; 2 bad input; 130 interrupted.
"""

StudyFolder = Annotated[Path, typer.Argument(help="Folder of the results.")]


def init(
    file: Annotated[Path, typer.Argument(help="File to write.")] = Path("study.toml"),
    schema: Annotated[
        bool, typer.Option("--schema", help="Print the JSON Schema of study files instead.")
    ] = False,
) -> None:
    """Write a study file with a comment on every key."""
    if schema:
        sys.stdout.write(json.dumps(json_schema(), indent=2) + "\n")
        return
    write_template(file)
    out.print(f"{file} is written. Next: gridfold run {file}")


def run(
    study: Annotated[Path, typer.Argument(help="The study file.")],
    folder: Annotated[
        Path | None,
        _output_option("--out", help="Folder of the results.", show_default="STUDY.results"),
    ] = None,
    resume: Annotated[
        bool, _output_option("--resume", help="Go on with what the folder holds.")
    ] = False,
    trust_devices: Annotated[
        bool,
        typer.Option(
            "--trust-devices",
            help="Run the Python files that the study names as devices, and remember them.",
        ),
    ] = False,
    log_json: Annotated[
        str | None,
        _output_option(help="Write a line of JSON for each contingency to a file; - for stderr."),
    ] = None,
    workers: Annotated[Workers, _worker_option(help="What works.")] = Workers.THREADS,
    count: Annotated[
        int | None, _worker_option("--jobs", "-j", min=1, help="How many.", show_default="cores")
    ] = None,
    cluster: Annotated[
        str | None, _worker_option(help="A Dask cluster instead: local or tcp://HOST:PORT.")
    ] = None,
) -> None:
    """Run a study: every contingency, on all cores or a cluster."""
    trusted = trusted_devices(study, trust_devices)
    with ExitStack() as stack:
        brake = stack.enter_context(_brake())
        tell = [stack.enter_context(_bar())]
        if log_json is not None:
            tell.append(_logger(stack, log_json))

        def on_progress(progress: Progress) -> None:
            brake.working = progress.stage is Stage.RUNNING
            for line in shortened(progress.warnings, command="gridfold show FOLDER --json -"):
                err.print(f"warning: {line}", style="yellow")
            for each in tell:
                each(progress)

        outcome = run_study(
            study,
            folder,
            resume=resume,
            workers=workers,
            count=count,
            cluster=cluster,
            on_progress=on_progress,
            stop=brake.stop,
            trust_devices=trusted,
        )
    with StudyStore.read(outcome.folder) as store:
        out.print(facts_table(study_facts(store, outcome)))
        if outcome.complete:
            out.print(result_table(store.frame(sort="largest_separation_deg", descending=True), 10))
    if outcome.stage is Stage.INTERRUPTED:
        err.print(
            f"interrupted: {outcome.done} of {outcome.total} are done; go on with --resume",
            style="yellow",
        )
        raise typer.Exit(_INTERRUPTED)
    raise typer.Exit(ExitCode.COMPLETED)


run.__doc__ = _RUN_HELP


def show(
    folder: StudyFolder,
    sort: Annotated[
        str | None, typer.Option(help="Column to sort by.", show_default="number")
    ] = None,
    descending: Annotated[bool, typer.Option("--descending", help="The largest first.")] = False,
    where: Annotated[
        str | None,
        typer.Option(help="Condition in SQL, such as 'stable = 0 AND lowest_voltage < 0.8'."),
    ] = None,
    columns: Annotated[
        str, typer.Option(help="Columns of the table, by commas; all: every one.")
    ] = "",
    limit: Annotated[int, typer.Option(min=1, help="Rows of the table.")] = 40,
    csv: Annotated[Path | None, _output_option(help="Write all rows as CSV.")] = None,
    parquet: Annotated[Path | None, _output_option(help="Write all rows as Parquet.")] = None,
    json: JsonOption = None,
) -> None:
    """Show the results of a study, also while it runs.

    Example:

      gridfold show study.results --where "stable = 1" --sort lowest_voltage
    """
    with StudyStore.read(folder) as store:
        frame = store.frame(where, sort, descending)
        about = store.identity
        if json != "-":
            out.print(facts_table(study_facts(store)))
        chosen = [name.strip() for name in columns.split(",") if name.strip()]
        if unknown := [name for name in chosen if name not in (*store.columns, "all")]:
            known = ", ".join(store.columns)
            raise OptionError(f"there is no column {unknown[0]!r}; there are: {known}")
        wanted = list(store.columns) if chosen == ["all"] else chosen
    keys = ("gridfold", "sources", "case", "fingerprint", "files", "study", "settings")
    notes = {key: about[key] for key in keys if key in about}
    if csv is not None:
        write_csv(csv, frame, notes)
    if parquet is not None:
        write_parquet(parquet, frame, notes)
    if json is not None:
        rows = frame.astype(object).where(frame.notna(), None).to_dict("records")
        write_json_option(json, notes | {"results": rows})
    if json != "-":
        out.print(result_table(frame, limit, wanted))


def report(
    folder: StudyFolder,
    file: Annotated[
        Path | None, typer.Option("--out", help="The page.", show_default="FOLDER/report.html")
    ] = None,
) -> None:
    """Write the report of a study: one page that needs no network."""
    target = folder / "report.html" if file is None else file
    with StudyStore.read(folder) as store:
        write_report(store, target)
    out.print(f"{target} is written")


@contextmanager
def _bar() -> Iterator[Callable[[Progress], None]]:
    """A bar on standard error with counts, rate and time left; silent where that is no terminal."""
    columns = (
        SpinnerColumn(),
        TextColumn("{task.description}", markup=False),
        BarColumn(bar_width=24),
        MofNCompleteColumn(),
        TextColumn("{task.fields[counts]}"),
        TimeRemainingColumn(),
    )
    with Bars(*columns, console=err, transient=True, disable=not err.is_terminal) as bars:
        task = bars.add_task("preparing", total=None, counts="")

        def tell(progress: Progress) -> None:
            counts = f"{progress.stable} stable, {progress.unstable} unstable"
            if progress.failed:
                counts += f", {progress.failed} failed"
            if progress.per_second:
                counts += f", {progress.per_second:.2g} a second"
            preparing = progress.stage is Stage.PREPARING
            bars.update(
                task,
                description="off-line work" if preparing else "contingencies",
                total=progress.total or None,
                completed=progress.done,
                counts="" if preparing else counts,
            )

        yield tell


def _logger(stack: ExitStack, target: str) -> Callable[[Progress], None]:
    """Writes a line of JSON for each contingency, and one at the beginning and the end."""
    stream: TextIO
    if target == "-":
        stream = sys.stderr
    else:
        try:
            stream = Path(target).open("a", encoding="utf-8")  # noqa: SIM115
            stack.callback(stream.close)
        except OSError as error:
            raise OutputError(f"{target}: cannot be written: {error.strerror}") from None

    def tell(progress: Progress) -> None:
        record: dict[str, Any] = {
            "stage": progress.stage.value,
            "done": progress.done,
            "total": progress.total,
            "stable": progress.stable,
            "unstable": progress.unstable,
            "failed": progress.failed,
            "seconds": round(progress.seconds, 3),
        }
        if progress.message:
            record["message"] = progress.message
        if progress.latest is not None:
            latest = progress.latest
            record["contingency"] = {key: latest[key] for key in ("number", "name", "status")}
            record["contingency"]["reason"] = latest["reason"]
        stream.write(json.dumps(record) + "\n")
        stream.flush()

    return tell


@dataclass
class _Brake:
    """What Ctrl-C and a polite kill (SIGTERM) do: stop the study; at once where it is not working yet.

    A second one ends the process at once.
    """

    stop: Event = field(default_factory=Event)
    working: bool = False

    def pull(self, number: int, frame: object) -> None:
        """Handle a signal."""
        if self.stop.is_set() or not self.working:
            raise KeyboardInterrupt
        self.stop.set()


@contextmanager
def _brake() -> Iterator[_Brake]:
    brake, numbers = _Brake(), (signal.SIGINT, signal.SIGTERM)
    before = [signal.signal(number, brake.pull) for number in numbers]
    try:
        yield brake
    finally:
        for number, handler in zip(numbers, before, strict=True):
            signal.signal(number, handler)
