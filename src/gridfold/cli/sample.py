"""The command that makes data sets: sample."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Annotated

import typer

from gridfold.cli.brake import brake_on_signals
from gridfold.cli.console import count_bar, err, out
from gridfold.cli.exit_codes import ExitCode
from gridfold.cli.study import CountOption, ResumeOption, output_option, worker_option
from gridfold.cli.trusted import trusted_devices
from gridfold.report.tables import facts_table
from gridfold.sampling import SampleProgress, SampleRun, load_plan
from gridfold.sampling import sample as make_samples
from gridfold.study import Stage, Workers

_HELP = """Make a labelled data set of operating points and faults.

The plan says what is drawn: loads, generation, parameters, faults, clearing times. Each sample is a
row in Parquet files; a data card tells where they come from. Ctrl-C ends it with what is worked on
written; --resume goes on, after a kill too.

Examples:

  gridfold init --samples plan.toml && gridfold sample plan.toml

  gridfold sample plan.toml --resume --jobs 8

Exit codes: 0 every sample is there; 2 bad input; 4 some samples failed; 130 interrupted. Samples
without an operating point are rows of their own kind, and no failure.
"""


def sample(
    plan: Annotated[Path, typer.Argument(help="The plan.")],
    folder: Annotated[
        Path | None,
        output_option("--out", help="Folder of the data.", show_default="PLAN.samples"),
    ] = None,
    resume: ResumeOption = False,
    trust_devices: Annotated[
        bool,
        typer.Option(
            "--trust-devices",
            help="Run the Python files that the plan names as devices, and remember them.",
        ),
    ] = False,
    workers: Annotated[Workers, worker_option(help="What works.")] = Workers.PROCESSES,
    count: CountOption = None,
) -> None:
    """Make a labelled data set of operating points and faults."""
    trusted = trusted_devices(load_plan(plan).case.devices, plan.parent, trust_devices)
    with ExitStack() as stack:
        brake = stack.enter_context(brake_on_signals())
        bar = stack.enter_context(_bar())

        def on_progress(progress: SampleProgress) -> None:
            brake.working = progress.stage is Stage.RUNNING
            bar(progress)

        outcome = make_samples(
            plan,
            folder,
            resume=resume,
            workers=workers,
            count=count,
            on_progress=on_progress,
            stop=brake.stop,
            trust_devices=trusted,
        )
    out.print(facts_table(_facts(outcome)))
    if outcome.stage is Stage.INTERRUPTED:
        err.print(
            f"interrupted: {outcome.done:,} of {outcome.total:,} are done; go on with --resume",
            style="yellow",
        )
        raise typer.Exit(ExitCode.INTERRUPTED)
    raise typer.Exit(ExitCode.ROWS_FAILED if outcome.failed else ExitCode.COMPLETED)


sample.__doc__ = _HELP


def _facts(outcome: SampleRun) -> dict[str, str]:
    """What came out, as names and values."""
    made = f"{outcome.done:,} of {outcome.total:,} in {outcome.folder}"
    kinds = ("stable", "unstable", "infeasible", "failed")
    counts = ", ".join(f"{getattr(outcome, kind):,} {kind}" for kind in kinds)
    rate = f"{outcome.seconds:.1f} s, {outcome.per_second:.3g} samples a second, {outcome.workers}"
    return {"Samples": made, "Of these": counts, "Time": rate}


@contextmanager
def _bar() -> Iterator[Callable[[SampleProgress], None]]:
    """A bar with counts, rate and time left."""
    with count_bar("samples") as show:

        def tell(progress: SampleProgress) -> None:
            counts = f"{progress.stable} stable, {progress.unstable} unstable"
            if progress.infeasible:
                counts += f", {progress.infeasible} infeasible"
            if progress.failed:
                counts += f", {progress.failed} failed"
            if progress.per_second:
                counts += f", {progress.per_second:.3g} a second"
            show(progress.stage is Stage.PREPARING, progress.done, progress.total, counts)

        yield tell
