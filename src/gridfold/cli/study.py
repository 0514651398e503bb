"""Commands that make and run studies: init, run."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from typing import Annotated, Any, TextIO

import typer

from gridfold.cli.brake import brake_on_signals
from gridfold.cli.console import count_bar, err, out
from gridfold.cli.exit_codes import ExitCode
from gridfold.cli.options import DevicesOption
from gridfold.cli.trusted import trusted_devices
from gridfold.dynamics.cuda.precision import Precision
from gridfold.errors import OptionError, OutputError
from gridfold.io.study_store import StudyStore
from gridfold.report.result_tables import result_tables
from gridfold.report.study_tables import (
    count_line,
    failure_lines,
    study_counts,
    study_facts,
)
from gridfold.report.tables import facts_table, shortened
from gridfold.sampling.plan import plan_schema, write_plan
from gridfold.study import Progress, Stage, Workers, run_study
from gridfold.study.study_file import RunsOn, json_schema, load_study, write_template

#: Rows that are shown at the end of a run.
_ROWS = 10

output_option = partial(typer.Option, rich_help_panel="Output")
worker_option = partial(typer.Option, rich_help_panel="Workers")
ResumeOption = Annotated[bool, output_option("--resume", help="Go on with what the folder holds.")]
CountOption = Annotated[
    int | None, worker_option("--jobs", "-j", min=1, help="How many.", show_default="cores")
]

_RUN_HELP = """Run a study: every contingency, on all cores or a cluster.

Ctrl-C ends it with what was in flight written; --resume goes on, after a kill too.

Python files that a study names as devices run only with --trust-devices, or if the same files were
trusted before. A file of --devices may run, since you name it; it is part of the study from then on.

Examples:

  gridfold init && gridfold run study.toml && gridfold report study.results

  gridfold run study.toml --resume --workers processes --jobs 8

  gridfold run study.toml --retry-failed --time-limit 600

Exit codes: 0 every contingency has a result; 2 bad input; 4 some contingencies failed, see
--retry-failed; 130 interrupted.
"""

StudyFolder = Annotated[Path, typer.Argument(help="Folder of the results.")]


def init(
    file: Annotated[Path, typer.Argument(help="File to write.")] = Path("study.toml"),
    schema: Annotated[
        bool, typer.Option("--schema", help="Print the JSON Schema of such files instead.")
    ] = False,
    samples: Annotated[
        bool, typer.Option("--samples", help="A plan of gridfold sample instead of a study.")
    ] = False,
    devices: DevicesOption = None,
) -> None:
    """Write a study file, or a sample plan, with a comment on every key.

    Example: gridfold init winter.toml
    """
    if schema:
        wanted = plan_schema() if samples else json_schema()
        sys.stdout.write(json.dumps(wanted, indent=2) + "\n")
        return
    if samples:
        if devices:
            raise OptionError("--devices is for studies; a plan names them in [case]")
        write_plan(file)
    else:
        write_template(file, devices or ())
    out.print(f"{file} is written. Next: gridfold {'sample' if samples else 'run'} {file}")


def run(
    study: Annotated[Path, typer.Argument(help="The study file.")],
    folder: Annotated[
        Path | None,
        output_option("--out", help="Folder of the results.", show_default="STUDY.results"),
    ] = None,
    resume: ResumeOption = False,
    trust_devices: Annotated[
        bool,
        typer.Option(
            "--trust-devices",
            help="Run the Python files that the study names as devices, and remember them.",
        ),
    ] = False,
    devices: DevicesOption = None,
    retry_failed: Annotated[
        bool, output_option("--retry-failed", help="Go on, and try again what has failed.")
    ] = False,
    time_limit: Annotated[
        float | None,
        worker_option(
            help="Longest time on the machine for one contingency (s); it fails beyond.",
            show_default="that of the study",
        ),
    ] = None,
    device: Annotated[
        RunsOn | None,
        worker_option(
            help="What contingencies run on; auto: a GPU where one is found.",
            show_default="that of the study",
        ),
    ] = None,
    precision: Annotated[
        Precision | None,
        worker_option(
            help="Digits with which a GPU computes; the error of single is found and told.",
            show_default="that of the study",
        ),
    ] = None,
    log_json: Annotated[
        str | None,
        output_option(help="Write a line of JSON for each contingency to a file; - for stderr."),
    ] = None,
    workers: Annotated[Workers, worker_option(help="What works.")] = Workers.THREADS,
    count: CountOption = None,
    cluster: Annotated[
        str | None, worker_option(help="A Dask cluster instead: local or tcp://HOST:PORT.")
    ] = None,
) -> None:
    """Run a study: every contingency, on all cores or a cluster."""
    trusted = trusted_devices(load_study(study).case.devices, study.parent, trust_devices)
    with ExitStack() as stack:
        brake = stack.enter_context(brake_on_signals())
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
            retry_failed=retry_failed,
            time_limit=time_limit,
            device=device,
            precision=precision,
            workers=workers,
            count=count,
            cluster=cluster,
            on_progress=on_progress,
            stop=brake.stop,
            trust_devices=trusted,
            devices=devices or (),
        )
    with StudyStore.read(outcome.folder) as store:
        out.print(facts_table(study_facts(store, outcome)))
        frame = store.frame(sort="largest_separation_deg", descending=True)
        if outcome.complete:
            for table in result_tables(frame, _ROWS, out.width):
                out.print(table)
            out.print(count_line(len(frame), _ROWS, study_counts(store)))
    if outcome.stage is Stage.INTERRUPTED:
        err.print(
            f"interrupted: {outcome.done} of {outcome.total} are done; go on with --resume",
            style="yellow",
        )
        raise typer.Exit(ExitCode.INTERRUPTED)
    if outcome.failed:
        for line in failure_lines(frame, outcome.total):
            err.print(line, style="yellow")
        raise typer.Exit(ExitCode.ROWS_FAILED)
    raise typer.Exit(ExitCode.COMPLETED)


run.__doc__ = _RUN_HELP


@contextmanager
def _bar() -> Iterator[Callable[[Progress], None]]:
    """A bar with counts, rate and time left."""
    with count_bar("contingencies") as show:

        def tell(progress: Progress) -> None:
            counts = f"{progress.stable} stable, {progress.unstable} unstable"
            if progress.failed:
                counts += f", {progress.failed} failed"
            if progress.per_second:
                counts += f", {progress.per_second:.2g} a second"
            preparing = progress.stage is Stage.PREPARING
            show(preparing, progress.done, progress.total, counts)

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
